"""Small closed loops for tests: two robots in 120 m x 100 m, a few landmarks, a few candidates."""

from dataclasses import fields, is_dataclass, replace

import numpy as np

from fgplan.closed_loop.mission import LoopMission, LoopRobot
from fgplan.closed_loop.records import LoopHistory, SessionRecord, SlamRecord, StepRecord
from fgplan.factors.keys import symbol_key
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.simulation.world import World, WorldRobot
from roadmaps import Workspace

WIDTH_M, HEIGHT_M = 120.0, 100.0
STEP_M = 10.0
STARTS = {"ann": (10.0, 10.0, np.pi / 2), "bob": (60.0, 10.0, np.pi / 2)}
GOALS = {"ann": ((15.0, 85.0), (55.0, 40.0)), "bob": ((70.0, 60.0), (100.0, 20.0))}
CAMERA = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.2, max_range_m=25.0)
MEETING = MultiRobotModel(
    criterion=DistanceCriterion(30.0),
    sensor=RelativePoseSensor(covariance=np.diag([0.3, 0.3, 0.02]) ** 2),
)
SECONDS = {"seconds"}
"""Fields that tell how long something took."""


def motion(spatial=False, scale=1.0):
    """Noise of a step of ten metres: 0.2 m, 0.01 rad."""
    sigmas = [0.01, 0.01, 0.01, 0.2, 0.2, 0.2] if spatial else [0.2, 0.2, 0.01]
    return MotionModel(sigmas=scale * np.array(sigmas), speed_m_per_s=STEP_M)


def pose_at(start, spatial):
    """A planar pose, or the same level at height 5."""
    if not spatial:
        return np.array(start)
    x, y, heading = start
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    pose[:3, 3] = x, y, 5.0
    return pose


def small_mission(
    seed=0,
    *,
    spatial=False,
    sensor=CAMERA,
    multi_robot=(MEETING,),
    measured=None,
    obstacles=(),
    known=(),
    goals=None,
    starts=None,
    landmarks=30,
    candidates=6,
    noise=1.0,
    start_sigma=1e-3,
    robot_radius_m=0.0,
    world=None,
    **options,
):
    """Make a mission; ``obstacles`` are the world's, ``known`` those of the team."""
    rng = np.random.default_rng(seed)
    goals = GOALS if goals is None else goals
    starts = STARTS if starts is None else starts
    bounds = {
        "lower": np.zeros(2),
        "upper": np.array([WIDTH_M, HEIGHT_M]),
        "robot_radius_m": robot_radius_m,
    }
    truth = Workspace(**bounds, obstacles=obstacles)
    points = rng.uniform([0.0, 0.0], [WIDTH_M, HEIGHT_M], (landmarks, 2))
    if spatial:
        points = np.column_stack([points, rng.uniform(0.0, 10.0, landmarks)])
    dim = 6 if spatial else 3
    return LoopMission(
        name="small",
        world=World(
            robots=tuple(
                WorldRobot(
                    name=name,
                    pose=pose_at(start, spatial),
                    odometry=motion(spatial, noise),
                    actuation=motion(spatial, noise),
                    landmark_sensors=("eye",),
                )
                for name, start in starts.items()
            ),
            workspace=truth,
            sensors={"eye": sensor},
            landmark_keys=tuple(symbol_key("l", index) for index in range(landmarks)),
            landmark_positions=points,
            multi_robot=measured or {},
            **(world or {}),
        ),
        workspace=Workspace(**bounds, obstacles=known),
        robots=tuple(
            LoopRobot(
                name=name,
                goals=np.array(goals[name]).reshape(-1, 2),
                motion=motion(spatial),
                start_covariance=start_sigma**2 * np.eye(dim),
                sensors=("eye",),
            )
            for name in starts
        ),
        multi_robot=multi_robot,
        candidates=CandidateOptions(
            candidates=candidates, spacing_m=STEP_M, vertices=60, neighbours=6
        ),
        seed=seed,
        **options,
    )


def spatial_meeting():
    """A relative pose in space between robots nearer than 30 m."""
    sigmas = np.diag([0.02, 0.02, 0.02, 0.3, 0.3, 0.3])
    return replace(MEETING, sensor=RelativePoseSensor(covariance=sigmas**2))


def of_kind(records, kind):
    """The records of one kind, in order."""
    return [record for record in records if isinstance(record, kind)]


def steps_of(records):
    """Step records."""
    return of_kind(records, StepRecord)


def sessions_of(records):
    """Session records."""
    return of_kind(records, SessionRecord)


def reached(records):
    """Number of goals reached, by robot."""
    counts = {}
    for step in steps_of(records):
        for robot in step.arrived:
            counts[robot] = counts.get(robot, 0) + 1
    return counts


def history_of(mission, records):
    """The history that figures read."""
    world = mission.world
    return LoopHistory(
        name=mission.name,
        robots=tuple(robot.name for robot in mission.robots),
        goals=mission.goals,
        landmarks=dict(zip(world.landmark_keys, world.landmark_positions, strict=True)),
        steps=tuple(steps_of(records)),
        sessions=tuple(sessions_of(records)),
        final=next(iter(of_kind(records, SlamRecord)), None),
    )


def assert_same(one, other, where="record"):
    """Two records are equal to the last bit, all fields but seconds."""
    if is_dataclass(one):
        assert type(one) is type(other), where
        for field in fields(one):
            if field.name not in SECONDS:
                name = f"{where}.{field.name}"
                assert_same(getattr(one, field.name), getattr(other, field.name), name)
    elif hasattr(one, "keys"):
        assert list(one) == list(other), where
        for key in one:
            assert_same(one[key], other[key], f"{where}[{key}]")
    elif isinstance(one, np.ndarray):
        assert one.shape == other.shape, where
        assert one.tobytes() == np.asarray(other, np.float64).tobytes(), where
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), where
        for place, (left, right) in enumerate(zip(one, other, strict=True)):
            assert_same(left, right, f"{where}[{place}]")
    else:
        assert one == other, where
