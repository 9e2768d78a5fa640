"""A scenario derived from a team's past: what ``fgplan run LOG`` plans where nobody says otherwise.

    bounds        all poses and landmarks and a tenth of the longer side (1 m at least) around them;
                  a log knows no obstacles
    goals         each robot goes to the last pose of the next robot in the team, of the one after
                  it where that is nearer than a twentieth of the diagonal, else where it began
    motion noise  variance a metre = sum of variances / sum of lengths over odometry edges
    speed         length over time of the odometry edges; 1 m/s where the log has no times
    factors       relative poses nearer than nine tenths of the distances at which robots measured
    between       each other, with the mean covariance of these; where they measured none, bearings
    robots        and ranges, else ranges, of states a second apart at most
    sensors       ranges and bearing-ranges to mapped landmarks with the median noise of the log, as
                  far as the farthest of them
    objective     the preset length_and_uncertainty with the weights of Regev and Indelman 2017

An odometry edge joins consecutive poses of one robot. Numbers are rounded to six digits. The run
folder gets the scenario as a file, so that whatever is wanted otherwise is changed there.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from fgplan.io.past_estimate import PastEstimate
from fgplan.io.team_past import ROUNDED_REPEAT
from fgplan.models.pose import position
from fgplan.typing import FloatArray, Key

MARGIN = 0.1
"""Margin around the past as a share of its longer side."""

NEAR = 0.05
"""A goal nearer than this share of the diagonal is no goal."""

REACH = 90.0
"""Percentile of the distances at which robots measured each other."""

CANDIDATES = 20
"""Candidate paths a robot."""

_SAME_TIME_S = 1.0
_NOISE_PER_METRE = 0.1
_BETWEEN = gtsam.BetweenFactorPose2 | gtsam.BetweenFactorPose3
_PAIR_RANGE = gtsam.RangeFactorPose2 | gtsam.RangeFactorPose3
_PAIR_SIGHT = gtsam.BearingRangeFactorPose2 | gtsam.BearingRangeFactorPose3
_RANGE = gtsam.RangeFactor2D | gtsam.RangeFactor3D
_BEARING_RANGE = gtsam.BearingRangeFactor2D | gtsam.BearingRangeFactor3D


@dataclass(frozen=True, slots=True, kw_only=True)
class DerivedScenario:
    """A scenario made from data.

    Attributes:
        tables: The scenario as plain tables; ``[prior]`` names the log's copy in ``past``.
        notes: What was derived and from what, plain sentences.
    """

    tables: dict[str, Any]
    notes: tuple[str, ...]


def derive_scenario(estimate: PastEstimate, name: str) -> DerivedScenario:
    """Derive a scenario from a team's past.

    Args:
        estimate: The past and its estimate.
        name: Title.

    Returns:
        The scenario and how it came about.
    """
    past, belief = estimate.past, estimate.belief
    places = [position(belief.pose(key))[:2] for keys in past.robots.values() for key in keys]
    places += [point[:2] for point in belief.landmarks().values()]
    lower, upper = np.min(places, axis=0), np.max(places, axis=0)
    margin = max(1.0, MARGIN * float((upper - lower).max()))
    odometry = _odometry(estimate)
    motion, motion_note = _motion(estimate, odometry)
    sensors = _sensors(estimate)
    team, team_note = _team(estimate)
    goals = _goals(estimate, NEAR * float(np.linalg.norm(upper - lower)))
    tables = {
        "schema": 1,
        "name": name,
        "world": {"bounds": [_rounded(lower - margin), _rounded(upper + margin)]},
        "prior": _prior(estimate),
        "robots": [
            {"name": robot, "goal": goals[robot], "sensors": list(sensors), "motion": motion}
            for robot in past.robots
        ],
        "sensors": sensors,
        "team": team,
        "objective": {
            "preset": "length_and_uncertainty",
            "path_weight": 0.1,
            "uncertainty_weight": 1.0,
        },
        "planner": {"name": "impacted_paths", "impacted_paths": {"candidates": CANDIDATES}},
    }
    to = "each robot goes to the last pose of the next"
    if len(past.robots) == 1:
        to = "the robot goes back to where it began"
    level = "; robots keep their height and stay level" if _spatial(estimate) else ""
    notes = (
        f"bounds: the past and {margin:.3g} m around it, no obstacles known",
        f"goals: {to}{level}",
        motion_note,
        team_note,
        *(f"sensor {sensor}: {_sensor_note(table)}" for sensor, table in sensors.items()),
    )
    return DerivedScenario(tables=tables, notes=notes)


def _prior(estimate: PastEstimate) -> dict[str, Any]:
    """The table that reads the log's copy again."""
    past = estimate.past
    if past.format == "pyfg":
        return {"kind": "pyfg", "file": f"past/{past.files[0].name}", "estimate": True}
    if past.format in ("mrclam", "tum"):
        return {"kind": past.format, "folder": "past"}
    return {
        "kind": "g2o",
        "files": ["past"],
        "estimate": True,
        "repeat_tolerance": ROUNDED_REPEAT,
    }


def _spatial(estimate: PastEstimate) -> bool:
    """Whether the robots are in space."""
    return estimate.belief.dim(next(iter(estimate.current_keys.values()))) == 6


def _factors(estimate: PastEstimate, kinds: Any) -> list[Any]:  # noqa: ANN401 - a union of types
    """Factors of the log of some types, in its order."""
    graph = estimate.past.graph
    every = (graph.at(index) for index in range(graph.size()))
    return [factor for factor in every if isinstance(factor, kinds)]


def _odometry(estimate: PastEstimate) -> list[Any]:
    """Relative poses of consecutive poses of one robot."""
    pairs = {
        frozenset(pair)
        for keys in estimate.past.robots.values()
        for pair in itertools.pairwise(keys)
    }
    return [one for one in _factors(estimate, _BETWEEN) if frozenset(one.keys()) in pairs]


def _motion(estimate: PastEstimate, odometry: Sequence[Any]) -> tuple[dict[str, Any], str]:
    """Motion noise and speed, and what is said of them."""
    size = 6 if _spatial(estimate) else 3
    metres = sum(float(np.linalg.norm(one.measured().translation())) for one in odometry)
    if metres == 0.0:
        return (
            {"sigmas": [0.0] * size, "per_metre": [_NOISE_PER_METRE] * size},
            f"motion noise: no odometry that moves in the log; {_NOISE_PER_METRE} m and rad after "
            "a metre",
        )
    variances = np.sum([np.diag(one.noiseModel().covariance()) for one in odometry], axis=0)
    times = estimate.past.times_s
    stamps = [[times[key] for key in list(one.keys())] for one in odometry if times]
    seconds = sum(max(both) - min(both) for both in stamps)
    speed = metres / seconds if seconds > 0.0 else 1.0
    motion = {
        "sigmas": [0.0] * size,
        "per_metre": _rounded(np.sqrt(variances / metres)),
        "speed_m_per_s": _rounded([speed])[0],
    }
    source = "" if seconds > 0.0 else " (the log has no times)"
    return motion, (
        f"motion noise and speed: from {len(odometry)} odometry edges of {metres:.6g} m, "
        f"{speed:.3g} m/s{source}"
    )


def _team(estimate: PastEstimate) -> tuple[dict[str, Any], str]:
    """Factors between robots, and what is said of them."""
    robot_of = estimate.past.robot_of
    for kinds in (_BETWEEN, _PAIR_SIGHT, _PAIR_RANGE):
        found = [
            one
            for one in _factors(estimate, kinds)
            if len({robot_of[key] for key in list(one.keys())}) == 2
        ]
        if not found:
            continue
        distances = [_distance(estimate, *one.keys()) for one in found]
        reach = float(np.percentile(distances, REACH))
        covariance = np.mean([one.noiseModel().covariance() for one in found], axis=0)
        model: dict[str, Any] = {"distance_m": _rounded([reach])[0]}
        if kinds is _BETWEEN:
            what = "relative pose"
            rows = [_rounded(row) for row in covariance]
            model["sensor"] = {"kind": "relative_pose", "covariance": rows}
        elif kinds is _PAIR_SIGHT:
            what = "bearing and range"
            sigmas = _rounded(np.sqrt(np.diag(covariance)))
            model["sensor"] = {
                "kind": "bearing_range",
                "bearing_sigma_rad": sigmas[0],
                "range_sigma_m": sigmas[-1],
            }
            model["time_tolerance_s"] = _SAME_TIME_S
        else:
            what = "range"
            sigma = _rounded(np.sqrt(covariance[0]))[0]
            model["sensor"] = {"kind": "range", "sigma_m": sigma}
            model["time_tolerance_s"] = _SAME_TIME_S
        return {"multi_robot": [model]}, (
            f"between robots: {what} nearer than {reach:.3g} m, as nine of ten of the "
            f"{len(found)} in the log"
        )
    return {}, "between robots: no factors, the log has none"


def _sensors(estimate: PastEstimate) -> dict[str, dict[str, Any]]:
    """Sensors of landmarks."""
    sensors: dict[str, dict[str, Any]] = {}
    found = _factors(estimate, _BEARING_RANGE)
    if found:
        sigmas = np.sqrt([np.diag(one.noiseModel().covariance()) for one in found])
        sensors["bearing_range"] = {
            "kind": "bearing_range",
            "bearing_sigma_rad": _rounded([np.median(sigmas[:, :-1])])[0],
            "range_sigma_m": _rounded([np.median(sigmas[:, -1])])[0],
            "max_range_m": _rounded([max(one.measured().range() for one in found)])[0],
        }
    found = _factors(estimate, _RANGE)
    if found:
        sigmas = np.sqrt([one.noiseModel().covariance()[0, 0] for one in found])
        sensors["range"] = {
            "kind": "range",
            "sigma_m": _rounded([np.median(sigmas)])[0],
            "max_range_m": _rounded([max(one.measured() for one in found)])[0],
        }
    return sensors


def _sensor_note(table: dict[str, Any]) -> str:
    """What is said of a sensor."""
    sigma = table.get("sigma_m", table.get("range_sigma_m"))
    return f"mapped landmarks up to {table['max_range_m']:.4g} m, range to {sigma:.3g} m (1 sigma)"


def _goals(estimate: PastEstimate, near_m: float) -> dict[str, list[float]]:
    """Goal of each robot."""
    belief, past = estimate.belief, estimate.past
    team = list(past.robots)
    last = {robot: position(belief.pose(key)) for robot, key in estimate.current_keys.items()}
    goals = {}
    for place, robot in enumerate(team):
        others = team[place + 1 :] + team[:place]
        wanted = [last[other] for other in others]
        wanted.append(position(belief.pose(past.robots[robot][0])))
        away = [np.linalg.norm((goal - last[robot])[:2]) for goal in wanted]
        far = [goal for goal, metres in zip(wanted, away, strict=True) if metres > near_m]
        goals[robot] = _rounded(far[0] if far else wanted[int(np.argmax(away))])
    return goals


def _distance(estimate: PastEstimate, first: Key, second: Key) -> float:
    """Distance of two poses, metres."""
    belief = estimate.belief
    offset = position(belief.pose(first)) - position(belief.pose(second))
    return float(np.linalg.norm(offset))


def _rounded(numbers: Sequence[Any] | FloatArray) -> list[float]:
    """Numbers to six digits."""
    return [float(f"{number:.6g}") for number in numbers]
