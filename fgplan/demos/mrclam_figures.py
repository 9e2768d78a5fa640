"""Figures of the MR.CLAM demo: maps robot by robot, errors over time, chosen paths."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fgplan.demos.mrclam_judgement import Judgement
from fgplan.demos.mrclam_results import Planned
from fgplan.io.mrclam import MrclamLog
from fgplan.io.mrclam_steps import MrclamSteps
from fgplan.slam.team_slam import TeamSlam
from fgplan.viz.chosen_paths import chosen_paths_figure
from fgplan.viz.ellipse import world_position_covariances
from fgplan.viz.figure import matplotlib_module, new_figure, save
from fgplan.viz.map_drawing import draw_lines
from fgplan.viz.palette import LANDMARK, UNTOUCHED, robot_styles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRIVEN = "#D8CDB8"
"""Past ways on the figure that is about what is to come."""

_MARGIN_M = 0.5
_SMALLEST_M = 1e-3


def draw_figures(
    folder: Path,
    log: MrclamLog,
    steps: MrclamSteps,
    slam: TeamSlam,
    judgement: Judgement,
    planned: Planned,
) -> tuple[Path, ...]:
    """Draw and write all figures.

    Args:
        folder: Where to.
        log: For the true landmarks.
        steps: Truth and odometry.
        slam: The estimate.
        judgement: Errors over time.
        planned: What was chosen.

    Returns:
        The files.

    Raises:
        MissingExtraError: If matplotlib is not installed.
    """
    figures = {
        "trajectories": trajectories_figure(log, steps, slam, judgement),
        "errors": errors_figure(steps, judgement),
        "chosen_paths": _chosen_figure(slam, planned),
    }
    return tuple(save(figure, folder / f"{name}.png") for name, figure in figures.items())


def trajectories_figure(
    log: MrclamLog, steps: MrclamSteps, slam: TeamSlam, judgement: Judgement
) -> "Figure":
    """One map a robot: truth, joint estimate, odometry alone.

    Args:
        log: For the true landmarks.
        steps: Truth and odometry.
        slam: The estimate.
        judgement: For the titles.

    Returns:
        A matplotlib Figure.
    """
    styles = robot_styles(steps.robots)
    estimates = {robot: slam.trajectory(robot)[:, :2] for robot in steps.robots}
    true_points = np.array(list(log.landmarks.values())).reshape(-1, 2)
    points = np.array(list(slam.landmarks().values())).reshape(-1, 2)
    every = np.vstack([*estimates.values(), true_points])
    lower, upper = every.min(axis=0) - _MARGIN_M, every.max(axis=0) + _MARGIN_M
    share = float((upper[1] - lower[1]) / (upper[0] - lower[0]))
    height = 1000.0 / len(steps.robots) * share + 150.0
    figure = new_figure(height_px=min(max(height, 400.0), 900.0))
    row = figure.subplots(1, len(steps.robots), squeeze=False, sharex=True, sharey=True)[0]
    for axes, robot, errors in zip(row, steps.robots, judgement.robots, strict=True):
        truth = steps.truth[robot][:, :2]
        axes.plot(*steps.by_odometry[robot][:, :2].T, color=UNTOUCHED, lw=0.8, zorder=2)
        axes.plot(*estimates[robot].T, color=styles[robot].color, lw=1.3, zorder=4)
        axes.plot(*truth.T, color="black", lw=0.6, ls=(0, (4.0, 2.5)), zorder=5)
        axes.plot(*true_points.T, "o", mfc="none", mec=LANDMARK, ms=5, mew=0.8, zorder=6)
        axes.plot(*points.T, "+", color=LANDMARK, ms=5, mew=0.8, zorder=6)
        axes.plot(*truth[0], "*", color=styles[robot].color, mec="white", ms=13, zorder=8)
        axes.set_title(
            f"{robot}: {errors.ate_m:.2f} m\n(odometry {errors.odometry_ate_m:.2f} m)", fontsize=11
        )
        axes.set_xlim(lower[0], upper[0])
        axes.set_ylim(lower[1], upper[1])
        axes.set_aspect("equal")
        axes.set_xlabel("x (m)")
    row[0].set_ylabel("y (m)")
    line, ring = matplotlib_module("lines").Line2D, {"ls": "", "color": LANDMARK}
    entries = {
        "Vicon": line([], [], color="black", lw=1.0, ls=(0, (4.0, 2.5))),
        "joint estimate (in the robot's colour)": line([], [], color="#505050", lw=2.0),
        "odometry alone": line([], [], color=UNTOUCHED, lw=1.2),
        "start": line([], [], marker="*", ls="", color="#505050", ms=12),
        "landmark, true": line([], [], marker="o", mfc="none", **ring),
        "landmark, mapped": line([], [], marker="+", **ring),
    }
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=10,
    )
    figure.suptitle("MR.CLAM: five robots by joint SLAM, error against Vicon (RMSE)", fontsize=14)
    return figure


def errors_figure(steps: MrclamSteps, judgement: Judgement) -> "Figure":
    """Position error over time, one row a robot, logarithmic.

    Args:
        steps: For the times.
        judgement: The errors.

    Returns:
        A matplotlib Figure.
    """
    styles = robot_styles(steps.robots)
    since = steps.times_s - steps.times_s[0]
    figure = new_figure(height_px=150 * len(steps.robots) + 120)
    rows = figure.subplots(len(steps.robots), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
    for axes, errors in zip(rows, judgement.robots, strict=True):
        robot = errors.robot
        odometry = np.maximum(judgement.odometry_errors_m[robot], _SMALLEST_M)
        estimate = np.maximum(judgement.errors_m[robot], _SMALLEST_M)
        axes.plot(since, odometry, color=UNTOUCHED, lw=1.2)
        axes.plot(since, estimate, color=styles[robot].color, lw=1.4)
        axes.axhline(errors.required_m, color="black", lw=0.9, ls=(0, (4.0, 2.5)))
        blind = [
            tick
            for tick, of_tick in enumerate(steps.measurements)
            if not any(one.robot == robot for one in of_tick)
        ]
        axes.plot(since[blind], np.full(len(blind), 1.4e-2), "|", color="#E6007E", ms=4)
        axes.set_yscale("log")
        axes.set_ylim(1e-2, 20.0)
        axes.set_ylabel("error (m)")
        axes.set_title(
            f"{robot}: RMSE {errors.ate_m:.3f} m, odometry {errors.odometry_ate_m:.2f} m, required "
            f"{errors.required_m:.2f} m",
            fontsize=10,
            loc="left",
        )
    rows[-1].set_xlabel("time since the start (s)")
    line = matplotlib_module("lines").Line2D
    entries = {
        "joint estimate (in the robot's colour)": line([], [], color="#505050", lw=2.0),
        "odometry alone": line([], [], color=UNTOUCHED, lw=1.2),
        "required of the RMSE": line([], [], color="black", lw=0.9, ls=(0, (4.0, 2.5))),
        "the robot's camera sees nothing": line([], [], marker="|", ls="", color="#E6007E"),
    }
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=2,
        frameon=False,
        fontsize=10,
    )
    figure.suptitle("MR.CLAM: position error, aligned at the first pose only", fontsize=14)
    return figure


def _chosen_figure(slam: TeamSlam, planned: Planned) -> "Figure":
    """Chosen paths, ellipses, multi-robot factors and planned observations."""
    team, paths = planned.team, planned.agreement.paths
    figure = chosen_paths_figure(
        paths,
        {
            robot: world_position_covariances(path.poses, planned.arrival.covariances[robot])
            for robot, path in paths.items()
        },
        joined=planned.joined,
        landmarks=team.problem.prior.landmarks(),
        workspace=team.workspace,
        goals=team.goals,
        title="MR.CLAM: chosen paths and what the robots will know (pale brown: driven)",
    )
    lines = [slam.trajectory(robot)[:, :2] for robot in slam.robots]
    draw_lines(figure.axes[0], lines, color=DRIVEN, lw=0.7, alpha=0.7, zorder=0.9)
    return figure
