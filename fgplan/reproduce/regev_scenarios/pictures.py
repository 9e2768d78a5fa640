"""Pictures over all seeds: running time by session (16, 19), covariance over time (15b, 17b, 18b).

Those of the mission of seed 0, figures 8 to 19 one by one, are drawn where it runs.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.reproduce.regev_scenarios.mission_run import REFERENCE
from fgplan.reproduce.regev_scenarios.scenario_summary import Missions
from fgplan.viz.figure import new_figure, save
from fgplan.viz.palette import robot_styles
from fgplan.viz.running_times import running_time_bars_figure


def draw_summaries(
    missions: Missions, summaries: Sequence[Mapping[str, Any]], folder: Path
) -> list[Path]:
    """Draw what all seeds come to.

    Args:
        missions: Results of ``run_mission``.
        summaries: Made of them by ``summarise``.
        folder: Where to.

    Returns:
        The files.
    """
    files = []
    for entry in summaries:
        if entry["variant"] == "as_published":
            figure = running_time_bars_figure(
                [str(row["session"]) for row in entry["by_session"]],
                {
                    name: [row["seconds"][name] for row in entry["by_session"]]
                    for name in entry["seconds_total"]
                },
                reference=REFERENCE,
                title=(
                    f"Scenario {entry['scenario']}: running time by planning session, median of "
                    f"{entry['missions']} missions (figures 16 and 19)"
                ),
            )
            files.append(save(figure, folder / f"scenario_{entry['scenario']}_running_times.png"))
    files.append(_draw_traces(missions, folder))
    return files


def _draw_traces(missions: Missions, folder: Path) -> Path:
    """Largest position trace of the team against steps, median and middle half over seeds."""
    groups: dict[str, list[Sequence[float]]] = {}
    for one in missions:
        name = f"Scenario {one['scenario']}"
        if one["variant"] != "as_published":
            name += ", own landmarks alone"
        groups.setdefault(name, []).append(one["largest_position_trace_by_step"])
    styles = robot_styles(sorted(groups))
    figure = new_figure(height_px=520)
    axes = figure.subplots()
    for name in sorted(groups):
        # A mission that has ended keeps its last value, so that every step has all seeds.
        steps = max(map(len, groups[name]))
        curves = np.array([[*each, *[each[-1]] * (steps - len(each))] for each in groups[name]])
        low, middle, high = np.percentile(curves, [25, 50, 75], axis=0)
        style = styles[name]
        axes.fill_between(range(steps), low, high, color=style.color, alpha=0.15, lw=0)
        axes.plot(range(steps), middle, color=style.color, ls=style.dash, lw=2, label=name)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("step")
    axes.set_ylabel("largest trace of a robot's position covariance (m²)")
    axes.grid(axis="y", color="#E0E0E0", lw=0.8)
    axes.legend(frameon=False)
    axes.set_title(
        "Position covariance from SLAM (figures 15b, 17b, 18b)\n"
        "(median over seeds; bands: middle half)",
        fontsize=13,
    )
    return save(figure, folder / "position_covariance.png")
