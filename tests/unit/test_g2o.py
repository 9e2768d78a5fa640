from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam import symbol

from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.io.g2o import read_g2o, write_g2o

DATA = Path(__file__).parents[1] / "data" / "g2o"
ARGOS_FOLDER = Path(__file__).parents[2] / "examples" / "data" / "argos_10_robots"
ARGOS = [ARGOS_FOLDER / f"{robot}.g2o" for robot in range(10)]

PLANAR = """# two poses and a landmark
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0.1

VERTEX_XY 7 2 3
FIX 0
EDGE_SE2 0 1 1 0 0.1 100 1 2 200 3 400
EDGE_SE2_XY 1 7 1.3 2.9 25 5 100
"""
SPATIAL = """VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0 0 0 0 0.1 0.99498743710662
EDGE_SE3:QUAT 0 1 1.1 0 0 0 0 0.1 0.99498743710662 {triangle}
"""


def wheel(name):
    return Path(gtsam.findExampleDataFile(name))


def written(tmp_path, text, name="a.g2o"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("path", "spatial"),
    [
        (DATA / "smallGrid3D.g2o", True),
        (wheel("Klaus3.g2o"), True),
        (wheel("toyExample.g2o"), True),
        (wheel("known_landmark_localization_3.g2o"), True),
        (wheel("known_landmark_localization_20.g2o"), True),
        (wheel("edge_se3_trackxyz_example.g2o"), True),
    ],
)
def test_equals_gtsam_where_gtsam_is_right(path, spatial):
    ours = read_g2o(path, landmark_character="l")
    graph, values = gtsam.readG2o(str(path), spatial)
    assert ours.graph.size() == graph.size() > 0
    assert list(ours.values.keys()) == list(values.keys())
    # 1e-12: an example with all residuals at rounding.
    assert ours.graph.error(ours.values) == pytest.approx(graph.error(values), rel=1e-9, abs=1e-12)
    moved = values.retract(_random_tangent(values))
    assert ours.graph.error(moved) == pytest.approx(graph.error(moved), rel=1e-9)


def _random_tangent(values):
    rng = np.random.default_rng(0)
    delta = gtsam.VectorValues()
    for key, dim in sorted(values.dims().items()):
        delta.insert(key, 0.1 * rng.normal(size=dim))
    return delta


def test_edges_after_a_fix_line_are_kept():
    # gtsam.readG2o returns no factor at all for this file.
    path = DATA / "ais2klinik_first_150.g2o"
    ours = read_g2o(path)
    assert ours.fixed == (0,)
    assert ours.counts == {"EDGE_SE2": ours.graph.size(), "FIX": 1, "VERTEX_SE2": 150}
    assert ours.graph.size() >= 149
    assert gtsam.readG2o(str(path), False)[0].size() < ours.graph.size()
    graph = gtsam.NonlinearFactorGraph(ours.graph)
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 1e-3)
    graph.add(gtsam.PriorFactorPose2(0, ours.values.atPose2(0), noise))
    assert Belief(graph, ours.values).covariance(149).shape == (3, 3)


def test_planar_file_with_landmark_comment_and_fix(tmp_path):
    ours = read_g2o(written(tmp_path, PLANAR))
    assert ours.fixed == (0,)
    assert ours.repeated == ours.same_ends == 0
    assert ours.counts == {
        "EDGE_SE2": 1,
        "EDGE_SE2_XY": 1,
        "FIX": 1,
        "VERTEX_SE2": 2,
        "VERTEX_XY": 1,
    }
    between, sighting = ours.graph.at(0), ours.graph.at(1)
    information = [[100.0, 1.0, 2.0], [1.0, 200.0, 3.0], [2.0, 3.0, 400.0]]
    np.testing.assert_allclose(between.noiseModel().information(), information, rtol=1e-12)
    assert sighting.keys() == [1, 7]
    np.testing.assert_array_equal(ours.values.atPoint2(7), [2.0, 3.0])
    measured = sighting.measured()
    assert measured.range() == pytest.approx(np.hypot(1.3, 2.9), rel=1e-15)
    assert measured.bearing().theta() == pytest.approx(np.arctan2(2.9, 1.3), rel=1e-15)


def test_landmark_factor_has_the_information_of_the_edge(tmp_path):
    # At zero residual d(error)/d(landmark) whitened must square to R_w I R_w' of the file.
    pose = gtsam.Pose2(1.0, 2.0, 0.7)
    text = ("VERTEX_SE2 0 1 2 0.7\nVERTEX_XY 3 {} {}\nEDGE_SE2_XY 0 3 1.5 -0.5 25 5 100\n").format(
        *pose.transformFrom(np.array([1.5, -0.5]))
    )
    ours = read_g2o(written(tmp_path, text))
    dense = ours.graph.linearize(ours.values).jacobian()[0][:, 3:]
    rotation = pose.rotation().matrix()
    want = rotation @ np.array([[25.0, 5.0], [5.0, 100.0]]) @ rotation.T
    np.testing.assert_allclose(dense.T @ dense, want, rtol=1e-10)


def test_sensor_offset_is_folded_into_the_measurement(tmp_path):
    # The landmark where the edge says, seen through an offset turned by 90 degrees about z.
    pose = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))
    offset = gtsam.Pose3(gtsam.Rot3.Yaw(np.pi / 2), np.array([0.5, 0.0, 0.2]))
    point = pose.compose(offset).transformFrom(np.array([2.0, 1.0, 0.5]))
    q, half = pose.rotation().toQuaternion(), np.sqrt(0.5)
    text = (
        f"VERTEX_SE3:QUAT 0 1 2 3 {q.x()} {q.y()} {q.z()} {q.w()}\n"
        f"VERTEX_TRACKXYZ 5 {point[0]} {point[1]} {point[2]}\n"
        "EDGE_SE3_TRACKXYZ 0 5 4 2 1 0.5 10 1 2 20 3 30\n"
        f"PARAMS_SE3OFFSET 4 0.5 0 0.2 0 0 {half} {half}\n"
    )
    ours = read_g2o(written(tmp_path, text))
    assert ours.graph.error(ours.values) < 1e-20
    dense = ours.graph.linearize(ours.values).jacobian()[0][:, 6:]
    turn = pose.compose(offset).rotation().matrix()
    want = turn @ np.array([[10.0, 1, 2], [1, 20, 3], [2, 3, 30]]) @ turn.T
    np.testing.assert_allclose(dense.T @ dense, want, rtol=1e-10, atol=1e-10)


def test_information_in_space_is_reordered_to_rotation_first(tmp_path):
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6))
    information = root @ root.T + np.eye(6)
    triangle = " ".join(repr(float(x)) for x in information[np.triu_indices(6)])
    ours = read_g2o(written(tmp_path, SPATIAL.format(triangle=triangle)))
    have = ours.graph.at(0).noiseModel().information()
    np.testing.assert_allclose(have[:3, :3], information[3:, 3:], rtol=1e-10)
    np.testing.assert_allclose(have[:3, 3:], information[3:, :3], rtol=1e-10)
    np.testing.assert_allclose(have[3:, 3:], information[:3, :3], rtol=1e-10)


def test_files_of_ten_robots_become_one_graph():
    ours = read_g2o(ARGOS)
    assert ours.values.size() == ours.counts["VERTEX_SE3:QUAT"] == 1070
    # 1370 pairs of poses; 226 edges are in two files, 16 of them with another last digit.
    assert ours.counts["EDGE_SE3:QUAT"] == 1596
    assert (ours.repeated, ours.same_ends, ours.graph.size()) == (210, 16, 1386)
    assert ours.values.exists(symbol("a", 0))
    loose = read_g2o(ARGOS, repeat_tolerance=1e-5)
    assert (loose.repeated, loose.same_ends, loose.graph.size()) == (226, 0, 1370)


def test_one_robot_alone_names_the_missing_vertex_and_the_remedy():
    with pytest.raises(ScenarioError, match=r"0\.g2o:\d+: EDGE_SE3:QUAT names vertex .*read_g2o"):
        read_g2o(ARGOS[0])


def test_repeats_within_one_file_are_two_measurements(tmp_path):
    twice = written(tmp_path, PLANAR + "EDGE_SE2 0 1 1 0 0.1 100 1 2 200 3 400\n")
    assert read_g2o(twice).graph.size() == 3
    again = written(tmp_path, PLANAR, "b.g2o")
    both = read_g2o([twice, again])
    assert (both.repeated, both.same_ends, both.graph.size()) == (2, 0, 3)


def test_an_edge_that_another_file_has_from_its_other_end_is_counted(tmp_path):
    turned = PLANAR.splitlines(keepends=True)
    turned = "".join(line for line in turned if line.startswith("VERTEX_SE2"))
    turned += "EDGE_SE2 1 0 -1 0 -0.1 100 1 2 200 3 400\n"
    both = read_g2o([written(tmp_path, PLANAR), written(tmp_path, turned, "b.g2o")])
    assert (both.repeated, both.same_ends, both.graph.size()) == (0, 1, 3)


def test_landmark_character_separates_ids(tmp_path):
    with pytest.raises(ScenarioError, match="landmark_character='l'"):
        read_g2o(wheel("example_with_vertices.g2o"))
    ours = read_g2o(wheel("example_with_vertices.g2o"), landmark_character="l")
    assert ours.values.exists(symbol("l", 0))
    assert ours.values.exists(0)
    assert ours.values.size() == 16
    with pytest.raises(
        InvalidInputError, match="landmark_character: expected one letter, got 'll'"
    ):
        read_g2o(wheel("example_with_vertices.g2o"), landmark_character="ll")
    far = written(tmp_path, f"VERTEX_XY {2**56} 1 1\n")
    with pytest.raises(ScenarioError, match=r"a landmark's id below 2\*\*56"):
        read_g2o(far, landmark_character="l")
    with pytest.raises(InvalidInputError, match="repeat_tolerance"):
        read_g2o(far, repeat_tolerance=np.nan)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("VERTEX_XY 7 2 3", "VERTEX_POINT 7 2 3", r"a\.g2o:5: unknown tag VERTEX_POINT.*with #"),
        ("VERTEX_XY 7 2 3", "VERTEX_XY 7 2 3 4", r":5: VERTEX_XY has 1 id and 2 numbers, got 4"),
        ("VERTEX_XY 7 2 3", "VERTEX_XY seven 2 3", r":5: VERTEX_XY: expected integer ids"),
        ("VERTEX_XY 7 2 3", "VERTEX_XY -7 2 3", r":5: VERTEX_XY: expected ids from 0"),
        (
            "VERTEX_XY 7 2 3",
            "VERTEX_XY 7 2 3x",
            r":5: VERTEX_XY: expected integer ids, then numbers, got 7 2 3x",
        ),
        ("VERTEX_XY 7 2 3", "VERTEX_XY 7 2 3_0", r":5: VERTEX_XY: expected integer ids"),
        ("VERTEX_XY 7 2 3", "VERTEX_XY 7 2 nan", r":5: VERTEX_XY: expected finite numbers"),
        ("VERTEX_XY 7 2 3", "VERTEX_SE2 7 2 3 0", r":8: EDGE_SE2_XY expects a VERTEX_XY"),
        (
            "VERTEX_XY 7 2 3",
            "VERTEX_SE2 1 2 3 0",
            r":5: .* another estimate at .*:3; give each its",
        ),
        ("VERTEX_XY 7 2 3", "VERTEX_XY 1 2 3", r":5: VERTEX_XY 1 stands with another tag"),
        ("VERTEX_XY 7 2 3", "VERTEX_TRACKXYZ 7 2 3 4", r":8: EDGE_SE2_XY expects a VERTEX_XY"),
        ("FIX 0", "FIX 9", r":6: FIX names vertex 9 \(9\), which no file"),
        ("FIX 0", "FIX", r":6: FIX has 1 id and 0 numbers, got 0 fields"),
        ("200 3 400", "200 3", r":7: EDGE_SE2 has 2 ids and 9 numbers, got 10 fields; is the line"),
        ("200 3 400", "200 3 -400", r":7: EDGE_SE2: expected a positive definite information"),
        ("100 1 2 200 3 400", "1 2 0 1 0 1", r":7: .*smallest eigenvalue -1 .*covariance"),
        ("EDGE_SE2 0 1", "EDGE_SE2 1 1", r":7: EDGE_SE2 joins 1 to itself"),
        ("1.3 2.9 25", "0 0 25", r":8: EDGE_SE2_XY: a landmark at distance zero"),
        ("EDGE_SE2 0 1", "EDGE_SE2 0 8", r":7: EDGE_SE2 names vertex 8"),
    ],
)
def test_malformed_lines_name_file_line_tag_and_remedy(tmp_path, old, new, words):
    assert old in PLANAR
    with pytest.raises(ScenarioError, match=words):
        read_g2o(written(tmp_path, PLANAR.replace(old, new)))


def test_malformed_spatial_lines(tmp_path):
    triangle = " ".join(repr(float(x)) for x in np.eye(6)[np.triu_indices(6)])
    good = SPATIAL.format(triangle=triangle)
    assert read_g2o(written(tmp_path, good)).graph.size() == 1
    bad = good.replace("0 0 0.1 0.99498743710662 1.0", "0 0 0.1 0.5 1.0")
    with pytest.raises(ScenarioError, match=r":3: EDGE_SE3:QUAT: expected a unit quaternion"):
        read_g2o(written(tmp_path, bad))
    with pytest.raises(ScenarioError, match=r"expected a unit quaternion"):
        read_g2o(written(tmp_path, good.replace("1 1 0 0 0 0 0.1", "1 1 0 0 0 0 0.9")))
    missing = wheel("edge_se3_trackxyz_missing_vertex.g2o")
    with pytest.raises(ScenarioError, match=r":3: EDGE_SE3_TRACKXYZ names vertex 9"):
        read_g2o(missing)
    text = wheel("edge_se3_trackxyz_example.g2o").read_text().replace("OFFSET 0", "OFFSET 6")
    with pytest.raises(ScenarioError, match=r"offset 0, .* add the line: PARAMS_SE3OFFSET 0 0 0"):
        read_g2o(written(tmp_path, text))


def test_sensor_offset_defined_twice(tmp_path):
    text = wheel("edge_se3_trackxyz_example.g2o").read_text()
    assert read_g2o(written(tmp_path, text + "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\n")).graph.size()
    with pytest.raises(ScenarioError, match=r":6: PARAMS_SE3OFFSET 0 stands with another .*:4"):
        read_g2o(written(tmp_path, text + "PARAMS_SE3OFFSET 0 9 0 0 0 0 0 1\n"))


def test_files_that_are_not_there_or_not_g2o(tmp_path):
    with pytest.raises(ScenarioError, match=r"none\.g2o: cannot be read as text.*No such file"):
        read_g2o(tmp_path / "none.g2o")
    with pytest.raises(ScenarioError, match="is it a g2o file"):
        read_g2o(written(tmp_path, "# nothing\n\n"))
    binary = tmp_path / "binary.g2o"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="cannot be read as text"):
        read_g2o(binary)
    with pytest.raises(ScenarioError, match="at least one file"):
        read_g2o([])


@pytest.mark.parametrize(
    ("path", "character"),
    [
        (DATA / "smallGrid3D.g2o", None),
        (DATA / "ais2klinik_first_150.g2o", None),
        (wheel("known_landmark_localization_20.g2o"), "l"),
        (ARGOS, None),
    ],
)
def test_written_file_reads_back_the_same(tmp_path, path, character):
    first = read_g2o(path, character)
    out = tmp_path / "out.g2o"
    write_g2o(out, first.graph, first.values, first.fixed)
    second = read_g2o(out)
    assert second.fixed == first.fixed
    assert second.graph.size() == first.graph.size()
    assert second.values.equals(first.values, 1e-12)
    moved = first.values.retract(_random_tangent(first.values))
    want = first.graph.error(moved)
    assert second.graph.error(moved) == pytest.approx(want, rel=1e-9)


def test_planar_landmarks_are_written_and_read_back(tmp_path):
    first = read_g2o(written(tmp_path, PLANAR))
    write_g2o(tmp_path / "b.g2o", first.graph, first.values, [0])
    second = read_g2o(tmp_path / "b.g2o")
    assert second.counts == first.counts
    moved = first.values.retract(_random_tangent(first.values))
    assert second.graph.error(moved) == pytest.approx(first.graph.error(moved), rel=1e-12)


def test_what_g2o_cannot_hold_is_refused(tmp_path):
    first = read_g2o(written(tmp_path, PLANAR))
    graph = gtsam.NonlinearFactorGraph(first.graph)
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), gtsam.noiseModel.Unit.Create(3)))
    with pytest.raises(InvalidInputError, match=r"factor 2: .* PriorFactorPose2; pass its key as"):
        write_g2o(tmp_path / "c.g2o", graph, first.values)
    lost = gtsam.Values(first.values)
    lost.update(1, gtsam.Pose2(np.nan, 0.0, 0.0))
    with pytest.raises(InvalidInputError, match="value of 1: expected finite numbers"):
        write_g2o(tmp_path / "c.g2o", first.graph, lost)
    with pytest.raises(InvalidInputError, match="fixed key 9 is not in the values"):
        write_g2o(tmp_path / "c.g2o", first.graph, first.values, [9])
    robust = gtsam.NonlinearFactorGraph()
    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.0)
    noise = gtsam.noiseModel.Robust.Create(huber, gtsam.noiseModel.Unit.Create(3))
    robust.add(gtsam.BetweenFactorPose2(0, 1, gtsam.Pose2(), noise))
    with pytest.raises(InvalidInputError, match="factor 0: g2o has no line for Robust noise"):
        write_g2o(tmp_path / "c.g2o", robust, first.values)
    values = gtsam.Values(first.values)
    values.insert(12, gtsam.Rot2(0.1))
    with pytest.raises(InvalidInputError, match="value of 12: g2o knows Pose2, Pose3"):
        write_g2o(tmp_path / "c.g2o", first.graph, values)
    with pytest.raises(ScenarioError, match="cannot be written"):
        write_g2o(tmp_path / "no" / "such" / "folder.g2o", first.graph, first.values)


def test_folder_of_ten_robots():
    read = read_g2o(ARGOS_FOLDER, repeat_tolerance=1e-5)
    assert [path.name for path in read.files] == [f"{robot}.g2o" for robot in range(10)]
    assert read.left_out == ()
    assert read.counts == {"EDGE_SE3:QUAT": 1596, "VERTEX_SE3:QUAT": 1070}
    assert (read.graph.size(), read.repeated, read.same_ends) == (1370, 226, 0)
    ends = [read.graph.at(index).keys() for index in range(1370)]
    assert sum(first >> 56 != second >> 56 for first, second in ends) == 310
    assert all(len(files) == 1 for files in read.vertex_files.values())
    # Without the tolerance 16 edges that differ in their sixth digit stand twice, and it says so.
    exact = read_g2o(ARGOS_FOLDER)
    assert (exact.graph.size(), exact.repeated, exact.same_ends) == (1386, 210, 16)


def team_files(tmp_path, robots=12, steps=4):
    """A planar team, one file a robot, each edge between two robots in both files."""
    rng = np.random.default_rng(3)
    lines = {robot: [] for robot in range(robots)}
    triangle = "100 0 0 100 0 400"
    for robot in range(robots):
        letter = chr(ord("a") + robot)
        for step in range(steps):
            x, y, heading = rng.normal(size=3)
            lines[robot].append(f"VERTEX_SE2 {symbol(letter, step)} {x} {y} {heading}")
        for step in range(steps - 1):
            edge = f"{symbol(letter, step)} {symbol(letter, step + 1)} 1 {rng.normal()} 0.1"
            lines[robot].append(f"EDGE_SE2 {edge} {triangle}")
    shared = []
    for robot in range(robots - 1):
        first, second = (symbol(chr(ord("a") + robot + i), 1 + i) for i in (0, 1))
        edge = f"EDGE_SE2 {first} {second} {rng.normal()} 0 0.2 {triangle}"
        shared.append(edge)
        lines[robot].append(edge)
        lines[robot + 1].append(edge)
    folder = tmp_path / "team"
    folder.mkdir()
    for robot, content in lines.items():
        (folder / f"robot_{robot}.g2o").write_text("\n".join(content) + "\n")
    whole = dict.fromkeys(line for content in lines.values() for line in content)
    return folder, "\n".join(whole) + "\n"


def test_parts_by_robot_are_the_whole_graph(tmp_path):
    folder, whole = team_files(tmp_path)
    parts = read_g2o(folder)
    assert [path.name for path in parts.files] == [f"robot_{robot}.g2o" for robot in range(12)]
    one = read_g2o(written(tmp_path, whole))
    assert parts.repeated == 11
    assert one.graph.size() == parts.graph.size() == 12 * 3 + 11
    assert parts.values.equals(one.values, 0.0)
    moved = one.values.retract(_random_tangent(one.values))
    assert parts.graph.error(moved) == pytest.approx(one.graph.error(moved), rel=1e-12)
    assert parts.vertex_files[symbol("c", 0)] == (2,)


@pytest.mark.parametrize("name", ["fullGraph.g2o", "full_graph.g2o", "full.g2o"])
def test_whole_graph_beside_its_parts_is_left_out_and_named(tmp_path, name):
    folder, whole = team_files(tmp_path, robots=2)
    (folder / name).write_text(whole)
    read = read_g2o(folder)
    assert read.left_out == (folder / name,)
    assert read.graph.size() == 7
    for part in read.files:
        part.unlink()
    alone = read_g2o(folder)
    assert (alone.files, alone.left_out) == ((folder / name,), ())
    assert alone.graph.size() == 7


def test_folder_without_g2o(tmp_path):
    with pytest.raises(ScenarioError, match=r"expected \*\.g2o files in this folder, found none"):
        read_g2o(tmp_path)
