"""Multi-robot SLAM with known association: iSAM2 over all robots' poses and one common map.

    P(X, L | Z) ~ prod P(x_0^r)  prod P(x_t^r | x_t-1^r, u)  prod P(z | x, l)  prod P(z | x^r, x^r')

A robot with odometry gets a new pose; one without stays where it is, and what it measures, or what
is measured of it, is of its last pose. A landmark enters the graph when it is determined: by one
bearing and range, or by several ranges and bearings (fgplan.slam.landmark_start); until then what
was measured of it waits, counted. Measurements of targets are not used: hidden targets are another
planner's, and their state changes.

The same updates in the same order give the same result to the last bit, whatever was asked in
between (fgplan.slam.incremental_estimate): a run is resumed by replaying its log.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.checks import check_covariance, check_finite, frozen
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.gaussian_noise import gaussian_noise
from fgplan.factors.keys import check_no_future_keys, describe_key
from fgplan.factors.motion import gtsam_pose
from fgplan.models.measurement import Measurement, Odometry
from fgplan.models.pose import check_pose, compose, tangent_dim
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.slam.incremental_estimate import Addition, IncrementalEstimate
from fgplan.slam.landmark_start import Sighting, landmark_start, sighting_of
from fgplan.slam.measured_factor import (
    checked_measurement,
    landmark_factor,
    odometry_factor,
    robot_factor,
)
from fgplan.slam.pose_key import MAX_TEAM, is_pose_key, pose_key
from fgplan.slam.slam_options import SlamOptions, SlamStart
from fgplan.typing import Covariance, FloatArray, Key, Pose

Started = tuple[FloatArray, Covariance]
"""Position, shape (2,) or (3,), metres, and its covariance."""


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A measurement of a landmark that is not in the graph yet, and the pose it was taken from."""

    measurement: Measurement
    pose_key: Key


@dataclass(slots=True)
class _Change:
    """What one update of iSAM2 changes; joins the state when that has succeeded.

    Attributes:
        waiting: All waiting lists as they will be.
        poses: New current pose of each robot that moved.
        points: First estimate of each new landmark.
        seen: Landmark and robot of each measurement.
        addition: What iSAM2 gets.
    """

    waiting: dict[Key, tuple[_Waiting, ...]]
    poses: dict[str, tuple[Key, Pose]] = field(default_factory=dict)
    points: dict[Key, FloatArray] = field(default_factory=dict)
    seen: list[tuple[Key, str]] = field(default_factory=list)
    addition: Addition = field(default_factory=Addition)


class TeamSlam:
    """All robots' poses and the map, updated as odometry and measurements come in.

    It changes in place, as GTSAM's ISAM2 does: it is not a value.

    Attributes:
        robots: Names in the order of the team.
        options: How iSAM2 is run.
    """

    def __init__(
        self,
        starts: Mapping[str, SlamStart],
        sensors: Mapping[str, AbstractSensor | RelativePoseSensor],
        options: SlamOptions = SlamOptions(),  # noqa: B008 - frozen
        landmark_priors: Mapping[Key, Started] | None = None,
    ) -> None:
        """Put the robots at their starts.

        Args:
            starts: Prior of each robot, in the order of the team; these are the poses of step 0.
            sensors: Sensors and multi-robot sensors by the names that measurements use.
            options: How iSAM2 is run.
            landmark_priors: Position and covariance of landmarks known beforehand.

        Raises:
            InvalidInputError: If there is no robot, robots in the plane and in space are mixed,
                or a landmark's prior is not usable.
            UnknownNameError: If a robust loss is for a sensor that is not there.
        """
        self.robots = tuple(starts)
        self.options = options
        self._sensors = dict(sensors)
        self._check_team(starts)
        self._keys = {name: [pose_key(i, 0)] for i, name in enumerate(self.robots)}
        self._steps = {name: [0] for name in self.robots}
        self._poses = {name: start.pose for name, start in starts.items()}
        self._step = -1
        self._points: dict[Key, FloatArray] = {}
        self._seen_by: dict[Key, list[str]] = {}
        self._waiting: dict[Key, tuple[_Waiting, ...]] = {}
        self._smoother = IncrementalEstimate(options)
        change = _Change({})
        for name, start in starts.items():
            key = self._keys[name][0]
            prior = gtsam.PriorFactorPose2 if self._planar else gtsam.PriorFactorPose3
            noise = gaussian_noise(start.covariance, f"prior of robot {name!r}")
            change.addition.add(prior(key, gtsam_pose(start.pose), noise))
            change.addition.values.insert(key, gtsam_pose(start.pose))
        for key, (point, covariance) in (landmark_priors or {}).items():
            self._add_landmark_prior(key, point, covariance, change)
        self._apply(change, "putting the robots at their starts")

    def update(
        self, step: int, odometry: Sequence[Odometry], measurements: Sequence[Measurement]
    ) -> None:
        """Take in what one step has brought. After an error nothing has changed.

        Args:
            step: Steps since the start, larger than at the last update; 0, or any number, first.
            odometry: Of the robots that moved, at most one each.
            measurements: Of all robots, from the poses after the motion.

        Raises:
            InvalidInputError: If the step is not later, a robot has odometry twice, exact
                odometry, or odometry at step 0, or a measurement's value, noise or landmark key
                is not usable.
            UnknownNameError: If a robot or sensor is not known.
            IllPosedBeliefError: If iSAM2 finds a variable not determined.
        """
        if int(step) != step or step <= self._step:
            raise InvalidInputError(
                f"slam update: expected a step later than {self._step}, got {step}"
            )
        change = _Change(dict(self._waiting))
        self._add_odometry(step, odometry, change)
        for measurement in measurements:
            self._add_measurement(measurement, change)
        self._apply(change, f"updating SLAM at step {step}")
        self._step = int(step)
        for name in change.poses:
            self._steps[name].append(self._step)
        self._start_landmarks({key for key, _ in change.seen}, f"starting landmarks at step {step}")

    def key(self, robot: str) -> Key:
        """Key of a robot's current pose.

        Raises:
            UnknownNameError: If the robot is not known.
        """
        return self._keys[self._known(robot)][-1]

    def keys(self, robot: str) -> tuple[Key, ...]:
        """Keys of all poses of a robot, in order.

        Raises:
            UnknownNameError: If the robot is not known.
        """
        return tuple(self._keys[self._known(robot)])

    def steps(self, robot: str) -> tuple[int, ...]:
        """Step at which each pose of a robot was reached; the first is 0.

        Raises:
            UnknownNameError: If the robot is not known.
        """
        return tuple(self._steps[self._known(robot)])

    def pose(self, robot: str) -> Pose:
        """Estimate of a robot's current pose, shape (3,) or (4, 4), world frame.

        Raises:
            UnknownNameError: If the robot is not known.
        """
        return self._poses[self._known(robot)]

    def covariance(self, robot: str) -> Covariance:
        """Covariance of a robot's current pose by iSAM2, where iSAM2 last linearised.

        Returns:
            Shape (3, 3) or (6, 6), tangent of the pose.

        Raises:
            UnknownNameError: If the robot is not known.
        """
        return self._smoother.covariance(self.key(robot))

    def trajectory(self, robot: str) -> FloatArray:
        """Estimates of all poses of a robot, shape (n, 3) or (n, 4, 4), world frame.

        Raises:
            UnknownNameError: If the robot is not known.
        """
        return frozen([self._smoother.pose(key, planar=self._planar) for key in self.keys(robot)])

    def landmarks(self) -> dict[Key, FloatArray]:
        """Estimate of each landmark by ascending key, shape (2,) or (3,), metres, world frame."""
        return {
            key: self._smoother.point(key, self._points[key].size) for key in sorted(self._points)
        }

    def seen_by(self) -> dict[Key, tuple[str, ...]]:
        """Robots that have measured each landmark of the map, by ascending key, in team order."""
        return {
            key: tuple(name for name in self.robots if name in self._seen_by.get(key, ()))
            for key in sorted(self._points)
        }

    @property
    def waiting(self) -> dict[Key, int]:
        """Measurements that wait for their landmark to be determined, by ascending key."""
        return {key: len(self._waiting[key]) for key in sorted(self._waiting)}

    def values(self) -> gtsam.Values:
        """Current estimate of every variable; a copy."""
        return gtsam.Values(self._smoother.values())

    def weights(self) -> dict[str, tuple[float, ...]]:
        """Weight at the estimate of each factor with robust noise, by sensor, in order of time."""
        return self._smoother.weights()

    def graph(self) -> gtsam.NonlinearFactorGraph:
        """All factors with Gaussian noise; a copy.

        A factor with robust noise has its covariance divided by its weight at the estimate
        (fgplan.slam.robust_noise). None is left out, however little it weighs, because a landmark
        may hang on it; ``weights`` tells which are outliers.
        """
        return self._smoother.graph()

    def belief(self, values: gtsam.Values | None = None) -> Belief:
        """Joint belief over all poses and landmarks.

        Args:
            values: Where to linearise; None takes the estimate.

        Returns:
            The belief of ``graph`` at the values.

        Raises:
            UnknownNameError: If the values lack a variable.
        """
        return Belief(self.graph(), self._smoother.values() if values is None else values)

    @property
    def _planar(self) -> bool:
        """Whether poses are (x, y, heading)."""
        return self._poses[self.robots[0]].ndim == 1

    def _known(self, robot: str) -> str:
        """A robot's name, checked."""
        if robot not in self._keys:
            raise UnknownNameError(
                f"robot {robot!r} is not one of: {', '.join(self.robots)}; SLAM has those that "
                "were given a start"
            )
        return robot

    def _check_team(self, starts: Mapping[str, SlamStart]) -> None:
        """Check number, kind of poses, and names of robust losses."""
        if not 1 <= len(starts) <= MAX_TEAM:
            raise InvalidInputError(f"slam: expected 1 to {MAX_TEAM} robots, got {len(starts)}")
        if len({start.pose.ndim for start in starts.values()}) > 1:
            raise InvalidInputError(
                "slam: expected all poses as (x, y, heading) or all as 4 x 4 matrices, got both"
            )
        for name in self.options.robust:
            self._sensor(name, "robust loss")

    def _sensor(self, name: str, who: str) -> AbstractSensor | RelativePoseSensor:
        """A sensor by name."""
        if name not in self._sensors:
            raise UnknownNameError(
                f"{who}: sensor {name!r} is not one of: {', '.join(self._sensors) or 'none'}"
            )
        return self._sensors[name]

    def _add_landmark_prior(
        self, key: object, point: FloatArray, covariance: Covariance, change: _Change
    ) -> None:
        """A landmark that is known beforehand."""
        landmark = _landmark_key(key)
        name = f"prior of landmark {describe_key(landmark)}"
        where = check_finite(point, name, (None,))
        if where.size != 3 and not (self._planar and where.size == 2):
            raise InvalidInputError(
                f"{name}: expected {'2 or 3' if self._planar else '3'} coordinates, got "
                f"{where.size}"
            )
        noise = gaussian_noise(check_covariance(covariance, name, where.size), name)
        prior = gtsam.PriorFactorPoint2 if where.size == 2 else gtsam.PriorFactorPoint3
        change.addition.add(prior(landmark, where, noise))
        change.addition.values.insert(landmark, where)
        change.points[landmark] = where

    def _add_odometry(self, step: int, odometry: Sequence[Odometry], change: _Change) -> None:
        """A new pose for each robot that moved."""
        for reading in odometry:
            name = self._known(reading.robot)
            who = f"odometry of robot {name!r} at step {step}"
            if step == 0:
                raise InvalidInputError(
                    f"{who}: expected none, because the start is the pose of step 0; count the "
                    "first motion as step 1"
                )
            if name in change.poses:
                raise InvalidInputError(f"{who}: expected at most one, got two")
            if reading.covariance is None:
                raise InvalidInputError(
                    f"{who}: expected a covariance, got exact odometry, which leaves no belief; "
                    "give the robot an actuation or odometry MotionModel"
                )
            before = self._poses[name]
            if reading.relative.shape != before.shape:
                raise InvalidInputError(
                    f"{who}: expected a relative pose of shape {before.shape}, got "
                    f"{reading.relative.shape}"
                )
            check_pose(reading.relative, who)
            covariance = check_covariance(reading.covariance, who, tangent_dim(before))
            keys = self._keys[name]
            new = pose_key(self.robots.index(name), len(keys))
            pose = compose(before, reading.relative)
            change.addition.add(
                odometry_factor((keys[-1], new), reading.relative, covariance, name)
            )
            change.addition.values.insert(new, gtsam_pose(pose))
            change.poses[name] = (new, pose)

    def _add_measurement(self, measurement: Measurement, change: _Change) -> None:
        """The factor of one measurement, or its place in the waiting list."""
        name = self._known(measurement.robot)
        if measurement.kind == "target":
            return
        who = f"measurement of robot {name!r}"
        sensor = self._sensor(measurement.sensor, who)
        key, pose = change.poses.get(name, (self._keys[name][-1], self._poses[name]))
        checked_measurement(measurement, sensor, pose)
        if measurement.kind == "robot":
            other = self._known(str(measurement.target))
            if other == name:
                raise InvalidInputError(f"{who}: expected another robot as its target, got itself")
            keyed = change.poses.get(other, (self._keys[other][-1], self._poses[other]))
            factor = robot_factor(measurement, sensor, (key, keyed[0]), pose, keyed[1])
            self._add_factor(factor, measurement.sensor, change)
            return
        if isinstance(sensor, RelativePoseSensor):
            raise InvalidInputError(
                f"{who}: expected a relative pose of another robot, got one of a "
                f"{measurement.kind}, {measurement.target!r}; a landmark is a point"
            )
        landmark = _landmark_key(measurement.target)
        change.seen.append((landmark, name))
        waiting = _Waiting(measurement, key)
        if landmark in self._points or landmark in change.points:
            self._add_sighting(waiting, pose, change)
            return
        change.waiting[landmark] = (*change.waiting.get(landmark, ()), waiting)
        sighting = sighting_of(measurement, sensor)
        point = None if sighting is None else sighting.point(pose)
        if point is not None:
            self._start(landmark, point, change)

    def _start(self, landmark: Key, point: FloatArray, change: _Change) -> None:
        """Put a landmark into the graph with all that waited for it."""
        change.addition.values.insert(landmark, point)
        change.points[landmark] = point
        current = dict(change.poses.values())
        for one in change.waiting.pop(landmark):
            pose = current.get(one.pose_key)
            if pose is None:
                pose = self._smoother.pose(one.pose_key, planar=self._planar)
            self._add_sighting(one, pose, change)

    def _add_sighting(self, one: _Waiting, pose: Pose, change: _Change) -> None:
        """The factor of a measurement of a landmark of the map."""
        landmark, name = int(one.measurement.target), one.measurement.sensor
        point = change.points.get(landmark, self._points.get(landmark))
        keys = (one.pose_key, landmark)
        factor = landmark_factor(one.measurement, self._sensors[name], keys, pose, point)
        self._add_factor(factor, name, change)

    def _add_factor(self, factor: gtsam.NonlinearFactor, sensor: str, change: _Change) -> None:
        """A factor of a measurement, its noise robust if its sensor's is."""
        loss = self.options.robust.get(sensor)
        if loss is not None:
            factor = factor.cloneWithNewNoiseModel(loss.around(factor.noiseModel()))
        change.addition.add(factor, sensor, robust=loss is not None)

    def _start_landmarks(self, seen: set[Key], doing: str) -> None:
        """Put those landmarks into the graph that have become determined."""
        change = _Change(dict(self._waiting))
        for landmark in sorted(seen & self._waiting.keys()):
            geometry = [
                (sighting, one.pose_key)
                for one in self._waiting[landmark]
                if (sighting := self._sighting(one)) is not None
            ]
            if len(geometry) < 2:
                continue
            sightings = [sighting for sighting, _ in geometry]
            poses = [self._smoother.pose(key, planar=self._planar) for _, key in geometry]
            if landmark_start(sightings, poses) is None:
                continue
            joint = self._smoother.joint_covariance(
                [key for _, key in geometry], tangent_dim(poses[0])
            )
            point = landmark_start(sightings, poses, joint)
            if point is not None:
                self._start(landmark, point, change)
        if change.points:
            self._apply(change, doing)

    def _sighting(self, one: _Waiting) -> Sighting | None:
        """A waiting measurement as geometry."""
        sensor = self._sensors[one.measurement.sensor]
        return (
            None if isinstance(sensor, RelativePoseSensor) else sighting_of(one.measurement, sensor)
        )

    def _apply(self, change: _Change, doing: str) -> None:
        """Update iSAM2, then let the change join the state."""
        self._smoother.update(change.addition, doing)
        self._waiting = change.waiting
        self._points.update(change.points)
        for name, (key, _) in change.poses.items():
            self._keys[name].append(key)
        for name in self.robots:
            self._poses[name] = self._smoother.pose(self._keys[name][-1], planar=self._planar)
        for landmark, name in change.seen:
            robots = self._seen_by.setdefault(landmark, [])
            if name not in robots:
                robots.append(name)


def _landmark_key(key: object) -> Key:
    """A key that may be a landmark's."""
    if isinstance(key, bool) or not isinstance(key, int | np.integer) or key < 0:
        raise InvalidInputError(f"landmark: expected a GTSAM key, got {key!r}")
    check_no_future_keys([int(key)])
    if is_pose_key(int(key)):
        raise InvalidInputError(
            f"landmark {describe_key(int(key))}: keys 'x' with a letter are SLAM's poses; use "
            "another character, as in gtsam.symbol('l', 0)"
        )
    return int(key)
