"""The world refuses what cannot be simulated."""

import numpy as np
import pytest

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.models.hidden_state import independent_targets
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import RangeSensor
from fgplan.simulation.world import World, WorldRobot
from roadmaps import Workspace

ROOM = Workspace(lower=[0, 0], upper=[10, 10], obstacles=[[(4, 4), (6, 4), (6, 6), (4, 6)]])


def robot(name="r1", pose=(1.0, 1.0, 0.0), **rest):
    return WorldRobot(name=name, pose=np.asarray(pose), **rest)


def test_a_world_is_frozen():
    world = World(
        robots=(robot(landmark_sensors=("s",), target_sensors=("s",)),),
        sensors={"s": RangeSensor(sigma_m=1.0)},
        workspace=ROOM,
        landmark_keys=(5, 3),
        landmark_positions=[[1, 2], [3, 4]],
        known_landmarks={3},
    )
    assert world.robot("r1").sensors == ("s",)
    assert world.landmark_position(3).tolist() == [3.0, 4.0]
    assert not world.landmark_positions.flags.writeable
    assert not world.robots[0].pose.flags.writeable
    with pytest.raises(AttributeError):
        world.step_s = 2.0


def test_line_of_sight():
    world = World(robots=(robot(),), workspace=ROOM)
    starts, ends = np.array([[1.0, 5.0]]), np.array([[3.0, 5.0], [9.0, 5.0]])
    assert world.has_line_of_sight(starts, ends).tolist() == [1, 0]
    assert World(robots=(robot(),)).has_line_of_sight(starts, ends).tolist() == [1, 1]


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"robots": ()}, InvalidInputError, "unique names"),
        ({"robots": (robot(), robot())}, InvalidInputError, "unique names"),
        (
            {"robots": (robot(), robot("r2", pose=np.eye(4)))},
            InvalidInputError,
            "planar or spatial robots, got both",
        ),
        ({"robots": (robot(robot_sensors=("x",)),)}, UnknownNameError, "'x' is not one of: none"),
        ({"robots": (robot(pose=(5, 5, 0)),)}, InvalidInputError, "start in free space"),
        ({"step_s": 0.0}, InvalidInputError, "step_s"),
        ({"landmark_keys": (1, 1)}, InvalidInputError, "1 twice"),
        ({"landmark_keys": (1,)}, InvalidInputError, "landmark positions"),
        (
            {"landmark_keys": (1,), "landmark_positions": np.zeros((1, 4))},
            InvalidInputError,
            "2 or 3 coordinates",
        ),
        ({"known_landmarks": {9}}, UnknownNameError, "landmark 9"),
        ({"hidden_state": [1.0]}, InvalidInputError, "hidden_state: expected shape"),
        (
            {
                "robots": (robot(pose=np.eye(4)),),
                "landmark_keys": (1,),
                "landmark_positions": [[1, 1]],
            },
            InvalidInputError,
            "expected 3 coordinates",
        ),
        (
            {
                "robots": (robot(pose=np.eye(4)),),
                "hidden": independent_targets(("a",), np.zeros((1, 2)), np.eye(2)),
                "hidden_state": [0.0, 0.0],
            },
            InvalidInputError,
            "targets in space",
        ),
    ],
)
def test_bad_worlds(given, error, message):
    with pytest.raises(error, match=message):
        World(**({"robots": (robot(),), "workspace": ROOM} | given))


def test_unknown_names():
    world = World(robots=(robot(),))
    with pytest.raises(UnknownNameError, match="robot 'r2' is not one of: r1"):
        world.robot("r2")
    with pytest.raises(UnknownNameError, match="landmark 4"):
        world.landmark_position(4)


def test_noise_must_fit_the_pose():
    with pytest.raises(InvalidInputError, match="odometry noise of 3 numbers"):
        robot(odometry=MotionModel(sigmas=np.ones(6)))
    with pytest.raises(InvalidInputError, match="pose of robot 'r1'"):
        robot(pose=(1.0, np.nan, 0.0))
