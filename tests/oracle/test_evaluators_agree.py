"""Every whole-graph evaluator gives the value of QR; cuts are causal; section 5.1 holds."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
import scenes

from fgplan.beliefs.belief import Belief
from fgplan.beliefs.candidate_belief import candidate_belief
from fgplan.beliefs.from_scratch import covariance_by_qr
from fgplan.errors import IllPosedBeliefError, InvalidInputError, UnknownNameError
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.isam2 import Isam2
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
from fgplan.evaluation.problem import PlanningProblem
from fgplan.evaluation.term_values import (
    PoseAt,
    PriorKey,
    objective_readings,
    path_steps,
    prior_covariances,
    uncertainty_values,
)
from fgplan.models.range_bearing import RangeSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel

OTHERS = [FromScratch("marginals"), FromScratch("fastest"), Isam2()]
KINDS = ["relative_pose", "full_relative_pose", "range", "bearing_range", "bearing"]


def rich_objective(robots, landmarks):
    """One term of every kind of variables, block, function and reading."""
    terms = [
        PathLengthTerm(robot=robots[0], weight=0.1),
        TravelTimeTerm(robot=robots[1], weight=0.1),
        PathTerm(robot=robots[0], name="turns", function=lambda path: float(path.steps)),
        UncertaintyTerm(of=PosesOf((robots[0],))),
        UncertaintyTerm(
            of=PosesOf((robots[1],)), read="arrival", function="log_determinant", block="pose"
        ),
        UncertaintyTerm(of=PosesOf(robots), read=(1, 3, 50), function="log_determinant"),
        UncertaintyTerm(
            of=PosesOf(robots), read="arrival", arrival_of=robots[0], function="entropy"
        ),
        UncertaintyTerm(of=Trajectory(robots[0]), read="end", function="largest_eigenvalue"),
        UncertaintyTerm(of=Trajectory(robots[1]), read=(0, 2), function="trace", block="heading"),
    ]
    if landmarks:
        terms += [
            UncertaintyTerm(of=PriorVariables(landmarks[:3]), function="mutual_information"),
            UncertaintyTerm(
                of=PriorVariables(landmarks), read="arrival", arrival_of=robots[1], function="trace"
            ),
        ]
    return Objective(tuple(terms))


def random_problem(seed, **options):
    generator = np.random.default_rng(seed)
    settings = {
        "robots": 2 + seed % 3,
        "landmarks": (0, 6)[seed % 2],
        "correlated": seed % 3 == 1,
        "past": (0, 2)[seed % 3 == 2],
        "kind": KINDS[seed % 5],
        "planar": seed % 4 != 3,
        "full_motion_noise": seed % 7 == 0,
        "prior_sigma": (1.0, 1e-3, 10.0)[seed % 3],
        "objective": rich_objective,
        "candidates": 3,
        "steps": (3, 6),
    }
    return scenes.random_scene(generator, **(settings | options))


def assert_terms(actual, expected, rtol=1e-9):
    scale = np.maximum(np.abs(expected), 1e-3 * np.abs(expected).max(axis=0))
    worst = (np.abs(actual - expected) / np.maximum(scale, 1e-300)).max()
    assert worst < rtol, f"largest relative difference {worst:g}"


@pytest.mark.parametrize("seed", range(11))
def test_marginals_fastest_and_isam2_give_the_value_of_qr(seed):
    """Noise is benign here (sigmas 1e-3 m to 20 m); with tighter noise GTSAM loses digits."""
    problem, paths = random_problem(seed)
    robot = problem.robots[seed % len(problem.robots)]
    announced = {name: options[0] for name, options in paths.items()}
    turns = [
        announced,
        {**announced, problem.robots[(seed + 1) % 2]: paths[problem.robots[(seed + 1) % 2]][1]},
        {name: options[2] for name, options in paths.items()},
        dict(list(announced.items())[:1]),
    ]
    oracle = FromScratch("qr")
    expected = []
    state = oracle.start(problem, robot, paths[robot])
    for turn in turns:
        state, found = oracle.evaluate(state, turn)
        expected.append(found)
        assert found.report.impacted == (0, 1, 2)
    for evaluator in OTHERS:
        state = evaluator.start(problem, robot, paths[robot])
        for turn, exact in zip(turns, expected, strict=True):
            state, found = evaluator.evaluate(state, turn)
            assert_terms(found.terms, exact.terms)
            np.testing.assert_allclose(found.values, exact.values, rtol=1e-9)
            assert found.report.fallbacks == 0


def joint_by_inversion(problem, paths, cut, keys):
    """Covariance as the inverse of the information, from the belief that a user can ask for."""
    belief = candidate_belief(problem, paths, cut)
    linear = belief.graph.linearize(belief.values)
    ordering = gtsam.Ordering(list(linear.keyVector()))
    covariance = np.linalg.inv(linear.hessian(ordering)[0])
    start, rows = 0, {}
    for place in range(ordering.size()):
        dim = belief.values.dims()[ordering.at(place)]
        rows[ordering.at(place)] = np.arange(start, start + dim)
        start += dim
    wanted = np.concatenate([rows[key] for key in keys])
    return covariance[np.ix_(wanted, wanted)]


@pytest.mark.parametrize("seed", range(4))
def test_qr_is_the_inverse_of_the_cut_graph(seed):
    """Terms put together here by hand from the inverted information of each cut's graph.

    1e-8: the inversion squares the condition.
    """
    problem, paths = random_problem(seed, landmarks=4, objective=rich_objective)
    robots = problem.robots
    chosen = {name: options[0] for name, options in paths.items()}
    evaluator = FromScratch("qr")
    _, found = evaluator.evaluate(evaluator.start(problem, robots[0], [chosen[robots[0]]]), chosen)
    steps = path_steps(chosen)
    last = max(steps.values())
    dim = problem.dim
    where = slice(0, 2) if dim == 3 else slice(3, 6)
    turn = slice(2, 3) if dim == 3 else slice(0, 3)

    def pose(robot, step):
        return candidate_belief(problem, chosen).key(robot, min(step, steps[robot]))

    def block(cut, keys, part):
        joint = joint_by_inversion(problem, chosen, cut, keys)
        rows = np.arange(len(joint)).reshape(len(keys), -1)[:, part].ravel()
        return joint[np.ix_(rows, rows)]

    def log_det(matrix):
        return np.linalg.slogdet(matrix)[1]

    whole = slice(None)
    first, second = robots[:2]
    joint = [
        block(min(cut, last), [pose(robot, cut) for robot in robots], where) for cut in (1, 3, 50)
    ]
    at_arrival = block(steps[first], [pose(robot, steps[first]) for robot in robots], where)
    trajectory = block(last, [pose(first, step) for step in range(1, steps[first] + 1)], where)
    landmarks = [scenes.landmark_key(i) for i in range(4)]
    prior = block(0, landmarks[:3], whole)
    expected = [
        chosen[first].length_m,
        chosen[second].times_s[-1],
        steps[first],
        np.trace(block(last, [pose(first, last)], where)),
        log_det(block(steps[second], [pose(second, steps[second])], whole)),
        sum(log_det(matrix) for matrix in joint),
        0.5 * (len(at_arrival) * np.log(2 * np.pi * np.e) + log_det(at_arrival)),
        np.linalg.eigvalsh(trajectory)[-1],
        np.trace(block(0, [pose(second, 0)], turn))
        + np.trace(block(2, [pose(second, 1), pose(second, 2)], turn)),
        0.5 * (log_det(prior) - log_det(block(last, landmarks[:3], whole))),
        np.trace(block(steps[second], landmarks, whole)),
    ]
    np.testing.assert_allclose(found.terms[0], expected, rtol=1e-8)


def test_readings_follow_the_rules_of_the_cut():
    problem, _ = random_problem(1, robots=2, landmarks=6)
    first, second = problem.robots
    cuts = objective_readings(problem, {first: 5, second: 2})
    assert [cut.cut for cut in cuts] == [0, 1, 2, 3, 5]
    assert [cut.final for cut in cuts] == [False] * 4 + [True]
    at = {cut.cut: {r.term: r.variables for r in cut.readings} for cut in cuts}
    assert at[5][3] == (PoseAt(first, 5),)
    assert at[2][4] == (PoseAt(second, 2),)
    assert at[3][5] == (PoseAt(first, 3), PoseAt(second, 2))
    assert at[5][5] == (PoseAt(first, 5), PoseAt(second, 2))
    assert at[5][7] == tuple(PoseAt(first, step) for step in range(1, 6))
    assert at[0][8] == (PoseAt(second, 0),)
    assert at[2][8] == (PoseAt(second, 1), PoseAt(second, 2))
    assert at[5][9] == tuple(PriorKey(scenes.landmark_key(i)) for i in range(3))
    # a robot that announced nothing stays where it is
    alone = objective_readings(problem, {first: 5})
    assert {r.variables for cut in alone for r in cut.readings if r.term in (4, 8)} == {
        (PoseAt(second, 0),)
    }


def test_values_of_a_batch_are_those_of_each():
    problem, _ = random_problem(1, robots=2, landmarks=6)
    prior = prior_covariances(problem)
    for cut in objective_readings(problem, {problem.robots[0]: 3, problem.robots[1]: 4}):
        size = int(cut.dims.sum())
        mixed = np.random.default_rng(3).normal(size=(5, size, 2 * size))
        batch = mixed @ mixed.transpose(0, 2, 1)
        together = uncertainty_values(problem, cut, batch, prior)
        for place in range(5):
            alone = uncertainty_values(problem, cut, batch[place : place + 1], prior)
            np.testing.assert_allclose(together[place], alone[0], rtol=1e-12)


def test_no_factor_from_the_future_is_read():
    """What comes after the step that is read changes nothing: equation (21)."""
    objective = lambda robots, _: Objective(  # noqa: E731
        (UncertaintyTerm(of=PosesOf(robots), read=(2,), function="log_determinant", block="pose"),)
    )
    problem, paths = random_problem(3, robots=3, objective=objective, kind="relative_pose")
    robot = problem.robots[0]
    announced = {name: options[0] for name, options in paths.items() if name != robot}
    for evaluator in (FromScratch("qr"), *OTHERS):
        state = evaluator.start(problem, robot, paths[robot])
        state, before = evaluator.evaluate(state, announced)
        moved = {}
        for name, path in announced.items():
            poses = path.poses.copy()
            where = (slice(3, None), slice(0, 2)) if poses.ndim == 2 else np.s_[3:, :2, 3]
            poses[where] = poses[3:][..., :2, 3] * 0.5 if poses.ndim == 3 else poses[3:, :2] * 0.5
            moved[name] = replace(path, poses=poses, observations=())
        kept = {
            name: replace(
                moved[name],
                observations=tuple(o for o in path.observations if o.step <= 2),
            )
            for name, path in announced.items()
        }
        _, after = evaluator.evaluate(state, kept)
        np.testing.assert_allclose(after.terms, before.terms, rtol=1e-9)


def test_candidate_belief_is_a_graph_to_look_at():
    problem, paths = random_problem(2, robots=3)
    chosen = {name: options[0] for name, options in paths.items() if name != "robot2"}
    whole = candidate_belief(problem, chosen)
    assert whole.graph.size() == problem.prior.graph.size() + len(whole.factors)
    assert whole.key("robot2") == problem.start_keys["robot2"]
    assert whole.key("robot0") == whole.keys["robot0"][-1]
    assert whole.graph.error(whole.values) == pytest.approx(
        problem.prior.graph.error(problem.prior.values)
    )
    evaluator = FromScratch("qr")
    names = problem.robots
    objective = Objective(tuple(UncertaintyTerm(of=PosesOf((name,))) for name in names))
    problem = replace(problem, objective=objective)
    _, found = evaluator.evaluate(
        evaluator.start(problem, "robot0", [chosen["robot0"]]), {"robot1": chosen["robot1"]}
    )
    belief = whole.belief()
    part = slice(0, 2) if problem.dim == 3 else slice(3, 6)
    traces = [np.trace(belief.covariance(whole.key(n))[part, part]) for n in names]
    np.testing.assert_allclose(found.terms[0], traces, rtol=1e-9)
    cut = candidate_belief(problem, chosen, 1)
    assert len(cut.keys["robot0"]) == 2
    assert max(f.step for f in cut.factors) == 1
    cut.belief()
    with pytest.raises(UnknownNameError, match="robot9"):
        whole.key("robot9", 1)


class HalfSquaredRange(AbstractSensor):
    """A user's own sensor; equal information to a range of sigma / distance."""

    kind = "half_squared_range"
    max_range_m = np.inf
    field_of_view_rad = 2 * np.pi

    def predict(self, pose, target):
        offset = target - pose[:2]
        return np.array([0.5 * offset @ offset])

    def jacobians(self, pose, target):
        by_pose, by_target = RangeSensor(sigma_m=1.0).jacobians(pose, target)
        distance = np.linalg.norm(target - pose[:2])
        return distance * by_pose, distance * by_target

    def noise(self, pose, target):
        return np.array([[(3.0 * np.linalg.norm(target - pose[:2])) ** 2]])


def test_a_users_own_sensor_is_evaluated_through_custom_factor():
    """Half the squared range with sigma 3 d carries the information of a range with sigma 3."""
    problem, paths = random_problem(0, landmarks=6, correlated=True, kind=None, past=0, robots=2)
    own = HalfSquaredRange()
    native = RangeSensor(sigma_m=3.0)
    values = []
    for sensor in (own, native):
        model = MultiRobotModel(
            criterion=DistanceCriterion(600.0), sensor=sensor, time_tolerance_s=100.0
        )
        changed = replace(problem, multi_robot=(model,), sensors={"theirs": sensor})
        seen = {
            name: [_observing(changed, path, sensor) for path in options]
            for name, options in paths.items()
        }
        for evaluator in (FromScratch("qr"), *OTHERS):
            state = evaluator.start(changed, "robot0", seen["robot0"])
            values.append(evaluator.evaluate(state, {"robot1": seen["robot1"][0]})[1].terms)
    for terms in values[1:]:
        assert_terms(terms, values[0])


def _observing(problem, path, sensor):
    """The path with an observation of some landmark from every step."""
    observations = []
    for step in range(1, path.steps + 1):
        key = scenes.landmark_key(step % 6)
        noise = sensor.noise(path.poses[step], problem.prior.point(key))
        observations.append(Observation(step=step, landmark=key, sensor="theirs", covariance=noise))
    return replace(path, observations=tuple(observations))


def test_relative_information_leaves_the_current_pose_as_it_was():
    """The example of section 5.1, equations (26) to (32), by number and by graph."""
    sigma_k = scenes.random_covariance(np.random.default_rng(5), [2.0, 1.0, 0.1])
    step = np.array([10.0, 2.0, 0.3])
    noise = scenes.random_covariance(np.random.default_rng(6), [0.5, 0.4, 0.02])
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(0, gtsam.Pose2(1, 2, 0.5))
    graph.add(
        gtsam.PriorFactorPose2(
            0, gtsam.Pose2(1, 2, 0.5), gtsam.noiseModel.Gaussian.Covariance(sigma_k)
        )
    )
    problem = PlanningProblem(
        prior=Belief(graph, values),
        start_keys={"other": 0},
        objective=Objective((UncertaintyTerm(of=PosesOf(("other",))),)),
    )
    start = gtsam.Pose2(1, 2, 0.5)
    goal = start.compose(gtsam.Pose2(*step))
    path = CandidatePath(
        robot="other",
        poses=np.array([[1, 2, 0.5], [goal.x(), goal.y(), goal.theta()]]),
        times_s=np.array([0.0, 1.0]),
        motion_covariances=noise[None],
    )
    whole = candidate_belief(problem, {"other": path})
    keys = [whole.key("other", 0), whole.key("other", 1)]
    linear = whole.graph.linearize(whole.values)
    rows = linear.jacobian(gtsam.Ordering(keys))[0]
    information = rows.T @ rows
    a, b, d = information[:3, :3], information[:3, 3:], information[3:, 3:]
    # (31), (32): the Schur complement gives back the information before the path
    np.testing.assert_allclose(np.linalg.inv(a - b @ np.linalg.solve(d, b.T)), sigma_k, rtol=1e-9)
    np.testing.assert_allclose(whole.belief().covariance(keys[0]), sigma_k, rtol=1e-9)
    np.testing.assert_allclose(covariance_by_qr(linear, keys[:1]), sigma_k, rtol=1e-9)


def test_where_gtsam_gives_up_qr_answers_and_is_counted():
    """A well-posed odometry chain of 600 steps, on which gtsam.Marginals throws."""
    steps = 600
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(0, gtsam.Pose2())
    sigmas = np.array([0.01, 0.01, 0.01])
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
    robots = {"robot": 0}
    objective = Objective((UncertaintyTerm(of=PosesOf(("robot",))),))
    problem = PlanningProblem(prior=Belief(graph, values), start_keys=robots, objective=objective)
    poses = np.zeros((steps + 1, 3))
    poses[:, 0] = np.arange(steps + 1)
    motion = np.diag([0.02**2, 0.02**2, 0.05**2])
    path = CandidatePath(
        robot="robot",
        poses=poses,
        times_s=np.arange(steps + 1.0),
        motion_covariances=np.tile(motion, (steps, 1, 1)),
    )
    # a straight chain in closed form: variances of x, of y through every later step's lever arm
    ahead = np.arange(steps)
    exact = 0.01**2 + steps * 0.02**2
    exact += 0.01**2 + steps * 0.02**2 + steps**2 * 0.01**2 + 0.05**2 * float((ahead**2).sum())
    counts = {}
    for evaluator in (FromScratch("marginals"), FromScratch("qr"), Isam2()):
        _, found = evaluator.evaluate(evaluator.start(problem, "robot", [path]), {})
        name = f"{evaluator.name} {getattr(evaluator, 'elimination', '')}"
        counts[name] = found.report.fallbacks
        np.testing.assert_allclose(found.values, exact, rtol=1e-9)
    assert counts == {"from_scratch marginals": 1, "from_scratch qr": 0, "isam2 ": 0}


def test_qr_says_when_a_variable_is_not_determined():
    linear = gtsam.GaussianFactorGraph()
    linear.add(
        gtsam.JacobianFactor(
            0, np.eye(2), 1, -np.eye(2), np.zeros(2), gtsam.noiseModel.Unit.Create(2)
        )
    )
    with pytest.raises(IllPosedBeliefError, match="not determined"):
        covariance_by_qr(linear, [0])


def test_inputs_are_checked():
    problem, paths = random_problem(0, robots=3)
    evaluator = FromScratch("qr")
    with pytest.raises(InvalidInputError, match=r"elimination.*'magic'"):
        FromScratch("magic")
    with pytest.raises(InvalidInputError, match=r"candidates of robot 'robot0'.*'robot1'"):
        evaluator.start(problem, "robot0", paths["robot1"])
    state = evaluator.start(problem, "robot0", paths["robot0"])
    with pytest.raises(InvalidInputError, match=r"announced path of robot 'robot1'.*'robot2'"):
        evaluator.evaluate(state, {"robot1": paths["robot2"][0]})
    future = UncertaintyTerm(of=PosesOf(("robot1",)), function="mutual_information")
    gaining = replace(problem, objective=Objective((future,)))
    with pytest.raises(InvalidInputError, match=r"mutual_information.*PriorVariables"):
        evaluator.start(gaining, "robot0", paths["robot0"])


def test_a_covariance_without_a_determinant_is_named():
    problem, _ = random_problem(0, robots=2)
    cut = objective_readings(problem, {"robot0": 3, "robot1": 3})[-1]
    size = int(cut.dims.sum())
    with pytest.raises(IllPosedBeliefError, match=r"entropy.*not positive definite|log_det.*not"):
        uncertainty_values(problem, cut, np.zeros((1, size, size)), {})
