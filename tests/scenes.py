"""Random planning scenes for oracle tests: a 2000 x 2500 m world, small paths, quick to solve.

Robots start near each other and cross the world's middle, so multi-robot factors abound. Everything
is drawn from one generator; the same seed gives the same scene.
"""

import gtsam
import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.evaluation.objective import Objective, length_and_uncertainty
from fgplan.evaluation.problem import PastState, PlanningProblem
from fgplan.models.motion import MotionModel
from fgplan.models.pose import compose
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.paths.state import State

WORLD = np.array([2000.0, 2500.0])
SPEED = 10.0


def robot_names(count):
    return tuple(f"robot{index}" for index in range(count))


def landmark_key(index):
    return gtsam.symbol("l", index)


def pose_key(robot, step):
    """Key of robot number `robot` at past step `step` >= 0 of its history."""
    return gtsam.symbol("abcdefgh"[robot], step)


def spatial(pose, generator=None):
    """A planar pose lifted to 4 x 4, tilted and raised a little if a generator is given."""
    matrix = np.eye(4)
    matrix[:3, :3] = gtsam.Rot3.Yaw(pose[2]).matrix()
    matrix[:2, 3] = pose[:2]
    if generator is not None:
        tilt = gtsam.Rot3.RzRyRx(*generator.normal(0, 0.1, 2), 0.0).matrix()
        matrix[:3, :3] = matrix[:3, :3] @ tilt
        matrix[2, 3] = generator.uniform(0, 50)
    return matrix


def random_covariance(generator, sigmas):
    """A full covariance with these standard deviations and moderate correlations."""
    sigmas = np.asarray(sigmas, dtype=float)
    mixed = generator.normal(size=(sigmas.size, 2 * sigmas.size))
    matrix = mixed @ mixed.T
    scale = np.sqrt(np.diag(matrix))
    matrix = matrix / np.outer(scale, scale) * np.outer(sigmas, sigmas)
    return 0.5 * (matrix + matrix.T)


def multi_robot_model(generator, kind, radius_m, planar):
    """A multi-robot model of a kind: relative_pose, full_relative_pose, range, bearing_range,
    bearing."""
    if kind in ("relative_pose", "full_relative_pose"):
        sigmas = [5.0, 5.0, 0.05] if planar else [0.05, 0.05, 0.05, 5.0, 5.0, 5.0]
        covariance = (
            random_covariance(generator, sigmas)
            if kind == "full_relative_pose"
            else np.diag(np.square(sigmas))
        )
        return MultiRobotModel(
            criterion=DistanceCriterion(radius_m), sensor=RelativePoseSensor(covariance=covariance)
        )
    sensor = {
        "range": RangeSensor(sigma_m=3.0, sigma_per_metre=0.001),
        "bearing": BearingSensor(sigma_rad=0.05),
        "bearing_range": BearingRangeSensor(bearing_sigma_rad=0.05, range_sigma_m=3.0),
    }[kind]
    return MultiRobotModel(
        criterion=DistanceCriterion(radius_m), sensor=sensor, time_tolerance_s=40.0
    )


def random_scene(
    generator,
    *,
    robots=2,
    candidates=4,
    steps=(4, 8),
    landmarks=0,
    correlated=False,
    past=0,
    prior_sigma=1.0,
    shared_vertices=True,
    kind="relative_pose",
    radius_m=300.0,
    planar=True,
    objective=None,
    include_past=True,
    full_motion_noise=False,
):
    """Draw a planning problem and candidate paths.

    Args:
        generator: numpy Generator.
        robots: Number of robots, 2 to 6.
        candidates: Candidate paths a robot.
        steps: Fewest and most steps of a path; equal numbers give equal lengths.
        landmarks: Mapped landmarks; paths plan bearing-range, range and bearing observations.
        correlated: Whether the current poses are tied to the next robot's by a factor.
        past: Past poses a robot before the current one, listed as past states with the current.
        prior_sigma: Standard deviation of the first pose, metres; a hundredth of it in radians.
        shared_vertices: Whether paths are drawn from few vertices, so that they meet and share
            prefixes; a vertex then keeps its place but not its heading.
        kind: Kind of multi-robot factor, or None for none.
        radius_m: Radius of the multi-robot criterion.
        planar: Pose2, or Pose3.
        objective: An objective, a function of (problem robots, landmark keys), or None for (41).
        include_past: Whether multi-robot factors take past states.
        full_motion_noise: Whether motion noise is a full matrix.

    Returns:
        The problem, and by robot its list of candidate paths.
    """
    names = robot_names(robots)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    motion = MotionModel(
        sigmas=np.array([1.0, 1.0, 0.01] if planar else [0.01, 0.01, 0.01, 1.0, 1.0, 1.0]),
        per_metre=np.full(3 if planar else 6, 0.001),
        speed_m_per_s=SPEED,
    )
    middle = WORLD / 2
    starts, past_states = {}, []
    for index, name in enumerate(names):
        angle = 2 * np.pi * index / robots + generator.uniform(-0.2, 0.2)
        where = middle + 350.0 * np.array([np.cos(angle), np.sin(angle)])
        pose = np.array([*where, angle + np.pi + generator.normal(0, 0.2)])
        chain = [pose if planar else spatial(pose, generator)]
        for _ in range(past):
            step = np.array([generator.uniform(30, 60), 0.0, generator.normal(0, 0.2)])
            chain.append(compose(chain[-1], step if planar else spatial(step)))
        chain = [gtsam.Pose2(*p) if planar else gtsam.Pose3(p) for p in chain]
        sigmas = np.full(3 if planar else 6, prior_sigma)
        sigmas[2 if planar else slice(0, 3)] *= 0.01
        _insert_chain(graph, values, index, chain, sigmas, planar)
        starts[name] = pose_key(index, past)
        if past:
            for step, at in enumerate(chain):
                past_states.append(
                    PastState(
                        pose_key(index, step),
                        State(name, step - past, 10.0 * (step - past), _array(at)),
                    )
                )
    points = _add_landmarks(generator, graph, values, landmarks, robots, middle, planar)
    if correlated:
        sigmas = np.array([3.0, 3.0, 0.03] if planar else [0.03, 0.03, 0.03, 3.0, 3.0, 3.0])
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        make = gtsam.BetweenFactorPose2 if planar else gtsam.BetweenFactorPose3
        read = values.atPose2 if planar else values.atPose3
        for index in range(robots - 1):
            first, second = pose_key(index, past), pose_key(index + 1, past)
            graph.add(make(first, second, read(first).between(read(second)), noise))
    prior = Belief(graph, values)
    models = () if kind is None else (multi_robot_model(generator, kind, radius_m, planar),)
    if models and not include_past:
        models = (
            MultiRobotModel(
                criterion=models[0].criterion,
                sensor=models[0].sensor,
                time_tolerance_s=models[0].time_tolerance_s,
                include_past=False,
            ),
        )
    sensors = {
        "camera": BearingSensor(sigma_rad=0.02),
        "beacon": RangeSensor(sigma_m=2.0, sigma_per_metre=0.001),
        "lidar": BearingRangeSensor(bearing_sigma_rad=0.02, range_sigma_m=2.0),
    }
    if objective is None:
        objective = length_and_uncertainty(names)
    elif not isinstance(objective, Objective):
        objective = objective(names, tuple(landmark_key(i) for i in range(landmarks)))
    problem = PlanningProblem(
        prior=prior,
        start_keys=starts,
        objective=objective,
        multi_robot=models,
        sensors=sensors,
        past_states=tuple(past_states),
    )
    vertices = middle + generator.uniform(-500, 500, size=(12, 2))
    paths = {
        name: [
            _random_path(
                generator, problem, name, motion, points, vertices if shared_vertices else None,
                int(generator.integers(steps[0], steps[1] + 1)), planar, full_motion_noise,
            )
            for _ in range(candidates)
        ]
        for name in names
    }  # fmt: skip
    return problem, paths


def _array(pose):
    return np.array([pose.x(), pose.y(), pose.theta()]) if hasattr(pose, "theta") else pose.matrix()


def _insert_chain(graph, values, index, chain, sigmas, planar):
    """Prior on the first pose and odometry along the past."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    odometry = gtsam.noiseModel.Diagonal.Sigmas(
        np.array([0.5, 0.5, 0.01] if planar else [0.01, 0.01, 0.01, 0.5, 0.5, 0.5])
    )
    prior = gtsam.PriorFactorPose2 if planar else gtsam.PriorFactorPose3
    between = gtsam.BetweenFactorPose2 if planar else gtsam.BetweenFactorPose3
    graph.add(prior(pose_key(index, 0), chain[0], noise))
    for step, pose in enumerate(chain):
        values.insert(pose_key(index, step), pose)
        if step:
            relative = chain[step - 1].between(pose)
            graph.add(between(pose_key(index, step - 1), pose_key(index, step), relative, odometry))


def _add_landmarks(generator, graph, values, landmarks, robots, middle, planar):
    """Landmarks, each with a weak prior and tied to the first pose of one robot."""
    size = 2 if planar else 3
    points = {}
    for index in range(landmarks):
        point = np.append(middle + generator.uniform(-450, 450, 2), [20.0] * (size - 2))
        key = landmark_key(index)
        points[key] = point
        values.insert(key, point)
        weak = gtsam.noiseModel.Isotropic.Sigma(size, 20.0)
        graph.add(
            (gtsam.PriorFactorPoint2 if planar else gtsam.PriorFactorPoint3)(key, point, weak)
        )
        seen_from = pose_key(index % robots, 0)
        where = values.atPose2(seen_from) if planar else values.atPose3(seen_from)
        make = gtsam.BearingRangeFactor2D if planar else gtsam.BearingRangeFactor3D
        sigmas = np.array([0.02, 3.0] if planar else [0.02, 0.02, 3.0])
        graph.add(
            make(
                seen_from, key, where.bearing(point), where.range(point),
                gtsam.noiseModel.Diagonal.Sigmas(sigmas),
            )
        )  # fmt: skip
    return points


def _random_path(
    generator, problem, robot, motion, points, vertices, steps, planar, full_motion_noise
):
    """A path from the current pose through random vertices (or free positions)."""
    start = problem.prior.pose(problem.start_keys[robot])
    here = start[:2] if planar else start[:2, 3]
    if vertices is None:
        ids = (-1,) * (steps + 1)
        free = here + np.cumsum(generator.uniform(-200, 200, size=(steps, 2)), axis=0)
        positions = np.vstack([here, free])
    else:
        chosen = [int(generator.integers(len(vertices)))]
        while len(chosen) < steps:  # no vertex twice in a row: a path does not stand still
            following = int(generator.integers(len(vertices)))
            if following != chosen[-1]:
                chosen.append(following)
        ids = (-1, *chosen)
        positions = np.vstack([here, vertices[chosen]])
    way = np.diff(positions, axis=0)
    headings = np.arctan2(way[:, 1], way[:, 0])
    planned = [
        np.array([*at, heading]) for at, heading in zip(positions[1:], headings, strict=True)
    ]
    poses = np.array([start, *(p if planar else spatial(p) for p in planned)])
    times = np.concatenate([[0.0], np.cumsum(np.linalg.norm(way, axis=1)) / SPEED])
    noise = motion.covariances(poses)
    if full_motion_noise:
        noise = np.array([random_covariance(generator, np.sqrt(np.diag(c))) for c in noise])
    observations = []
    for step in range(1, steps + 1):
        for key, point in points.items():
            name = ("lidar", "beacon", "camera")[int(generator.integers(3))]
            sensor = problem.sensors[name]
            if np.linalg.norm(point[:2] - positions[step]) < 250.0:
                observations.append(
                    Observation(
                        step=step,
                        landmark=key,
                        sensor=name,
                        covariance=sensor.noise(poses[step], point),
                    )
                )
    return CandidatePath(
        robot=robot,
        poses=poses,
        times_s=times,
        motion_covariances=noise,
        vertices=ids,
        observations=tuple(observations),
    )
