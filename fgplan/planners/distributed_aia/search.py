"""Algorithm 1 of Tzes et al. 2021 for a whole team in one process, robots planned in turn.

After every sweep in which a goal node was made, team paths are extracted from the new ones and
replayed; the cheapest that satisfies the constraint (of equal ones that of the earliest robot's
earliest node) is the plan of its part of the team. With a budget, paths are extracted from each
robot's cheapest goal nodes at the end.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.checks import check_generator
from fgplan.planners.aia.geodesic_fields import GeodesicFields
from fgplan.planners.aia.lower_bound import unreachable_reason
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.search import Ending
from fgplan.planners.distributed_aia.extraction import extract, replayed, team_parts
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.options import DistributedOptions
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.planners.distributed_aia.way import Way
from fgplan.planners.planner import Progress
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.threads import one_blas_thread

_SWEEPS_A_CALL = 256

Candidate = tuple[TeamPlan, dict[int, Way]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DistributedResult:
    """What the robots found.

    Attributes:
        plan: The team's plan; None if a part of the team found none.
        ending: Why the search ended.
        sweeps: Iterations of each robot.
        shortfall: Least shortfall of any robot's node.
        counts: What was counted, over all robots.
        bytes_per_node: Memory by room for a node of one robot.
        seconds: Real seconds of ``setup`` and ``search``.
        reason: Why the terminal constraint is unreachable, if that is known beforehand.
        farthest: Target farthest from its limit at that node; empty of a joint constraint.
        candidates: Team paths that were replayed, and those ``refused`` there.
        refused: As said.
    """

    plan: TeamPlan | None
    ending: Ending
    sweeps: int
    shortfall: float
    counts: dict[str, int]
    bytes_per_node: float
    seconds: dict[str, float]
    candidates: int
    refused: int
    reason: str = ""
    farthest: str = ""


class _Parts:
    """The best plan of each part of the team."""

    def __init__(self, growth: ForestGrowth) -> None:
        self.growth = growth
        self.parts = team_parts(growth.graph)
        self.best: list[Candidate | None] = [None] * len(self.parts)
        self.candidates = self.refused = 0

    @property
    def done(self) -> bool:
        """Whether every part has a plan."""
        return all(best is not None for best in self.best)

    def look(self, rows: Sequence[int], born_since: int) -> None:
        """Replay paths of goal nodes; a robot whose goal nodes are all refused asks for more."""
        for row in rows:
            place = next(p for p, part in enumerate(self.parts) if row in part)
            goals = self.growth.goal_nodes(row, born_since)
            refused = self.refused
            for node in goals:
                ways = extract(self.growth, row, node)
                plan = replayed(self.growth, ways, ((row, node),))
                self.candidates += 1
                if plan is None:
                    self.refused += 1
                    continue
                best = self.best[place]
                if best is None or (plan.cost, plan.origins) < (best[0].cost, best[0].origins):
                    self.best[place] = (plan, ways)
            if goals and self.refused - refused == len(goals):
                self.growth.tighten(row)

    def joined(self) -> TeamPlan | None:
        """The plan of the whole team."""
        found = [best for best in self.best if best is not None]
        if len(found) < len(self.parts):
            return None
        if len(found) == 1:
            return found[0][0]
        ways = {robot: way for _, own in found for robot, way in own.items()}
        return replayed(self.growth, ways, [plan.origins[0] for plan, _ in found])


@one_blas_thread()
def search_distributed(
    problem: AcquisitionProblem,
    options: DistributedOptions,
    graph: CommunicationGraph,
    generator: np.random.Generator,
    *,
    progress: Progress | None = None,
    fields: GeodesicFields | None = None,
) -> DistributedResult:
    """Plan for a team whose robots each grow a tree.

    Args:
        problem: What is planned for.
        options: How.
        graph: Who hears whom.
        generator: Source of every random number; each robot has a stream of its own.
        progress: Told sweeps, the budget, and how far the nearest robot is.
        fields: Geodesic distances of the same workspace, start and cells, to be used again.

    Returns:
        The plan and what was counted.

    Raises:
        InvalidInputError: If the problem is of a kind that these trees do not know.
    """
    check_generator(generator, "search")
    reason = unreachable_reason(problem)
    began = time.perf_counter()
    generators = generator.spawn(len(problem.robots))
    growth = ForestGrowth(problem, options, graph, generators, fields=fields)
    parts = _Parts(growth)
    planted = time.perf_counter()
    ending: Ending = "unreachable" if reason else _grow(growth, parts, progress, planted)
    if options.until == "budget" and not reason:
        parts.look(range(len(growth.robots)), 0)
    return DistributedResult(
        plan=parts.joined(),
        ending=ending,
        sweeps=growth.sweep,
        shortfall=growth.shortfall,
        counts=growth.counted(),
        bytes_per_node=growth.bytes_per_node,
        seconds={"setup": planted - began, "search": time.perf_counter() - planted},
        candidates=parts.candidates,
        refused=parts.refused,
        reason=reason,
        farthest=growth.farthest,
    )


def _grow(growth: ForestGrowth, parts: _Parts, progress: Progress | None, began: float) -> Ending:
    """Sweep until every part has a plan or a budget is spent."""
    options = growth.options
    limit = options.iterations if options.iterations is not None else 2**62
    try:
        while growth.sweep < limit:
            ended = growth.run(min(_SWEEPS_A_CALL, limit - growth.sweep))
            if progress is not None:
                total = 0 if options.iterations is None else options.iterations
                progress(growth.sweep, total, f"sweeps; worst target {growth.shortfall:.3g}")
            if ended == "feasible":
                rows = np.flatnonzero(growth.links.grows).tolist()
                parts.look(rows, growth.sweep - 1)
                growth.goals_looked_at()
                solved = [
                    robot
                    for part, best in zip(parts.parts, parts.best, strict=True)
                    for robot in part
                    if best is not None
                ]
                growth.rest(solved)
                if parts.done:
                    return "feasible"
            if ended == "nodes":
                return "nodes"
            if options.seconds is not None and time.perf_counter() - began >= options.seconds:
                return "seconds"
    except KeyboardInterrupt:
        return "interrupted"
    return "iterations"
