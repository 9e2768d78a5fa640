"""Each way to be ill-posed, tested on the words that a user would read."""

import gtsam
import numpy as np
import pytest
from gtsam import symbol

from fgplan.beliefs.belief import Belief
from fgplan.beliefs.diagnosis import connected_components
from fgplan.errors import IllPosedBeliefError

X = [symbol("x", step) for step in range(8)]
Y = [symbol("y", step) for step in range(8)]
L = [symbol("l", index) for index in range(4)]


def unit(dim):
    return gtsam.noiseModel.Isotropic.Sigma(dim, 0.1)


def chain(keys, graph=None, values=None, offset=0.0):
    graph = gtsam.NonlinearFactorGraph() if graph is None else graph
    values = gtsam.Values() if values is None else values
    for step, key in enumerate(keys):
        values.insert(key, gtsam.Pose2(step, offset, 0.1 * step))
        if step:
            move = values.atPose2(keys[step - 1]).between(values.atPose2(key))
            graph.add(gtsam.BetweenFactorPose2(keys[step - 1], key, move, unit(3)))
    return graph, values


def with_prior(graph, key, pose=None):
    graph.add(gtsam.PriorFactorPose2(key, pose or gtsam.Pose2(), unit(3)))
    return graph


def message(graph, values):
    """The words of the error, whether structure or numbers found it."""
    with pytest.raises(IllPosedBeliefError) as caught:
        Belief(graph, values).covariance(values.keys()[0])
    return str(caught.value)


def test_no_prior_anywhere_is_gauge_freedom():
    words = message(*chain(X[:4]))
    assert "no factor fixes the world frame: all 4 variables (x0, x1, x2, x3)" in words
    assert "gauge freedom" in words
    assert "Add a PriorFactorPose2 on x0: graph.add(gtsam.PriorFactorPose2(x0, value, noise))" in (
        words
    )


def test_the_same_in_space_names_the_prior_of_space():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for step in (0, 1):
        values.insert(X[step], gtsam.Pose3())
    graph.add(gtsam.BetweenFactorPose3(X[0], X[1], gtsam.Pose3(), unit(6)))
    assert "Add a PriorFactorPose3 on x0" in message(graph, values)


def test_component_without_absolute_factor_names_both_components():
    graph, values = chain(X[:3])
    with_prior(graph, X[0])
    chain(Y[:3], graph, values, offset=5.0)
    words = message(graph, values)
    assert "1 of 2 connected components of the graph has no absolute factor" in words
    assert "the 3 variables y0, y1, y2 could move together" in words
    assert "nothing connects them to x0, x1, x2" in words
    assert "Add a PriorFactorPose2 on y0, or a factor between the components (an encounter" in words


def test_two_loose_components_are_counted():
    graph, values = chain(X[:2])
    chain(Y[:2], graph, values)
    assert "2 of 2 connected components of the graph have no absolute factor" in message(
        graph, values
    )


def test_landmarks_tied_to_no_robot():
    graph, values = chain(X[:2])
    with_prior(graph, X[0])
    for index in (0, 1):
        values.insert(L[index], gtsam.Point2(index, 1.0))
    graph.add(gtsam.BetweenFactorPoint2(L[0], L[1], gtsam.Point2(1.0, 0.0), unit(2)))
    words = message(graph, values)
    assert "the 2 landmarks, tied to no robot, l0, l1 could move together" in words
    assert "Add a PriorFactorPoint2 on l0" in words


def test_variable_in_no_factor():
    graph, values = chain(X[:3])
    with_prior(graph, X[0])
    values.insert(L[2], gtsam.Point2(1.0, 1.0))
    words = message(graph, values)
    assert "variable l2 (Point2) is in the values but in no factor" in words
    assert "add a PriorFactorPoint2 on l2, or a factor that measures it, or leave it out" in words


def seen(kind):
    graph, values = chain(X[:3])
    with_prior(graph, X[0])
    values.insert(L[1], gtsam.Point2(1.0, 3.0))
    add = {
        "range": lambda x: gtsam.RangeFactor2D(x, L[1], 3.0, unit(1)),
        "bearing": lambda x: gtsam.BearingFactor2D(x, L[1], gtsam.Rot2(0.5), unit(1)),
    }[kind]
    graph.add(add(X[1]))
    return graph, values, add


def test_landmark_seen_once_by_range():
    graph, values, add = seen("range")
    words = message(graph, values)
    assert "landmark l1 (Point2) has 2 dimensions but is touched only once, by factor 3" in words
    assert "(RangeFactor2D on x1, l1): 1 number in all" in words
    assert "A range leaves the bearing open: add a second range from another place, a bearing" in (
        words
    )
    assert "or a PriorFactorPoint2 on l1" in words
    graph.add(add(X[2]))
    assert Belief(graph, values).covariance(L[1]).shape == (2, 2)


def test_landmark_seen_once_by_bearing():
    graph, values, add = seen("bearing")
    words = message(graph, values)
    assert "A bearing leaves the distance open: add a second bearing from another place" in words
    assert "or a PriorFactorPoint2 on l1" in words
    graph.add(add(X[2]))
    assert Belief(graph, values).covariance(L[1]).shape == (2, 2)


def test_landmark_in_space_seen_once_by_bearing():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(X[0], gtsam.Pose3())
    values.insert(L[0], gtsam.Point3(1.0, 2.0, 3.0))
    graph.add(gtsam.PriorFactorPose3(X[0], gtsam.Pose3(), unit(6)))
    graph.add(gtsam.BearingFactor3D(X[0], L[0], gtsam.Unit3(np.array([1.0, 2.0, 3.0])), unit(2)))
    words = message(graph, values)
    assert "landmark l0 (Point3) has 3 dimensions" in words
    assert "2 numbers in all. A bearing leaves the distance open" in words


def test_landmark_seen_twice_by_range_from_one_place_is_found_by_numbers():
    graph, values, add = seen("range")
    graph.add(add(X[1]))
    words = message(graph, values)
    assert "landmark l1 (Point2) could move along [" in words
    assert "is touched only by 2 RangeFactor2D, all with x1" in words
    assert "add a second range from another place" in words


def test_landmark_on_the_robot_leaves_the_bearing_without_gradient():
    # Bearing at zero distance: GTSAM gives a zero Jacobian without a word.
    graph, values = chain(X[:2])
    with_prior(graph, X[0])
    values.insert(L[0], gtsam.Point2(0.0, 0.0))
    graph.add(gtsam.BearingRangeFactor2D(X[0], L[0], gtsam.Rot2(), 1.0, unit(2)))
    words = message(graph, values)
    assert "landmark l0 (Point2) could move along" in words
    assert "Add a PriorFactorPoint2 on l0" in words


def test_prior_on_position_only_leaves_the_heading_open():
    graph, values = chain(X[:4])
    graph.add(gtsam.PoseTranslationPrior2D(X[0], gtsam.Pose2(), unit(2)))
    words = message(graph, values)
    assert "1 direction not determined: the 4 variables x0, x1, x2, x3 could move together" in words
    assert "the absolute factors among them, factor 3 (PoseTranslationPrior2D on x0)" in words
    assert "Add a PriorFactorPose2 on x0" in words


def test_robot_that_hangs_on_the_team_by_one_range():
    graph, values = chain(X[:3])
    with_prior(graph, X[0])
    chain(Y[:3], graph, values, offset=4.0)
    graph.add(gtsam.RangeFactorPose2(X[1], Y[1], 4.0, unit(1)))
    words = message(graph, values)
    assert "2 directions not determined" in words
    assert "y0, y1, y2 could move together" in words
    assert "they hang on the rest by factor 5 (RangeFactorPose2 on x1, y1) only" in words
    assert "Add a PriorFactorPose2 on y0" in words


def test_custom_relative_factor_is_left_to_the_numbers():
    # Its type says nothing, so only the rank can: a difference of headings.
    def difference(_, values, jacobians):
        if jacobians is not None:
            jacobians[0] = -np.eye(3)
            jacobians[1] = np.eye(3)
        return np.zeros(3)

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key in X[:2]:
        values.insert(key, gtsam.Pose2())
    graph.add(gtsam.CustomFactor(unit(3), X[:2], difference))
    words = message(graph, values)
    assert "3 directions not determined: the 2 variables x0, x1 could move together" in words
    assert "factor 0 (CustomFactor on x0, x1), leave that open" in words


def test_well_posed_belief_is_silent():
    graph, values = chain(X[:4])
    with_prior(graph, X[2])
    assert Belief(graph, values).covariance(X[0]).shape == (3, 3)


def test_connected_components_are_sorted():
    graph, values = chain(X[:2])
    with_prior(graph, X[0])
    chain(Y[:2], graph, values)
    with_prior(graph, Y[0])
    belief = Belief(graph, values)
    assert connected_components(belief.keys, belief.views) == [X[:2], Y[:2]]
