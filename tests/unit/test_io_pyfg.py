"""PyFactorGraph text: every line becomes the factor that it says, or an error that names it."""

from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam import symbol

from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.io.pyfg import read_pyfg, write_pyfg

PLANAR = """VERTEX_SE2 1.5 A0 0 0 0.1
VERTEX_SE2 2.5 A1 1 0.5 0.2
VERTEX_SE2 2.75 B0 4 5 -3
VERTEX_XY L0 2 3
# a comment
VERTEX_SE2:PRIOR 1.5 A0 0.1 0.2 0.3 4 0.1 0.2 9 0.3 16
VERTEX_XY:PRIOR 0 L0 2 3.5 4 1 9
EDGE_SE2 2.5 A0 A1 1 0.4 0.1 0.04 0.001 0.002 0.09 0.003 0.0004
EDGE_RANGE 2.5 A1 L0 2.6 0.25
EDGE_RANGE 2.75 A1 B0 5.4 0.36
EDGE_SE2_XY 2.6 A1 L0 1.5 2.5 0.04 0.01 0.09
"""
TRIANGLE = np.eye(6) + 0.05 * np.arange(36).reshape(6, 6) / 36
SYMMETRIC = TRIANGLE + TRIANGLE.T
SIX = " ".join(repr(float(x)) for x in SYMMETRIC[np.triu_indices(6)])
SPATIAL = f"""VERTEX_SE3:QUAT 0 A0 1 2 3 0 0 0 1
VERTEX_SE3:QUAT 1 A1 2 2 3 0 0.6 0 0.8
VERTEX_XYZ L0 5 5 5
VERTEX_SE3:QUAT:PRIOR 0 A0 1 2 3 0 0 0 1 {SIX}
VERTEX_XYZ:PRIOR 0 L0 5 5 5 1 0 0 1 0 1
EDGE_SE3:QUAT 1 A0 A1 1 0 0 0 0.6 0 0.8 {SIX}
EDGE_SE3_XYZ 1 A1 L0 3 3 1 1 0.1 0.2 2 0.3 3
EDGE_RANGE 1 A1 L0 4.5 0.04
EDGE_RANGE 1 A1 A0 1.1 0.04
"""
A0, A1, B0, L0 = symbol("A", 0), symbol("A", 1), symbol("B", 0), symbol("L", 0)


def written(tmp_path, text):
    path = tmp_path / "a.pyfg"
    path.write_text(text)
    return path


def wheel(name):
    return Path(gtsam.findExampleDataFile(name))


def moved(values):
    rng = np.random.default_rng(0)
    delta = gtsam.VectorValues()
    for key, dim in sorted(values.dims().items()):
        delta.insert(key, 0.1 * rng.normal(size=dim))
    return values.retract(delta)


def test_planar_file(tmp_path):
    read = read_pyfg(written(tmp_path, PLANAR))
    assert read.times_s == {A0: 1.5, A1: 2.5, B0: 2.75}
    assert read.stamps_s == (1.5, 0.0, 2.5, 2.5, 2.75, 2.6)
    assert sum(read.counts.values()) == 10
    assert read.counts["EDGE_RANGE"] == 2
    assert read.values.atPose2(A1).equals(gtsam.Pose2(1, 0.5, 0.2), 0.0)
    np.testing.assert_array_equal(read.values.atPoint2(L0), [2, 3])
    prior, landmark, between, seen, met, sighting = (read.graph.at(i) for i in range(6))
    want = [[4, 0.1, 0.2], [0.1, 9, 0.3], [0.2, 0.3, 16]]
    np.testing.assert_allclose(prior.noiseModel().covariance(), want, rtol=1e-12)
    assert prior.prior().equals(gtsam.Pose2(0.1, 0.2, 0.3), 0.0)
    np.testing.assert_allclose(landmark.noiseModel().covariance(), [[4, 1], [1, 9]], rtol=1e-12)
    assert between.keys() == [A0, A1]
    assert between.measured().equals(gtsam.Pose2(1, 0.4, 0.1), 0.0)
    assert isinstance(seen, gtsam.RangeFactor2D)
    assert isinstance(met, gtsam.RangeFactorPose2)
    assert (seen.measured(), met.measured()) == (2.6, 5.4)
    # 0.5 (e / sigma)^2 by hand: |(4, 5) - (1, 0.5)| - 5.4 with variance 0.36
    residual = np.hypot(3.0, 4.5) - 5.4
    assert met.error(read.values) == pytest.approx(0.5 * residual**2 / 0.36, rel=1e-12)
    assert sighting.measured().range() == pytest.approx(np.hypot(1.5, 2.5), rel=1e-15)


def test_spatial_file_orders_translation_before_rotation(tmp_path):
    read = read_pyfg(written(tmp_path, SPATIAL))
    prior, _, between, sighting, seen, met = (read.graph.at(i) for i in range(6))
    swapped = SYMMETRIC[np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])]
    for factor in (prior, between):
        np.testing.assert_allclose(factor.noiseModel().covariance(), swapped, rtol=1e-12)
    assert between.measured().translation().tolist() == [1, 0, 0]
    assert isinstance(sighting, gtsam.BearingRangeFactor3D)
    assert isinstance(seen, gtsam.RangeFactor3D)
    assert isinstance(met, gtsam.RangeFactorPose3)


def test_landmark_before_pose_is_the_same_range(tmp_path):
    turned = PLANAR.replace("2.5 A1 L0 2.6", "2.5 L0 A1 2.6")
    have, want = (read_pyfg(written(tmp_path, text)).graph for text in (turned, PLANAR))
    assert have.at(3).keys() == want.at(3).keys() == [A1, L0]


@pytest.mark.parametrize("text", [PLANAR, SPATIAL, "goats_15.pyfg", "goats_16.pyfg"])
def test_written_file_reads_back_the_same(tmp_path, text):
    path = wheel(text) if text.endswith("pyfg") else written(tmp_path, text)
    first = read_pyfg(path)
    write_pyfg(tmp_path / "b.pyfg", first.graph, first.values, first.times_s, first.stamps_s)
    second = read_pyfg(tmp_path / "b.pyfg")
    assert second.counts == first.counts
    assert second.times_s == first.times_s
    assert second.stamps_s == first.stamps_s
    assert second.values.equals(first.values, 1e-12)
    elsewhere = moved(first.values)
    assert second.graph.error(elsewhere) == pytest.approx(first.graph.error(elsewhere), rel=1e-9)


def test_counts_of_the_log_in_the_wheel():
    read = read_pyfg(wheel("goats_15.pyfg"))
    lines = [line.split()[0] for line in wheel("goats_15.pyfg").read_text().splitlines()]
    assert read.counts == {tag: lines.count(tag) for tag in sorted(set(lines))}
    assert read.graph.size() == 472 + 786
    assert read.values.size() == 473 + 3


def test_stamps_left_out_are_those_of_the_last_pose(tmp_path):
    first = read_pyfg(written(tmp_path, PLANAR))
    write_pyfg(tmp_path / "b.pyfg", first.graph, first.values, first.times_s)
    assert read_pyfg(tmp_path / "b.pyfg").stamps_s == (1.5, 0.0, 2.5, 2.5, 2.75, 2.5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("VERTEX_XY L0", "VERTEX_POINT L0", r"a\.pyfg:4: unknown tag VERTEX_POINT; known are.*#"),
        ("VERTEX_XY L0 2 3", "VERTEX_XY L0 2", r":4: VERTEX_XY has 1 name and 2 numbers, got 2 f"),
        ("0.25\n", "\n", r":9: EDGE_RANGE has a time, 2 names and 2 numbers, got 4 fields; is the"),
        ("VERTEX_SE2 1.5 A0", "VERTEX_SE2 soon A0", r":1: VERTEX_SE2: expected numbers, got soon"),
        ("VERTEX_SE2 1.5 A0", "VERTEX_SE2 nan A0", r":1: VERTEX_SE2: expected finite numbers"),
        ("VERTEX_SE2 1.5 A0", "VERTEX_SE2 1.5 7", r":1: VERTEX_SE2: expected a name of a letter"),
        ("VERTEX_XY L0", f"VERTEX_XY L{'1' * 5000}", r":4: VERTEX_XY: expected a name of a letter"),
        ("VERTEX_XY L0", "VERTEX_XY L\u0661", r":4: VERTEX_XY: expected a name of a letter"),
        ("VERTEX_XY L0", f"VERTEX_XY L{2**48}", r":4: VERTEX_XY: expected a number below 2\*\*48"),
        ("VERTEX_SE2 2.5 A1", "VERTEX_SE2 2.5 A0", r":2: VERTEX_SE2 A0 stands at .*:1 already"),
        ("2.5 A0 A1", "2.5 A0 A7", r":8: EDGE_SE2 names A7, which the file does not define"),
        ("2.5 A0 A1", "2.5 A0 A0", r":8: EDGE_SE2 joins A0 to itself"),
        ("2.5 A0 A1", "2.5 A0 L0", r":8: EDGE_SE2 expects a VERTEX_SE2, but L0 is the VERTEX_XY"),
        ("0.04 0.001", "0.04 9", r":8: EDGE_SE2: expected a positive definite covariance.*informa"),
        ("2.6 0.25", "-2.6 0.25", r":9: EDGE_RANGE: expected metres and variance above zero"),
        ("2.6 0.25", "2.6 0", r":9: EDGE_RANGE: expected metres and variance above zero"),
        ("A1 B0 5.4", "B0 B0 5.4", r":10: EDGE_RANGE joins B0 to itself"),
        ("A1 L0 1.5 2.5", "A1 L0 0 0", r":11: EDGE_SE2_XY: a landmark at distance zero"),
        ("A1 L0 1.5 2.5", "A1 B0 1.5 2.5", r":11: EDGE_SE2_XY expects a VERTEX_XY, but B0"),
        ("VERTEX_SE2:PRIOR 1.5 A0", "VERTEX_SE2:PRIOR 1.5 L0", r":6: VERTEX_SE2:PRIOR expects a"),
    ],
)
def test_malformed_lines_name_file_line_tag_and_remedy(tmp_path, old, new, words):
    assert old in PLANAR
    with pytest.raises(ScenarioError, match=words):
        read_pyfg(written(tmp_path, PLANAR.replace(old, new, 1)))


def test_other_ranges_quaternions_and_empty_files(tmp_path):
    two = "VERTEX_XY L0 0 0\nVERTEX_XY L1 1 1\nEDGE_RANGE 0 L0 L1 1 1\n"
    with pytest.raises(ScenarioError, match=r":3: EDGE_RANGE expects a pose and a landmark or two"):
        read_pyfg(written(tmp_path, two))
    with pytest.raises(ScenarioError, match=r":2: VERTEX_SE3:QUAT: expected a unit quaternion"):
        read_pyfg(written(tmp_path, SPATIAL.replace("0 0.6 0 0.8", "0 0.6 0 0.9", 1)))
    with pytest.raises(ScenarioError, match=r"got none; is it a \.pyfg file"):
        read_pyfg(written(tmp_path, "\n"))


def test_what_the_format_cannot_hold_is_refused(tmp_path):
    read = read_pyfg(written(tmp_path, PLANAR))
    out = tmp_path / "b.pyfg"

    def refused(words, factor=None, values=read.values, times=read.times_s, stamps=None):
        graph = gtsam.NonlinearFactorGraph(read.graph)
        if factor is not None:
            graph.add(factor)
        with pytest.raises(InvalidInputError, match=words):
            write_pyfg(out, graph, values, times, stamps)
        assert not out.exists()

    one = gtsam.noiseModel.Isotropic.Sigma(1, 1.0)
    offset = gtsam.RangeFactorWithTransform2D(A0, L0, 1.0, one, gtsam.Pose2(1, 0, 0))
    refused("factor 6: the format has no line for a RangeFactorWithTransform2D", offset)
    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.0)
    refused(
        "factor 6: the format has no line for Robust noise",
        gtsam.RangeFactor2D(A0, L0, 1.0, gtsam.noiseModel.Robust.Create(huber, one)),
    )
    refused("factor 6: A9 is not in the values", gtsam.RangeFactor2D(symbol("A", 9), L0, 1.0, one))
    refused("expected a stamp a factor, 6, got 1", stamps=[0.0])
    refused("expected a time of pose B0", times={A0: 0.0, A1: 0.0})
    refused("time of pose A0: expected finite", times={**read.times_s, A0: np.nan})
    refused("factor 0: expected finite numbers", stamps=[np.inf, *read.stamps_s[1:]])
    lost = gtsam.Values(read.values)
    lost.update(A1, gtsam.Pose2(np.nan, 0.0, 0.0))
    refused("value of A1: expected finite numbers", values=lost)
    plain, turned = gtsam.Values(read.values), gtsam.Values(read.values)
    plain.insert(3, gtsam.Point2(0, 0))
    refused("expected keys of a letter and a number.* got 3", values=plain)
    turned.insert(symbol("R", 0), gtsam.Rot2(0.1))
    refused("value of R0: expected Pose2, Pose3, Point2 or Point3", values=turned)
