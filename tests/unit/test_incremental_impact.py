"""Which candidates an announcement reaches, in small worlds made by hand.

Robots a and b are 1 km apart and c stands with a; what joins them is named in each test: a tie of
the prior, a landmark, or a multi-robot factor.
"""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
import scenes

from fgplan.announcement.announcement import announcement_of, decode_message
from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError, NoCandidatePathError, UnknownNameError
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental import prior_marginal
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.incremental.preparation import FIRST_CAPACITY
from fgplan.evaluation.objective import (
    Objective,
    PathTerm,
    PosesOf,
    UncertaintyTerm,
    length_and_uncertainty,
)
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel

HERE, FAR, NEAR = (0.0, 0.0), (1000.0, 0.0), (0.0, 30.0)
ENGINE = Incremental()


def world(robots, *, landmarks=(), tied=(), objective=None, ties_to_landmarks=()):
    """Robots at positions, landmarks at positions, ties of the prior by name or by index."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    keys = {name: index for index, name in enumerate(robots)}
    loose = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, 1.0, 0.01]))
    for name, place in robots.items():
        pose = gtsam.Pose2(*place, 0.0)
        values.insert(keys[name], pose)
        graph.add(gtsam.PriorFactorPose2(keys[name], pose, loose))
    for first, second in tied:
        one, two = values.atPose2(keys[first]), values.atPose2(keys[second])
        graph.add(gtsam.BetweenFactorPose2(keys[first], keys[second], one.between(two), loose))
    for index, place in enumerate(landmarks):
        key, point = scenes.landmark_key(index), np.array(place)
        values.insert(key, point)
        noise = gtsam.noiseModel.Isotropic.Sigma(2, 5.0)
        graph.add(gtsam.PriorFactorPoint2(key, point, noise))
    for name, index in ties_to_landmarks:
        key = scenes.landmark_key(index)
        pose, point = values.atPose2(keys[name]), values.atPoint2(key)
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.02, 1.0]))
        graph.add(
            gtsam.BearingRangeFactor2D(
                keys[name], key, pose.bearing(point), pose.range(point), noise
            )
        )
    model = MultiRobotModel(
        criterion=DistanceCriterion(20.0),
        sensor=RelativePoseSensor(covariance=np.diag([1.0, 1.0, 1e-4])),
    )
    return PlanningProblem(
        prior=Belief(graph, values),
        start_keys=keys,
        objective=objective or length_and_uncertainty(tuple(robots)),
        multi_robot=(model,),
        sensors={"lidar": BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.1)},
    )


def path(problem, robot, points, seen=(), **options):
    """A path of one second a step; `seen` lists (step, landmark)."""
    start = problem.prior.pose(problem.start_keys[robot])
    places = np.array([start[:2], *points])
    way = np.diff(places, axis=0)
    poses = np.vstack([start, np.column_stack([places[1:], np.arctan2(way[:, 1], way[:, 0])])])
    return CandidatePath(
        robot=robot,
        poses=poses,
        times_s=np.arange(float(len(poses))),
        motion_covariances=np.tile(np.diag([0.25, 0.25, 1e-4]), (len(way), 1, 1)),
        observations=tuple(
            Observation(
                step=step,
                landmark=scenes.landmark_key(index),
                sensor="lidar",
                covariance=np.diag([1e-4, 1e-2]),
            )
            for step, index in seen
        ),
        **options,
    )


def play(problem, robot, candidates, turns):
    """Evaluate turns, each checked against QR; returns what was found."""
    oracle, results = FromScratch("qr"), []
    memory, state = (e.start(problem, robot, candidates) for e in (ENGINE, oracle))
    for announced in turns:
        memory, found = ENGINE.evaluate(memory, announced)
        state, exact = oracle.evaluate(state, announced)
        np.testing.assert_allclose(found.terms, exact.terms, rtol=1e-9)
        results.append(found)
    return results


def own(found, robot=0):
    """Own uncertainty terms of the robot with that place in the team."""
    return found.terms[:, 2 * robot + 1]


def test_an_announcement_far_from_everybody_costs_no_solve():
    problem = world({"a": HERE, "b": FAR})
    candidates = [path(problem, "a", [(10.0, 5.0 * i), (20.0, 5.0 * i)]) for i in range(4)]
    turns = [{"b": path(problem, "b", [(1010.0, y), (1020.0, y)])} for y in (0.0, 30.0)]
    first, second = play(problem, "a", candidates, [*turns, {}][:2])
    assert (first.report.solves, first.report.messages_rebuilt) == (4, 4)
    report = second.report
    assert report.impacted == ()
    assert report.untouched == (0, 1, 2, 3)
    assert (report.solves, report.messages_rebuilt, report.messages_reused) == (0, 0, 4)
    assert np.array_equal(own(first), own(second))
    assert (own(second, 1) != own(first, 1)).all()
    assert np.ptp(own(second, 1)) == 0.0


def test_no_kernel_is_called_for_untouched_candidates(monkeypatch):
    """Counted where the work is done, not by the report."""
    problem = world({"a": HERE, "b": FAR})
    candidates = [path(problem, "a", [(10.0, 0.0)]), path(problem, "a", [(10.0, 9.0)])]
    memory, _ = ENGINE.evaluate(ENGINE.start(problem, "a", candidates), {})
    calls = []
    for name in ("build", "solve", "posterior_by_qr"):
        target = f"fgplan.evaluation.incremental.candidate_terms.{name}"
        monkeypatch.setattr(target, lambda *_: calls.append(1))
    memory, found = ENGINE.evaluate(memory, {"b": path(problem, "b", [(1010.0, 0.0)])})
    assert calls == []
    assert np.isfinite(found.values).all()


def test_only_the_candidates_that_meet_the_announced_path_are_impacted():
    problem = world({"a": HERE, "b": FAR})
    candidates = [path(problem, "a", [(500.0, 0.0)]), path(problem, "a", [(0.0, 500.0)])]
    here = path(problem, "b", [(510.0, 0.0)], vertices=(-1, 3))
    turns = [{"b": path(problem, "b", [(1010.0, 0.0)])}, {"b": here}, {}]
    _, met, gone = play(problem, "a", candidates, turns)
    assert (met.report.impacted, met.report.untouched) == ((0,), (1,))
    assert (met.report.factors_added, met.report.solves) == (1, 1)
    assert (gone.report.impacted, gone.report.untouched) == ((0,), (1,))
    assert (gone.report.factors_removed, gone.report.factors_kept) == (1, 0)
    assert own(met)[0] < own(gone)[0]


def test_prior_correlation_connects_everybody():
    problem = world({"a": HERE, "b": FAR}, tied=[("a", "b")], landmarks=[(1010.0, 5.0)])
    candidates = [path(problem, "a", [(10.0, 0.0)]), path(problem, "a", [(0.0, 10.0)])]
    seeing = path(problem, "b", [(1010.0, 0.0)], seen=[(1, 0)])
    alone, told = play(problem, "a", candidates, [{}, {"b": seeing}])
    assert told.report.impacted == (0, 1)
    assert told.report.factors_added == 0
    assert (own(told) < own(alone)).all()


def test_a_landmark_seen_by_two_robots_connects_them():
    problem = world({"a": HERE, "b": FAR}, landmarks=[(500.0, 0.0), (0.0, 50.0)])
    candidates = [
        path(problem, "a", [(490.0, 0.0)], seen=[(1, 0)]),
        path(problem, "a", [(0.0, 40.0)], seen=[(1, 1)]),
        path(problem, "a", [(0.0, -40.0)]),
    ]
    seeing = path(problem, "b", [(510.0, 0.0)], seen=[(1, 0)])
    _, told = play(problem, "a", candidates, [{}, {"b": seeing}])
    assert told.report.impacted == (0,)
    assert told.report.untouched == (1, 2)


def test_a_landmark_of_the_prior_connects_the_robots_that_saw_it():
    """Both have seen the landmark in the past; nobody observes it again."""
    seen = [("a", 0), ("b", 0)]
    problem = world({"a": HERE, "b": (60.0, 0.0)}, landmarks=[(30.0, 5.0)], ties_to_landmarks=seen)
    candidates = [path(problem, "a", [(0.0, -100.0)])]
    _, told = play(problem, "a", candidates, [{}, {"b": path(problem, "b", [(60.0, -500.0)])}])
    assert told.report.impacted == (0,)


def test_a_change_reaches_a_candidate_through_a_third_robot():
    problem = world({"a": HERE, "b": FAR, "c": NEAR})
    candidates = [path(problem, "a", [(0.0, 15.0)]), path(problem, "a", [(0.0, -50.0)])]
    third = path(problem, "c", [(5.0, 20.0), (900.0, 0.0)])
    turns = [{"c": third}, {"c": third, "b": path(problem, "b", [(905.0, 0.0)])}, {"c": third}]
    before, met, after = play(problem, "a", candidates, turns)
    assert (met.report.impacted, after.report.impacted) == ((0,), (0,))
    assert met.report.factors_added == 0
    assert own(met)[0] != own(before)[0]
    assert own(met)[1] == own(before)[1]


def decoded(announced):
    """The path as it comes out of the bytes that carry it: equal arrays, another object."""
    message = announcement_of(announced, sequence=1, basis={})
    return decode_message(message.encoded, announced.robot).path()


@pytest.mark.parametrize("tied", [False, True])
def test_an_equal_announcement_in_another_object_changes_nothing(tied):
    problem = world(
        {"a": HERE, "b": (60.0, 0.0)}, tied=[("a", "b")] if tied else (), landmarks=[(40.0, 5.0)]
    )
    candidates = [path(problem, "a", [(30.0, 0.0)], seen=[(1, 0)]), path(problem, "a", [(9.0, 0)])]
    announced = path(problem, "b", [(40.0, 0.0), (30.0, 9.0)], seen=[(1, 0)])
    copy = decoded(announced)
    assert copy is not announced
    assert copy.poses is not announced.poses
    turns = [{"b": announced}, {"b": copy}]
    first, again = play(problem, "a", candidates, turns)
    assert again.report.impacted == ()
    assert (again.report.solves, again.report.messages_rebuilt) == (0, 0)
    assert (again.report.factors_added, again.report.factors_removed) == (0, 0)
    assert np.array_equal(first.terms, again.terms)


def test_a_new_length_or_new_vertices_are_a_change():
    """A term of the other's path reads them although the poses are the same."""
    term = PathTerm(robot="b", name="vertices", function=lambda p: 1.0 + sum(p.vertices))
    objective = Objective((*length_and_uncertainty(("a", "b")).terms, term))
    problem = world({"a": HERE, "b": (60.0, 0.0)}, objective=objective)
    theirs = path(problem, "b", [(30.0, 0.0)], vertices=(0, 1))
    turns = [
        {"b": theirs},
        {"b": replace(theirs, length_m=99.0)},
        {"b": replace(theirs, length_m=99.0, vertices=(0, 7))},
    ]
    found = play(problem, "a", [path(problem, "a", [(20.0, 0.0)])], turns)
    assert [result.terms[0, 2] for result in found] == [30.0, 99.0, 99.0]
    assert [result.terms[0, 4] for result in found] == [2.0, 2.0, 8.0]


def test_a_longer_announcement_keeps_what_the_old_one_was_connected_to():
    """Numbering everything anew must not forget that the old path saw a's landmark."""
    problem = world({"a": HERE, "b": FAR}, landmarks=[(500.0, 0.0)])
    candidates = [path(problem, "a", [(490.0, 0.0)], [(1, 0)]), path(problem, "a", [(9.0, 0.0)])]
    seeing = path(problem, "b", [(510.0, 0.0)], [(1, 0)])
    long = path(problem, "b", [(1000.0 + i, 1.0) for i in range(1, FIRST_CAPACITY + 6)])
    turns = [{"b": seeing}, {"b": long}, {"b": seeing}, {"b": long}, {}]
    for found in play(problem, "a", candidates, turns)[1:]:
        assert 0 in found.report.impacted or found.report.factors_removed == 0


@pytest.mark.parametrize("kept", [1500, 0], ids=["all kept", "eliminated again"])
def test_a_new_landmark_keeps_what_the_old_announcement_was_connected_to(kept, monkeypatch):
    """Touching a landmark for the first time must not forget that the old path saw a's."""
    monkeypatch.setattr(prior_marginal, "KEPT_SCALARS", kept)
    problem = world({"a": HERE, "b": FAR}, landmarks=[(500.0, 0.0), (1000.0, 9.0)])
    candidates = [path(problem, "a", [(490.0, 0.0)], [(1, 0)]), path(problem, "a", [(9.0, 0.0)])]
    turns = [
        {"b": path(problem, "b", [(510.0, 0.0)], [(1, 0)])},
        {"b": path(problem, "b", [(1005.0, 0.0)], [(1, 1)])},
    ]
    _, second = play(problem, "a", candidates, turns)
    assert second.report.impacted == (0,)
    assert second.report.untouched == (1,)


def test_states_that_differ_in_what_they_observe_have_one_factor():
    problem = world({"a": HERE, "b": (30.0, 0.0)}, landmarks=[(15.0, 5.0)])
    seeing = path(problem, "a", [(15.0, 0.0), (16.0, 9.0)], seen=[(1, 0)], vertices=(-1, 4, 5))
    blind = path(problem, "a", [(15.0, 0.0), (0.0, 30.0)], vertices=(-1, 4, 6))
    theirs = path(problem, "b", [(20.0, 0.0)])
    (found,) = play(problem, "a", [seeing, blind], [{"b": theirs}])
    # states at vertex 4 (once) and at vertex 5
    assert found.report.factors_added == 2
    assert found.report.involved_vertices == (4, 5)


def test_places_between_vertices_are_no_involved_vertices():
    problem = world({"a": HERE, "b": (30.0, 0.0)})
    mine = path(problem, "a", [(15.0, 0.0), (18.0, 0.0)], vertices=(-1, -1, 2))
    (found,) = play(problem, "a", [mine], [{"b": path(problem, "b", [(20.0, 0.0)])}])
    assert found.report.involved_vertices == (2,)


def test_a_team_without_uncertainty_of_its_own_paths_is_not_touched_at_all():
    """The own robot's announced path is not read."""
    objective = Objective((UncertaintyTerm(of=PosesOf(("a",))),))
    problem = world({"a": HERE, "b": FAR}, objective=objective)
    candidates = [path(problem, "a", [(9.0, 0.0)])]
    memory, first = ENGINE.evaluate(ENGINE.start(problem, "a", candidates), {})
    _, again = ENGINE.evaluate(memory, {"a": path(problem, "a", [(500.0, 0.0)])})
    assert again.report.impacted == ()
    assert np.array_equal(first.terms, again.terms)


def test_bad_input_is_named():
    problem = world({"a": HERE, "b": FAR, "c": NEAR})
    mine = path(problem, "a", [(9.0, 0.0)])
    theirs = path(problem, "b", [(1009.0, 0.0)])
    with pytest.raises(NoCandidatePathError, match=r"'a'.*at least one candidate"):
        ENGINE.start(problem, "a", [])
    with pytest.raises(InvalidInputError, match=r"'b'.*its own paths, got one of 'a'"):
        ENGINE.start(problem, "b", [mine])
    with pytest.raises(UnknownNameError, match="'nobody'"):
        ENGINE.start(problem, "nobody", [replace(mine, robot="nobody")])
    memory, first = ENGINE.evaluate(ENGINE.start(problem, "a", [mine]), {"b": theirs})
    with pytest.raises(UnknownNameError, match=r"'nobody'.*expected one of a, b, c"):
        ENGINE.evaluate(memory, {"nobody": theirs})
    with pytest.raises(InvalidInputError, match=r"'c'.*got a path of robot 'b'"):
        ENGINE.evaluate(memory, {"c": theirs})
    with pytest.raises(InvalidInputError, match=r"'b'.*expected pose 0 at the estimate"):
        ENGINE.choose(memory, {"b": replace(theirs, poses=theirs.poses + 1.0)})
    # nothing half-done: the memory is as it was
    _, again = ENGINE.evaluate(memory, {"b": theirs})
    assert again.report.impacted == ()
    assert np.array_equal(first.terms, again.terms)
