"""One planning session of a closed loop: from what SLAM knows to paths that the team agreed on.

The prior of planning is the whole SLAM graph, so robots that have seen the same landmarks are
correlated in it. Planned factors are motions, observations of mapped landmarks, and multi-robot
factors between future poses (section 7.2 of Regev and Indelman 2017).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.closed_loop.candidates import Leg
from fgplan.closed_loop.comparison import (
    EXECUTED,
    Candidates,
    Contestant,
    largest_difference,
    plan_as,
)
from fgplan.closed_loop.mission import LoopMission
from fgplan.closed_loop.records import (
    EvaluatorRecord,
    Pairs,
    SessionRecord,
    SlamRecord,
    Trigger,
)
from fgplan.evaluation.problem import PlanningProblem
from fgplan.factors.multi_robot import joined_pairs
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.planned_observations import planned_observations
from fgplan.planners.impacted_paths.planner import pose_covariances, report_counts
from fgplan.slam.team_slam import TeamSlam
from fgplan.team.agreement import Agreement
from fgplan.team.options import CoordinationOptions
from fgplan.typing import FloatArray
from roadmaps import Workspace


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateSet:
    """Where a robot goes next, and how it can.

    Attributes:
        goal: Place of the goal among the robot's goals, from 0.
        candidates: Candidate paths without observations; at least one.
        kept: How many of them, the first ones, were kept from the session before.
    """

    goal: int
    candidates: tuple[CandidatePath, ...]
    kept: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """What a session is held with.

    Attributes:
        number: From 1.
        step: Steps since the start.
        trigger: Why it is held.
        sets: Candidates of the robots that have a goal left; at least one robot.
        unreachable: By robot, why a goal was given up.
        obstacles: Polygons seen since the session before, each of shape (corners, 2).
        edges_removed: Edges of the roadmap that they cross.
    """

    number: int
    step: int
    trigger: Trigger
    sets: Mapping[str, CandidateSet]
    unreachable: Mapping[str, str] = field(default_factory=dict)
    obstacles: tuple[FloatArray, ...] = ()
    edges_removed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionOutcome:
    """What comes out of a session.

    Attributes:
        record: For the history.
        legs: The robots on their ways: candidates with observations, chosen paths.
        carried: By robot, what its evaluator takes to the next session.
    """

    record: SessionRecord
    legs: Mapping[str, Leg]
    carried: Mapping[str, Any]


def hold_session(
    mission: LoopMission,
    session: Session,
    slam: TeamSlam,
    belief: Belief,
    workspace: Workspace,
    carried: Mapping[str, Any],
    contestants: Mapping[str, Contestant],
    *,
    compare: bool = False,
) -> SessionOutcome:
    """Plan until the team agrees.

    Args:
        mission: What is given.
        session: Who goes where, over which candidates.
        slam: For keys and who has seen what.
        belief: The SLAM graph at the linearisation point of planning.
        workspace: Bounds and the obstacles known now.
        carried: By robot, what its evaluator took from the session before.
        contestants: Ways of planning; ``EXECUTED`` is among them, and its choice is executed.
        compare: Whether all values are compared with from scratch by QR.

    Returns:
        Record, legs with chosen paths, and what is carried on.
    """
    candidates = observed(mission, session.sets, slam, belief, workspace)
    problem = planning_problem(mission, slam, belief, candidates)
    # whoever has new candidates alone finds nothing of the old ones in them
    held = {robot: carried[robot] for robot in carried if robot in session.sets}
    held = {robot: item for robot, item in held.items() if session.sets[robot].kept}
    options = CoordinationOptions(session=session.number, without_path="stay")
    digest = belief.digest()
    runs: dict[str, EvaluatorRecord] = {}
    agreements: dict[str, Agreement] = {}
    for name, contestant in contestants.items():
        runs[name], agreements[name] = plan_as(
            contestant, problem, candidates, options, digest, held
        )
    executed = agreements[EXECUTED]
    difference = None
    if compare:
        difference = largest_difference(problem, candidates, executed.paths, held)
    carry = getattr(contestants[EXECUTED].evaluator, "carry", None)
    return SessionOutcome(
        record=_record(mission, session, slam, problem, candidates, executed, runs, difference),
        legs={
            robot: Leg(
                robot=robot,
                goal=each.goal,
                candidates=candidates[robot],
                chosen=executed.chosen[robot],
            )
            for robot, each in session.sets.items()
        },
        carried={}
        if carry is None
        else {
            robot: carry(memory)
            for robot, memory in executed.evaluator_states.items()
            if memory is not None
        },
    )


def planning_problem(
    mission: LoopMission, slam: TeamSlam, belief: Belief, candidates: Candidates
) -> PlanningProblem:
    """What every robot knows alike.

    Args:
        mission: What is given.
        slam: For the keys of the current poses.
        belief: The SLAM graph.
        candidates: Of every robot; the objective is of those that have some.

    Returns:
        The problem.
    """
    sensors: dict[str, AbstractSensor] = {
        name: mission.world.sensors[name] for robot in mission.robots for name in robot.sensors
    }
    return PlanningProblem(
        prior=belief,
        start_keys={robot.name: slam.key(robot.name) for robot in mission.robots},
        objective=mission.objective(tuple(robot for robot, paths in candidates.items() if paths)),
        multi_robot=mission.multi_robot,
        sensors=sensors,
        expected_landmarks=tuple(
            sorted(
                {
                    seen.landmark
                    for paths in candidates.values()
                    for path in paths
                    for seen in path.observations
                }
            )
        ),
    )


def observed(
    mission: LoopMission,
    sets: Mapping[str, CandidateSet],
    slam: TeamSlam,
    belief: Belief,
    workspace: Workspace,
) -> Candidates:
    """Candidates with the observations of mapped landmarks that they would make.

    Args:
        mission: Sensors, and whether landmarks that only others have mapped count.
        sets: Robots and their candidates.
        slam: Who has seen which landmark.
        belief: Where the landmarks are thought to be.
        workspace: What blocks the view.

    Returns:
        Candidates of every robot of the team; none for a robot without a goal.
    """
    landmarks, seen_by = belief.landmarks(), slam.seen_by()
    found: dict[str, tuple[CandidatePath, ...]] = {}
    for robot in mission.robots:
        each = sets.get(robot.name)
        if each is None:
            found[robot.name] = ()
            continue
        usable = {
            key: point
            for key, point in landmarks.items()
            if mission.others_landmarks or robot.name in seen_by.get(key, ())
        }
        seen = planned_observations(
            [path.poses for path in each.candidates],
            {name: mission.world.sensors[name] for name in robot.sensors},
            usable,
            workspace,
        )
        found[robot.name] = tuple(
            replace(path, observations=observations)
            for path, observations in zip(each.candidates, seen, strict=True)
        )
    return found


def slam_record(slam: TeamSlam, belief: Belief, step: int) -> SlamRecord:
    """The SLAM result with all marginal covariances.

    Args:
        slam: Trajectories and who has seen what.
        belief: Its graph, for the covariances.
        step: Steps since the start.

    Returns:
        The record.
    """
    marginals = belief.marginal_covariances()
    landmarks = slam.landmarks()
    return SlamRecord(
        step=step,
        trajectories={robot: slam.trajectory(robot) for robot in slam.robots},
        trajectory_steps={robot: slam.steps(robot) for robot in slam.robots},
        covariances={
            robot: np.array([marginals[key] for key in slam.keys(robot)]) for robot in slam.robots
        },
        landmarks=landmarks,
        landmark_covariances={key: marginals[key] for key in landmarks},
        seen_by={key: robots for key, robots in slam.seen_by().items() if key in landmarks},
    )


def joined_states(problem: PlanningProblem, paths: Mapping[str, CandidatePath]) -> Pairs:
    """Future states that multi-robot factors join when every path is followed."""
    robots = [robot for robot in problem.robots if robot in paths]
    pairs = []
    for model in problem.multi_robot:
        for place, robot in enumerate(robots):
            for other in robots[place + 1 :]:
                first, second = paths[robot].states(), paths[other].states()
                pairs += [(first[i], second[j]) for i, j in joined_pairs(model, first, second)]
    return tuple(pairs)


def _record(
    mission: LoopMission,
    session: Session,
    slam: TeamSlam,
    problem: PlanningProblem,
    candidates: Candidates,
    agreement: Agreement,
    runs: Mapping[str, EvaluatorRecord],
    difference: float | None,
) -> SessionRecord:
    """Everything that is kept of a session."""
    reports = [(r.robot, r.decision.report) for r in agreement.records if r.decision is not None]
    covariances: dict[str, FloatArray] = pose_covariances(problem, agreement.paths)
    joined = joined_states(problem, agreement.paths)
    counts = report_counts(agreement)
    counts["multi_robot_factors"] = len(joined)
    counts["landmark_factors"] = sum(len(path.observations) for path in agreement.paths.values())
    announcers = [item.robot for item in agreement.ledger.history if item.value is not None]
    if session.obstacles:
        counts["roadmap_edges_removed"] = session.edges_removed
    sets = session.sets
    return SessionRecord(
        session=session.number,
        step=session.step,
        time_s=session.step * mission.world.step_s,
        trigger=session.trigger,
        renewed=tuple(robot for robot, each in sets.items() if not each.kept),
        goals={robot: mission.goals[robot][each.goal] for robot, each in sets.items()},
        goal_numbers={robot: each.goal + 1 for robot, each in sets.items()},
        estimate=slam_record(slam, problem.prior, session.step),
        candidates={robot: candidates[robot] for robot in sets},
        chosen=dict(agreement.paths),
        chosen_index=dict(agreement.chosen),
        covariances={robot: covariances[robot] for robot in agreement.paths},
        joined=joined,
        values=agreement.values,
        announced_by=("all", *announcers),
        runs=runs,
        max_rel_diff=difference,
        counts=counts,
        segments_reused=_by_robot(session, reports, "segments_reused"),
        segments_rebuilt=_by_robot(session, reports, "segments_rebuilt"),
        candidates_kept={robot: each.kept for robot, each in sets.items()},
        candidates_replaced={
            robot: len(each.candidates) - each.kept for robot, each in sets.items()
        },
        unreachable=session.unreachable,
        obstacles=session.obstacles,
    )


def _by_robot(session: Session, reports: list[tuple[str, Any]], name: str) -> dict[str, int]:
    """Sum of one count of the reports by robot."""
    return {
        robot: sum(getattr(report, name) for who, report in reports if who == robot)
        for robot in session.sets
    }
