"""``choose`` decides as evaluating all does, and its lower bounds are lower bounds."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from example_counts import FEWER
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fgplan.evaluation.evaluations import TIE_TOLERANCE, weigh
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.candidate_terms import lower_bounds
from fgplan.evaluation.incremental.evaluator import BOUND_MARGIN, Incremental
from fgplan.evaluation.incremental.turn import begin_turn
from fgplan.evaluation.objective import (
    Objective,
    PathLengthTerm,
    PosesOf,
    PriorVariables,
    Trajectory,
    UncertaintyTerm,
    length_and_uncertainty,
)
from fgplan.models.relative_pose import RelativePoseSensor

ENGINE = Incremental()
NOTE = (
    "no bound: there is no uncertainty term, or one is not monotone, has a negative weight, reads "
    "before the end or reads a whole path of the robot itself"
)


def bounded_objective(number, path_weight, weight=1.0):
    """Objectives for which bounds are allowed; a path may have any weight."""

    def make(robots, landmarks):
        terms = [PathLengthTerm(robot=robot, weight=path_weight) for robot in robots]
        if number == 0:
            terms += [UncertaintyTerm(of=PosesOf((r,)), weight=weight) for r in robots]
        elif number == 1:
            terms += [
                UncertaintyTerm(of=PosesOf(robots), function="log_determinant", weight=weight),
                UncertaintyTerm(of=Trajectory(robots[-1]), block="pose"),
            ]
        else:
            terms += [UncertaintyTerm(of=PosesOf((robots[0],)), function="largest_eigenvalue")]
            if landmarks:
                terms += [UncertaintyTerm(of=PriorVariables(landmarks), weight=weight)]
        return Objective(tuple(terms))

    return make


SCENES = st.fixed_dictionaries(
    {
        "robots": st.integers(2, 4),
        "candidates": st.integers(1, 8),
        "landmarks": st.sampled_from([0, 4]),
        "correlated": st.booleans(),
        "past": st.sampled_from([0, 1]),
        "prior_sigma": st.sampled_from([1e-6, 1e-3, 1.0, 100.0, 1000.0]),
        "shared_vertices": st.booleans(),
        "kind": st.sampled_from(["relative_pose", "relative_pose", "bearing_range", None]),
        "radius_m": st.sampled_from([100.0, 300.0]),
        "planar": st.sampled_from([True, True, True, False]),
        "objective": st.builds(
            bounded_objective,
            st.integers(0, 2),
            st.sampled_from([0.1, 1.0, 0.0, -0.1]),
            st.sampled_from([1.0, 1.0, 0.0]),
        ),
    }
)


def with_noise(problem, paths, sigma, odometry):
    """Relative poses and odometry of these sigmas, metres; a thousandth of them in radians."""
    if problem.dim != 3 or not problem.multi_robot:
        return problem, paths
    sensor = RelativePoseSensor(covariance=np.diag(np.square([sigma, sigma, 1e-3 * sigma])))
    model = replace(problem.multi_robot[0], sensor=sensor, time_tolerance_s=None)
    step = np.diag(np.square([odometry, odometry, 1e-3 * odometry]))
    noisy = {
        robot: [
            replace(path, motion_covariances=np.tile(step, (path.steps, 1, 1))) for path in options
        ]
        for robot, options in paths.items()
    }
    return replace(problem, multi_robot=(model,)), noisy


@given(
    seed=st.integers(0, 2**20),
    options=SCENES,
    noise=st.sampled_from([None, None, (1e-3, 0.1), (1e-5, 1e-3), (1.0, 1e-4)]),
    data=st.data(),
)
@settings(max_examples=FEWER)
def test_the_choice_is_that_of_evaluating_all(seed, options, noise, data):
    # 1000 m beside 1e-5 m: the joint determinant of two robots is lost in 64 bits, QR says so too
    assume(noise != (1e-5, 1e-3) or options["prior_sigma"] < 100.0)
    problem, paths = scenes.random_scene(np.random.default_rng(seed), steps=(2, 5), **options)
    if noise is not None:
        problem, paths = with_noise(problem, paths, *noise)
    robot, *others = problem.robots
    size = len(paths[robot])
    all_memory = one_memory = ENGINE.start(problem, robot, paths[robot])
    announced = {}
    for _ in range(3):
        who = data.draw(st.sampled_from(others))
        announced = {**announced, who: paths[who][data.draw(st.integers(0, size - 1))]}
        incumbent = data.draw(st.one_of(st.none(), st.integers(0, size - 1)))
        all_memory, found = ENGINE.evaluate(all_memory, announced)
        one_memory, choice = ENGINE.choose(one_memory, announced, incumbent)
        assert choice.index == found.best
        np.testing.assert_allclose(choice.value, found.values[choice.index], rtol=1e-9)
        if incumbent is None:
            assert choice.incumbent_value is None
        else:
            np.testing.assert_allclose(choice.incumbent_value, found.values[incumbent], rtol=1e-9)
        evaluated = np.flatnonzero(~np.isnan(one_memory.terms).any(axis=1))
        assert sorted((*choice.report.skipped, *evaluated.tolist())) == list(range(size))
        assert incumbent not in choice.report.skipped
        assert choice.report.notes == ()


@given(seed=st.integers(0, 2**20), options=SCENES)
@settings(max_examples=FEWER)
def test_bounds_are_below_the_values(seed, options):
    """Every term; to rounding, which reaches 1e-8 where starts are known to 1000 m only."""
    problem, paths = scenes.random_scene(np.random.default_rng(seed), steps=(2, 5), **options)
    robot, *others = problem.robots
    announced = {name: paths[name][0] for name in others}
    memory = ENGINE.start(problem, robot, paths[robot])
    lower = lower_bounds(begin_turn(memory, announced), np.arange(len(paths[robot])))
    _, found = ENGINE.evaluate(memory, announced)
    assert (lower <= found.terms + BOUND_MARGIN * np.abs(found.terms)).all()


def test_bounds_exclude_most_candidates_of_a_usual_scene():
    """A bound that excludes nothing would pass everything above."""
    problem, paths = scenes.random_scene(np.random.default_rng(1), robots=4, candidates=30)
    robot, *others = problem.robots
    memory = ENGINE.start(problem, robot, paths[robot])
    _, choice = ENGINE.choose(memory, {name: paths[name][0] for name in others}, 7)
    assert len(choice.report.skipped) >= 20
    assert choice.report.solves == 30 - len(choice.report.skipped)


def not_monotone(robots, landmarks):
    of = PriorVariables(landmarks)
    information = UncertaintyTerm(of=of, function="mutual_information", weight=-1.0)
    return Objective((*length_and_uncertainty(robots).terms, information))


def negative_weight(robots, _):
    return Objective((UncertaintyTerm(of=PosesOf((robots[0],)), weight=-1.0),))


def early(robots, _):
    terms = [UncertaintyTerm(of=PosesOf((robots[1],)), read="arrival")]
    return Objective((*length_and_uncertainty(robots).terms, *terms))


def own_trajectory(robots, _):
    return Objective((UncertaintyTerm(of=Trajectory(robots[0])),))


def paths_alone(robots, _):
    return Objective(tuple(PathLengthTerm(robot=robot) for robot in robots))


@pytest.mark.parametrize(
    "objective", [not_monotone, negative_weight, early, own_trajectory, paths_alone]
)
def test_without_a_bound_everything_is_evaluated_and_said_so(objective):
    problem, paths = scenes.random_scene(
        np.random.default_rng(4), robots=3, candidates=12, landmarks=4, objective=objective
    )
    announced = {name: paths[name][0] for name in problem.robots[1:]}
    memory = ENGINE.start(problem, "robot0", paths["robot0"])
    after, choice = ENGINE.choose(memory, announced, 5)
    _, found = ENGINE.evaluate(memory, announced)
    assert choice.report.notes == (NOTE,)
    assert choice.report.skipped == ()
    assert not np.isnan(after.terms).any()
    assert choice.index == found.best
    assert choice.incumbent_value == found.values[5]


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_of_equal_candidates_the_lowest_index_wins(order):
    problem, paths = scenes.random_scene(np.random.default_rng(9), robots=3, candidates=6)
    announced = {name: paths[name][0] for name in problem.robots[1:]}
    memory = ENGINE.start(problem, "robot0", paths["robot0"])
    _, found = ENGINE.evaluate(memory, announced)
    best = paths["robot0"][found.best]
    # nearly equal: a length that differs by less than the tolerance, on either side
    near = replace(best, length_m=best.length_m * (1.0 - 1e-12))
    twins = [(best, near)[i] for i in order]
    rest = [path for i, path in enumerate(paths["robot0"]) if i != found.best]
    candidates = [rest[0], twins[0], *rest[1:], twins[1]]
    memory = ENGINE.start(problem, "robot0", candidates)
    _, found = ENGINE.evaluate(memory, announced)
    assert abs(found.values[1] - found.values[-1]) <= TIE_TOLERANCE * abs(found.values[1])
    for incumbent in (None, 1, len(candidates) - 1):
        _, choice = ENGINE.choose(memory, announced, incumbent)
        assert choice.index == found.best == 1


def test_a_candidate_without_a_bound_is_evaluated_whatever_the_weights(monkeypatch):
    """-inf times a weight of zero or less is no number; such a candidate must not be skipped."""
    problem, paths = scenes.random_scene(
        np.random.default_rng(2), robots=2, candidates=12, objective=bounded_objective(0, -0.1, 0.0)
    )
    monkeypatch.setattr(
        "fgplan.evaluation.incremental.evaluator.lower_bounds",
        lambda turn, subset: np.full((len(subset), len(problem.objective.terms)), -np.inf),
    )
    memory = ENGINE.start(problem, "robot0", paths["robot0"])
    _, choice = ENGINE.choose(memory, {"robot1": paths["robot1"][0]})
    assert choice.report.skipped == ()


def test_starts_tied_too_closely_for_cholesky_are_chosen_among_all_the_same():
    """Priors of 1e4 m tied by relative poses of 1e-5 m: S of the starts is singular to rounding."""
    generator = np.random.default_rng(11)
    problem, paths = scenes.random_scene(
        generator, robots=3, candidates=8, correlated=True, prior_sigma=1e4
    )
    problem, paths = with_noise(problem, paths, 1e-5, 1e-4)
    announced = {name: paths[name][0] for name in problem.robots[1:]}
    memory = ENGINE.start(problem, "robot0", paths["robot0"])
    turn = begin_turn(memory, announced)
    assert np.isneginf(lower_bounds(turn, np.arange(8))).any()
    _, choice = ENGINE.choose(memory, announced, 3)
    oracle = FromScratch("qr")
    _, exact = oracle.evaluate(oracle.start(problem, "robot0", paths["robot0"]), announced)
    np.testing.assert_allclose(choice.value, exact.values.min(), rtol=1e-8)
    assert choice.value == pytest.approx(float(weigh(problem, exact.terms)[choice.index]), rel=1e-8)
