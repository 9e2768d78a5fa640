"""What each part of the MR.CLAM estimate is worth: the same log with one thing changed."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fgplan.io.mrclam import MrclamLog
from fgplan.io.mrclam_slam import HUBER, mrclam_slam
from fgplan.io.mrclam_steps import CAMERA_ROBOT, MrclamOptions, MrclamSteps, mrclam_steps
from fgplan.slam.robust_noise import RobustLoss
from fgplan.slam.trajectory_error import absolute_trajectory_error

CAUCHY = RobustLoss(loss="cauchy", parameter=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """One way of estimating, and how good it is.

    Attributes:
        name: What is different, in words.
        ate_m: Root mean square position error by robot, aligned at the first pose, metres.
        seconds: Of SLAM.
    """

    name: str
    ate_m: Mapping[str, float]
    seconds: float


def run_variants(
    log: MrclamLog, until_s: float | None, progress: Callable[[int, int, str], None]
) -> tuple[Variant, ...]:
    """Estimate with one thing changed at a time.

    Args:
        log: The log.
        until_s: Seconds of it; None takes all.
        progress: Called as ``progress(done, total, doing)``.

    Returns:
        The variants, the unchanged one not among them.
    """
    usual = MrclamOptions()
    as_logged = replace(usual, lags_s={robot.subject: 0.0 for robot in log.robots})
    slow = replace(usual, interval_s=2.0)
    steps = mrclam_steps(log, usual, until_s)
    cases: tuple[tuple[str, Callable[[], tuple[MrclamSteps, ...]], RobustLoss | None], ...] = (
        ("odometry's clock as logged", lambda: (mrclam_steps(log, as_logged, until_s),), HUBER),
        ("a pose every two seconds", lambda: (mrclam_steps(log, slow, until_s),), HUBER),
        ("Gaussian noise, no robust loss", lambda: (steps,), None),
        (f"Cauchy's loss, parameter {CAUCHY.parameter:g}", lambda: (steps,), CAUCHY),
        ("no measurements between robots", lambda: (without_robot_measurements(steps),), HUBER),
        (
            "each robot by itself",
            lambda: tuple(only_robot(steps, robot) for robot in steps.robots),
            HUBER,
        ),
    )
    found = []
    for place, (name, inputs, loss) in enumerate(cases):
        progress(place, len(cases), name)
        began = time.perf_counter()
        errors: dict[str, float] = {}
        for given in inputs():
            errors |= _errors(given, loss)
        found.append(Variant(name=name, ate_m=errors, seconds=time.perf_counter() - began))
    return tuple(found)


def without_robot_measurements(steps: MrclamSteps) -> MrclamSteps:
    """Steps in which robots do not see each other; landmarks still join them."""
    kept = tuple(
        tuple(one for one in of_tick if one.sensor != CAMERA_ROBOT)
        for of_tick in steps.measurements
    )
    return replace(steps, measurements=kept)


def only_robot(steps: MrclamSteps, robot: str) -> MrclamSteps:
    """Steps of one robot that knows of no other."""
    alone = without_robot_measurements(steps)
    return replace(
        alone,
        robots=(robot,),
        starts={robot: steps.starts[robot]},
        odometry=tuple(
            tuple(one for one in of_step if one.robot == robot) for of_step in alone.odometry
        ),
        measurements=tuple(
            tuple(one for one in of_tick if one.robot == robot) for of_tick in alone.measurements
        ),
    )


def _errors(steps: MrclamSteps, loss: RobustLoss | None) -> dict[str, float]:
    """Error of each robot."""
    slam = mrclam_slam(steps, loss=loss)
    found = {}
    for robot in steps.robots:
        truth = steps.truth[robot]
        seen = ~np.isnan(truth[:, 0])
        found[robot] = absolute_trajectory_error(slam.trajectory(robot)[seen], truth[seen], "first")
    return found
