"""The heuristic of section IV-B: random meeting points, short ways, and waiting.

A team draws a meeting point from the free space; every robot goes there at full speed by the
geodesic, and waits for the others. Nothing is optimised.
"""

import numpy as np

from fgplan.errors import NoCandidatePathError
from fgplan.planners.intermittent.geodesic_way import geodesic_cells, geodesic_way, walk
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.segment import Segment
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from roadmaps import sample_positions

_DRAWS = 50


def plan_meeting_point(
    problem: SegmentProblem, options: SegmentOptions, generator: np.random.Generator
) -> Segment:
    """Plan a team's ways to a random meeting point.

    Args:
        problem: Starts; the estimate is not looked at.
        options: Length of a step.
        generator: Source of the point.

    Returns:
        Ways that end there; robots that arrive early wait.

    Raises:
        NoCandidatePathError: If no point drawn can be reached by all.
    """
    grid = geodesic_cells(problem.workspace)
    for point in sample_positions(problem.workspace, _DRAWS, generator):
        try:
            ways = [walk(geodesic_way(grid, a, point), options.step_m) for a in problem.starts]
        except NoCandidatePathError:
            continue
        arrivals = [int(t) + len(w) - 1 for t, w in zip(problem.times, ways, strict=True)]
        end = max(arrivals)
        places = tuple(
            np.concatenate([way, np.repeat(way[-1:], end - arrival, axis=0)])
            for way, arrival in zip(ways, arrivals, strict=True)
        )
        return Segment(
            end=end,
            places=places,
            cost=float("nan"),
            target=-1,
            rank=-1,
            failed=(),
            nodes=1,
            meeting_nodes=1,
        )
    raise NoCandidatePathError(
        f"no meeting point of {_DRAWS} that all robots can reach from "
        f"{np.round(problem.starts, 3).tolist()}: obstacles keep them apart"
    )
