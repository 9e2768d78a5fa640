import gtsam
import numpy as np
import pytest

from fgplan.errors import IllPosedBeliefError, InvalidInputError, UnknownNameError
from fgplan.factors.boundary import gtsam_boundary

X0, X1 = gtsam.symbol("x", 0), gtsam.symbol("x", 1)
AB3 = gtsam.LabeledSymbol(ord("a"), ord("B"), 3).key()


def two_poses():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
    graph.add(gtsam.BetweenFactorPose2(X0, X1, gtsam.Pose2(1, 0, 0), noise))
    values.insert(X0, gtsam.Pose2())
    values.insert(X1, gtsam.Pose2(1, 0, 0))
    return graph, values


def test_indeterminate_system_names_the_variable():
    graph, values = two_poses()
    with (
        pytest.raises(IllPosedBeliefError, match=r"marginals: variable x0 .* QR") as caught,
        gtsam_boundary("marginals"),
    ):
        gtsam.Marginals(graph, values)
    assert isinstance(caught.value.__cause__, RuntimeError)


def test_missing_key_in_values_is_named():
    with pytest.raises(UnknownNameError, match="reading: key x1 is not"), gtsam_boundary("reading"):
        gtsam.Values().atPose2(X1)


def test_map_at_and_bayes_tree_are_unknown_names():
    graph, values = two_poses()
    graph.add(gtsam.PriorFactorPose2(X0, gtsam.Pose2(), gtsam.noiseModel.Unit.Create(3)))
    marginals = gtsam.Marginals(graph, values)
    for query in (
        lambda: marginals.jointMarginalCovariance([77, X0]),
        lambda: marginals.marginalCovariance(77),
    ):
        with pytest.raises(UnknownNameError, match="not in the graph"), gtsam_boundary("joint"):
            query()


def test_wrong_type_names_key_and_both_types():
    _, values = two_poses()
    with (
        pytest.raises(InvalidInputError, match=r"x0 holds a gtsam::Pose2, not a .*Matrix"),
        gtsam_boundary("landmark"),
    ):
        values.atPoint2(X0)


def test_everything_else_is_invalid_input():
    with pytest.raises(InvalidInputError, match="noise: GTSAM refused"), gtsam_boundary("noise"):
        gtsam.noiseModel.Diagonal.Sigmas(np.array([-1.0]))


def test_fgplan_errors_pass_unchanged():
    with pytest.raises(UnknownNameError, match=r"^as it was$"), gtsam_boundary("x"):
        raise UnknownNameError("as it was")
