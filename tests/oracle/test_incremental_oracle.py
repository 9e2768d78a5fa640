"""The incremental evaluator gives every term of the QR oracle, on random scenes.

A scene is drawn from its seed alone: 2 to 6 robots, Pose2 or Pose3, priors from 1e-6 m to 1000 m,
with or without prior correlation, landmarks and past poses, vertices shared or not, every kind of
multi-robot factor, paths of unequal length, and five objectives. Each is played over several turns:
announcements are replaced, withdrawn and repeated, so that old and new factors are partly the same.
Sixty scenes hold every option and run by default, over 200 with ``full``.
"""

import inspect
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scenes

from fgplan.evaluation.evaluations import weigh
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.objective import (
    Objective,
    PathLengthTerm,
    PathTerm,
    PosesOf,
    PriorVariables,
    Trajectory,
    TravelTimeTerm,
    UncertaintyTerm,
)
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel

TOLERANCE = 1e-9
KINDS = ("relative_pose", "full_relative_pose", "range", "bearing_range", "bearing", None)
GROUPS, GROUP = 22, 10
BY_DEFAULT = 6


def objective_of(number):
    """One of five objectives; together every function, block, reading and set of variables."""

    def make(robots, landmarks):
        first, second = robots[:2]
        each = [PosesOf((robot,)) for robot in robots]
        terms = [PathLengthTerm(robot=robot, weight=0.1) for robot in robots]
        if number == 0:
            terms += [UncertaintyTerm(of=of) for of in each]
        elif number == 1:
            terms += [UncertaintyTerm(of=of, read="arrival", block="pose") for of in each]
        elif number == 2:
            steps = (1, 3, 5)
            terms += [UncertaintyTerm(of=of, read=steps, function="log_determinant") for of in each]
        elif number == 3:
            terms += [
                UncertaintyTerm(of=PosesOf(robots), function="entropy", block="pose"),
                UncertaintyTerm(of=PosesOf(robots), read="arrival", arrival_of=second),
                UncertaintyTerm(of=Trajectory(first), function="largest_eigenvalue"),
                UncertaintyTerm(of=Trajectory(second), read="arrival"),
            ]
            if landmarks:
                of = PriorVariables(landmarks)
                information = UncertaintyTerm(of=of, function="mutual_information", weight=-2.0)
                terms += [information, UncertaintyTerm(of=of, read=(2, 4))]
        else:
            terms += [UncertaintyTerm(of=of, block="heading", weight=1e3) for of in each]
            terms += [TravelTimeTerm(robot=first)]
            terms += [PathTerm(robot=second, name="steps", function=lambda path: path.steps)]
        return Objective(tuple(terms))

    return make


def draw(seed):
    """Options of a scene by its seed; the first ones walk through the kinds and team sizes."""
    generator = np.random.default_rng(seed)
    planar = bool(generator.random() < 0.75)
    options = {
        "robots": 2 + seed % 5 if planar else 2 + seed % 2,
        "candidates": 3,
        "steps": (2, 7) if planar else (2, 5),
        "landmarks": int(generator.choice([0, 0, 4, 8])),
        "correlated": bool(generator.integers(2)),
        "past": int(generator.choice([0, 0, 2])),
        "prior_sigma": float(generator.choice([1e-6, 1e-3, 1.0, 100.0, 1000.0])),
        "shared_vertices": bool(generator.integers(2)),
        "kind": KINDS[int(generator.choice([0, 0, 0, 1, 2, 3, 4, 5]))],
        "radius_m": float(generator.choice([50.0, 150.0, 300.0])),
        "planar": planar,
        "objective": objective_of(int(generator.integers(5))),
        "full_motion_noise": bool(generator.integers(2)),
    }
    return generator, options


def information_terms(problem):
    """Which terms are differences of log determinants."""
    return np.array(
        [getattr(term, "function", "") == "mutual_information" for term in problem.objective.terms]
    )


def worst_difference(problem, terms, expected):
    """Largest relative difference; mutual information against at least one nat.

    A path that tells nothing about the landmarks gains 0 nats exactly, and what is computed is the
    rounding of two log determinants of sizes up to 100, so there the difference itself is taken.
    """
    floor = np.where(information_terms(problem), 1.0, 0.0)
    scale = np.maximum(np.abs(expected), floor)
    wrong = np.abs(terms - expected)
    return float(np.max(np.divide(wrong, scale, out=wrong.copy(), where=scale > 0.0)))


def margin(values, index):
    """Relative distance of the best value to the next."""
    rest = np.delete(values, index)
    return np.min(rest - values[index]) / abs(values[index]) if rest.size else np.inf


def next_turn(generator, announced, paths, others):
    """Withdraw, announce, replace or repeat one robot's path."""
    robot = others[int(generator.integers(len(others)))]
    announced = dict(announced)
    if generator.random() < 0.2:
        announced.pop(robot, None)
    else:
        announced[robot] = paths[robot][int(generator.integers(len(paths[robot])))]
    return announced


def play(seed, turns=3):
    """Compare all turns of one scene; returns the counts of the reports."""
    generator, options = draw(seed)
    problem, paths = scenes.random_scene(generator, **options)
    robot = problem.robots[int(generator.integers(len(problem.robots)))]
    others = [name for name in problem.robots if name != robot]
    announced = {name: paths[name][0] for name in others if generator.random() < 0.8}
    engine, oracle = Incremental(), FromScratch("qr")
    memory, state = (e.start(problem, robot, paths[robot]) for e in (engine, oracle))
    chosen = memory
    counts = np.zeros(3, np.int64)
    for turn in range(turns):
        memory, found = engine.evaluate(memory, announced)
        state, exact = oracle.evaluate(state, announced)
        chosen, choice = engine.choose(chosen, announced, 0)
        where = f"seed {seed}, turn {turn}, {options}"
        assert worst_difference(problem, found.terms, exact.terms) <= TOLERANCE, where
        # the value is a sum that may cancel: against the sum of what is added
        size = weigh(replace_weights(problem), np.abs(exact.terms))
        assert (np.abs(found.values - exact.values) <= TOLERANCE * np.maximum(size, 1.0)).all(), (
            where
        )
        if margin(exact.values, exact.best) > 1e-8:
            assert found.best == exact.best == choice.index, where
        np.testing.assert_allclose(choice.value, found.values[choice.index], rtol=1e-9)
        np.testing.assert_allclose(choice.incumbent_value, found.values[0], rtol=1e-9)
        report = found.report
        assert sorted((*report.impacted, *report.untouched)) == list(range(len(paths[robot])))
        counts += (len(report.untouched), report.messages_reused, report.fallbacks)
        announced = next_turn(generator, announced, paths, others)
    return counts


def replace_weights(problem):
    """The problem with weights without sign."""
    terms = tuple(replace(term, weight=abs(term.weight)) for term in problem.objective.terms)
    return replace(problem, objective=Objective(terms))


def test_scenes_that_run_by_default_hold_every_option():
    drawn = [draw(seed)[1] for seed in range(BY_DEFAULT * GROUP)]
    assert {one["kind"] for one in drawn} == set(KINDS)
    assert {one["prior_sigma"] for one in drawn} == {1e-6, 1e-3, 1.0, 100.0, 1000.0}
    assert {one["robots"] for one in drawn if one["planar"]} == {2, 3, 4, 5, 6}
    assert {one["robots"] for one in drawn if not one["planar"]} == {2, 3}
    numbers = [inspect.getclosurevars(one["objective"]).nonlocals["number"] for one in drawn]
    assert set(numbers) == set(range(5))
    for name, values in (
        ("landmarks", {0, 4, 8}),
        ("past", {0, 2}),
        ("radius_m", {50.0, 150.0, 300.0}),
        ("correlated", {False, True}),
        ("shared_vertices", {False, True}),
        ("full_motion_noise", {False, True}),
    ):
        assert {one[name] for one in drawn if one["planar"]} == values
        assert {one[name] for one in drawn if not one["planar"]} == values


@pytest.mark.parametrize(
    "group",
    [
        pytest.param(group, marks=[] if group < BY_DEFAULT else pytest.mark.full)
        for group in range(GROUPS)
    ],
)
def test_random_scenes_agree_with_qr(group):
    counts = sum(play(seed) for seed in range(group * GROUP, (group + 1) * GROUP))
    # the sweep is worth something only if paths stay untouched and messages are used again
    assert counts[0] > 0
    assert counts[1] > 0


def compare(problem, robot, candidates, turns):
    """Play given turns with both evaluators; returns what the engine found."""
    engine, oracle = Incremental(), FromScratch("qr")
    memory, state = (e.start(problem, robot, candidates) for e in (engine, oracle))
    results = []
    for announced in turns:
        memory, found = engine.evaluate(memory, announced)
        state, exact = oracle.evaluate(state, announced)
        assert worst_difference(problem, found.terms, exact.terms) <= TOLERANCE
        results.append(found)
    return results


@pytest.mark.parametrize("seed", range(5))
def test_a_third_robot_carries_a_change_to_a_robot_it_does_not_meet(seed):
    """Robots 0 and 2 share no factor; an announcement of 2 changes the own term of 0 through 1."""
    problem, paths = scenes.random_scene(
        np.random.default_rng(seed), robots=3, candidates=3, radius_m=1000.0, prior_sigma=5.0
    )
    # no factor of robot 2 with robot 0: 300 m apart and more is the rule of the criterion
    model = problem.multi_robot[0]

    def not_first_with_third(first, second):
        return {first.robot, second.robot} != {"robot0", "robot2"}

    problem = replace(problem, multi_robot=(replace(model, criterion=not_first_with_third),))
    middle = {"robot1": paths["robot1"][0]}
    turns = [
        middle,
        {**middle, "robot2": paths["robot2"][0]},
        {**middle, "robot2": paths["robot2"][1]},
    ]
    results = compare(problem, "robot0", paths["robot0"], turns)
    own = 1  # (41): length and uncertainty of robot 0 come first
    for before, after in pairwise(results):
        change = np.abs(after.terms[:, own] / before.terms[:, own] - 1.0)
        assert (change > 1e-6).all()
        assert after.report.impacted == (0, 1, 2)
        assert after.report.factors_added == after.report.factors_removed == 0


@pytest.mark.parametrize("planar", [True, False])
def test_factors_between_unequal_steps_enter_at_the_later_one(planar):
    """Terms at steps and at arrival where every pair of states is joined, whatever their steps."""

    def make(robots, _):
        terms = [UncertaintyTerm(of=PosesOf((r,)), read=(0, 1, 2, 4, 9)) for r in robots]
        terms += [UncertaintyTerm(of=PosesOf((r,)), read="arrival") for r in robots]
        terms += [UncertaintyTerm(of=Trajectory(robots[0]), read=(3,), block="pose")]
        return Objective(tuple(terms))

    problem, paths = scenes.random_scene(
        np.random.default_rng(7), robots=3, candidates=3, steps=(2, 6), radius_m=5000.0,
        planar=planar, objective=make, correlated=True, past=1,
    )  # fmt: skip
    assert len({path.steps for options in paths.values() for path in options}) > 2
    others = {name: paths[name][0] for name in problem.robots[1:]}
    later = {name: paths[name][1] for name in problem.robots[1:]}
    compare(problem, problem.robots[0], paths[problem.robots[0]], [others, later, {}, others])


@pytest.mark.parametrize("seed", range(4))
def test_two_models_at_once(seed):
    generator = np.random.default_rng(seed)
    problem, paths = scenes.random_scene(generator, robots=3, landmarks=4, past=2)
    models = [
        problem.multi_robot[0],
        scenes.multi_robot_model(generator, ("range", "bearing_range")[seed % 2], 400.0, True),
        scenes.multi_robot_model(generator, "full_relative_pose", 100.0, True),
    ]
    problem = replace(problem, multi_robot=tuple(models))
    others = {name: paths[name][0] for name in problem.robots[:2]}
    later = {**others, "robot0": paths["robot0"][1]}
    results = compare(problem, "robot2", paths["robot2"], [others, later])
    alone = compare(replace(problem, multi_robot=models[:1]), "robot2", paths["robot2"], [others])
    assert results[0].report.factors_added > alone[0].report.factors_added


class DistanceProduct(AbstractSensor):
    """A user's own sensor with more rows than a planar pose has: distances to three points."""

    kind = "distance_product"
    max_range_m = np.inf
    field_of_view_rad = 2 * np.pi

    def _offsets(self, pose, target):
        turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
        antennas = np.array([[0.0, 0.0], [30.0, 5.0], [-20.0, 10.0], [5.0, -40.0]])
        return turn, antennas, target - pose[:2] - antennas @ turn.T

    def predict(self, pose, target):
        return np.linalg.norm(self._offsets(pose, target)[2], axis=1)

    def jacobians(self, pose, target):
        turn, antennas, offsets = self._offsets(pose, target)
        way = offsets / np.linalg.norm(offsets, axis=1)[:, None]
        spin = turn @ np.array([[0.0, -1.0], [1.0, 0.0]])
        by_heading = -np.einsum("ij,ij->i", way, antennas @ spin.T)
        return np.column_stack([-way @ turn, by_heading]), way

    def noise(self, pose, target):
        return np.diag([1.0, 2.0, 3.0, 4.0])


class WestOnly(DistanceCriterion):
    """A user's criterion built on the default one, with a rule of its own."""

    def __call__(self, first, second):
        near = DistanceCriterion.__call__(self, first, second)
        return near and first.pose[0] < 1100.0 and second.pose[0] < 1100.0


@pytest.mark.parametrize("sensor", [DistanceProduct(), RelativePoseSensor(covariance=np.eye(3))])
@pytest.mark.parametrize(
    "criterion",
    [
        lambda first, second: abs(first.step - second.step) <= 1,
        lambda first, second: first.vertex % 3 == second.vertex % 3,
        WestOnly(400.0),
    ],
    ids=["steps", "vertex", "subclass"],
)
def test_a_users_own_criterion_and_sensor(sensor, criterion):
    generator = np.random.default_rng(11)
    problem, paths = scenes.random_scene(generator, robots=3, candidates=3, past=1)
    own = isinstance(sensor, DistanceProduct)
    tolerance = {"time_tolerance_s": 1e3} if own else {}
    model = MultiRobotModel(criterion=criterion, sensor=sensor, **tolerance)
    problem = replace(problem, multi_robot=(model,))
    others = {name: paths[name][0] for name in problem.robots[1:]}
    later = {**others, "robot1": paths["robot1"][2]}
    results = compare(problem, "robot0", paths["robot0"], [others, later])
    assert results[0].report.factors_added > 0


def test_a_criterion_may_ask_for_the_vertex():
    """Two candidates and two announcements that differ in nothing but their vertices."""
    generator = np.random.default_rng(3)
    problem, paths = scenes.random_scene(generator, robots=2, candidates=1, steps=(3, 3))

    def same_vertex(first, second):
        return first.vertex == second.vertex

    model = MultiRobotModel(criterion=same_vertex, sensor=problem.multi_robot[0].sensor)
    problem = replace(problem, multi_robot=(model,))
    mine, theirs = paths["robot0"][0], paths["robot1"][0]
    candidates = [replace(mine, vertices=(-1, 1, 2, 3)), replace(mine, vertices=(-1, 4, 5, 3))]
    turns = [{"robot1": replace(theirs, vertices=(-1, *at))} for at in ((1, 2, 3), (4, 7, 3))]
    first, second = compare(problem, "robot0", candidates, turns)
    # step 3 is one state of both candidates
    assert (first.report.factors_added, second.report.factors_added) == (3, 1)
    assert second.report.factors_removed == 2
    assert first.values[0] < first.values[1]
    assert second.values[0] > second.values[1]
