"""From one meeting of a team to its next: Algorithm 1, its goal set, and what if it is empty.

Goal set (6): (i) the communication graph of the robots' places is connected, lambda_2 of its
Laplacian positive; (ii) all arrive at the same time; (iii) the uncertainty of the most uncertain
target, in the team's view when it plans, is at most delta (or each robot has travelled far enough,
section III-B). The node of least cost wins, as the text has it (line 13 of Algorithm 1 says least
uncertainty). If none satisfies (iii), the next most uncertain target is tried, and so on (section
IV; of equally uncertain ones the nearest); then (iii) is dropped. If the tree has no connected
simultaneous node at all, the robots go by short ways to the place that the last of them reaches
first, and slow down so that all arrive with it. So a team always meets, and the segment says what
failed.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.errors import NoCandidatePathError
from fgplan.planners.intermittent.geodesic_way import geodesic_cells, geodesic_way, walk
from fgplan.planners.intermittent.joint_tree import JointTree
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.typing import BoolArray, FloatArray, IntArray
from roadmaps import sample_positions

MEETING_PLACES = 32
"""Places tried by the last fallback, beside the robots' starts."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """Paths of a team to a meeting.

    Attributes:
        end: Time of the meeting, steps.
        places: Of each body, one row a step from its start to ``end``, shape (end - t0 + 1, 2).
        cost: Sum of uncertainty from the earliest start to the end; NaN after the last fallback.
        target: Which target met the limit; -1 where none did.
        rank: Its place in the order of uncertainty, 0 the most uncertain; -1 where none did.
        failed: Constraints of (6) that had to be given up: some of ``uncertainty``, ``connection``,
            ``time``.
        nodes: Nodes of the tree.
        meeting_nodes: Nodes that satisfy (i) and (ii).
    """

    end: int
    places: tuple[FloatArray, ...]
    cost: float
    target: int
    rank: int
    failed: tuple[str, ...]
    nodes: int
    meeting_nodes: int

    @property
    def at_first_attempt(self) -> bool:
        """Whether the limit held for the most uncertain target, without any fallback."""
        return self.rank == 0 and not self.failed


def algebraic_connectivity(places: FloatArray, range_m: float) -> float:
    """Second smallest eigenvalue of the Laplacian of a communication graph.

    Args:
        places: Shape (B, 2), metres.
        range_m: Links are at most this long.

    Returns:
        lambda_2; positive iff the graph is connected. Infinite for a single robot.
    """
    if len(places) == 1:
        return float("inf")
    gap = np.hypot(*np.moveaxis(places[:, None] - places[None], -1, 0))
    links = (gap <= range_m).astype(np.float64)
    np.fill_diagonal(links, 0.0)
    laplacian = np.diag(links.sum(axis=1)) - links
    return float(np.linalg.eigvalsh(laplacian)[1])


def plan_segment(
    problem: SegmentProblem, options: SegmentOptions, generator: np.random.Generator
) -> Segment:
    """Plan a team's paths to its next meeting.

    Args:
        problem: Starts, estimate and model.
        options: Of Algorithm 1.
        generator: Source of all samples.

    Returns:
        Paths that end in a meeting, and which constraints had to be given up.

    Raises:
        NoCandidatePathError: If obstacles keep the robots apart.
    """
    grown = grow_tree(problem, options, generator)
    meets, simultaneous, connected = meeting_nodes(grown)
    rows = np.flatnonzero(meets)
    report = {"nodes": grown.count, "meeting_nodes": len(rows)}
    if not len(rows):
        failed: tuple[str, ...] = () if connected.any() else ("connection",)
        failed += () if simultaneous.any() else ("time",)
        return _straight_meeting(problem, options, generator, failed or ("time",), report)
    settled = [grown.settle(row) for row in rows.tolist()]
    costs = np.array([cost for cost, _ in settled])
    if options.goal == "travel":
        good = (grown.tree.travelled[rows] >= options.travel_m).all(axis=1) & np.isfinite(costs)
        if good.any():
            best = int(rows[good][np.argmin(costs[good])])
            return _segment(grown, best, -1, 0, (), report)
        best = int(rows[np.argmax(grown.tree.travelled[rows].min(axis=1))])
        return _segment(grown, best, -1, -1, ("travel",), report)
    values = np.array([problem.model.uncertainties(covariance) for _, covariance in settled])
    now = problem.model.uncertainties(grown.tree.covariance[0])
    order = _by_uncertainty(problem, now)
    for rank, target in enumerate(order):
        good = (values[:, target] <= options.delta) & np.isfinite(costs)
        if good.any():
            best = int(rows[good][np.argmin(costs[good])])
            return _segment(grown, best, target, rank, (), report)
    best = int(rows[np.argmin(values[:, order[0]])])
    return _segment(grown, best, -1, -1, ("uncertainty",), report)


def _by_uncertainty(problem: SegmentProblem, now: FloatArray) -> list[int]:
    """Targets, the most uncertain first; among equals (all, at first) the nearest to the team."""
    places = problem.model.target_places(problem.estimate.mean)
    far = np.hypot(*(places - problem.starts.mean(axis=0)).T)
    scale = float(now.max()) or 1.0
    return [int(target) for target in np.lexsort((far, -np.round(now / scale, 9)))]


def grow_tree(
    problem: SegmentProblem, options: SegmentOptions, generator: np.random.Generator
) -> JointTree:
    """Algorithm 1 up to its last line.

    Args:
        problem: Starts, estimate and model.
        options: Of Algorithm 1.
        generator: Source of all samples.

    Returns:
        The tree.
    """
    grown = JointTree(problem, options)
    for wanted in draw_samples(problem, options, generator):
        grown.extend(wanted)
    return grown


def draw_samples(
    problem: SegmentProblem, options: SegmentOptions, generator: np.random.Generator
) -> FloatArray:
    """Samples of f_1, then of f_2 (section IV).

    Args:
        problem: Workspace and number of bodies.
        options: Their numbers, and the spread of f_2.
        generator: Source of all samples.

    Returns:
        Shape (n_sample, B, 2), metres: first ``explore`` uniform over the free joint space, then
        normal about a meeting place that is uniform over the free space, within the bounds.
    """
    bodies, world = len(problem.starts), problem.workspace
    first = min(options.explore, options.samples)
    rest = options.samples - first
    uniform = sample_positions(world, first * bodies, generator).reshape(first, bodies, 2)
    centers = sample_positions(world, rest, generator)
    spread = 2.0 * options.range_m if options.spread_m is None else options.spread_m
    about = centers[:, None] + spread * generator.standard_normal((rest, bodies, 2))
    return np.concatenate([uniform, np.clip(about, world.lower, world.upper)])


def meeting_nodes(grown: JointTree) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Conditions (i) and (ii) of the goal set (6) for every node but the root.

    Args:
        grown: The tree.

    Returns:
        Whether a node satisfies what is asked of it, (ii), and (i); shape (nodes,) each. With
        ``relaxed`` (ii) is not asked for; a fixed formation is always connected.
    """
    count = grown.count
    simultaneous = np.ptp(grown.tree.time[:count], axis=1) == 0
    connected = np.ones(count, dtype=np.bool_)
    if grown.problem.meets:
        connected = _connected(grown.tree.position[:count], grown.options.range_m)
    simultaneous[0] = connected[0] = False
    meets = connected & np.isfinite(grown.tree.cost[:count])
    if grown.options.sync != "relaxed":
        meets &= simultaneous
    return meets, simultaneous, connected


def _connected(places: FloatArray, range_m: float) -> BoolArray:
    """Which joint positions, shape (V, B, 2), form a connected graph: lambda_2 > 0."""
    bodies = places.shape[1]
    offsets = places[:, :, None] - places[:, None]
    reach = np.sqrt((offsets**2).sum(axis=-1)) <= range_m
    for _ in range(max(bodies - 2, 0).bit_length()):
        reach = reach @ reach
    return np.asarray(reach[:, 0].all(axis=1))


def _segment(
    grown: JointTree,
    node: int,
    target: int,
    rank: int,
    failed: tuple[str, ...],
    report: dict[str, int],
) -> Segment:
    """The paths to a node, a row a step; who arrives early waits (``relaxed`` only)."""
    way = grown.path(node)
    end = int(grown.tree.time[node].max())
    places = []
    for body, start in enumerate(grown.problem.times.tolist()):
        times = grown.tree.time[way, body]
        steps = np.arange(start, end + 1)
        corners = grown.tree.position[way, body]
        places.append(np.stack([np.interp(steps, times, axis) for axis in corners.T], axis=1))
    return Segment(
        end=end,
        places=tuple(places),
        cost=grown.settle(node)[0],
        target=target,
        rank=rank,
        failed=failed,
        **report,
    )


def _straight_meeting(
    problem: SegmentProblem,
    options: SegmentOptions,
    generator: np.random.Generator,
    failed: tuple[str, ...],
    report: dict[str, int],
) -> Segment:
    """The last fallback: meet where the last robot arrives first."""
    grid = geodesic_cells(problem.workspace)
    drawn = sample_positions(problem.workspace, MEETING_PLACES, generator)
    best: tuple[int, list[FloatArray]] | None = None
    for place in np.concatenate([problem.starts, drawn]):
        try:
            ways = [geodesic_way(grid, start, place) for start in problem.starts]
        except NoCandidatePathError:
            continue
        arrival = max(
            int(time) + len(walk(way, options.step_m)) - 1
            for time, way in zip(problem.times, ways, strict=True)
        )
        if best is None or arrival < best[0]:
            best = (arrival, ways)
    if best is None:
        raise NoCandidatePathError(
            f"no place that all of {len(problem.starts)} robots can reach from "
            f"{np.round(problem.starts, 3).tolist()}: obstacles keep them apart"
        )
    end, ways = best
    return Segment(
        end=end,
        places=stretched(ways, problem.times, end, options.step_m),
        cost=float("nan"),
        target=-1,
        rank=-1,
        failed=("uncertainty", *failed),
        **report,
    )


def stretched(
    ways: list[FloatArray], starts: IntArray, end: int, step_m: float
) -> tuple[FloatArray, ...]:
    """Ways walked so slowly that all arrive at the same step; corners fall on whole steps.

    Args:
        ways: Corners of each body's way, shape (C, 2), metres.
        starts: Step at which each starts.
        end: Step at which all arrive; not before any of them can (``walk``).
        step_m: Longest step, metres.

    Returns:
        Places of each, one row a step, shape (end - start + 1, 2).
    """
    placed = []
    for way, start in zip(ways, starts.tolist(), strict=True):
        lengths = np.hypot(*np.diff(way, axis=0).T)
        least = np.ceil(lengths / step_m - 1e-9)
        spare = end - start - least.sum()
        passed = np.concatenate([[0.0], np.cumsum(lengths)])
        share = passed / passed[-1] if passed[-1] > 0.0 else np.linspace(0.0, 1.0, len(passed))
        at = np.concatenate([[0.0], np.cumsum(least)]) + np.round(share * spare)
        steps = np.arange(end - start + 1)
        placed.append(np.stack([np.interp(steps, at, axis) for axis in way.T], axis=1))
    return tuple(placed)
