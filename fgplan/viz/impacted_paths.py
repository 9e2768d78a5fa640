"""What a new announcement changed: figure 7 of Regev and Indelman 2017.

Two maps, the previous and the new announcement. Factors that both have are cyan; those of the
previous one alone golden (removed), those of the new one alone magenta (added). The vertices of
the robot that a factor touches (involved vertices) are circles. Candidate paths that are impacted
are in the robot's colour; untouched ones, which the paper leaves out, pale grey.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.typing import FloatArray
from fgplan.viz.map_drawing import (
    MapPicture,
    draw_lines,
    draw_roadmap,
    draw_start,
    draw_workspace,
    map_extent,
    path_positions,
    state_position,
)
from fgplan.viz.palette import ADDED, REMOVED, UNCHANGED, UNTOUCHED, robot_styles
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Pairs = Sequence[tuple[State, State]]


def impacted_paths_figure(
    candidates: Sequence[CandidatePath],
    impacted: Sequence[int],
    before: Mapping[str, CandidatePath],
    after: Mapping[str, CandidatePath],
    *,
    kept: Pairs,
    removed: Pairs,
    added: Pairs,
    team: Sequence[str] = (),
    workspace: Workspace | None = None,
    roadmap: nx.Graph | None = None,
    title: str | None = None,
) -> "Figure":
    """Draw which candidate paths of one robot a change of announcements impacts, and why.

    Args:
        candidates: All candidate paths of the robot that re-evaluates.
        impacted: Indices of the impacted ones.
        before: The others' announced paths as they were.
        after: The others' announced paths as they are.
        kept: Pairs of states with a multi-robot factor before and after, in any order of the two.
        removed: Pairs with one before alone.
        added: Pairs with one after alone.
        team: Names in the order of the team, for the colours.
        workspace: Bounds and obstacles; None takes the extent of the paths.
        roadmap: Drawn in the background.
        title: Title of the figure; None counts the impacted paths.

    Returns:
        A matplotlib Figure with two maps.

    Raises:
        InvalidInputError: If there is no candidate, or an index is out of range.
        MissingExtraError: If matplotlib is not installed.
    """
    if not candidates:
        raise InvalidInputError("figure: expected at least one candidate path, got none")
    wrong = [index for index in impacted if not 0 <= index < len(candidates)]
    if wrong:
        raise InvalidInputError(
            f"figure: expected impacted indices from 0 to {len(candidates) - 1}, got {wrong[0]}"
        )
    robot = candidates[0].robot
    lines = [path_positions(path) for path in candidates]
    chosen = frozenset(impacted)
    others = tuple(dict.fromkeys((*before, *after)))
    styles = robot_styles(tuple(dict.fromkeys((*team, robot, *others))))
    everything = [*lines, *(path_positions(p) for p in (*before.values(), *after.values()))]
    picture = MapPicture(map_extent(workspace, everything), panels=2)
    touched = [line for index, line in enumerate(lines) if index in chosen]
    untouched = [line for index, line in enumerate(lines) if index not in chosen]
    own = styles[robot]
    for axes, announced, changed, color, name in (
        (picture.axes[0], before, removed, REMOVED, "Previous announcement"),
        (picture.axes[1], after, added, ADDED, "New announcement"),
    ):
        axes.set_title(name, fontsize=12)
        draw_lines(axes, untouched, color=UNTOUCHED, lw=1.0, zorder=2.2)
        draw_lines(axes, touched, color=own.color, lw=1.1, alpha=0.65, zorder=3)
        draw_lines(axes, _segments(kept), color=UNCHANGED, lw=0.9, zorder=4)
        draw_lines(axes, _segments(changed), color=color, lw=0.9, zorder=4.2)
        involved = _involved((*kept, *changed), robot)
        axes.plot(*involved.T, "o", mfc="white", mec=own.color, mew=1.3, ms=6, zorder=5)
        draw_start(picture, axes, robot, lines[0][0], own)
        for other, path in announced.items():
            style, line = styles[other], path_positions(path)
            axes.plot(
                *line.T, color=style.color, ls=style.dash, lw=2.6, marker=".", ms=7, zorder=4.5
            )
            draw_start(picture, axes, other, line[0], style)
        if roadmap is not None:
            draw_roadmap(picture, axes, roadmap)
        if workspace is not None:
            draw_workspace(picture, axes, workspace)
    picture.entry(f"{robot}: impacted ({len(touched)})", color=own.color, lw=1.6)
    picture.entry(f"{robot}: untouched ({len(untouched)})", color=UNTOUCHED, lw=1.6)
    picture.entry("involved vertex", marker="o", mfc="white", mec=own.color, ls="", ms=7)
    for other in others:
        label, style = f"{other}: announced", styles[other]
        picture.entry(label, color=style.color, ls=style.dash, lw=2.6, marker=".")
    for label, color, pairs in (
        ("unchanged", UNCHANGED, kept),
        ("removed", REMOVED, removed),
        ("added", ADDED, added),
    ):
        picture.entry(f"{label} factor ({len(pairs)})", color=color, lw=2.0)
    count = f"{len(touched)} of {len(lines)} candidate paths of {robot} are impacted"
    return picture.finish(title or count)


def _segments(pairs: Pairs) -> list[FloatArray]:
    """The two positions of each pair, shape (2, 2)."""
    return [np.array([state_position(one), state_position(other)]) for one, other in pairs]


def _involved(pairs: Pairs, robot: str) -> FloatArray:
    """Positions of one robot's states that a factor touches, each once: shape (n, 2)."""
    own = [state for pair in pairs for state in pair if state.robot == robot]
    points = {tuple(state_position(state).tolist()): None for state in own}
    return np.array(list(points)).reshape(-1, 2)
