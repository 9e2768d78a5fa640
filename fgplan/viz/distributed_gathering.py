"""Pictures of distributed robots that gather information: figures 3 and 4 of Tzes et al. 2021.

Figure 4(a)-(c): the team's paths with the ellipses of one robot that is done, and who hears whom;
4(d): every target's uncertainty at one robot; figure 3: time of an iteration. And a film in which
links come and go.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.models.uncertainty import uncertainty_function
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.stopping_rule import links_along
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.viz.figure import matplotlib_module, new_figure
from fgplan.viz.information_gathering import draw_team_path, film_team_path
from fgplan.viz.palette import ROBOT_COLORS, robot_styles
from fgplan.viz.running_times import draw_bars
from fgplan.viz.uncertainty_label import uncertainty_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PREFIX = "iteration_us_"


def draw_distributed_plan(
    problem: AcquisitionProblem,
    plan: TeamPlan,
    graph: CommunicationGraph,
    label: str,
    *,
    robot: int | None = None,
) -> "Figure":
    """The team's paths on a map: figure 4(a)-(c).

    Args:
        problem: What was planned for.
        plan: The plan.
        graph: Who hears whom.
        label: Name of the graph, for the title.
        robot: Whose ellipses are drawn, its place in the team; the one that is done last if left
            out.

    Returns:
        The figure.
    """
    seen = done_robot(plan) if robot is None else robot
    title = f"{label}: F = {plan.horizon} steps; ellipses are those of {problem.robots[seen].name}"
    links = links_along(graph, plan.poses)
    figure = draw_team_path(problem, plan.at(seen), title, links=links)
    styles = robot_styles([one.name for one in problem.robots])
    halo = matplotlib_module("patheffects").withStroke(linewidth=2.5, foreground="white")
    for one in problem.robots:
        name = figure.axes[0].annotate(
            one.name,
            (float(one.pose[0]), float(one.pose[1])),
            xytext=(6, 5),
            textcoords="offset points",
            color=styles[one.name].color,
            fontweight="bold",
            zorder=9,
        )
        name.set_path_effects([halo])
    return figure


def film_distributed_plan(
    problem: AcquisitionProblem,
    plan: TeamPlan,
    graph: CommunicationGraph,
    file: str | Path,
    *,
    frames: int = 60,
) -> Path:
    """An animated GIF: robots move, links come and go, ellipses of the robot that is done shrink.

    Args:
        problem: What was planned for.
        plan: The plan.
        graph: Who hears whom.
        file: Ends in .gif.
        frames: Most frames.

    Returns:
        The path of the file.

    Raises:
        InvalidInputError: If the name ends otherwise.
    """
    links = links_along(graph, plan.poses)
    path = plan.at(done_robot(plan))
    return film_team_path(problem, path, file, frames=frames, links=links)


def done_robot(plan: TeamPlan) -> int:
    """The robot that is looked at: where the constraint holds last, of several the first.

    Args:
        plan: The plan; where the constraint holds at no robot, as in one that was cut by the rule
            of section VI-B, the robot of the last horizon.

    Returns:
        Its place in the team.
    """
    held = plan.satisfied if plan.satisfied.any() else np.ones(len(plan.satisfied), dtype=np.bool_)
    return int(np.argmax(np.where(held, plan.horizons, -1)))


def draw_target_uncertainties(
    problem: AcquisitionProblem, plan: TeamPlan, robot: int, label: str
) -> "Figure":
    """Every target's uncertainty at one robot against time, and the limit: figure 4(d).

    Args:
        problem: What was planned for.
        plan: The plan.
        robot: Its place in the team.
        label: Name of the graph, for the title.

    Returns:
        The figure; targets that move are dashed.
    """
    terminal = problem.terminal
    function = uncertainty_function(terminal.function)
    figure = new_figure(height_px=560)
    axes = figure.add_subplot()
    path = plan.at(robot)
    for k, target in enumerate(problem.hidden.targets):
        values = function.evaluate(path.of_target(problem, k), problem.priors[k])
        block = problem.hidden.blocks[k]
        moves = bool(np.any(block.drift) or np.any(block.process))
        marker = "ovsd"[k // len(ROBOT_COLORS) % 4]
        axes.plot(
            values,
            color=ROBOT_COLORS[k % len(ROBOT_COLORS)],
            ls="--" if moves else "-",
            marker=marker,
            markevery=max(1, len(values) // 12),
            ms=4,
            lw=1.5,
            label=f"{target}, moves" if moves else target,
        )
    for limit in np.unique(terminal.limits(problem.targets)):
        axes.axhline(float(limit), color="black", ls=":", lw=1.6, label=f"limit δ = {limit:.3g}")
    if function.positive and not function.needs_prior:
        axes.set_yscale("log")
    axes.set_xlabel("step")
    axes.set_ylabel(uncertainty_label(function.name))
    axes.set_title(f"{label}: targets as {problem.robots[robot].name} knows them", fontsize=13)
    axes.grid(color="#E8E8E8", lw=0.7)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", frameon=False)
    return figure


def iteration_time_figure(
    rows: Sequence[Mapping[str, Any]], *, title: str = "Time of one iteration"
) -> "Figure":
    """Time of an iteration by row, bars of each way of planning: figure 3.

    Args:
        rows: Each with ``robots``, ``targets`` and numbers whose keys begin with
            ``iteration_us_``, microseconds; the rest of the key names the bar. A row may lack one.
        title: Of the figure.

    Returns:
        The figure.

    Raises:
        InvalidInputError: If there is no such number, or one is not above zero.
    """
    keys = list(dict.fromkeys(key for row in rows for key in row if key.startswith(_PREFIX)))
    if not keys:
        raise InvalidInputError(
            f"figure: expected rows with keys that begin with {_PREFIX!r}, got none"
        )
    values = {}
    for key in keys:
        each = np.array([float(row.get(key, np.nan)) for row in rows])
        if (each <= 0).any():
            raise InvalidInputError(f"figure: expected {key} above zero, got {each.tolist()}")
        values[key.removeprefix(_PREFIX).replace("_", " ")] = each
    colors = {name: ROBOT_COLORS[i % len(ROBOT_COLORS)] for i, name in enumerate(values)}
    figure = new_figure(height_px=520)
    axes = figure.add_subplot()
    groups = [f"{row['robots']}/{row['targets']}" for row in rows]
    draw_bars(axes, groups, values, colors, "robots/targets")
    axes.set_yscale("log")
    axes.set_ylabel("time of an iteration (µs)")
    figure.legend(
        *axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False
    )
    figure.suptitle(title, fontsize=14)
    return figure
