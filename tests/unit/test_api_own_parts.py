"""A user's own sensors, functions, objectives, evaluators and planners: accepted or refused."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scenes import landmark_key, random_scene

import fgplan
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.objective import (
    Objective,
    PathLengthTerm,
    PosesOf,
    PriorVariables,
    UncertaintyTerm,
    length_and_uncertainty,
)
from fgplan.evaluation.registry import find_evaluator
from fgplan.models import uncertainty
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.models.sensor_check import check_sensor
from fgplan.models.uncertainty import UncertaintyFunction, register_uncertainty
from fgplan.paths.candidate_path import Observation
from fgplan.planners import registry
from fgplan.planners.registry import register_planner
from fgplan.team.coordination import coordinate

POSE, POINT = np.array([1.0, 2.0, 0.5]), np.array([9.0, 4.0])
SPATIAL = np.array(
    [[0.36, 0.48, -0.8, 1.0], [-0.8, 0.6, 0.0, 2.0], [0.48, 0.64, 0.6, 3.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True, kw_only=True)
class Beacon(AbstractSensor):
    """Squared distance; ``wrong`` says what is wrong with it."""

    kind = "beacon"
    wrong: str = ""

    def predict(self, pose, target):
        return np.array([(target - pose[:2]) @ (target - pose[:2])])

    def jacobians(self, pose, target):
        offset = target - pose[:2]
        by_target = 2.0 * offset[None]
        by_pose = np.append(-by_target @ fgplan.rotation_matrix(pose), [[0.0]], axis=1)
        if self.wrong == "one":
            return by_pose
        if self.wrong == "flat":
            return by_pose[0], by_target[0]
        if self.wrong == "frame":  # the world's frame, not the robot's
            return np.append(-by_target, [[0.0]], axis=1), by_target
        if self.wrong == "sign":
            return by_pose, -by_target
        if self.wrong == "nan":
            return by_pose, by_target * np.nan
        if self.wrong == "rows":
            return np.tile(by_pose, (2, 1)), np.tile(by_target, (2, 1))
        return by_pose, by_target

    def noise(self, pose, target):
        if self.wrong == "noise":
            return np.eye(2)
        return np.array([[np.nan if self.wrong == "nan noise" else 4.0]])


def test_own_sensor_sees_all_round_and_far_unless_it_says_otherwise():
    beacon = Beacon()
    assert (beacon.max_range_m, beacon.field_of_view_rad) == (np.inf, 2.0 * np.pi)
    assert beacon.visible(POSE, np.array([-1e6, 0.0]))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("one", "Jacobians of sensor 'beacon': expected two.*got ndarray"),
        ("flat", r"'beacon' by pose: expected shape \(3, 3\), got \(3,\)"),
        ("nan", "'beacon' by target: expected finite"),
        ("rows", r"noise of sensor 'beacon'.*shape \(2, 2\) for Jacobians of 2 rows"),
        ("noise", r"noise of sensor 'beacon'.*shape \(1, 1\)"),
        ("nan noise", "noise of sensor 'beacon': expected finite"),
    ],
)
def test_shapes_of_an_own_sensor_are_refused_by_its_kind(wrong, words):
    with pytest.raises(InvalidInputError, match=words):
        Beacon(wrong=wrong).linearise(POSE, POINT)


@pytest.mark.parametrize("evaluator", [FromScratch(), FromScratch("qr"), Incremental()])
@pytest.mark.parametrize("wrong", ["flat", "nan"])
def test_evaluators_name_the_sensor_that_is_wrong(evaluator, wrong):
    problem, paths = random_scene(
        np.random.default_rng(0), candidates=1, landmarks=1, steps=(2, 2), kind=None
    )
    seen = Observation(step=1, landmark=landmark_key(0), sensor="own", covariance=np.array([[4.0]]))
    path = replace(paths["robot0"][0], observations=(seen,))
    good = replace(problem, sensors={"own": Beacon()})
    evaluator.evaluate(evaluator.start(good, "robot0", [path]), {})
    bad = replace(problem, sensors={"own": Beacon(wrong=wrong)})
    with pytest.raises(InvalidInputError, match="sensor 'beacon'"):
        evaluator.evaluate(evaluator.start(bad, "robot0", [path]), {})


@pytest.mark.parametrize(
    ("sensor", "pose", "target"),
    [
        (Beacon(), POSE, POINT),
        (RangeSensor(sigma_m=0.1), POSE, POINT),
        (BearingSensor(sigma_rad=0.1), POSE, [-3.0, 1.0]),
        (BearingRangeSensor(bearing_sigma_rad=0.1, range_sigma_m=0.1), POSE, POINT),
        (BearingRangeSensor(bearing_sigma_rad=0.1, range_sigma_m=0.1), POSE, [4.0, 5.0, 6.0]),
        (RangeSensor(sigma_m=0.1), SPATIAL, [4.0, -5.0, 6.0]),
        (BearingSensor(sigma_rad=0.1), SPATIAL, [4.0, -5.0, 6.0]),
        (BearingRangeSensor(bearing_sigma_rad=0.1, range_sigma_m=0.1), SPATIAL, [4.0, 5.0, 6.0]),
    ],
)
def test_right_jacobians_agree_with_differences(sensor, pose, target):
    assert check_sensor(sensor, pose, target) < 1e-6


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("frame", r"'beacon': Jacobian by pose\[0, [01]\] is .*central differences say .*off by"),
        (
            "sign",
            r"'beacon': Jacobian by target\[0, 0\] is -16, central differences say 16, off by 32",
        ),
        ("nan", "by target: expected finite"),
        ("noise", "noise of sensor 'beacon': expected shape"),
        ("rows", "noise of sensor 'beacon'"),
    ],
)
def test_wrong_jacobians_are_named_with_their_error(wrong, words):
    with pytest.raises(InvalidInputError, match=words):
        check_sensor(Beacon(wrong=wrong), POSE, POINT)


class Tilted(BearingSensor):
    """A spatial bearing whose Jacobian by the target is twice too large."""

    def jacobians(self, pose, target):
        by_pose, by_target = super().jacobians(pose, target)
        return by_pose, 2.0 * by_target


def test_jacobians_with_fewer_rows_are_compared_up_to_a_rotation():
    with pytest.raises(InvalidInputError, match=r"J transposed J of the Jacobian by target"):
        check_sensor(Tilted(sigma_rad=0.1), SPATIAL, [4.0, 5.0, 6.0])


class TooManyRows(Beacon):
    """Two rows for one number."""

    def noise(self, pose, target):
        return np.eye(2)


def test_more_rows_than_numbers_are_refused():
    with pytest.raises(InvalidInputError, match="at most 1 rows for a measurement of 1"):
        check_sensor(TooManyRows(wrong="rows"), POSE, POINT)


class Bare(Beacon):
    """Predicts what ``wrong`` says in place of a vector."""

    def predict(self, pose, target):
        value = super().predict(pose, target)
        return {"float": float(value[0]), "list": list(value), "matrix": value[None]}[self.wrong]


@pytest.mark.parametrize(
    ("sensor", "pose", "target", "words"),
    [
        (Beacon, POSE, POINT, r"got the class Beacon; make one: Beacon\(\.\.\.\)"),
        ("beacon", POSE, POINT, "expected an AbstractSensor, got str; derive"),
        (
            RangeSensor(sigma_m=0.1),
            POSE,
            [1.0, 2.0, 3.0, 4.0],
            "'range': target: expected 2 or 3 coordinates for a planar pose, got 4",
        ),
        (Beacon(), POSE, [1.0], "'beacon': target: expected 2 or 3 coordinates .*got 1"),
        (
            RangeSensor(sigma_m=0.1),
            SPATIAL,
            [1.0, 2.0],
            "'range': target: expected 3 coordinates for a spatial pose, got 2",
        ),
        (
            Bare(wrong="float"),
            POSE,
            POINT,
            r"prediction of sensor 'beacon': expected an array of shape \(m,\), got float; .*numpy",
        ),
        (Bare(wrong="list"), POSE, POINT, "got list"),
        (Bare(wrong="matrix"), POSE, POINT, r"got one of shape \(1, 1\)"),
    ],
)
def test_what_cannot_be_checked_as_a_sensor_is_named(sensor, pose, target, words):
    with pytest.raises(InvalidInputError, match=words):
        check_sensor(sensor, pose, target)


@pytest.fixture
def functions(monkeypatch):
    monkeypatch.setattr(
        uncertainty, "UNCERTAINTY_FUNCTIONS", dict(uncertainty.UNCERTAINTY_FUNCTIONS)
    )


def own_function(evaluate):
    return UncertaintyFunction(name="own", evaluate=evaluate, monotone=False, positive=True)


def first_variance(covariance, prior):
    return covariance[..., 0, 0]


def test_uncertainty_function_may_be_registered_again_or_replaced(functions):
    register_uncertainty(own_function(first_variance))
    register_uncertainty(own_function(first_variance))
    other = own_function(lambda covariance, prior: covariance[..., 1, 1])
    with pytest.raises(InvalidInputError, match=r"'own': the name is taken; .*replace=True"):
        register_uncertainty(other)
    register_uncertainty(other, replace=True)
    assert uncertainty.uncertainty_function("own") is other
    with pytest.raises(InvalidInputError, match="'trace': the name is taken by a built-in"):
        register_uncertainty(replace(other, name="trace"), replace=True)


@pytest.mark.parametrize("evaluator", [FromScratch(), Incremental()])
def test_function_that_does_not_give_one_number_a_covariance_is_named(functions, evaluator):
    register_uncertainty(own_function(lambda covariance, prior: np.trace(covariance)))
    term = UncertaintyTerm(of=PosesOf(("robot0",)), function="own")
    problem, paths = random_scene(np.random.default_rng(0), candidates=3, steps=(2, 2))
    problem = replace(problem, objective=Objective((term,)))
    state = evaluator.start(problem, "robot0", paths["robot0"])
    with pytest.raises(InvalidInputError, match=r"function 'own': expected \(\d,\) numbers"):
        evaluator.evaluate(state, {})


def test_one_in_place_of_several_is_refused():
    term = PathLengthTerm(robot="ann")
    for make, words in (
        (lambda: PosesOf("ann"), r"PosesOf robots: .*got 'ann'; write \('ann',\)"),
        (lambda: PosesOf((1,)), "PosesOf robots: expected a name each, got 1"),
        (lambda: PosesOf(()), "PosesOf robots: expected at least one"),
        (lambda: PriorVariables(7), r"PriorVariables keys: .*got 7; write \(7,\)"),
        (lambda: PriorVariables(("l1",)), "PriorVariables keys: expected a key each, got 'l1'"),
        (lambda: length_and_uncertainty("ann"), r"robots: .*got 'ann'; write \('ann',\)"),
        (lambda: Objective(term), "objective terms: expected a tuple or list"),
        (lambda: Objective(["length"]), "objective terms: expected a term each, got 'length'"),
        (lambda: UncertaintyTerm(of="ann"), r"expected of = PosesOf\(\(robot,\)\).*got 'ann'"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            make()
    assert PosesOf(["ann", "bob"]).robots == ("ann", "bob")
    assert Objective([term]).terms == (term,)


def test_team_coordinates_by_the_name_of_an_evaluator_or_its_default():
    problem, paths = random_scene(np.random.default_rng(1), candidates=3)
    expected = coordinate(problem, paths, Incremental())
    for evaluator in ((), ("incremental",), ("from_scratch",), (FromScratch("qr"),)):
        found = coordinate(problem, paths, *evaluator)
        assert found.chosen == expected.chosen
        assert found.value == pytest.approx(expected.value, rel=1e-9)
    assert coordinate(problem, paths, "as_published").agreed  # not exact: its rises are no error
    with pytest.raises(InvalidInputError, match=r"got the class FromScratch; make one: FromScr"):
        coordinate(problem, paths, FromScratch)
    with pytest.raises(UnknownNameError, match="evaluator 'magic': expected one of as_published"):
        coordinate(problem, paths, "magic")
    with pytest.raises(InvalidInputError, match="expected an object with name, start and evaluate"):
        coordinate(problem, paths, 3)
    with pytest.raises(InvalidInputError, match=r"'robot0': expected a list of paths, got one"):
        coordinate(problem, {**paths, "robot0": paths["robot0"][0]})


def test_evaluators_by_name():
    for name in ("incremental", "from_scratch", "isam2", "as_published"):
        evaluator: AbstractEvaluator = find_evaluator(name)
        assert evaluator.name == name
        assert find_evaluator(evaluator) is evaluator


def test_planner_may_be_registered_again_or_replaced(monkeypatch):
    monkeypatch.setattr(registry, "PLANNERS", dict(registry.PLANNERS))
    register_planner("mine", "a:b")
    register_planner("mine", "a:b")
    with pytest.raises(InvalidInputError, match=r"'mine': .* taken by 'a:b'.*replace=True"):
        register_planner("mine", "c:d")
    register_planner("mine", "c:d", replace=True)
    assert registry.PLANNERS["mine"] == "c:d"
