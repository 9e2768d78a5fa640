"""The Victoria Park log as the past of a team: consecutive parts of one drive, cut apart.

The log (inside the GTSAM wheel) is one vehicle's odometry and the bearings and ranges of the trees
that its laser saw. Robot i of R is the i-th of R parts of equal numbers of poses. The odometry
between parts is left out, so each robot has its own poses and odometry and only the trees, which
are common variables, tie the robots together. Nothing then says where the park is, so the first
pose of the first part has a prior (the gauge), in the frame of the file.

The joint MAP estimate is found in two steps. The file's own initial values are integrated odometry;
from them Levenberg-Marquardt ends in a local minimum tens of times worse than the best known.
So the whole log, odometry included, goes through gtsam.ISAM2, 200 poses at a time, as a vehicle
would have done; that gives initial values alone, and the graph without the odometry between parts
is optimised from them.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.checks import frozen
from fgplan.errors import InvalidInputError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.typing import FloatArray, Key

FILE = "victoria_park.txt"
GAUGE_SIGMAS = (0.01, 0.01, 0.001)
"""Prior on the first pose: metres, metres, radians."""

POSES_A_BATCH = 200
"""Poses between two updates of ISAM2: 1000 end in a worse minimum, 5 take ten times as long."""

RELINEARIZE_THRESHOLD = 0.05
_POSE_LIMIT = 2**56
"""Poses have plain integers as keys, landmarks have symbols."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VictoriaLog:
    """The log, or its first poses, as GTSAM factors in the order of driving.

    Attributes:
        poses: Keys of the poses, ascending.
        first: Pose of the first key: the file's frame.
        odometry: Factor by the key that it leads to.
        sightings: Bearing-range factors by the key of the pose.
        odometry_sigmas: Shape (3,): m, m, rad a step; one noise for every step.
        sighting_sigmas: Shape (2,): bearing rad, range m; one noise for every sighting.
        steps: Shape (N, 3), measured odometry: m, m, rad.
        bearings_rad: Measured bearing of every sighting.
        ranges_m: Measured range of every sighting.
    """

    poses: tuple[Key, ...]
    first: gtsam.Pose2
    odometry: dict[Key, gtsam.BetweenFactorPose2] = field(repr=False)
    sightings: dict[Key, list[gtsam.BearingRangeFactor2D]] = field(repr=False)
    odometry_sigmas: FloatArray
    sighting_sigmas: FloatArray
    steps: FloatArray = field(repr=False)
    bearings_rad: FloatArray = field(repr=False)
    ranges_m: FloatArray = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TeamPast:
    """What the team knows at planning time.

    Attributes:
        belief: Joint belief over all poses and trees at the MAP estimate.
        parts: By robot, the keys of its poses in the order of driving; the last is where it is.
        cost: Half the sum of squared whitened residuals at the MAP estimate.
        seen_by: How many robots have seen each tree, by key.
        seen_once: Trees with one sighting in all: determined by it, checked by nothing.
        factors: Number of factors by kind.
    """

    belief: Belief = field(repr=False)
    parts: dict[str, tuple[Key, ...]] = field(repr=False)
    cost: float
    seen_by: dict[Key, int] = field(repr=False)
    seen_once: tuple[Key, ...] = field(repr=False)
    factors: dict[str, int]

    def trajectory(self, robot: str) -> FloatArray:
        """Estimated past poses of a robot, shape (N, 3), world frame: m, m, rad."""
        return np.array([self.belief.pose(key) for key in self.parts[robot]])


def read_log(limit: int | None = None) -> VictoriaLog:
    """Read the log that is inside the GTSAM wheel.

    Args:
        limit: Number of poses to keep, from the beginning; None keeps all 6969.

    Returns:
        The log.

    Raises:
        InvalidInputError: If GTSAM cannot find or read it, or it is not what this demo is about.
    """
    with gtsam_boundary(f"reading {FILE} of the GTSAM wheel"):
        graph, values = gtsam.load2D(gtsam.findExampleDataFile(FILE))
    poses = tuple(sorted(key for key in values.keys() if key < _POSE_LIMIT))[:limit]  # noqa: SIM118
    kept = set(poses)
    odometry: dict[Key, gtsam.BetweenFactorPose2] = {}
    sightings: dict[Key, list[gtsam.BearingRangeFactor2D]] = {}
    for index in range(graph.size()):
        factor = graph.at(index)
        keys = factor.keys()
        if keys[0] not in kept:
            continue
        if isinstance(factor, gtsam.BetweenFactorPose2) and keys[1] in kept:
            odometry[keys[1]] = factor
        elif isinstance(factor, gtsam.BearingRangeFactor2D):
            sightings.setdefault(keys[0], []).append(factor)
    seen = [factor for key in poses for factor in sightings.get(key, ())]
    if list(odometry) != list(poses[1:]) or not seen:
        raise InvalidInputError(
            f"{FILE}: expected odometry from each pose to the next and sightings of trees, got "
            f"{len(odometry)} steps for {len(poses)} poses and {len(seen)} sightings; this GTSAM "
            "ships another file"
        )
    moves = [factor.measured() for factor in odometry.values()]
    return VictoriaLog(
        poses=poses,
        first=values.atPose2(poses[0]),
        odometry=odometry,
        sightings=sightings,
        odometry_sigmas=_only_noise(list(odometry.values()), "odometry"),
        sighting_sigmas=_only_noise(seen, "sightings"),
        steps=frozen([(move.x(), move.y(), move.theta()) for move in moves]),
        bearings_rad=frozen([factor.measured().bearing().theta() for factor in seen]),
        ranges_m=frozen([factor.measured().range() for factor in seen]),
    )


def team_past(log: VictoriaLog, robots: Sequence[str]) -> TeamPast:
    """Cut the log into the pasts of a team and estimate them jointly.

    Args:
        log: The log.
        robots: Names; as many parts.

    Returns:
        The joint belief at the MAP estimate.

    Raises:
        IllPosedBeliefError: If the trees do not tie the parts together; names what is loose.
    """
    parts = {
        robot: tuple(int(key) for key in keys)
        for robot, keys in zip(robots, np.array_split(log.poses, len(robots)), strict=True)
    }
    graph, cut = _team_graph(log, {keys[0] for keys in parts.values()})
    initial = _drive(log)
    # Structure is checked before anything is optimised: the message names what is missing.
    Belief(graph, initial)
    with gtsam_boundary("optimising the team's past"):
        estimate = gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
    belief = Belief(graph, estimate)
    belief.eliminated()
    owner = {key: robot for robot, keys in parts.items() for key in keys}
    sighted = [
        (owner[key], factor.keys()[1]) for key in log.poses for factor in log.sightings.get(key, ())
    ]
    times = Counter(tree for _, tree in sighted)
    seen_by = Counter(tree for _, tree in dict.fromkeys(sighted))
    return TeamPast(
        belief=belief,
        parts=parts,
        cost=float(graph.error(estimate)),
        seen_by=dict(sorted(seen_by.items())),
        seen_once=tuple(sorted(tree for tree, count in times.items() if count == 1)),
        factors={
            "odometry": len(log.odometry) - cut,
            "left_out": cut,
            "sightings": len(sighted),
            "gauge": 1,
        },
    )


def _only_noise(factors: Sequence[gtsam.NoiseModelFactor], what: str) -> FloatArray:
    """Standard deviations that all factors of one kind share."""
    found = {tuple(factor.noiseModel().sigmas().tolist()) for factor in factors}
    if len(found) != 1:
        raise InvalidInputError(
            f"{FILE}: expected one noise for all {what}, got {len(found)}; this GTSAM ships "
            "another file"
        )
    return frozen(found.pop())


def _gauge(log: VictoriaLog) -> gtsam.PriorFactorPose2:
    """Prior on the first pose of the first part."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array(GAUGE_SIGMAS))
    return gtsam.PriorFactorPose2(log.poses[0], log.first, noise)


def _team_graph(log: VictoriaLog, beginnings: set[Key]) -> tuple[gtsam.NonlinearFactorGraph, int]:
    """The log's factors without the odometry into the first poses of parts; how many are out."""
    graph = gtsam.NonlinearFactorGraph()
    graph.add(_gauge(log))
    kept = [factor for key, factor in log.odometry.items() if key not in beginnings]
    for factor in kept:
        graph.add(factor)
    for key in log.poses:
        for sighting in log.sightings.get(key, ()):
            graph.add(sighting)
    return graph, len(log.odometry) - len(kept)


def _drive(log: VictoriaLog) -> gtsam.Values:
    """Estimate of the whole log by ISAM2, odometry included: initial values."""
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(RELINEARIZE_THRESHOLD)
    parameters.relinearizeSkip = 1
    smoother = gtsam.ISAM2(parameters)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(_gauge(log))
    known: set[Key] = set()
    pose = log.first
    with gtsam_boundary("driving the log through ISAM2"):
        for place, key in enumerate(log.poses, start=1):
            if key in log.odometry:
                graph.add(log.odometry[key])
                pose = pose.compose(log.odometry[key].measured())
            values.insert(key, pose)
            for sighting in log.sightings.get(key, ()):
                graph.add(sighting)
                tree = sighting.keys()[1]
                if tree not in known:
                    known.add(tree)
                    values.insert(tree, _sighted_place(pose, sighting))
            if place % POSES_A_BATCH == 0 or place == len(log.poses):
                smoother.update(graph, values)
                graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
                pose = smoother.calculateEstimatePose2(key)
        return smoother.calculateEstimate()


def _sighted_place(pose: gtsam.Pose2, sighting: gtsam.BearingRangeFactor2D) -> FloatArray:
    """Where a tree stands by one sighting, shape (2,), metres, world frame."""
    seen = sighting.measured()
    angle, distance = seen.bearing().theta(), seen.range()
    return pose.transformFrom(distance * np.array([np.cos(angle), np.sin(angle)]))
