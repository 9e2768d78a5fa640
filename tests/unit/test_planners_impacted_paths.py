"""From a mission to a plan: candidates, agreement, covariances."""

import itertools
import json

import gtsam
import numpy as np
import pytest

from fgplan.beliefs.belief import Belief
from fgplan.errors import (
    InvalidInputError,
    NoCandidatePathError,
    OptionError,
    UnknownNameError,
)
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.evaluation.registry import find_evaluator
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.planners.exhaustive.planner import ExhaustivePlanner
from fgplan.planners.impacted_paths.candidates import candidate_sets
from fgplan.planners.impacted_paths.options import CandidateOptions, ImpactedPathsOptions
from fgplan.planners.impacted_paths.planner import ImpactedPathsPlanner
from fgplan.planners.mission import Mission, MissionRobot
from fgplan.planners.plan import plan_of
from fgplan.planners.planner import AbstractPlanner
from fgplan.planners.registry import PLANNERS, find_planner, register_planner
from fgplan.team.coordination import coordinate
from fgplan.team.in_process import InProcessTransport, NetworkFaults, Partition
from fgplan.team.options import CoordinationOptions
from roadmaps import Workspace

WALL = [(9.0, 0.0), (11.0, 0.0), (11.0, 6.0), (9.0, 6.0)]
SENSOR = BearingRangeSensor(bearing_sigma_rad=0.05, range_sigma_m=0.2, max_range_m=6.0)
OPTIONS = {"candidates": 4, "vertices": 60, "spacing_m": 3.0, "evaluator": "from_scratch"}


def make_mission(goals=None, options=None, sensors=("camera",), **changes):
    """Three robots and two landmarks in a hall with a wall."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    starts = [(2.0, 2.0, 0.3), (2.0, 10.0, 0.0), (18.0, 2.0, 3.0)]
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.2, 0.2, 0.05]))
    for key, start in enumerate(starts):
        graph.add(gtsam.PriorFactorPose2(key, gtsam.Pose2(*start), noise))
        values.insert(key, gtsam.Pose2(*start))
    for key, point in ((100, (8.5, 4.0)), (101, (13.0, 9.0))):
        isotropic = gtsam.noiseModel.Isotropic.Sigma(2, 0.1)
        graph.add(gtsam.PriorFactorPoint2(key, np.array(point), isotropic))
        values.insert(key, np.array(point))
    goals = goals or [[(18.0, 10.0)], [(18.0, 3.0)], [(2.0, 6.0)]]
    motion = MotionModel(
        sigmas=np.array([0.05, 0.05, 0.01]),
        per_metre=np.array([0.05, 0.05, 0.01]),
        speed_m_per_s=2.0,
    )
    robots = tuple(
        MissionRobot(
            name=f"r{place}", start_key=place, goals=np.array(goal), motion=motion, sensors=sensors
        )
        for place, goal in enumerate(goals)
    )
    names = [robot.name for robot in robots]
    given = {
        "name": "hall",
        "workspace": Workspace(lower=[0, 0], upper=[20, 12], obstacles=[WALL]),
        "robots": robots,
        "prior": Belief(graph, values),
        "objective": length_and_uncertainty(names),
        "sensors": {"camera": SENSOR},
        "multi_robot": (
            MultiRobotModel(
                criterion=DistanceCriterion(4.0),
                sensor=RelativePoseSensor(covariance=np.diag([0.1, 0.1, 0.01])),
            ),
        ),
        "options": OPTIONS if options is None else options,
        "digest": "abc",
        "seed": 5,
    }
    return Mission(**{**given, **changes})


def plan_with(mission, planner=None, seed=5):
    return (planner or ImpactedPathsPlanner()).plan(mission, np.random.default_rng(seed))


def test_plan_leads_every_robot_to_its_goal_and_says_what_it_cost():
    heard = []
    mission = make_mission()
    plan = ImpactedPathsPlanner().plan(
        mission, np.random.default_rng(5), lambda done, total, doing: heard.append(doing)
    )
    assert plan.agreed
    assert [robot.robot for robot in plan.robots] == ["r0", "r1", "r2"]
    for robot, wanted in zip(plan.robots, mission.robots, strict=True):
        assert robot.poses[-1, :2] == pytest.approx(wanted.goals[-1], abs=1e-12)
        assert robot.poses[0] == pytest.approx(mission.prior.pose(wanted.start_key), abs=0)
        assert robot.covariances.shape == (len(robot.poses), 3, 3)
        assert robot.covariances[0] == pytest.approx(robot.covariances[0].T, abs=1e-12)
        assert robot.candidates == 4
    values = [item.value for item in plan.objective]
    assert all(b < a for a, b in itertools.pairwise(values))
    assert plan.objective[0].robot == ""
    # The objective again from the plan's own lengths and covariances (41).
    again = sum(
        0.1 * robot.path.length_m + np.trace(robot.covariances[-1][:2, :2]) for robot in plan.robots
    )
    assert plan.value == pytest.approx(again, rel=1e-9)
    assert plan.report["evaluations"] > 0
    assert plan.traffic["announcement"]["sent"] == 3 + plan.report["announcements"]
    assert {"candidates", "start", "evaluation", "coordination", "covariances"} <= set(plan.seconds)
    assert {"candidate paths", "turns"} <= set(heard)
    assert plan.scenario_digest == "abc"


@pytest.mark.parametrize("evaluator", ["incremental", "isam2"])
def test_evaluators_agree_on_the_plan(evaluator):
    expected = plan_with(make_mission())
    plan = plan_with(make_mission(options={**OPTIONS, "evaluator": evaluator}))
    assert [robot.candidate for robot in plan.robots] == [r.candidate for r in expected.robots]
    assert [item.value for item in plan.objective] == pytest.approx(
        [item.value for item in expected.objective], rel=1e-9
    )


def test_same_seed_same_plan_and_another_seed_another_roadmap():
    first, second, third = (plan_with(make_mission(), seed=seed) for seed in (1, 1, 2))
    plain = [plan.to_data() for plan in (first, second, third)]
    for data in plain:
        data["seconds"] = {}
        for turn in data["details"]["turns"]:
            turn.pop("seconds", None)
    assert plain[0] == plain[1]
    assert plain[0]["robots"] != plain[2]["robots"]


def test_plan_is_plain_data_and_reads_back():
    plan = plan_with(make_mission())
    text = json.dumps(plan.to_data(), allow_nan=False)
    back = plan_of(json.loads(text))
    assert back.to_data() == plan.to_data()
    assert back.value == plan.value
    assert back.paths["r1"].poses.tobytes() == plan.paths["r1"].poses.tobytes()
    with pytest.raises(InvalidInputError, match="schema"):
        plan_of({**plan.to_data(), "schema": "plan.v0"})
    broken = plan.to_data()
    del broken["robots"]
    with pytest.raises(InvalidInputError, match="robots"):
        plan_of(broken)


@pytest.mark.parametrize("kind", ["prm", "rrg"])
def test_candidates_are_free_timed_and_distinct(kind):
    goals = [[(18.0, 10.0), (18.0, 3.0)], [(18.0, 3.0)], [(2.0, 6.0)]]
    mission = make_mission(goals=goals)
    options = ImpactedPathsOptions(candidates=4, vertices=150, roadmap=kind, spacing_m=2.0)
    sets = candidate_sets(mission, options, np.random.default_rng(0))
    for robot, paths in sets.candidates.items():
        assert 1 <= len(paths) <= 4
        lengths = [path.length_m for path in paths]
        assert lengths == sorted(lengths)
        assert len({path.poses.tobytes() for path in paths}) == len(paths)
        for path in paths:
            sets.problem.check_path(path)
            ways = np.linalg.norm(np.diff(path.poses[:, :2], axis=0), axis=1)
            assert ways.max() <= 2.0 + 1e-9
            assert path.length_m == pytest.approx(ways.sum(), rel=1e-9)
            assert path.times_s[-1] == pytest.approx(ways.sum() / 2.0, rel=1e-9)
            free = mission.workspace.are_motions_valid(path.poses[:-1, :2], path.poses[1:, :2])
            assert free.all()
            directions = np.diff(path.poses[:, :2], axis=0)
            angles = np.arctan2(directions[:, 1], directions[:, 0])
            assert path.poses[1:, 2] == pytest.approx(angles, abs=1e-12)
            graph = sets.roadmaps["" if kind == "prm" else robot]
            for pose, vertex in zip(path.poses, path.vertices, strict=True):
                if vertex >= 0:
                    assert (graph.nodes[vertex]["position"] == pose[:2]).all()
            assert path.vertices[0] >= 0
            assert path.vertices[-1] >= 0
    for path in sets.candidates["r0"]:
        first = np.linalg.norm(path.poses[:, :2] - goals[0][0], axis=1)
        assert first.min() == 0.0  # over the first goal to the second


def test_observations_are_exactly_those_that_the_sensor_and_the_wall_allow():
    mission = make_mission()
    options = ImpactedPathsOptions(candidates=4, vertices=60, spacing_m=1.0)
    sets = candidate_sets(mission, options, np.random.default_rng(0))
    points = {key: mission.prior.point(key) for key in (100, 101)}
    found = blocked = 0
    for paths in sets.candidates.values():
        for path in paths:
            wanted = set()
            for step in range(1, path.steps + 1):
                for key, point in points.items():
                    pose = path.poses[step]
                    if not SENSOR.visible(pose, point):
                        continue
                    if mission.workspace.has_line_of_sight(pose[:2], point)[0]:
                        wanted.add((step, key))
                    else:
                        blocked += 1
            assert {(seen.step, seen.landmark) for seen in path.observations} == wanted
            found += len(wanted)
            for seen in path.observations:
                noise = SENSOR.noise(path.poses[seen.step], points[seen.landmark])
                assert seen.covariance == pytest.approx(noise, abs=0)
    assert found > 0
    assert blocked > 0


def test_robot_without_sensors_plans_no_observation():
    mission = make_mission(sensors=())
    options = ImpactedPathsOptions(candidates=2, vertices=60)
    paths = candidate_sets(mission, options, np.random.default_rng(0)).candidates["r0"]
    assert all(path.observations == () for path in paths)


def test_candidate_sets_read_the_mission_where_nothing_is_given():
    mission = make_mission()
    options = CandidateOptions(candidates=4, vertices=60, spacing_m=3.0)
    expected = candidate_sets(mission, options, np.random.default_rng(mission.seed))
    found = candidate_sets(mission)  # OPTIONS names an evaluator too, which is not its business
    for robot, paths in expected.candidates.items():
        assert len(found.candidates[robot]) == len(paths)
        for have, want in zip(found.candidates[robot], paths, strict=True):
            assert have.poses.tobytes() == want.poses.tobytes()
            assert len(have.observations) == len(want.observations)
    with pytest.raises(OptionError, match="planner option candidates"):
        candidate_sets(make_mission(options={"candidates": 0}))


def test_robots_in_space_stay_level_at_their_height():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    start = gtsam.Pose3(gtsam.Rot3.Yaw(0.4), np.array([2.0, 2.0, 5.0]))
    graph.add(gtsam.PriorFactorPose3(0, start, gtsam.noiseModel.Isotropic.Sigma(6, 0.1)))
    values.insert(0, start)
    robot = MissionRobot(
        name="drone",
        start_key=0,
        goals=np.array([[18.0, 10.0, 5.0]]),
        motion=MotionModel(sigmas=np.full(6, 0.1)),
    )
    mission = Mission(
        name="flight",
        workspace=Workspace(lower=[0, 0], upper=[20, 12], obstacles=[WALL]),
        robots=(robot,),
        prior=Belief(graph, values),
        objective=length_and_uncertainty(["drone"]),
        options={"candidates": 3, "vertices": 60, "evaluator": "from_scratch"},
    )
    plan = plan_with(mission)
    poses = plan.robots[0].poses
    assert poses.shape[1:] == (4, 4)
    assert (poses[:, 2, 3] == 5.0).all()
    rotations = poses[:, :3, :3]
    assert rotations @ np.swapaxes(rotations, 1, 2) == pytest.approx(
        np.tile(np.eye(3), (len(poses), 1, 1)), abs=1e-12
    )
    ahead = np.diff(poses[:, :3, 3], axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    assert rotations[1:, :, 0] == pytest.approx(ahead, abs=1e-12)
    assert plan.robots[0].covariances.shape == (len(poses), 6, 6)


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ((10.0, 3.0), r"robot 'r1'.*goal 1 at .* touches an obstacle"),
        ((25.0, 3.0), r"robot 'r1'.*goal 1 at .* outside the bounds"),
    ],
)
def test_unreachable_goal_names_the_robot_or_it_stays(goal, words):
    goals = [[(18.0, 10.0)], [goal], [(2.0, 6.0)]]
    with pytest.raises(NoCandidatePathError, match=words):
        plan_with(make_mission(goals=goals))
    mission = make_mission(goals=goals, options={**OPTIONS, "without_path": "stay"})
    plan = plan_with(mission)
    assert plan.agreed
    assert set(plan.paths) == {"r0", "r2"}
    assert plan.robots[1].path is None
    assert plan.robots[1].covariances.shape == (1, 3, 3)
    assert any("robot 'r1' stays" in text for text in plan.warnings)
    assert plan_of(plan.to_data()).robots[1].path is None


def test_goal_behind_a_closed_wall_is_unreachable():
    closed = [(9.0, 0.0), (11.0, 0.0), (11.0, 12.0), (9.0, 12.0)]
    workspace = Workspace(lower=[0, 0], upper=[20, 12], obstacles=[closed])
    for kind in ("prm", "rrg"):
        options = {**OPTIONS, "roadmap": kind}
        with pytest.raises(NoCandidatePathError, match="robot 'r0': expected at least one"):
            plan_with(make_mission(workspace=workspace, options=options))
    options = {**OPTIONS, "max_length_m": 3.0}
    with pytest.raises(NoCandidatePathError, match="longer than max_length_m"):
        plan_with(make_mission(options=options))


def test_robot_without_goal_and_unknown_sensor_are_named():
    mission = make_mission()
    parked = MissionRobot(
        name="r0", start_key=0, goals=np.zeros((0, 2)), motion=mission.robots[0].motion
    )
    robots = (parked, *mission.robots[1:])
    with pytest.raises(NoCandidatePathError, match=r"robot 'r0'.*it has no goal"):
        plan_with(make_mission(robots=robots))
    with pytest.raises(UnknownNameError, match="robot 'r0': sensor 'sonar' is not one of: camera"):
        plan_with(make_mission(sensors=("sonar",)))
    with pytest.raises(InvalidInputError, match="at least one robot"):
        plan_with(make_mission(robots=()))


def test_options_are_refused_by_name():
    for options, error, words in (
        ({"candiates": 3}, UnknownNameError, r"option 'candiates'.*expected one of candidates"),
        ({"candidates": 0}, InvalidInputError, "planner option candidates"),
        ({"roadmap": "grid"}, InvalidInputError, "planner option roadmap: expected one of prm"),
        ({"paths": "best"}, InvalidInputError, "planner option paths"),
        ({"order": "other"}, InvalidInputError, "planner option order"),
        ({"spacing_m": -1.0}, InvalidInputError, "planner option spacing_m"),
        ({"choose": "yes"}, InvalidInputError, "planner option choose"),
        ({"evaluator": "magic"}, UnknownNameError, r"evaluator 'magic': expected one of as_pub"),
        ({"evaluator": "json:dumps"}, InvalidInputError, "evaluator 'json:dumps': expected an"),
    ):
        with pytest.raises(error, match=words):
            plan_with(make_mission(options=options))


def test_every_registered_evaluator_exists():
    for name in ("incremental", "from_scratch", "isam2", "as_published"):
        assert find_evaluator(name).name == name


def test_exhaustive_finds_the_optimum_and_the_gap():
    options = {**OPTIONS, "candidates": 3}
    plan = plan_with(make_mission(options=options), ExhaustivePlanner())
    agreed = plan_with(make_mission(options=options))
    assert plan.details["combinations"] == 27
    assert plan.report["evaluations"] == 9
    assert plan.details["agreed"] == pytest.approx(agreed.value, rel=1e-9)
    assert plan.value == plan.details["optimum"] <= agreed.value * (1 + 1e-9)
    gap = (agreed.value - plan.value) / abs(plan.value)
    assert plan.details["gap"] == pytest.approx(gap, abs=1e-9)
    again = sum(
        0.1 * robot.path.length_m + np.trace(robot.covariances[-1][:2, :2]) for robot in plan.robots
    )
    assert plan.value == pytest.approx(again, rel=1e-9)
    assert plan_of(plan.to_data()).to_data() == plan.to_data()


def test_exhaustive_refuses_too_many_combinations():
    options = {**OPTIONS, "combinations": 20}
    with pytest.raises(InvalidInputError, match=r"at most 20 combinations, got 4 x 4 x 4 = 64"):
        plan_with(make_mission(options=options), ExhaustivePlanner())
    for wrong in ({"combinations": 0}, {"compare": 1}):
        with pytest.raises(InvalidInputError, match=f"planner option {next(iter(wrong))}"):
            plan_with(make_mission(options={**OPTIONS, **wrong}), ExhaustivePlanner())


def test_registry_finds_planners_by_name_and_by_module(monkeypatch):
    for name in ("impacted_paths", "exhaustive"):
        planner = find_planner(name)
        assert planner.name == name
        assert isinstance(planner, AbstractPlanner)
    own = find_planner("fgplan.planners.impacted_paths.planner:ImpactedPathsPlanner")
    assert own.name == "impacted_paths"
    monkeypatch.setattr("fgplan.planners.registry.PLANNERS", dict(PLANNERS))
    register_planner("mine", "fgplan.planners.exhaustive.planner:ExhaustivePlanner")
    assert find_planner("mine").name == "exhaustive"
    with pytest.raises(InvalidInputError, match="the name is taken"):
        register_planner("mine", "a:b")
    with pytest.raises(InvalidInputError, match="expected 'module:object'"):
        register_planner("other", "a.b")
    with pytest.raises(UnknownNameError, match=r"one of aia.*impacted_paths, intermittent, mine"):
        find_planner("nobody")
    with pytest.raises(UnknownNameError, match="cannot import"):
        find_planner("no_such_module:Planner")
    with pytest.raises(UnknownNameError, match="cannot import"):
        find_planner("json:Planner")
    with pytest.raises(InvalidInputError, match="planner 'json:dumps': expected an object"):
        find_planner("json:dumps")


@pytest.mark.parametrize("name", ["incremental", "from_scratch", "isam2"])
@pytest.mark.parametrize("order", ["fixed", "random"])
def test_network_faults_change_nothing_with_real_evaluators(name, order):
    mission = make_mission()
    options = ImpactedPathsOptions(candidates=4, vertices=60, spacing_m=3.0)
    sets = candidate_sets(mission, options, np.random.default_rng(5))
    coordination = CoordinationOptions(order=order, repair_after_s=0.5)
    plain = coordinate(sets.problem, sets.candidates, find_evaluator(name), options=coordination)
    robots = sets.problem.robots
    faults = NetworkFaults(
        loss=0.3,
        duplication=0.2,
        reordering=0.3,
        delay_s=(0.01, 0.2),
        partitions=(Partition(0.1, 2.0, (robots[:1], robots[1:])),),
    )
    network = InProcessTransport(robots, faults, np.random.default_rng(0))
    faulty = coordinate(
        sets.problem,
        sets.candidates,
        find_evaluator(name),
        options=coordination,
        transport=network,
    )
    assert plain.agreed
    assert faulty.values == plain.values
    assert faulty.chosen == plain.chosen
    assert faulty.ledger.history == plain.ledger.history


def test_as_published_runs_though_it_is_not_exact():
    plan = plan_with(make_mission(options={**OPTIONS, "evaluator": "as_published"}))
    assert set(plan.paths) == {"r0", "r1", "r2"}
    assert np.isfinite(plan.value)
