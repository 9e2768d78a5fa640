"""Algorithm 1 from a problem to the best plan found: budgets, restarts, and ending at any time.

The tree is grown in calls of compiled loops; between two calls there is time for more room, for
progress, and for an interrupt, after which the best plan so far is still handed back. Where a part
is not known to the compiled loops (a user's own sensor, density or uncertainty function, the
optimal assignment) one iteration at a time is driven from Python, with the same kernels; without
the compiler, in numpy (``plain_growth``). All grow the same tree.
"""

import time
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from fgplan.checks import check_generator
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.geodesic_fields import GeodesicFields
from fgplan.planners.aia.growth import Growth
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.lower_bound import unreachable_reason
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.problem import AcquisitionProblem, check_monotone
from fgplan.planners.aia.team_path import TeamPath
from fgplan.planners.planner import Progress
from fgplan.threads import one_blas_thread

Ending = Literal[
    "feasible", "iterations", "nodes", "seconds", "stalled", "interrupted", "unreachable", "lost"
]
_ITERATIONS_A_CALL = 4096
_STALLED = 50_000
_RESTART_FACTOR = 2
_RESTART_ITERATIONS = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchResult:
    """What a search found.

    Attributes:
        plan: The best plan; None if no feasible one was found.
        ending: Why the search ended.
        shortfall: Least shortfall of any node: the worst target's number over its limit; at most
            one where a plan is feasible (wherever the robots are).
        closest: Path to that node.
        nodes: Nodes of the last tree; ``counts`` has the rest of what was counted, over all trees.
        counts: Iterations, rejected draws, nodes left out by bound, dominance and repetition.
        bytes_per_node: Memory by room for a node.
        seconds: Real seconds of ``setup`` (geodesic fields, arrays) and ``search``.
        improvements: (seconds since the search began, cost) of each best plan.
        reason: Why the terminal constraint is unreachable, if that is known beforehand.
        farthest: Target farthest from its limit at the closest node; empty of a joint constraint.
    """

    plan: TeamPath | None
    ending: Ending
    shortfall: float
    closest: TeamPath | None
    nodes: int
    counts: dict[str, int]
    bytes_per_node: float
    seconds: dict[str, float]
    improvements: tuple[tuple[float, float], ...] = ()
    reason: str = ""
    farthest: str = ""


@dataclass(slots=True)
class _Clock:
    """Budgets of one search and what it has found so far."""

    options: TreeOptions
    began: float
    best: TeamPath | None = None
    closest: TeamPath | None = None
    shortfall: float = float("inf")
    farthest: str = ""
    improvements: list[tuple[float, float]] = field(default_factory=list)

    @property
    def elapsed(self) -> float:
        """Seconds since the search began."""
        return time.perf_counter() - self.began

    @property
    def late(self) -> bool:
        """Whether the time is over."""
        return self.options.seconds is not None and self.elapsed >= self.options.seconds

    def note(self, growth: Growth) -> None:
        """Keep what a tree has found."""
        cost = growth.best_cost
        if cost < (self.best.cost if self.best is not None else np.inf):
            self.best = growth.best_path()
            self.improvements.append((self.elapsed, cost))
        if growth.shortfall < self.shortfall:
            self.shortfall = growth.shortfall
            self.closest = growth.closest_path()
            self.farthest = growth.farthest


@one_blas_thread()
def search(
    problem: AcquisitionProblem,
    options: TreeOptions,
    generator: np.random.Generator,
    *,
    progress: Progress | None = None,
    densities: Densities | None = None,
    fields: GeodesicFields | None = None,
) -> SearchResult:
    """Plan by a sampling tree.

    Args:
        problem: What is planned for.
        options: How.
        generator: Source of every random number.
        progress: Told nodes, node budget, and the best value with the worst target's uncertainty.
        densities: A user's own f_V and f_U.
        fields: Geodesic distances of the same workspace, start and cells, to be used again.

    Returns:
        The best plan found and what was counted.

    Raises:
        InvalidInputError: If the problem, or a user's own part, is not usable.
    """
    check_generator(generator, "search")
    if options.dominance != "off":
        check_monotone(problem)
    reason = unreachable_reason(problem, options.measure_at)
    began = time.perf_counter()
    growth = make_growth(problem, options, densities, fields)
    clock = _Clock(options, time.perf_counter())
    seconds = {"setup": clock.began - began}
    counts: dict[str, int] = {}
    ending: Ending = "unreachable" if reason else "iterations"
    limit = options.iterations if options.iterations is not None else 2**62
    for restart in range(0 if reason else 1 + options.restarts):
        bound = np.inf if clock.best is None else clock.best.cost
        growth.plant(bound)
        ending = _grow(growth, clock, generator, progress, limit)
        if restart == 0 and clock.best is not None:
            # A tree that the bound has cut off would go on for ever: later ones get little more
            # than the first one needed.
            limit = min(limit, max(_RESTART_ITERATIONS, _RESTART_FACTOR * growth.iterations))
        clock.note(growth)
        for name, number in growth.counted().items():
            counts[name] = counts.get(name, 0) + number
        if ending in ("interrupted", "seconds"):
            break
    seconds["search"] = clock.elapsed
    return SearchResult(
        plan=clock.best,
        ending=ending,
        shortfall=clock.shortfall,
        closest=clock.closest,
        nodes=growth.nodes,
        counts=counts,
        bytes_per_node=growth.bytes_per_node,
        seconds=seconds,
        improvements=tuple(clock.improvements),
        reason=reason,
        farthest=clock.farthest,
    )


def _grow(
    growth: Growth,
    clock: _Clock,
    generator: np.random.Generator,
    progress: Progress | None,
    limit: int,
) -> Ending:
    """Grow one tree until a budget is spent."""
    options = clock.options
    if options.until == "first_feasible" and growth.feasible:
        return "feasible"
    added_at, nodes = 0, growth.nodes
    try:
        while growth.iterations < limit:
            now = min(_ITERATIONS_A_CALL, limit - growth.iterations)
            ended = growth.run(now, generator)
            clock.note(growth)
            if progress is not None:
                progress(growth.nodes, options.node_budget, _state(clock))
            if options.until == "first_feasible" and growth.feasible:
                return "feasible"
            if ended == "nodes":
                return "nodes"
            if clock.late:
                return "seconds"
            if growth.nodes > nodes:
                added_at, nodes = growth.iterations, growth.nodes
            elif growth.iterations - added_at >= _STALLED:
                return "stalled"
    except KeyboardInterrupt:
        clock.note(growth)
        return "interrupted"
    return "iterations"


def _state(clock: _Clock) -> str:
    """Best value and worst target, in words."""
    best = "none yet" if clock.best is None else f"{clock.best.cost:.4g}"
    return f"nodes; best plan {best}; worst target at {clock.shortfall:.3g} of its limit"
