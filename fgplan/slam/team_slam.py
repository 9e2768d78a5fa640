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
from functools import partial
from typing import cast

import gtsam

from fgplan.beliefs.belief import Belief
from fgplan.checks import frozen
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.motion import gtsam_pose
from fgplan.models.measurement import Measurement, Odometry
from fgplan.models.pose import compose, tangent_dim
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.slam.incremental_estimate import IncrementalEstimate
from fgplan.slam.landmark_start import landmark_start, sighting_of
from fgplan.slam.measured_factor import (
    landmark_factor,
    landmark_prior_factor,
    measurement_noise,
    odometry_factor,
    prior_factor,
    rigid,
    robot_factor,
)
from fgplan.slam.pose_key import MAX_TEAM, pose_key
from fgplan.slam.reading_check import (
    check_measurement,
    checked_landmark_prior,
    checked_odometry,
    checked_step,
    landmark_key,
)
from fgplan.slam.robust_noise import FactorMaker, RobustFactor
from fgplan.slam.slam_options import SlamOptions, SlamStart
from fgplan.slam.team_change import LandmarkMeasurement, TeamChange
from fgplan.typing import Covariance, FloatArray, Key, Pose

Located = tuple[FloatArray, Covariance]
"""Position, shape (2,) or (3,), metres, and its covariance."""


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
        landmark_priors: Mapping[Key, Located] | None = None,
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
        self._sizes: dict[Key, int] = {}
        self._seen_by: dict[Key, list[str]] = {}
        self._waiting: dict[Key, tuple[LandmarkMeasurement, ...]] = {}
        self._smoother = IncrementalEstimate(options)
        change = TeamChange({})
        for name, start in starts.items():
            key = self._keys[name][0]
            change.addition.factors.append(prior_factor(key, start.pose, start.covariance, name))
            change.addition.values.insert(key, gtsam_pose(start.pose))
        for key, located in (landmark_priors or {}).items():
            self._add_landmark_prior(key, located, change)
        self._apply(change, "putting the robots at their starts")

    def update(
        self, step: int, odometry: Sequence[Odometry], measurements: Sequence[Measurement]
    ) -> None:
        """Take in what one step has brought. An update that is refused changes nothing.

        Landmarks start afterwards: where a user's sensor fails in that, the step is taken.

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
        step = checked_step(step, self._step)
        change = TeamChange(dict(self._waiting))
        for reading in odometry:
            self._add_odometry(step, reading, change)
        for measurement in measurements:
            self._add_measurement(measurement, change)
        self._apply(change, f"updating SLAM at step {step}")
        self._step = step
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
        return {key: self._smoother.point(key, self._sizes[key]) for key in sorted(self._sizes)}

    def seen_by(self) -> dict[Key, tuple[str, ...]]:
        """Robots that have measured each landmark of the map, by ascending key, in team order."""
        return {
            key: tuple(name for name in self.robots if name in self._seen_by.get(key, ()))
            for key in sorted(self._sizes)
        }

    @property
    def rebuilds(self) -> int:
        """How often iSAM2's steps ran away, and the whole graph was solved by damped steps."""
        return self._smoother.rebuilds

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

    def _add_landmark_prior(self, key: object, prior: Located, change: TeamChange) -> None:
        """A landmark that is known beforehand."""
        landmark, point, covariance = checked_landmark_prior(key, *prior, planar=self._planar)
        change.addition.factors.append(landmark_prior_factor(landmark, point, covariance))
        change.addition.values.insert(landmark, point)
        change.points[landmark] = point

    def _add_odometry(self, step: int, reading: Odometry, change: TeamChange) -> None:
        """A new pose for a robot that moved."""
        name = self._known(reading.robot)
        if name in change.poses:
            raise InvalidInputError(
                f"odometry of robot {name!r} at step {step}: expected at most one, got two"
            )
        before, keys = self._poses[name], self._keys[name]
        covariance = checked_odometry(reading, step, before)
        relative = rigid(reading.relative)
        new = pose_key(self.robots.index(name), len(keys))
        pose = compose(before, relative)
        factor = odometry_factor((keys[-1], new), relative, covariance, name)
        change.addition.factors.append(factor)
        change.addition.values.insert(new, gtsam_pose(pose))
        change.poses[name] = (new, pose)

    def _add_measurement(self, measurement: Measurement, change: TeamChange) -> None:
        """The factor of one measurement, or its place in the waiting list."""
        name = self._known(measurement.robot)
        if measurement.kind == "target":
            return
        sensor = self._sensor(measurement.sensor, f"measurement of robot {name!r}")
        key, pose = change.poses.get(name, (self._keys[name][-1], self._poses[name]))
        check_measurement(measurement, sensor, pose)
        if measurement.kind == "robot":
            other = self._known(str(measurement.target))
            if other == name:
                raise InvalidInputError(
                    f"measurement of robot {name!r} with sensor {measurement.sensor!r}: expected "
                    "another robot as its target, got itself"
                )
            there = change.poses.get(other, (self._keys[other][-1], self._poses[other]))[0]
            make = partial(robot_factor, measurement, sensor, (key, there), planar=self._planar)
            self._add_factor(make, measurement, change)
            return
        landmark = landmark_key(measurement.target)
        change.seen.append((landmark, name))
        one = LandmarkMeasurement(measurement, cast(AbstractSensor, sensor), key)
        if landmark in self._sizes or landmark in change.points:
            self._add_sighting(one, change)
            return
        change.waiting[landmark] = (*change.waiting.get(landmark, ()), one)
        sighting = sighting_of(measurement, one.sensor)
        point = None if sighting is None else sighting.point(pose)
        if point is not None:
            self._start(landmark, point, change)

    def _start(self, landmark: Key, point: FloatArray, change: TeamChange) -> None:
        """Put a landmark into the graph with all that waited for it."""
        change.addition.values.insert(landmark, point)
        change.points[landmark] = point
        for one in change.waiting.pop(landmark):
            self._add_sighting(one, change)

    def _add_sighting(self, one: LandmarkMeasurement, change: TeamChange) -> None:
        """The factor of a measurement of a landmark of the map."""
        landmark = int(one.measurement.target)
        size = self._sizes.get(landmark) or change.points[landmark].size
        keys = (one.pose_key, landmark)
        make = partial(
            landmark_factor,
            one.measurement,
            one.sensor,
            keys,
            planar=self._planar,
            flat=size == 2,
        )
        self._add_factor(make, one.measurement, change)

    def _add_factor(self, make: FactorMaker, measurement: Measurement, change: TeamChange) -> None:
        """A factor of a measurement, its noise robust if its sensor's is."""
        name, noise = measurement.sensor, measurement_noise(measurement)
        loss = self.options.robust.get(name)
        if loss is None:
            change.addition.factors.append(make(noise))
        else:
            change.addition.add_robust(RobustFactor(name, make, noise, loss))

    def _start_landmarks(self, seen: set[Key], doing: str) -> None:
        """Put those landmarks into the graph that have become determined."""
        change = TeamChange(dict(self._waiting))
        for landmark in sorted(seen & self._waiting.keys()):
            point = self._place(self._waiting[landmark])
            if point is not None:
                self._start(landmark, point, change)
        if change.points:
            self._apply(change, doing)

    def _place(self, waiting: Sequence[LandmarkMeasurement]) -> FloatArray | None:
        """First estimate of a landmark from all that waits for it."""
        sighted = [
            (sighting, one.pose_key)
            for one in waiting
            if (sighting := sighting_of(one.measurement, one.sensor)) is not None
        ]
        if len(sighted) < 2:
            return None
        keys = [key for _, key in sighted]
        poses = [self._smoother.pose(key, planar=self._planar) for key in keys]
        return landmark_start(
            [sighting for sighting, _ in sighted],
            poses,
            lambda: self._smoother.joint_covariance(keys, tangent_dim(poses[0])),
        )

    def _apply(self, change: TeamChange, doing: str) -> None:
        """Update iSAM2, then let the change join the state."""
        self._smoother.update(change.addition, doing)
        self._waiting = change.waiting
        self._sizes.update({key: point.size for key, point in change.points.items()})
        for name, (key, _) in change.poses.items():
            self._keys[name].append(key)
        for name in self.robots:
            self._poses[name] = self._smoother.pose(self._keys[name][-1], planar=self._planar)
        for landmark, name in change.seen:
            robots = self._seen_by.setdefault(landmark, [])
            if name not in robots:
                robots.append(name)
