import subprocess
import sys
from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam import symbol

from fgplan.beliefs.belief import REMEMBERED, Belief
from fgplan.errors import InvalidInputError, UnknownNameError

X = [symbol("x", step) for step in range(20)]
L1 = symbol("l", 1)
B3 = gtsam.LabeledSymbol(ord("b"), ord("B"), 3).key()


def sigmas(*values):
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))


def planar(count=6, landmark=True, loop=True):
    """A planar robot with odometry, a loop closure, a bearing-range landmark, a second robot."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pose = gtsam.Pose2(1.0, 2.0, 0.5)
    graph.add(gtsam.PriorFactorPose2(X[0], pose, sigmas(0.1, 0.2, 0.05)))
    values.insert(X[0], pose)
    for step in range(1, count):
        move = gtsam.Pose2(1.0, 0.1, 0.3)
        graph.add(gtsam.BetweenFactorPose2(X[step - 1], X[step], move, sigmas(0.1, 0.1, 0.02)))
        pose = pose.compose(gtsam.Pose2(1.0, 0.12, 0.28))
        values.insert(X[step], pose)
    if loop:
        move = values.atPose2(X[0]).between(pose)
        graph.add(gtsam.BetweenFactorPose2(X[0], X[count - 1], move, sigmas(0.3, 0.3, 0.1)))
    if landmark:
        values.insert(L1, gtsam.Point2(3.0, 5.0))
        for step in (1, 3):
            bearing, range_m = values.atPose2(X[step]).bearing(values.atPoint2(L1)), 2.5
            graph.add(gtsam.BearingRangeFactor2D(X[step], L1, bearing, range_m, sigmas(0.05, 0.1)))
        values.insert(B3, gtsam.Pose2(4.0, 4.0, -1.0))
        move = values.atPose2(X[2]).between(values.atPose2(B3))
        graph.add(gtsam.BetweenFactorPose2(X[2], B3, move, sigmas(1.0, 2.0, 0.3)))
    return graph, values


def spatial():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pose = gtsam.Pose3.Expmap(np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]))
    graph.add(gtsam.PriorFactorPose3(X[0], pose, sigmas(0.01, 0.02, 0.03, 0.1, 0.2, 0.3)))
    values.insert(X[0], pose)
    for step in range(1, 5):
        move = gtsam.Pose3.Expmap(np.array([0.1, -0.1, 0.2, 1.0, 0.0, 0.1]))
        pose = pose.compose(move)
        noise = sigmas(0.01, 0.01, 0.02, 0.1, 0.05, 0.05)
        graph.add(gtsam.BetweenFactorPose3(X[step - 1], X[step], move, noise))
        values.insert(X[step], pose)
    point = np.array([4.0, 5.0, 6.0])
    values.insert(L1, gtsam.Point3(point))
    for step in (0, 2, 4):
        seen = values.atPose3(X[step])
        graph.add(
            gtsam.BearingRangeFactor3D(
                X[step], L1, seen.bearing(point), seen.range(point), sigmas(0.05, 0.05, 0.1)
            )
        )
    return graph, values


def relative(have, want):
    return float(np.abs(have - want).max() / np.abs(want).max())


@pytest.mark.parametrize("problem", [planar, spatial])
def test_covariances_equal_gtsam_marginals(problem):
    graph, values = problem()
    belief = Belief(graph, values)
    oracle = gtsam.Marginals(graph, values)
    together = belief.marginal_covariances()
    assert tuple(together) == belief.keys == tuple(values.keys())
    for key in belief.keys:
        assert relative(belief.covariance(key), oracle.marginalCovariance(key)) < 1e-9
        assert relative(together[key], oracle.marginalCovariance(key)) < 1e-9
        assert belief.dim(key) == belief.covariance(key).shape[0]
    keys = [L1, X[4], X[0]]
    joint = oracle.jointMarginalCovariance(keys)
    want = np.block([[joint.at(a, b) for b in keys] for a in keys])
    assert relative(belief.covariance(keys), want) < 1e-9
    assert (
        relative(
            belief.covariance(X[4], [X[0], L1]),
            np.hstack([joint.at(X[4], X[0]), joint.at(X[4], L1)]),
        )
        < 1e-9
    )
    assert relative(belief.covariance([L1], X[4]), joint.at(L1, X[4])) < 1e-9
    np.testing.assert_allclose(
        belief.covariance(X[4], X[4]), belief.covariance(X[4]), rtol=1e-13, atol=1e-18
    )


@pytest.mark.parametrize("problem", [planar, spatial])
def test_covariances_equal_isam2_with_qr(problem):
    graph, values = problem()
    params = gtsam.ISAM2Params()
    params.setFactorization("QR")
    smoother = gtsam.ISAM2(params)
    smoother.update(graph, values)
    belief = Belief(graph, values)
    for key in belief.keys:
        assert relative(belief.covariance(key), smoother.marginalCovariance(key)) < 1e-9


@pytest.mark.parametrize("problem", [planar, spatial])
def test_square_root_information_is_upper_triangular_in_the_order_asked(problem):
    belief = Belief(*problem())
    for keys in ([X[3], X[0]], [X[0], X[3]], [L1, X[2], X[4]]):
        rows = belief.square_root_information(keys)
        assert (np.tril(rows, -1) == 0.0).all()
        assert (np.diag(rows) > 0.0).all()
        inverse = np.linalg.inv(rows)
        assert relative(inverse @ inverse.T, belief.covariance(keys)) < 1e-9
    assert belief.square_root_information(X[1]).shape == (belief.dim(X[1]),) * 2


def test_square_root_information_of_every_variable_is_the_whole_matrix():
    graph, values = planar()
    belief = Belief(graph, values)
    rows = belief.square_root_information(belief.keys)
    dense = belief.linear().jacobian(_ordering(belief.keys))[0]
    np.testing.assert_allclose(rows.T @ rows, dense.T @ dense, rtol=1e-10, atol=1e-9)


def _ordering(keys):
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    return ordering


@pytest.mark.parametrize("prior", [1e-6, 1e-3, 1.0, 1000.0])
def test_prior_of_any_magnitude(prior):
    # A lone prior moved by one step of odometry: cov' = Ad cov Ad' + Q, exactly.
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    move = gtsam.Pose2(1.0, 0.5, 0.3)
    graph.add(gtsam.PriorFactorPose2(X[0], gtsam.Pose2(), sigmas(prior, prior, 0.01)))
    graph.add(gtsam.BetweenFactorPose2(X[0], X[1], move, sigmas(1e-3, 1e-3, 1e-4)))
    values.insert(X[0], gtsam.Pose2())
    values.insert(X[1], move)
    adjoint = move.inverse().AdjointMap()
    start = np.diag([prior**2, prior**2, 1e-4])
    want = adjoint @ start @ adjoint.T + np.diag([1e-6, 1e-6, 1e-8])
    belief = Belief(graph, values)
    assert relative(belief.covariance(X[1]), want) < 1e-12
    assert relative(belief.covariance(X[0]), start) < 1e-12
    assert relative(belief.covariance(X[0], X[1]), start @ adjoint.T) < 1e-12


def test_pose_and_point_are_read_as_arrays():
    graph, values = planar()
    belief = Belief(graph, values)
    np.testing.assert_allclose(belief.pose(X[0]), [1.0, 2.0, 0.5], rtol=1e-15)
    np.testing.assert_array_equal(belief.point(L1), [3.0, 5.0])
    graph3, values3 = spatial()
    belief3 = Belief(graph3, values3)
    np.testing.assert_array_equal(belief3.pose(X[2]), values3.atPose3(X[2]).matrix())
    np.testing.assert_array_equal(belief3.point(L1), [4.0, 5.0, 6.0])
    assert not belief3.pose(X[2]).flags.writeable
    with pytest.raises(InvalidInputError, match=r"l1 is a Point2, not a pose.*Belief\.point"):
        belief.pose(L1)
    with pytest.raises(InvalidInputError, match=r"x0 is a Pose2, not a point.*Belief\.pose"):
        belief.point(X[0])


def test_unknown_key_lists_near_names():
    belief = Belief(*planar())
    for read in (belief.covariance, belief.dim, belief.pose, belief.square_root_information):
        with pytest.raises(UnknownNameError, match=r"key x9 .* of 8 variables; near names: x\d"):
            read(X[9])
    with pytest.raises(UnknownNameError, match="near names: bB3, l1, x0, x1, x2"):
        belief.covariance(X[0], 77)
    with pytest.raises(InvalidInputError, match="distinct keys, got x0, x0"):
        belief.covariance([X[0], X[0]])


def test_later_changes_of_the_users_graph_do_not_reach_the_belief():
    graph, values = planar()
    belief = Belief(graph, values)
    before = belief.digest()
    graph.add(gtsam.PriorFactorPose2(X[0], gtsam.Pose2(), sigmas(1.0, 1.0, 1.0)))
    values.update(X[0], gtsam.Pose2(9.0, 9.0, 0.0))
    belief.linear().add(
        gtsam.JacobianFactor(X[0], np.eye(3), np.zeros(3), gtsam.noiseModel.Unit.Create(3))
    )
    assert belief.pose(X[0])[0] == 1.0
    assert belief.digest() == before
    assert belief.linear().size() == belief.graph.size() == len(belief.views)


def test_eliminations_are_remembered_by_kept_keys_and_bounded():
    belief = Belief(*planar())
    first = belief.eliminated([X[2], X[1]])
    assert belief.eliminated([X[2], X[1]]) is first
    assert belief.eliminated([X[1], X[2]]) is not first
    for step in range(6):
        belief.square_root_information(X[step])
    assert len(belief.eliminations) == REMEMBERED
    want = belief.covariance(X[3])
    belief.eliminations.clear()
    np.testing.assert_allclose(belief.covariance(X[3]), want, rtol=1e-11, atol=1e-15)


def test_digest_is_of_the_content():
    graph, values = planar()
    digest = Belief(graph, values).digest()
    backwards = gtsam.NonlinearFactorGraph()
    for index in reversed(range(graph.size())):
        backwards.add(graph.at(index))
    assert Belief(backwards, values).digest() == digest
    moved = gtsam.Values(values)
    moved.update(X[3], values.atPose2(X[3]).retract(np.array([1e-9, 0.0, 0.0])))
    assert Belief(graph, moved).digest() != digest
    more = gtsam.NonlinearFactorGraph(graph)
    more.add(gtsam.PriorFactorPose2(X[0], values.atPose2(X[0]), sigmas(1.0, 1.0, 1.0)))
    assert Belief(more, values).digest() != digest


def test_digest_is_the_same_in_another_process():
    here = Path(__file__)
    code = (
        f"import sys; sys.path[:0] = [{str(here.parent)!r}, {str(here.parents[2])!r}]\n"
        "from test_beliefs_belief import Belief, planar, spatial\n"
        "print(Belief(*planar()).digest(), Belief(*spatial()).digest())"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == [Belief(*planar()).digest(), Belief(*spatial()).digest()]


def test_values_that_are_not_finite_are_refused_by_name():
    graph, values = planar()
    values.update(X[3], gtsam.Pose2(np.nan, 0.0, 0.0))
    with pytest.raises(InvalidInputError, match=r"value of x3 \(Pose2\): expected finite"):
        Belief(graph, values)
    graph, values = spatial()
    values.update(L1, gtsam.Point3(np.inf, 0.0, 0.0))
    with pytest.raises(InvalidInputError, match=r"value of l1 \(Point3\): expected finite"):
        Belief(graph, values)


def prior_with(noise, pose=None):
    graph, values = planar()
    graph.add(gtsam.PriorFactorPose2(X[2], pose or gtsam.Pose2(), noise))
    return graph, values


INDEFINITE = np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        (sigmas(0.1, np.nan, 0.1), "finite sigmas"),
        (sigmas(0.1, np.inf, 0.1), "finite sigmas"),
        (sigmas(0.1, 0.0, 0.1), r"above zero, .* hard constraint"),
        (gtsam.noiseModel.Constrained.All(3), r"above zero, .* hard constraint"),
        (gtsam.noiseModel.Gaussian.Covariance(np.diag([1.0, 0.0, 1.0])), "above zero"),
        (gtsam.noiseModel.Gaussian.Covariance(INDEFINITE), "positive definite"),
        (sigmas(0.1, 0.1, 1e10), r"up to 1e\+09"),
        (
            gtsam.noiseModel.Robust.Create(
                gtsam.noiseModel.mEstimator.Huber.Create(1.0), gtsam.noiseModel.Unit.Create(3)
            ),
            r"robust noise has no covariance.*noiseModel\(\)\.noise\(\)",
        ),
    ],
)
def test_noise_that_gtsam_accepts_is_refused_with_the_factor(noise, words):
    with pytest.raises(InvalidInputError, match=rf"factor 10 \(PriorFactorPose2 on x2\).*{words}"):
        Belief(*prior_with(noise))


def test_correlated_noise_is_accepted():
    noise = gtsam.noiseModel.Gaussian.Covariance(np.array([[2.0, 1, 0], [1, 2, 0], [0, 0, 1]]))
    assert Belief(*prior_with(noise)).covariance(X[2]).shape == (3, 3)


def test_measurement_that_is_not_finite_is_refused():
    bad = prior_with(sigmas(1.0, 1.0, 1.0), gtsam.Pose2(np.nan, 0.0, 0.0))
    with pytest.raises(
        InvalidInputError, match=r"factor 10 .* finite error at the values, got nan"
    ):
        Belief(*bad)


def test_factor_without_value_and_empty_slots_are_refused():
    graph, values = planar()
    values.erase(X[5])
    with pytest.raises(
        UnknownNameError, match=r"factor 5 \(BetweenFactorPose2 on x4, x5\): key x5"
    ):
        Belief(graph, values)
    graph, values = planar()
    graph.add(None)
    with pytest.raises(InvalidInputError, match="factor 10: the slot is empty"):
        Belief(graph, values)
    with pytest.raises(InvalidInputError, match="at least one factor"):
        Belief(gtsam.NonlinearFactorGraph(), values)


def test_value_of_another_type_than_the_factors_is_refused():
    graph, values = planar(landmark=False)
    values.erase(X[1])
    values.insert(X[1], gtsam.Point2(0.0, 0.0))
    with pytest.raises(InvalidInputError, match=r"key x1 holds a .* not a gtsam::Pose2"):
        Belief(graph, values)


def test_other_types_of_variable_are_carried_along():
    graph, values = planar()
    key = symbol("r", 0)
    values.insert(key, gtsam.Rot2(0.3))
    graph.add(gtsam.PriorFactorRot2(key, gtsam.Rot2(0.3), sigmas(0.2)))
    belief = Belief(graph, values)
    assert belief.kinds[key] == "other"
    assert belief.covariance(key)[0, 0] == pytest.approx(0.04, rel=1e-14)
    with pytest.raises(InvalidInputError, match="r0 is a other, not a pose"):
        belief.pose(key)


def test_linear_container_factors_have_no_noise_model_to_check():
    graph, values = planar()
    linear = gtsam.JacobianFactor(
        X[1], 2.0 * np.eye(3), np.zeros(3), gtsam.noiseModel.Unit.Create(3)
    )
    graph.add(gtsam.LinearContainerFactor(linear, values))
    belief = Belief(graph, values)
    gain = np.linalg.inv(belief.covariance(X[1])) - np.linalg.inv(
        Belief(*planar()).covariance(X[1])
    )
    np.testing.assert_allclose(gain, 4.0 * np.eye(3), atol=1e-8)
