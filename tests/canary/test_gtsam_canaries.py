"""What GTSAM 4.3.0 does that fgplan relies on, or guards against: one small test a behaviour.

A failure here is not a bug of fgplan by itself: it says that the GTSAM pin moved something. Each
test names the part of fgplan to look at. "Relies": that part breaks or must change. "Guards": the
guard may have become unnecessary, or must be widened.
"""

import pickle

import gtsam
import numpy as np
import pytest
from gtsam import symbol

X0, X1, X2 = (symbol("x", step) for step in range(3))
SMALL = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)


def pair(prior=True):
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    if prior:
        graph.add(gtsam.PriorFactorPose2(X0, gtsam.Pose2(), SMALL))
    graph.add(gtsam.BetweenFactorPose2(X0, X1, gtsam.Pose2(1, 0, 0), SMALL))
    values.insert(X0, gtsam.Pose2())
    values.insert(X1, gtsam.Pose2(1, 0, 0))
    return graph, values


def chain(count):
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.02, 0.02, 0.05]))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), noise))
    for step in range(count):
        values.insert(step, gtsam.Pose2(step, 0, 0))
        if step:
            graph.add(gtsam.BetweenFactorPose2(step - 1, step, gtsam.Pose2(1, 0, 0), noise))
    return graph, values


# Elimination ----------------------------------------------------------------------------------


def test_marginals_throws_on_a_well_posed_long_chain():
    # Guards: beliefs/elimination.py exists because of this.
    graph, values = chain(1000)
    with pytest.raises(RuntimeError, match="Indeterminate linear system"):
        gtsam.Marginals(graph, values)


def test_sequential_elimination_is_wrong_on_a_long_chain_and_isam2_with_qr_is_right():
    # Guards: beliefs/elimination.py; oracle in tests/unit/test_beliefs_belief.py.
    graph, values = chain(1000)
    turn, shift = 1000 * 0.05**2, np.arange(1000) @ np.arange(1000) * 0.05**2
    exact = np.array([1000 * 0.02**2, 1000 * 0.02**2 + shift, turn])
    ordering = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(
        graph.linearize(values), [999]
    )
    last = graph.linearize(values).eliminateSequential(ordering).at(999)
    rough = np.linalg.inv(last.R().T @ last.R()).diagonal()
    params = gtsam.ISAM2Params()
    params.setFactorization("QR")
    smoother = gtsam.ISAM2(params)
    smoother.update(graph, values)
    right = smoother.marginalCovariance(999).diagonal()
    np.testing.assert_allclose(right, exact, rtol=1e-9)
    assert np.abs(rough / exact - 1.0).max() > 1e-8


def test_marginals_takes_no_factorization_argument():
    # Guards: were there one, Marginals with QR would be a second oracle.
    graph, values = pair()
    with pytest.raises(TypeError):
        gtsam.Marginals(graph, values, "QR")


def test_text_of_the_indeterminate_system():
    # Relies: factors/boundary.py recognises this text and the key in it.
    graph, values = pair(prior=False)
    with pytest.raises(RuntimeError) as caught:
        graph.linearize(values).optimize()
    assert "Indeterminate linear system" in str(caught.value)
    assert f"variable\n{X0}" in str(caught.value)
    assert not hasattr(gtsam, "IndeterminantLinearSystemException")
    assert not hasattr(gtsam, "IndeterminateSystemException")


def test_texts_of_missing_keys():
    # Relies: factors/boundary.py.
    graph, values = pair()
    with pytest.raises(RuntimeError, match='key "x2", which does not exist in the Values'):
        values.atPose2(X2)
    with pytest.raises(RuntimeError, match=r'key "x0", type stored in Values is .* but requested'):
        values.atPoint2(X0)
    marginals = gtsam.Marginals(graph, values)
    with pytest.raises(IndexError, match="not in the BayesTree"):
        marginals.marginalCovariance(X2)
    with pytest.raises(IndexError, match="map::at"):
        marginals.jointMarginalCovariance([X0, X2])


def test_joint_marginal_blocks_come_in_the_order_asked():
    # Relies: tests that read fullMatrix of the oracle.
    graph, values = pair()
    joint = gtsam.Marginals(graph, values).jointMarginalCovariance([X1, X0])
    full = joint.fullMatrix()
    np.testing.assert_array_equal(full[:3, :3], joint.at(X1, X1))
    np.testing.assert_array_equal(full[:3, 3:], joint.at(X1, X0))


def test_bayes_net_of_a_forest_is_not_in_the_given_order():
    # Guards: conditionals are picked by key (SquareRootFactor.position), never by place.
    graph = gtsam.GaussianFactorGraph()
    unit = gtsam.noiseModel.Unit.Create(1)
    for first, second in ((0, 2), (1, 3)):
        graph.add(first, np.eye(1), second, np.eye(1), np.zeros(1), unit)
        graph.add(second, np.eye(1), np.zeros(1), unit)
    ordering = gtsam.Ordering()
    for key in (0, 1, 2, 3):
        ordering.push_back(key)
    net = graph.eliminateSequential(ordering)
    order = [net.at(place).firstFrontalKey() for place in range(net.size())]
    assert sorted(order) == [0, 1, 2, 3]
    assert order != [0, 1, 2, 3]


def test_constrained_colamd_puts_keys_last_but_not_in_the_order_given():
    # Relies and guards: beliefs/elimination.py takes the keys out and appends them in order.
    graph, values = chain(30)
    orders = set()
    for last in ([3, 20, 11], [20, 11, 3], [11, 3, 20]):
        ordering = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(
            graph.linearize(values), last
        )
        keys = [ordering.at(place) for place in range(ordering.size())]
        assert set(keys[-3:]) == {3, 11, 20}
        orders.add(tuple(keys[-3:]) == tuple(last))
    assert False in orders


# Rows of a linear graph --------------------------------------------------------------------------


def test_sparse_jacobian_layout():
    # Relies: beliefs/whitened_rows.py. 1-based triplets; columns by ascending key although the
    # triplets of a row come in the factor's order of keys; b last; noise folded in.
    graph = gtsam.GaussianFactorGraph()
    noise = gtsam.noiseModel.Isotropic.Sigma(1, 0.5)
    graph.add(9, np.array([[3.0, 0.0]]), 4, np.array([[5.0]]), np.array([7.0]), noise)
    np.testing.assert_allclose(
        graph.sparseJacobian_(), [[1, 1, 1], [2, 1, 4], [6.0, 10.0, 14.0]], rtol=1e-15
    )


def test_sparse_jacobian_leaves_out_zeros_and_what_is_below_1e_12():
    # Relies: dims are asked for separately (whitened_rows), MAX_SIGMA in beliefs/noise_model.py.
    graph = gtsam.GaussianFactorGraph()
    unit = gtsam.noiseModel.Unit.Create(2)
    graph.add(4, np.array([[1e-13, 2.0], [0.0, 2e-12]]), np.zeros(2), unit)
    np.testing.assert_array_equal(graph.sparseJacobian_(), [[1, 2], [2, 2], [2.0, 2e-12]])


def test_values_know_dims_and_keys_ascending():
    # Relies: beliefs/belief.py.
    values = gtsam.Values()
    values.insert(X1, gtsam.Pose3())
    values.insert(X0, gtsam.Point2(1, 2))
    assert dict(values.dims()) == {X0: 2, X1: 6}
    assert list(values.keys()) == [X0, X1]


def test_vectors_of_two_and_three_are_points():
    # Relies: beliefs/belief.py tells Pose2 from Point3 by trying.
    values = gtsam.Values()
    values.insert(1, np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(values.atPoint3(1), [1.0, 2.0, 3.0])
    with pytest.raises(RuntimeError):
        values.atPose2(1)


@pytest.mark.parametrize("spatial", [False, True])
def test_between_jacobians_at_zero_error(spatial):
    # Relies: beliefs/candidate_belief.py and the engine's rows: whitened [-W Ad(h^-1), W].
    rng = np.random.default_rng(2)
    pose, dim = (gtsam.Pose3, 6) if spatial else (gtsam.Pose2, 3)
    factor = gtsam.BetweenFactorPose3 if spatial else gtsam.BetweenFactorPose2
    first, move = pose.Expmap(rng.normal(size=dim)), pose.Expmap(rng.normal(size=dim))
    root = rng.normal(size=(dim, dim))
    covariance = root @ root.T + np.eye(dim)
    covariance = 0.5 * (covariance + covariance.T)
    values = gtsam.Values()
    values.insert(X0, first)
    values.insert(X1, first.compose(move))
    graph = gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    graph.add(factor(X0, X1, move, noise))
    rows = graph.linearize(values).jacobian()[0]
    whiten = noise.R()
    np.testing.assert_allclose(whiten.T @ whiten @ covariance, np.eye(dim), atol=1e-12)
    np.testing.assert_allclose(rows[:, dim:], whiten, atol=1e-13)
    np.testing.assert_allclose(rows[:, :dim], -whiten @ move.inverse().AdjointMap(), atol=1e-12)


def test_pose3_tangent_is_rotation_first_and_on_the_right():
    # Relies: fgplan/typing.py, models/pose.py (adjoint, position_slice), io/g2o.py.
    pose = gtsam.Pose3(gtsam.Rot3.Yaw(np.pi / 2), np.array([1.0, 2.0, 3.0]))
    moved = pose.retract(np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]))
    np.testing.assert_allclose(moved.translation(), [1.0, 2.1, 3.0], atol=1e-15)
    turned = pose.retract(np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0]))
    assert turned.rotation().yaw() == pytest.approx(np.pi / 2 + 0.2)


def test_pose2_tangent_is_x_y_heading_and_on_the_right():
    # Relies: fgplan/typing.py, models/pose.py.
    start = gtsam.Pose2(1.0, 2.0, np.pi / 2)
    moved = start.retract(np.array([0.1, 0.0, 0.0]))
    assert (moved.x(), moved.y(), moved.theta()) == pytest.approx((1.0, 2.1, np.pi / 2))
    assert start.retract(np.array([0.0, 0.0, 0.3])).theta() == pytest.approx(np.pi / 2 + 0.3)


# Silent acceptances ------------------------------------------------------------------------------


def test_nan_and_infinite_sigmas_are_accepted():
    # Guards: beliefs/noise_model.py.
    for sigma in (np.nan, np.inf):
        model = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, sigma]))
        assert type(model) is gtsam.noiseModel.Diagonal


def test_nan_measurement_is_accepted_and_its_error_is_nan():
    # Guards: beliefs/belief.py checks the error of each factor.
    graph, values = pair()
    graph.add(gtsam.PriorFactorPose2(X0, gtsam.Pose2(np.nan, 0, 0), SMALL))
    assert np.isnan(graph.error(values))


def test_zero_sigma_becomes_a_hard_constraint():
    # Guards: beliefs/noise_model.py.
    model = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, 0.0]))
    assert model.isConstrained()
    assert isinstance(model, gtsam.noiseModel.Diagonal)
    singular = gtsam.noiseModel.Gaussian.Covariance(np.diag([1.0, 0.0]))
    assert singular.sigmas()[1] == 0.0


def test_off_diagonal_of_an_asymmetric_covariance_is_dropped():
    # Guards: fgplan/checks.py check_covariance; io/g2o.py symmetrises exactly.
    model = gtsam.noiseModel.Gaussian.Covariance(np.array([[1.0, 0.0], [0.5, 1.0]]))
    np.testing.assert_array_equal(model.covariance(), np.eye(2))


def test_indefinite_covariance_is_accepted_with_a_negative_diagonal_of_r():
    # Guards: beliefs/noise_model.py recognises it by this sign.
    model = gtsam.noiseModel.Gaussian.Covariance(np.array([[1.0, 2.0], [2.0, 1.0]]))
    assert model.R()[0, 0] < 0.0


def test_nan_covariance_becomes_a_unit_model():
    # Guards: nothing can see it afterwards; fgplan/checks.py check_covariance comes before.
    model = gtsam.noiseModel.Gaussian.Covariance(np.array([[1.0, np.nan], [np.nan, 1.0]]))
    assert isinstance(model, gtsam.noiseModel.Unit)


def test_negative_sigma_is_refused():
    # Relies: nothing of fgplan checks it a second time.
    with pytest.raises(ValueError, match="must be non-negative"):
        gtsam.noiseModel.Diagonal.Sigmas(np.array([-1.0, 1.0]))


def test_empty_slot_is_accepted():
    # Guards: beliefs/belief.py.
    graph, _ = pair()
    graph.add(None)
    assert graph.size() == 3
    assert graph.at(2) is None


def test_bearing_at_zero_distance_has_no_gradient():
    # Guards: the rank check (beliefs/diagnosis.py) and io/g2o.py's refusal of distance zero.
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(X0, gtsam.Pose2())
    values.insert(X1, gtsam.Point2(0.0, 0.0))
    graph.add(gtsam.BearingFactor2D(X0, X1, gtsam.Rot2(), gtsam.noiseModel.Unit.Create(1)))
    rows = graph.linearize(values).jacobian()[0]
    np.testing.assert_array_equal(rows, np.zeros((1, 5)))


def test_robust_noise_weighs_the_rows_by_the_values():
    # Guards: beliefs/noise_model.py refuses robust noise for this reason.
    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.0)
    noise = gtsam.noiseModel.Robust.Create(huber, gtsam.noiseModel.Unit.Create(3))
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose2(X0, gtsam.Pose2(4.0, 0, 0), noise))
    values.insert(X0, gtsam.Pose2())
    assert graph.linearize(values).jacobian()[0][0, 0] == pytest.approx(0.5)


def test_duplicate_keys_of_a_joint_marginal_are_collapsed():
    # Guards: Belief.covariance refuses a key that is asked for twice.
    graph, values = pair()
    joint = gtsam.Marginals(graph, values).jointMarginalCovariance([X1, X1])
    assert joint.fullMatrix().shape == (3, 3)


# iSAM2 -----------------------------------------------------------------------------------------


def test_isam2_removes_a_factor_twice_without_a_word():
    # Guards: beliefs/incremental_smoother.py keeps its own book of slots.
    graph, values = pair()
    extra = gtsam.NonlinearFactorGraph()
    extra.add(gtsam.PriorFactorPose2(X1, gtsam.Pose2(1, 0, 0), SMALL))
    smoother = gtsam.ISAM2()
    smoother.update(graph, values)
    index = smoother.update(extra, gtsam.Values()).getNewFactorsIndices()[0]
    params = gtsam.ISAM2UpdateParams()
    params.removeFactorIndices = [index]
    for _ in range(2):
        smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), params)
    want = gtsam.Marginals(graph, values).marginalCovariance(X1)
    np.testing.assert_allclose(smoother.marginalCovariance(X1), want, rtol=1e-9, atol=1e-15)


def test_isam2_is_unusable_after_an_indeterminate_update():
    # Guards: beliefs/incremental_smoother.py builds it anew.
    graph, values = pair(prior=False)
    smoother = gtsam.ISAM2()
    with pytest.raises(RuntimeError, match="Indeterminate"):
        smoother.update(graph, values)
    with pytest.raises(IndexError):
        smoother.marginalCovariance(X0)


# Keys, copies, pickles ---------------------------------------------------------------------------


def test_layout_of_symbols():
    # Relies: factors/keys.py.
    assert symbol("x", 12) == ord("x") << 56 | 12
    labelled = gtsam.LabeledSymbol(ord("a"), ord("B"), 3)
    assert labelled.key() == ord("a") << 56 | ord("B") << 48 | 3
    assert gtsam.DefaultKeyFormatter(5) == "5"
    # Why describe_key exists: GTSAM's own formatter does not know labels.
    assert gtsam.DefaultKeyFormatter(labelled.key()) != "aB3"


def test_copies_of_graph_and_values_are_independent():
    # Relies: Belief copies what the user passes in.
    graph, values = pair()
    graph_copy, values_copy = gtsam.NonlinearFactorGraph(graph), gtsam.Values(values)
    graph.add(gtsam.PriorFactorPose2(X1, gtsam.Pose2(), SMALL))
    values.update(X0, gtsam.Pose2(5, 0, 0))
    assert graph_copy.size() == 2
    assert values_copy.atPose2(X0).x() == 0.0


def test_what_can_be_pickled():
    # Relies: sweeps send graphs and values to workers; linear graphs are rebuilt there.
    graph, values = pair()
    assert pickle.loads(pickle.dumps(graph)).equals(graph, 0.0)
    assert pickle.loads(pickle.dumps(values)).equals(values, 0.0)
    with pytest.raises(RuntimeError, match="unregistered class"):
        pickle.dumps(graph.linearize(values))


def test_values_serialise_to_the_same_text():
    # Relies: Belief.digest.
    assert pair()[1].serialize() == pair()[1].serialize()


# g2o reader --------------------------------------------------------------------------------------

PLANAR = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\n{}EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"


@pytest.mark.parametrize(
    ("line", "edges"), [("", 1), ("FIX 0\n", 0), ("# comment\n", 0), ("FOO 1 2 3\n", 1)]
)
def test_g2o_reader_loses_edges_after_short_lines(tmp_path, line, edges):
    # Guards: io/g2o.py exists because of this.
    path = tmp_path / "a.g2o"
    path.write_text(PLANAR.format(line))
    assert gtsam.readG2o(str(path), False)[0].size() == edges


def test_g2o_reader_invents_missing_vertices(tmp_path):
    # Guards: io/g2o.py.
    path = tmp_path / "a.g2o"
    path.write_text("VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n")
    graph, values = gtsam.readG2o(str(path), False)
    assert (graph.size(), values.size()) == (1, 2)


def test_g2o_writer_to_nowhere_is_silent(tmp_path):
    # Guards: io/g2o.py write_g2o raises.
    graph, values = pair()
    gtsam.writeG2o(graph, values, str(tmp_path / "no" / "folder.g2o"))
    assert not (tmp_path / "no").exists()
