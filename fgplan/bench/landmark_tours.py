"""Candidate paths that cost the same whatever the past: tours past mapped landmarks.

The team shares out the mapped landmarks nearest to its robots: in turn, each robot takes the
nearest one left, eight each. A robot plans over its own eight and four of the next robot. A tour
passes six of these, the nearest next, by a few metres, with one pose half way and one beside each;
from each pose the robot observes the landmark behind and the one ahead. So every candidate of every
world has 12 poses and 24 observations of 6 landmarks, and the team has 32 to choose from.
"""

from collections.abc import Mapping

import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.typing import FloatArray, Key

OWN, FROM_NEXT, PASSED = 8, 4, 6
ASIDE_M = (3.0, 8.0)
SENSOR_NAME = "bearing_range"


def draw_tours(
    prior: Belief,
    start_keys: Mapping[str, Key],
    count: int,
    sensor: BearingRangeSensor,
    motion: MotionModel,
    generator: np.random.Generator,
) -> dict[str, list[CandidatePath]]:
    """Draw candidate paths of all robots.

    Args:
        prior: Holds the current poses and the mapped landmarks.
        start_keys: Current pose by robot.
        count: Candidates a robot.
        sensor: Sensor of landmarks, named ``SENSOR_NAME`` in the problem.
        motion: Motion noise and speed.
        generator: Source of all randomness.

    Returns:
        Candidates by robot.

    Raises:
        InvalidInputError: If the prior maps too few landmarks for the team.
    """
    mapped = {key: prior.point(key) for key in prior.keys if prior.kinds[key] == "Point2"}
    if len(mapped) < OWN * len(start_keys):
        raise InvalidInputError(
            f"landmark tours: expected at least {OWN * len(start_keys)} mapped landmarks for "
            f"{len(start_keys)} robots, got {len(mapped)}; use a longer past"
        )
    starts = {robot: prior.pose(key) for robot, key in start_keys.items()}
    shares = list(_shared_out(starts, mapped).values())
    tours: dict[str, list[CandidatePath]] = {}
    for place, (robot, start) in enumerate(starts.items()):
        pool = [*shares[place], *shares[(place + 1) % len(shares)][:FROM_NEXT]]
        pool = list(dict.fromkeys(pool))
        tours[robot] = [
            _tour(
                robot,
                start,
                {pool[i]: mapped[pool[i]] for i in generator.permutation(len(pool))[:PASSED]},
                sensor,
                motion,
                generator,
            )
            for _ in range(count)
        ]
    return tours


def _shared_out(
    starts: Mapping[str, FloatArray], mapped: Mapping[Key, FloatArray]
) -> dict[str, list[Key]]:
    """Landmarks of each robot, nearest first; none belongs to two."""
    left = dict(mapped)
    shares: dict[str, list[Key]] = {robot: [] for robot in starts}
    for _ in range(OWN):
        for robot, start in starts.items():
            nearest = min(left, key=lambda key: float(np.linalg.norm(left[key] - start[:2])))
            shares[robot].append(nearest)
            del left[nearest]
    return shares


def _tour(
    robot: str,
    start: FloatArray,
    passed: Mapping[Key, FloatArray],
    sensor: BearingRangeSensor,
    motion: MotionModel,
    generator: np.random.Generator,
) -> CandidatePath:
    """One tour: always on to the nearest landmark that is left."""
    left, here = dict(passed), start[:2]
    order: list[Key] = []
    places = [here]
    while left:
        key = min(left, key=lambda one: float(np.linalg.norm(left[one] - here)))
        angle = generator.uniform(0.0, 2.0 * np.pi)
        aside = generator.uniform(*ASIDE_M) * np.array([np.cos(angle), np.sin(angle)])
        there = left.pop(key) + aside
        places += [0.5 * (here + there), there]
        order.append(key)
        here = there
    way = np.diff(np.array(places), axis=0)
    headings = np.append(start[2], np.arctan2(way[:, 1], way[:, 0]))
    poses = np.column_stack([np.array(places), headings])
    observations = []
    for step in range(1, len(poses)):
        ahead = (step - 1) // 2
        behind = ahead - 1 if ahead else 1
        for key in (order[ahead], order[behind]):
            noise = sensor.noise(poses[step], passed[key])
            observations.append(
                Observation(step=step, landmark=key, sensor=SENSOR_NAME, covariance=noise)
            )
    times = np.append(0.0, np.cumsum(np.linalg.norm(way, axis=1))) / motion.speed_m_per_s
    return CandidatePath(
        robot=robot,
        poses=poses,
        times_s=times,
        motion_covariances=motion.covariances(poses),
        observations=tuple(observations),
    )
