from dataclasses import replace

import numpy as np
import pytest

from fgplan.models.measurement import Measurement
from fgplan.models.pose import compose
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.simulation.noise import exponential
from fgplan.slam.landmark_start import landmark_start, sighting_of
from fgplan.slam.sighting_geometry import SightingGeometry

RANGE = RangeSensor(sigma_m=0.05)
BEARING = BearingSensor(sigma_rad=0.01)
BOTH = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.05)
POINT = np.array([6.0, 5.0])
SPATIAL_POINT = np.array([6.0, 5.0, 3.0])


def planar(*positions):
    return [np.array([x, y, 0.3 * i]) for i, (x, y) in enumerate(positions)]


def spatial(*positions):
    poses = []
    for i, where in enumerate(positions):
        pose = exponential(np.array([0.2 * i, -0.1, 0.3 * i, 0.0, 0.0, 0.0]))
        pose[:3, 3] = where
        poses.append(pose)
    return poses


def sighted(sensors, poses, point):
    """Noise-free sightings; one sensor for all, or one a pose."""
    sensors = sensors if isinstance(sensors, list) else [sensors] * len(poses)
    return [
        sighting_of(
            Measurement(
                robot="r",
                sensor="s",
                kind="landmark",
                target=1,
                value=sensor.predict(pose, point),
                covariance=sensor.noise(pose, point),
            ),
            sensor,
        )
        for sensor, pose in zip(sensors, poses, strict=True)
    ]


CORNER = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0)]
CORNER_3D = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 2.0, 0.5), (1.0, 1.0, 3.0)]


@pytest.mark.parametrize(
    ("sensors", "poses", "point"),
    [
        (RANGE, planar(*CORNER), POINT),
        (BEARING, planar(*CORNER[:2]), POINT),
        (BEARING, planar(*CORNER), POINT),
        (BOTH, planar(*CORNER[:1]), POINT),
        ([BEARING, RANGE], planar((0, 0), (0, 0)), POINT),
        ([RANGE, BEARING, RANGE], planar(*CORNER), POINT),
        (RANGE, spatial(*CORNER_3D), SPATIAL_POINT),
        (BEARING, spatial(*CORNER_3D[:2]), SPATIAL_POINT),
        (BOTH, spatial(*CORNER_3D[:1]), SPATIAL_POINT),
        ([BEARING, RANGE], spatial(CORNER_3D[0], CORNER_3D[0]), SPATIAL_POINT),
    ],
)
def test_a_determined_landmark_is_found(sensors, poses, point):
    found = landmark_start(sighted(sensors, poses, point), poses)
    np.testing.assert_allclose(found, point, atol=1e-4)


@pytest.mark.parametrize(
    ("sensors", "poses", "point", "why"),
    [
        (RANGE, planar((0, 0)), POINT, "one circle"),
        (RANGE, planar((0, 0), (2, 0)), POINT, "two circles meet twice"),
        (RANGE, planar((0, 0), (2, 0), (4, 0), (6, 0)), POINT, "both sides of a straight way"),
        (RANGE, planar((0, 0), (2, 0), (4, 0.004)), POINT, "hardly off the line"),
        (BEARING, planar((0, 0)), POINT, "one ray"),
        (BEARING, planar((0, 0), (0.1, 0.0)), POINT, "no parallax"),
        (BEARING, planar((0, 0), (6 / 5, 1.0)), POINT, "straight towards it"),
        ([BEARING, RANGE], planar((0, 0), (8, 5)), POINT, "a ray meets a circle twice"),
        (RANGE, spatial(*CORNER_3D[:3]), SPATIAL_POINT, "three spheres meet twice"),
        (RANGE, spatial(*((x, y, 0) for x, y in CORNER), (0, 2, 0)), SPATIAL_POINT, "in a plane"),
        (BEARING, spatial(CORNER_3D[0], CORNER_3D[0]), SPATIAL_POINT, "twice the same ray"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_undetermined_landmark_waits(sensors, poses, point, why):
    assert landmark_start(sighted(sensors, poses, point), poses) is None, why


def test_many_noisy_ranges_choose_the_right_side():
    for seed in range(20):
        generator = np.random.default_rng(seed)
        poses = planar(*(2.0 * np.column_stack([np.arange(8), 0.05 * np.arange(8) ** 2])))
        point = np.array([generator.uniform(2, 10), generator.choice([-9.0, 12.0])])
        sightings = sighted(RANGE, poses, point)
        noisy = [
            replace(one, distance=one.distance + generator.normal(0, 0.05)) for one in sightings
        ]
        found = landmark_start(noisy, poses)
        assert found is not None
        assert np.linalg.norm(found - point) < 0.5


def test_uncertain_poses_let_a_landmark_wait():
    poses = planar(*CORNER)
    sightings = sighted(RANGE, poses, POINT)

    def joint(sigma):
        return lambda: sigma**2 * np.eye(9)

    np.testing.assert_allclose(landmark_start(sightings, poses, joint(0.01)), POINT, atol=1e-4)
    # Off by a metre to each other, three poses cannot tell where 2 m of parallax point to.
    assert landmark_start(sightings, poses, joint(1.0)) is None


def test_what_is_uncertain_of_all_poses_alike_does_not_matter():
    poses = planar(*CORNER)
    # Poses off by the same 20 m, in the world frame, and 1 cm to each other.
    rotations = []
    for pose in poses:
        block = np.zeros((3, 2))
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        block[:2] = [[cos, sin], [-sin, cos]]
        rotations.append(block)
    common = np.vstack(rotations)
    joint = 400.0 * common @ common.T + 1e-4 * np.eye(9)
    found = landmark_start(sighted(RANGE, poses, POINT), poses, lambda: joint)
    np.testing.assert_allclose(found, POINT, atol=1e-4)


@pytest.mark.parametrize("size", [2, 3])
def test_residuals_change_with_poses_and_point_as_differences_say(size):
    poses = planar(*CORNER) if size == 2 else spatial(*CORNER_3D[:3])
    truth = POINT if size == 2 else SPATIAL_POINT
    sightings = sighted([BOTH, RANGE, BEARING], poses, truth)
    geometry = SightingGeometry.of(sightings, poses)
    dim, step = (3 if size == 2 else 6), 1e-6

    def at(moved, point):
        return SightingGeometry.of(sightings, moved).residuals(point)[0]

    by_point = [
        (at(poses, truth + e) - at(poses, truth - e)) / (2 * step) for e in step * np.eye(size)
    ]
    np.testing.assert_allclose(geometry.residuals(truth)[1], np.array(by_point).T, atol=1e-8)
    by_poses = []
    for index in range(3):
        for e in step * np.eye(dim):
            ends = []
            for sign in (1.0, -1.0):
                moved = list(poses)
                moved[index] = compose(poses[index], exponential(sign * e))
                ends.append(at(moved, truth))
            by_poses.append((ends[0] - ends[1]) / (2 * step))
    np.testing.assert_allclose(geometry.by_poses(truth, poses), np.array(by_poses).T, atol=1e-8)


def test_rounding_that_leaves_no_covariance_lets_a_landmark_wait():
    poses = planar(*CORNER)
    joint = np.eye(9)
    joint[0, 3] = joint[3, 0] = 1e3
    assert landmark_start(sighted(RANGE, poses, POINT), poses, lambda: joint) is None


def test_own_sensor_starts_no_landmark():
    class Own(AbstractSensor):
        def predict(self, pose, target):
            return target - pose[:2]

        def jacobians(self, pose, target):
            return np.hstack([-np.eye(2), np.zeros((2, 1))]), np.eye(2)

        def noise(self, pose, target):
            return np.eye(2)

    assert sighted(Own(), planar((0, 0)), POINT) == [None]


def test_a_range_of_zero_or_less_gives_no_point():
    pose = np.zeros(3)
    sighting = sighted(BOTH, [pose], POINT)[0]
    assert replace(sighting, distance=-0.1).point(pose) is None
    np.testing.assert_allclose(sighting.point(pose), POINT, rtol=1e-12)


def test_ranges_along_a_nearly_straight_way_do_not_place_what_lies_ahead():
    """One minimum of the squares, but noise of 0.1 m decides on which side of the way it is."""
    x = [192.9, 195.8, 198.8, 201.6, 204.5, 207.3, 210.2]
    y = [176.4, 175.6, 174.6, 173.5, 172.6, 171.7, 171.6]
    poses = planar(*zip(x, y, strict=True))
    ahead, aside = np.array([249.5, 163.7]), np.array([220.0, 203.0])
    sensor = RangeSensor(sigma_m=0.1)
    assert landmark_start(sighted(sensor, poses, ahead), poses) is None
    found = landmark_start(sighted(sensor, poses, aside), poses)
    np.testing.assert_allclose(found, aside, atol=1e-3)
    # A bearing tells the sides apart.
    sensors = [sensor] * 6 + [BOTH]
    found = landmark_start(sighted(sensors, poses, ahead), poses)
    np.testing.assert_allclose(found, ahead, atol=1e-3)
