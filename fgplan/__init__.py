"""Belief-space planning for teams of robots.

Names are imported when they are first used, so that `import fgplan` is quick and pulls in nothing
that is not needed. Roadmaps and maps are in the package `roadmaps`.

A plan:

    import fgplan, numpy as np

    mission = fgplan.load_mission("examples/scenarios/two_robots.toml")
    planner = fgplan.find_planner("impacted_paths")
    plan = planner.plan(mission, np.random.default_rng(mission.seed))
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fgplan.announcement.announcement import Announcement as Announcement
    from fgplan.announcement.ledger import Ledger as Ledger
    from fgplan.beliefs.belief import Belief as Belief
    from fgplan.beliefs.candidate_belief import CandidateBelief as CandidateBelief
    from fgplan.beliefs.candidate_belief import candidate_belief as candidate_belief
    from fgplan.closed_loop.loop import run_loop as run_loop
    from fgplan.closed_loop.mission import LoopMission as LoopMission
    from fgplan.closed_loop.mission import LoopRobot as LoopRobot
    from fgplan.closed_loop.records import SessionRecord as SessionRecord
    from fgplan.closed_loop.records import SlamRecord as SlamRecord
    from fgplan.closed_loop.records import StepRecord as StepRecord
    from fgplan.errors import FgplanError as FgplanError
    from fgplan.errors import IllPosedBeliefError as IllPosedBeliefError
    from fgplan.errors import InvalidInputError as InvalidInputError
    from fgplan.errors import MissingExtraError as MissingExtraError
    from fgplan.errors import NoCandidatePathError as NoCandidatePathError
    from fgplan.errors import OptionError as OptionError
    from fgplan.errors import ScenarioError as ScenarioError
    from fgplan.errors import StaleAnnouncementError as StaleAnnouncementError
    from fgplan.errors import UnknownNameError as UnknownNameError
    from fgplan.evaluation.as_published import AsPublished as AsPublished
    from fgplan.evaluation.evaluations import AbstractEvaluator as AbstractEvaluator
    from fgplan.evaluation.evaluations import Evaluations as Evaluations
    from fgplan.evaluation.evaluations import ReevaluationReport as ReevaluationReport
    from fgplan.evaluation.from_scratch import FromScratch as FromScratch
    from fgplan.evaluation.incremental.evaluator import Incremental as Incremental
    from fgplan.evaluation.isam2 import Isam2 as Isam2
    from fgplan.evaluation.objective import Objective as Objective
    from fgplan.evaluation.objective import PathLengthTerm as PathLengthTerm
    from fgplan.evaluation.objective import PathTerm as PathTerm
    from fgplan.evaluation.objective import PosesOf as PosesOf
    from fgplan.evaluation.objective import PriorVariables as PriorVariables
    from fgplan.evaluation.objective import Trajectory as Trajectory
    from fgplan.evaluation.objective import TravelTimeTerm as TravelTimeTerm
    from fgplan.evaluation.objective import UncertaintyTerm as UncertaintyTerm
    from fgplan.evaluation.objective import length_and_uncertainty as length_and_uncertainty
    from fgplan.evaluation.problem import PastState as PastState
    from fgplan.evaluation.problem import PlanningProblem as PlanningProblem
    from fgplan.evaluation.registry import find_evaluator as find_evaluator
    from fgplan.factors.keys import describe_key as describe_key
    from fgplan.factors.keys import symbol_key as symbol_key
    from fgplan.io.g2o import G2oGraph as G2oGraph
    from fgplan.io.g2o import read_g2o as read_g2o
    from fgplan.io.g2o import write_g2o as write_g2o
    from fgplan.io.loop_folder import run_in_folder as run_in_folder
    from fgplan.io.loop_mission import load_loop_mission as load_loop_mission
    from fgplan.io.mission_file import load_mission as load_mission
    from fgplan.io.mrclam import read_mrclam as read_mrclam
    from fgplan.io.pyfg import read_pyfg as read_pyfg
    from fgplan.io.pyfg import write_pyfg as write_pyfg
    from fgplan.io.result_file import read_result as read_result
    from fgplan.io.result_file import write_result as write_result
    from fgplan.io.tum import read_tum as read_tum
    from fgplan.io.tum import write_tum as write_tum
    from fgplan.models.measurement import Measurement as Measurement
    from fgplan.models.measurement import Odometry as Odometry
    from fgplan.models.motion import MotionModel as MotionModel
    from fgplan.models.pose import compose as compose
    from fgplan.models.pose import position as position
    from fgplan.models.pose import rotation_matrix as rotation_matrix
    from fgplan.models.range_bearing import BearingRangeSensor as BearingRangeSensor
    from fgplan.models.range_bearing import BearingSensor as BearingSensor
    from fgplan.models.range_bearing import RangeSensor as RangeSensor
    from fgplan.models.relative_pose import RelativePoseSensor as RelativePoseSensor
    from fgplan.models.sensor import AbstractSensor as AbstractSensor
    from fgplan.models.sensor_check import check_sensor as check_sensor
    from fgplan.models.uncertainty import UncertaintyFunction as UncertaintyFunction
    from fgplan.models.uncertainty import register_uncertainty as register_uncertainty
    from fgplan.models.uncertainty import uncertainty_function as uncertainty_function
    from fgplan.paths.candidate_path import CandidatePath as CandidatePath
    from fgplan.paths.candidate_path import Observation as Observation
    from fgplan.paths.multi_robot import Criterion as Criterion
    from fgplan.paths.multi_robot import DistanceCriterion as DistanceCriterion
    from fgplan.paths.multi_robot import MultiRobotModel as MultiRobotModel
    from fgplan.paths.path_making import make_candidate_paths as make_candidate_paths
    from fgplan.paths.state import State as State
    from fgplan.planners.impacted_paths.candidates import CandidateSets as CandidateSets
    from fgplan.planners.impacted_paths.candidates import candidate_sets as candidate_sets
    from fgplan.planners.impacted_paths.options import CandidateOptions as CandidateOptions
    from fgplan.planners.impacted_paths.options import read_options as read_options
    from fgplan.planners.impacted_paths.planner import pose_covariances as pose_covariances
    from fgplan.planners.impacted_paths.planner import robot_plans as robot_plans
    from fgplan.planners.mission import Mission as Mission
    from fgplan.planners.mission import MissionRobot as MissionRobot
    from fgplan.planners.mission import MissionTarget as MissionTarget
    from fgplan.planners.plan import ObjectiveValue as ObjectiveValue
    from fgplan.planners.plan import Plan as Plan
    from fgplan.planners.plan import RobotPlan as RobotPlan
    from fgplan.planners.planner import AbstractPlanner as AbstractPlanner
    from fgplan.planners.registry import find_planner as find_planner
    from fgplan.planners.registry import register_planner as register_planner
    from fgplan.simulation.simulate import simulate as simulate
    from fgplan.simulation.sweep import SweepTask as SweepTask
    from fgplan.simulation.sweep import run_sweep as run_sweep
    from fgplan.simulation.world import World as World
    from fgplan.simulation.world import WorldRobot as WorldRobot
    from fgplan.slam.team_slam import SlamOptions as SlamOptions
    from fgplan.slam.team_slam import SlamStart as SlamStart
    from fgplan.slam.team_slam import TeamSlam as TeamSlam
    from fgplan.team.agreement import Agreement as Agreement
    from fgplan.team.coordination import coordinate as coordinate
    from fgplan.team.in_process import InProcessTransport as InProcessTransport
    from fgplan.team.in_process import NetworkFaults as NetworkFaults
    from fgplan.team.options import CoordinationOptions as CoordinationOptions
    from fgplan.team.transport import Transport as Transport

MODULE_OF = {
    "AbstractEvaluator": "fgplan.evaluation.evaluations",
    "AbstractPlanner": "fgplan.planners.planner",
    "AbstractSensor": "fgplan.models.sensor",
    "Agreement": "fgplan.team.agreement",
    "Announcement": "fgplan.announcement.announcement",
    "AsPublished": "fgplan.evaluation.as_published",
    "BearingRangeSensor": "fgplan.models.range_bearing",
    "BearingSensor": "fgplan.models.range_bearing",
    "Belief": "fgplan.beliefs.belief",
    "CandidateBelief": "fgplan.beliefs.candidate_belief",
    "CandidateOptions": "fgplan.planners.impacted_paths.options",
    "CandidatePath": "fgplan.paths.candidate_path",
    "CandidateSets": "fgplan.planners.impacted_paths.candidates",
    "CoordinationOptions": "fgplan.team.options",
    "Criterion": "fgplan.paths.multi_robot",
    "DistanceCriterion": "fgplan.paths.multi_robot",
    "Evaluations": "fgplan.evaluation.evaluations",
    "FgplanError": "fgplan.errors",
    "FromScratch": "fgplan.evaluation.from_scratch",
    "G2oGraph": "fgplan.io.g2o",
    "IllPosedBeliefError": "fgplan.errors",
    "InProcessTransport": "fgplan.team.in_process",
    "Incremental": "fgplan.evaluation.incremental.evaluator",
    "InvalidInputError": "fgplan.errors",
    "Isam2": "fgplan.evaluation.isam2",
    "Ledger": "fgplan.announcement.ledger",
    "LoopMission": "fgplan.closed_loop.mission",
    "LoopRobot": "fgplan.closed_loop.mission",
    "Measurement": "fgplan.models.measurement",
    "MissingExtraError": "fgplan.errors",
    "Mission": "fgplan.planners.mission",
    "MissionRobot": "fgplan.planners.mission",
    "MissionTarget": "fgplan.planners.mission",
    "MotionModel": "fgplan.models.motion",
    "MultiRobotModel": "fgplan.paths.multi_robot",
    "NetworkFaults": "fgplan.team.in_process",
    "NoCandidatePathError": "fgplan.errors",
    "Objective": "fgplan.evaluation.objective",
    "ObjectiveValue": "fgplan.planners.plan",
    "Observation": "fgplan.paths.candidate_path",
    "Odometry": "fgplan.models.measurement",
    "OptionError": "fgplan.errors",
    "PastState": "fgplan.evaluation.problem",
    "PathLengthTerm": "fgplan.evaluation.objective",
    "PathTerm": "fgplan.evaluation.objective",
    "Plan": "fgplan.planners.plan",
    "PlanningProblem": "fgplan.evaluation.problem",
    "PosesOf": "fgplan.evaluation.objective",
    "PriorVariables": "fgplan.evaluation.objective",
    "RangeSensor": "fgplan.models.range_bearing",
    "ReevaluationReport": "fgplan.evaluation.evaluations",
    "RelativePoseSensor": "fgplan.models.relative_pose",
    "RobotPlan": "fgplan.planners.plan",
    "ScenarioError": "fgplan.errors",
    "SessionRecord": "fgplan.closed_loop.records",
    "SlamOptions": "fgplan.slam.team_slam",
    "SlamRecord": "fgplan.closed_loop.records",
    "SlamStart": "fgplan.slam.team_slam",
    "StaleAnnouncementError": "fgplan.errors",
    "State": "fgplan.paths.state",
    "StepRecord": "fgplan.closed_loop.records",
    "SweepTask": "fgplan.simulation.sweep",
    "TeamSlam": "fgplan.slam.team_slam",
    "Trajectory": "fgplan.evaluation.objective",
    "Transport": "fgplan.team.transport",
    "TravelTimeTerm": "fgplan.evaluation.objective",
    "UncertaintyFunction": "fgplan.models.uncertainty",
    "UncertaintyTerm": "fgplan.evaluation.objective",
    "UnknownNameError": "fgplan.errors",
    "World": "fgplan.simulation.world",
    "WorldRobot": "fgplan.simulation.world",
    "candidate_belief": "fgplan.beliefs.candidate_belief",
    "candidate_sets": "fgplan.planners.impacted_paths.candidates",
    "check_sensor": "fgplan.models.sensor_check",
    "compose": "fgplan.models.pose",
    "coordinate": "fgplan.team.coordination",
    "describe_key": "fgplan.factors.keys",
    "find_evaluator": "fgplan.evaluation.registry",
    "find_planner": "fgplan.planners.registry",
    "length_and_uncertainty": "fgplan.evaluation.objective",
    "load_loop_mission": "fgplan.io.loop_mission",
    "load_mission": "fgplan.io.mission_file",
    "make_candidate_paths": "fgplan.paths.path_making",
    "pose_covariances": "fgplan.planners.impacted_paths.planner",
    "position": "fgplan.models.pose",
    "read_g2o": "fgplan.io.g2o",
    "read_mrclam": "fgplan.io.mrclam",
    "read_options": "fgplan.planners.impacted_paths.options",
    "read_pyfg": "fgplan.io.pyfg",
    "read_result": "fgplan.io.result_file",
    "read_tum": "fgplan.io.tum",
    "register_planner": "fgplan.planners.registry",
    "register_uncertainty": "fgplan.models.uncertainty",
    "robot_plans": "fgplan.planners.impacted_paths.planner",
    "rotation_matrix": "fgplan.models.pose",
    "run_in_folder": "fgplan.io.loop_folder",
    "run_loop": "fgplan.closed_loop.loop",
    "run_sweep": "fgplan.simulation.sweep",
    "simulate": "fgplan.simulation.simulate",
    "symbol_key": "fgplan.factors.keys",
    "uncertainty_function": "fgplan.models.uncertainty",
    "write_g2o": "fgplan.io.g2o",
    "write_pyfg": "fgplan.io.pyfg",
    "write_result": "fgplan.io.result_file",
    "write_tum": "fgplan.io.tum",
}
"""Module of each public name."""

__all__ = sorted(MODULE_OF)


def __getattr__(name: str) -> object:
    """Import a public name when it is first used."""
    if name not in MODULE_OF:
        raise AttributeError(f"module 'fgplan' has no attribute {name!r}")
    value = getattr(importlib.import_module(MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, for completion."""
    return [*globals(), *__all__]
