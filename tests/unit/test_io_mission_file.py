"""A scenario file to a mission: what each table becomes, and what is refused."""

import math
from pathlib import Path

import gtsam
import numpy as np
import pytest

from fgplan.errors import ScenarioError
from fgplan.evaluation.objective import (
    PathLengthTerm,
    PathTerm,
    PosesOf,
    PriorVariables,
    Trajectory,
    TravelTimeTerm,
    UncertaintyTerm,
)
from fgplan.io.mission_file import load_mission
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.multi_robot import DistanceCriterion
from fgplan.planners.mission import MissionSimulation

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "scenarios" / "two_robots.toml"
MAPS = ROOT / "tests" / "data" / "maps"
TEXT = EXAMPLE.read_text(encoding="utf-8")
OBJECTIVE = TEXT[TEXT.index("[objective]") : TEXT.index("[planner]\n")]

OWN = """
import numpy as np
import gtsam
from fgplan.models.range_bearing import RangeSensor

class Sonar(RangeSensor):
    pass

def near(first, second):
    return abs(first.time_s - second.time_s) < 1.0

class Near:
    def __call__(self, first, second):
        return True

def corners(path):
    return float(len(path.poses))

def not_a_sensor():
    return 3

number = 4

def past():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
    for key, place in ((7, (4.0, 6.0, 0.0)), (9, (4.0, 34.0, 0.0))):
        graph.add(gtsam.PriorFactorPose2(key, gtsam.Pose2(*place), noise))
        values.insert(key, gtsam.Pose2(*place))
    return graph, values, {"bob": 9, "ann": 7}

def past_without_bob():
    graph, values, keys = past()
    return graph, values, {"ann": 7}

def past_with_a_stranger():
    graph, values, keys = past()
    return graph, values, {**keys, "eve": 9}

def past_of_two():
    return 1, 2

def past_in_wrong_order():
    graph, values, keys = past()
    return values, graph, keys
"""


@pytest.fixture
def load(tmp_path):
    (tmp_path / "own_models.py").write_text(OWN, encoding="utf-8")

    def load_text(text):
        path = tmp_path / "team.toml"
        path.write_text(text, encoding="utf-8")
        return load_mission(path)

    return load_text


def edited(*changes: tuple[str, str]) -> str:
    text = TEXT
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def without_starts(function: str) -> str:
    text = "\n".join(line for line in TEXT.splitlines() if not line.startswith("start"))
    return text + f'\n[prior]\nkind = "python"\nfunction = "own_models:{function}"\n'


def with_terms(*tables: str) -> str:
    terms = "".join(f"[[objective.terms]]\n{table}\n" for table in tables)
    return TEXT.replace(OBJECTIVE, terms)


def test_example_becomes_a_mission():
    mission = load_mission(EXAMPLE)
    ann = mission.robots[0]
    assert [robot.name for robot in mission.robots] == ["ann", "bob"]
    assert mission.name == "two robots"
    assert mission.options == {"candidates": 10}
    np.testing.assert_array_equal(ann.goals, [[55.0, 33.0]])
    np.testing.assert_array_equal(mission.prior.pose(ann.start_key), [4.0, 6.0, 0.0])
    # sigmas 0.1 m, 0.1 m, 0.01 rad
    expected = np.diag([1e-2, 1e-2, 1e-4])
    np.testing.assert_allclose(mission.prior.covariance(ann.start_key), expected, rtol=1e-12)
    np.testing.assert_array_equal(mission.prior.point(gtsam.symbol("l", 1)), [44.0, 20.0])
    assert len(mission.objective.terms) == 4
    assert isinstance(mission.multi_robot[0].sensor, RelativePoseSensor)
    assert mission.multi_robot[0].criterion == DistanceCriterion(8.0)
    assert len(mission.workspace.obstacles) == 2


def test_digest_sees_content_and_not_layout(load):
    first = load(TEXT).digest
    assert load("# a remark\n" + TEXT).digest == first
    assert load(edited(("seed = 1", "seed = 2"))).digest != first
    assert load(edited(("sigma_m = 0.2", "sigma_m = 0.3"))).digest != first


def test_digest_sees_the_cells_of_the_map(load, tmp_path):
    (tmp_path / "yard.map").write_text("type octile\nheight 2\nwidth 2\nmap\n..\n.@\n")
    world = 'map = "yard.map"\nmap_cell_m = 30.0\nbounds = [[0, 0], [60, 60]]\nunknown = "free"\n'
    start = TEXT.index("bounds"), TEXT.index("robot_radius_m")
    text = (TEXT[: start[0]] + world + TEXT[start[1] :]).replace(
        "goal = [55.0, 8.0]", "goal = [5.0, 8.0]"
    )
    first = load(text)
    assert first.workspace.grid.resolution_m == 30.0
    (tmp_path / "yard.map").write_text("type octile\nheight 2\nwidth 2\nmap\n@.\n.@\n")
    text_again = text.replace("goal = [5.0, 8.0]", "goal = [5.0, 8.1]")
    with pytest.raises(ScenarioError, match="free space"):
        load(text.replace("goal = [5.0, 8.0]", "goal = [5.0, 50.0]"))
    assert load(text).digest != first.digest
    assert load(text_again).digest != load(text).digest


def test_ros_map_gives_the_bounds(load, tmp_path):
    for name in ("depot.yaml", "depot.pgm"):
        (tmp_path / name).write_bytes((MAPS / name).read_bytes())
    cut = TEXT.index("bounds"), TEXT.index("robot_radius_m = 0.5")
    text = TEXT[: cut[0]] + 'map = "depot.yaml"\nunknown = "free"\n' + TEXT[cut[1] :]
    with pytest.raises(ScenarioError, match=r"within the bounds.*robots\[0\]\.goal.*robot 'ann'"):
        load(text)  # the depot is 30 m by 15 m, the goal 55 m away


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ('kind = "range"\nsigma_m = 0.5', RangeSensor(sigma_m=0.5)),
        (
            'kind = "bearing"\nsigma_rad = 0.1\nfield_of_view_rad = 1.0',
            BearingSensor(sigma_rad=0.1, field_of_view_rad=1.0),
        ),
        (
            'kind = "bearing_range"\nbearing_sigma_rad = 0.1\nrange_sigma_m = 1\nmax_range_m = 5',
            BearingRangeSensor(bearing_sigma_rad=0.1, range_sigma_m=1.0, max_range_m=5.0),
        ),
        ('kind = "proportional_range"', ProportionalRangeSensor()),
        (
            'kind = "proportional_range"\nslope = 0.1\nsigma_m = 0.2\nfloor_m = 0.05\n'
            "max_range_m = 2",
            ProportionalRangeSensor(slope=0.1, sigma_m=0.2, floor_m=0.05, max_range_m=2.0),
        ),
        (
            'kind = "position"\nsigma_m = 0.3\nsigma_per_metre = 0.1\nfield_of_view_rad = 1.0',
            PositionSensor(sigma_m=0.3, sigma_per_metre=0.1, field_of_view_rad=1.0),
        ),
    ],
)
def test_built_in_sensors(load, table, expected):
    mission = load(TEXT + f"\n[sensors.extra]\n{table}\n")
    assert mission.sensors["extra"] == expected


def test_sensor_and_criterion_of_the_user(load):
    text = TEXT + '\n[sensors.own]\nkind = "own_models:Sonar"\nsigma_m = 0.25\n'
    text = text.replace("distance_m = 8.0", 'criterion = "own_models:near"')
    mission = load(text)
    assert type(mission.sensors["own"]).__name__ == "Sonar"
    assert mission.sensors["own"].sigma_m == 0.25
    assert mission.multi_robot[0].criterion.__name__ == "near"
    of_class = load(text.replace("own_models:near", "own_models:Near"))
    assert of_class.multi_robot[0].criterion(None, None) is True


def test_range_between_robots_by_name(load):
    sensor = 'sensor = "lidar"\ntime_tolerance_s = 0.5\ninclude_past = false'
    start = TEXT.index("sensor = {"), TEXT.index("[objective]")
    mission = load(TEXT[: start[0]] + sensor + "\n" + TEXT[start[1] :])
    model = mission.multi_robot[0]
    assert isinstance(model.sensor, BearingRangeSensor)
    assert model.time_tolerance_s == 0.5
    assert model.include_past is False


def test_terms_of_every_kind(load):
    mission = load(
        with_terms(
            'kind = "path_length"\nweight = 0.5',
            'kind = "travel_time"\nrobot = "bob"',
            'kind = "path"\nrobot = "ann"\nfunction = "own_models:corners"',
            'kind = "uncertainty"\nrobot = "ann"\nfunction = "entropy"\nblock = "pose"\n'
            'read = "arrival"',
            'kind = "uncertainty"\nrobots = ["ann", "bob"]\nread = [3, 5]',
            'kind = "uncertainty"\ntrajectory_of = "bob"',
            'kind = "uncertainty"\nlandmarks = "all"\nfunction = "mutual_information"',
            'kind = "uncertainty"\nlandmarks = ["l1"]',
            'kind = "uncertainty"\nkeys = ["x0"]',
        )
    )
    terms = mission.objective.terms
    assert terms[:3] == (
        PathLengthTerm(robot="ann", weight=0.5),
        PathLengthTerm(robot="bob", weight=0.5),
        TravelTimeTerm(robot="bob"),
    )
    assert isinstance(terms[3], PathTerm)
    assert terms[3].name == "corners"
    landmark_keys = (gtsam.symbol("l", 0), gtsam.symbol("l", 1))
    assert terms[4:] == (
        UncertaintyTerm(of=PosesOf(("ann",)), function="entropy", block="pose", read="arrival"),
        UncertaintyTerm(of=PosesOf(("ann", "bob")), read=(3, 5)),
        UncertaintyTerm(of=Trajectory("bob")),
        UncertaintyTerm(of=PriorVariables(landmark_keys), function="mutual_information"),
        UncertaintyTerm(of=PriorVariables(landmark_keys[1:])),
        UncertaintyTerm(of=PriorVariables((gtsam.symbol("x", 0),))),
    )


def test_weights_of_the_preset(load):
    mission = load(edited(("path_weight = 0.1", "path_weight = 0.7")))
    assert [term.weight for term in mission.objective.terms] == [0.7, 1.0, 0.7, 1.0]


def test_prior_from_a_function(load):
    mission = load(without_starts("past"))
    assert [robot.start_key for robot in mission.robots] == [7, 9]
    assert mission.prior.keys == (7, 9, gtsam.symbol("l", 0), gtsam.symbol("l", 1))


def test_spatial_robots(load):
    text = TEXT.replace("[4.0, 6.0, 0.0]", "[4.0, 6.0, 2.0, 0.0, 0.0, 0.0, 1.0]")
    text = text.replace("[4.0, 34.0, 0.0]", "[4.0, 34.0, 2.0, 0.0, 0.0, 1.0, 0.0]")
    text = text.replace("[0.1, 0.1, 0.01]", "[0.01, 0.01, 0.01, 0.1, 0.1, 0.1]")
    text = text.replace("[0.5, 0.5, 0.05]", "[0.01, 0.01, 0.01, 0.1, 0.1, 0.1]")
    text = text.replace("goal = [55.0, 33.0]", "goal = [55.0, 33.0, 1.0]")
    text = text.replace("goal = [55.0, 8.0]", "goals = [[50.0, 8.0, 1.0], [55.0, 8.0, 1.0]]")
    lines = [
        "motion = { sigmas = [0.01, 0.01, 0.01, 0.1, 0.1, 0.1] }"
        if line.startswith("motion")
        else line
        for line in text.splitlines()
    ]
    text = "\n".join(lines).replace("[0.2, 0.2, 0.02]", "[0.02, 0.02, 0.02, 0.2, 0.2, 0.2]")
    text = text.replace("position = [30.0, 4.0]", "position = [30.0, 4.0, 1.0]")
    text = text.replace("position = [44.0, 20.0]", "position = [44.0, 20.0, 1.0]")
    mission = load(text)
    pose = mission.prior.pose(mission.robots[1].start_key)
    # a half turn about z
    np.testing.assert_allclose(pose[:3, :3], np.diag([-1.0, -1.0, 1.0]), atol=1e-15)
    assert mission.robots[1].goals.shape == (2, 3)
    with pytest.raises(ScenarioError, match=r"quaternion of length one, got 2.*robots\[1\]\.start"):
        load(text.replace("0.0, 0.0, 1.0, 0.0]", "0.0, 0.0, 2.0, 0.0]"))


def test_targets_are_static_unless_said(load):
    text = TEXT + '\n[[targets]]\nname = "fox"\nmean = [1, 2]\nsigmas = [2, 3]\n'
    fox = load(text).targets[0]
    np.testing.assert_array_equal(fox.covariance, np.diag([4.0, 9.0]))
    np.testing.assert_array_equal(fox.transition, np.eye(2))
    np.testing.assert_array_equal(fox.process, np.zeros((2, 2)))
    moving = load(
        text + "transition = [[1, 1], [0, 1]]\ndrift = [1, 0]\nprocess = [[1, 0], [0, 1]]\n"
    )
    np.testing.assert_array_equal(moving.targets[0].transition, [[1, 1], [0, 1]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            edited(("goal = [55.0, 33.0]", "goal = [24.0, 15.0]")),
            ["free space", "[24.0, 15.0]", "$.robots[0].goal", "'ann'"],
        ),
        (edited(("goal = [55.0, 33.0]", "")), ["goal or goals", "neither", "robot 'ann'"]),
        (edited(("goal = [55.0, 33.0]", "goal = [55.0, 33.0, 0.0]")), ["2 coordinates", "got 3"]),
        (
            edited(("start = [4.0, 6.0, 0.0]\n", "")),
            ["[x, y, heading]", "got nothing", "$.robots[0].start"],
        ),
        (
            edited(("start = [4.0, 6.0, 0.0]", "start = [4.0, 6.0, 0.0, 1.0]")),
            ["got 4 numbers", "$.robots[0].start"],
        ),
        (
            edited(("start_sigmas = [0.1, 0.1, 0.01]\n", "")),
            ["start_sigmas or start_covariance", "neither"],
        ),
        (
            edited(("start_sigmas = [0.1, 0.1, 0.01]", "start_covariance = [[1, 2], [2, 1, 0]]")),
            ["square", "start_covariance"],
        ),
        (
            edited(
                (
                    "start_sigmas = [0.1, 0.1, 0.01]",
                    "start_covariance = [[1, 0, 0], [0, 1, 2], [0, 2, 1]]",
                )
            ),
            ["positive definite", "'ann'"],
        ),
        (
            edited(
                (
                    "start_sigmas = [0.1, 0.1, 0.01]",
                    "start_covariance = [[1, 0, 0], [0, 1, 0], [0, 0.5, 1]]",
                )
            ),
            ["symmetric", "'ann'"],
        ),
        (
            edited(
                (
                    "motion = { sigmas = [0.05, 0.05, 0.005], per_metre = [0.05, 0.05, 0.01] }",
                    "motion = { sigmas = [0.05, 0.05, 0.0, 0.005] }",
                )
            ),
            ["3 numbers", "got 4", "motion.sigmas"],
        ),
        (
            edited(
                (
                    "motion = { sigmas = [0.05, 0.05, 0.005], per_metre = [0.05, 0.05, 0.01] }",
                    "motion = { sigmas = [0.05, 0.05, 0.0] }",
                )
            ),
            ["noise", "$.robots[0].motion"],
        ),
        (
            edited(("distance_m = 8.0\n", "")),
            ["distance_m or criterion", "neither", "$.team.multi_robot[0]"],
        ),
        (edited(("distance_m = 8.0", 'distance_m = 8.0\ncriterion = "own_models:near"')), ["both"]),
        (
            edited(("distance_m = 8.0", 'criterion = "own_models:number"')),
            ["call with two states", "int"],
        ),
        (edited(('kind = "relative_pose"', 'kind = "bearing"')), ["between robots", "bearing"]),
        (edited(('kind = "relative_pose"', 'kind = "position"')), ["between robots", "'position'"]),
        (
            edited(("sensor = {", "time_tolerance_s = 1.0\nsensor = {")),
            ["any two times", "$.team.multi_robot[0]"],
        ),
        (
            edited((", sigmas = [0.2, 0.2, 0.02]", "")),
            ["sigmas or covariance", "neither", "multi_robot[0].sensor"],
        ),
        (
            edited(
                (
                    'sensor = { kind = "relative_pose", sigmas = [0.2, 0.2, 0.02] }',
                    'sensor = "radar"',
                )
            ),
            ["lidar", "'radar'"],
        ),
        (
            edited(("bearing_sigma_rad = 0.02", "bearing_sigma_rad = 0")),
            ["> 0.0", "$.sensors.lidar.bearing_sigma_rad"],
        ),
        (
            edited(("bearing_sigma_rad = 0.02", "bearing_sigma_deg = 1")),
            ["bearing_sigma_deg", "$.sensors.lidar"],
        ),
        (
            edited(('kind = "bearing_range"', 'kind = "radar"')),
            [
                "bearing_range, proportional_range, clamped_range, position or 'module:object'",
                "'radar'",
            ],
        ),
        (
            edited(('kind = "bearing_range"', "")),
            ["kind of a sensor", "got nothing", "$.sensors.lidar.kind"],
        ),
        (
            edited(('kind = "bearing_range"', 'kind = "own_models:Sonar"')),
            ["own_models:Sonar accepts", "$.sensors.lidar"],
        ),
        (
            TEXT + '\n[sensors.own]\nkind = "proportional_range"\nfloor_m = 0',
            ["> 0.0", "$.sensors.own.floor_m"],
        ),
        (
            TEXT + '\n[sensors.own]\nkind = "proportional_range"\nslope = -0.1',
            [">= 0.0", "$.sensors.own.slope"],
        ),
        (TEXT + '\n[sensors.own]\nkind = "position"', ["sigma_m", "$.sensors.own"]),
        (TEXT + '\n[sensors.own]\nkind = "own_models:not_a_sensor"', ["AbstractSensor", "got int"]),
        (
            TEXT + '\n[sensors.own]\nkind = "no_such_module:Sonar"',
            ["importable module", "no_such_module.py"],
        ),
        (TEXT + '\n[sensors.own]\nkind = "own_models:Absent"', ["object 'Absent'", "found none"]),
        (
            edited(("bounds = [[0.0, 0.0], [60.0, 40.0]]\n", "")),
            ["bounds or map", "neither", "$.world"],
        ),
        (
            edited(("bounds = [[0.0, 0.0], [60.0, 40.0]]", 'map = "absent.yaml"')),
            ["absent.yaml", "$.world.map"],
        ),
        (
            edited(("bounds = [[0.0, 0.0], [60.0, 40.0]]", 'map = "own_models.py"')),
            [".map file", "$.world.map"],
        ),
        (
            edited(("robot_radius_m = 0.5", "robot_radius_m = 0.5\nmap_cell_m = 2.0")),
            ["MovingAI", "$.world.map_cell_m"],
        ),
        (
            edited(
                (
                    "[20.0, 12.0], [28.0, 12.0], [28.0, 18.0]",
                    "[20.0, 12.0], [28.0, 18.0], [28.0, 12.0]",
                )
            ),
            ["simple polygon", "$.world"],
        ),
        (TEXT + "\n[[objective.terms]]\nkind = 'path_length'", ["preset or terms"]),
        (
            with_terms('kind = "path_length"\nrobot = "eve"'),
            ["ann, bob", "'eve'", "$.objective.terms[0]"],
        ),
        (with_terms('kind = "path_length"\nblock = "pose"'), ["no block", "'path_length'"]),
        (with_terms('kind = "uncertainty"\nname = "x"'), ["no name"]),
        (
            with_terms('kind = "uncertainty"\nrobot = "ann"\nkeys = ["x0"]'),
            ["at most", "'robot', 'keys'"],
        ),
        (
            with_terms('kind = "uncertainty"\nfunction = "tracy"'),
            ["'tracy'", "trace", "$.objective.terms[0]"],
        ),
        (with_terms('kind = "uncertainty"\nkeys = ["0x"]'), ["key such as", "'0x'"]),
        (with_terms('kind = "uncertainty"\nlandmarks = ["oak"]'), ["l0, l1", "'oak'"]),
        (with_terms('kind = "path"'), ["'module:object'", "got nothing"]),
        (with_terms('kind = "path"\nfunction = "own_models:number"'), ["call with a path", "int"]),
        (with_terms('kind = "path"\nfunction = "corners"'), ["'module:object'", "'corners'"]),
        (without_starts("past_without_bob"), ["start key", "'bob'"]),
        (without_starts("past_with_a_stranger"), ["'eve'", "ann, bob"]),
        (without_starts("past_of_two"), ["(graph, values, start_keys)", "got tuple"]),
        (without_starts("past_in_wrong_order"), ["graph as a NonlinearFactorGraph", "got Values"]),
        (
            without_starts("past")
            + "\n[[robots]]\nname = 'cid'\ngoal = [1, 1]\nmotion = { sigmas = [1, 1, 1] }\n",
            ["'cid'", "start key"],
        ),
        (
            TEXT + "\n[prior]\nkind = 'python'\nfunction = 'own_models:past'",
            ["no start", "'python'", "$.robots[0].start"],
        ),
        (
            TEXT + '\n[[targets]]\nname = "fox"\nmean = [1, 2]\nsigmas = [2, 3]\n'
            "transition = [[1], [1, 0]]",
            ["$.targets[0]", "'fox'"],
        ),
        (
            TEXT + '\n[[targets]]\nname = "fox"\nmean = [1, 2]\nsigmas = [2, 3]\ndrift = [1]',
            ["'fox' d", "(2)", "$.targets[0]"],
        ),
    ],
)
def test_refusal_names_the_place(load, text, words):
    with pytest.raises(ScenarioError) as caught:
        load(text)
    message = str(caught.value)
    assert "team.toml: " in message
    assert " - at `$." in message
    for word in words:
        assert word in message, message


def test_same_landmarks_in_graph_and_file_are_refused(load, tmp_path):
    own = (tmp_path / "own_models.py").read_text()
    own += (
        "\ndef past_with_landmark():\n"
        "    graph, values, keys = past()\n"
        "    values.insert(gtsam.symbol('l', 0), np.zeros(2))\n"
        "    return graph, values, keys\n"
    )
    (tmp_path / "graph_models.py").write_text(own)
    text = without_starts("past_with_landmark").replace("own_models", "graph_models")
    with pytest.raises(ScenarioError, match=r"key l0 to be free.*\$\.landmarks\[0\]"):
        load(text)


def test_unlimited_range_is_left_out_not_written(load):
    assert load(edited(("max_range_m = 12.0\n", ""))).sensors["lidar"].max_range_m == math.inf


G2O = """
VERTEX_SE2 {a0} 0 0 0
VERTEX_SE2 {a1} 2 6 0
VERTEX_SE2 {a2} 4 6 0
VERTEX_SE2 {b0} 4 34 0
EDGE_SE2 {a0} {a1} 2 6 0 100 0 0 100 0 1000
EDGE_SE2 {a1} {a2} 2 0 0 100 0 0 100 0 1000
EDGE_SE2 {a2} {b0} 0 28 0 100 0 0 100 0 1000
""".format(**{name: gtsam.symbol(name[0], int(name[1])) for name in ("a0", "a1", "a2", "b0")})


def g2o_text(fields: str) -> str:
    text = "\n".join(line for line in TEXT.splitlines() if not line.startswith("start"))
    return text + '\n[prior]\nkind = "g2o"\nfiles = ["past.g2o"]\n' + fields


START_KEYS = 'start_keys = { ann = "a2", bob = "b0" }\n'


def test_prior_from_g2o_with_past_states(load, tmp_path):
    (tmp_path / "past.g2o").write_text(f"FIX {gtsam.symbol('a', 0)}\n" + G2O)
    mission = load(g2o_text(START_KEYS + "past_step_s = 0.5\n"))
    assert [robot.start_key for robot in mission.robots] == [
        gtsam.symbol("a", 2),
        gtsam.symbol("b", 0),
    ]
    np.testing.assert_array_equal(mission.prior.pose(gtsam.symbol("b", 0)), [4.0, 34.0, 0.0])
    states = [past.state for past in mission.past_states]
    assert [(state.robot, state.step, state.time_s) for state in states] == [
        ("ann", -2, -1.0),
        ("ann", -1, -0.5),
    ]
    # FIX holds a0 by 1 mm and 1 mrad
    held = mission.prior.covariance(gtsam.symbol("a", 0))
    np.testing.assert_allclose(held, 1e-6 * np.eye(3), rtol=1e-9, atol=1e-18)


def test_gauge_of_the_scenario(load, tmp_path):
    (tmp_path / "past.g2o").write_text(G2O)
    mission = load(g2o_text(START_KEYS + 'gauge = { key = "a1", sigmas = [0.1, 0.2, 0.3] }\n'))
    np.testing.assert_allclose(
        mission.prior.covariance(gtsam.symbol("a", 1)),
        np.diag([0.01, 0.04, 0.09]),
        rtol=1e-9,
        atol=1e-15,
    )
    assert mission.past_states == ()


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (START_KEYS, ["pose to hold", "FIX", "$.prior.gauge"]),
        (START_KEYS + 'gauge = { key = "a9" }\n', ["key of a pose", "got a9", "$.prior.gauge.key"]),
        (
            START_KEYS + 'gauge = { key = "a0", sigmas = [1, 1] }\n',
            ["3 numbers, got 2", "gauge.sigmas"],
        ),
        (
            'start_keys = { ann = "a2", bob = "b7" }\ngauge = { key = "a0" }\n',
            ["got b7", "$.prior.start_keys.bob"],
        ),
        ('start_keys = { ann = "a2" }\ngauge = { key = "a0" }\n', ["start key", "'bob'"]),
    ],
)
def test_refusal_of_g2o_priors(load, tmp_path, fields, words):
    (tmp_path / "past.g2o").write_text(G2O)
    with pytest.raises(ScenarioError) as caught:
        load(g2o_text(fields))
    for word in words:
        assert word in str(caught.value)


def test_malformed_g2o_names_scenario_and_line(load, tmp_path):
    (tmp_path / "past.g2o").write_text("VERTEX_SE2 0 1\n")
    with pytest.raises(ScenarioError, match=r"past\.g2o:1"):
        load(g2o_text(START_KEYS))


def test_team_settings_become_options_of_the_planner(load):
    team = (
        '[team]\norder = "random"\nwithout_path = "stay"\n'
        "[team.communication]\nloss = 0.1\n[[team.multi_robot]]"
    )
    mission = load(edited(("[[team.multi_robot]]", team)))
    assert mission.options["order"] == "random"
    assert mission.options["without_path"] == "stay"
    assert mission.options["communication"]["loss"] == 0.1
    assert "tolerance" not in mission.options
    twice = edited(("[[team.multi_robot]]", team), ("candidates = 10", 'order = "fixed"'))
    with pytest.raises(ScenarioError, match=r"order once.*\$\.team\.order"):
        load(twice)


def test_simulation_is_handed_on_for_a_closed_loop(load):
    assert load(TEXT).simulation is None
    asked = load(TEXT + "\n[simulation]\nsteps = 5\nseed = 3\nruns = 2\noptions.rate = 0.5\n")
    assert asked.simulation == MissionSimulation(steps=5, seed=3, runs=2, options={"rate": 0.5})
    with pytest.raises(ScenarioError, match=r">= 1, got 0 - at `\$\.simulation\.steps`"):
        load(TEXT + "\n[simulation]\nsteps = 0\n")
