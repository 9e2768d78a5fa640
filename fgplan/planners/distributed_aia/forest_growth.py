"""Trees that grow: what holds the kernels' arrays, for a whole team in one process or one robot.

``run`` is a loop over the compiled ``grow_forest`` that makes room when asked to. A robot on its
own has a row that grows and one for each neighbour, filled by ``receive``; everything else is the
same code, so a team in one process and robots that exchange messages grow the same trees.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from fgplan.planners.aia.arrays import prepare
from fgplan.planners.aia.geodesic_fields import GeodesicFields
from fgplan.planners.aia.ground import Ground
from fgplan.planners.aia.judgement import Judgement
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.tree_kernels import (
    CLOSEST,
    GOALS,
    NEED_NODES,
    NODES,
    PENDING,
    SHORTFALL,
    find_group,
)
from fgplan.planners.distributed_aia.extension_kernels import enter_node
from fgplan.planners.distributed_aia.forest import (
    bytes_per_node,
    make_forest,
    make_heard,
    tree_of,
    with_room,
)
from fgplan.planners.distributed_aia.forest_kernels import (
    FUSED,
    MEASURED,
    NEED_NUMBERS,
    SWEEP,
    TURN,
    receive_nodes,
)
from fgplan.planners.distributed_aia.known_problem import check_prepared, check_problem
from fgplan.planners.distributed_aia.links import links_of
from fgplan.planners.distributed_aia.node_message import Nodes
from fgplan.planners.distributed_aia.options import DistributedOptions
from fgplan.planners.distributed_aia.stream import RESERVE, refilled
from fgplan.planners.distributed_aia.sweep_kernels import FULL, grow_forest
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.typing import FloatArray

Ended = Literal["sweeps", "feasible", "nodes"]
_FIRST_NODES = 512
MARGIN = 0.8
"""By which a robot's limits shrink when the replay has refused its goal nodes."""


class ForestGrowth(Ground):
    """Trees of the robots that grow here."""

    def __init__(
        self,
        problem: AcquisitionProblem,
        options: DistributedOptions,
        graph: CommunicationGraph,
        generators: Sequence[np.random.Generator],
        *,
        robot: int | None = None,
        fields: GeodesicFields | None = None,
    ) -> None:
        """Make room and plant the roots.

        Args:
            problem: What is planned for: independent targets in the plane, built-in sensors.
            options: How.
            graph: Who hears whom.
            generators: Source of random numbers of each robot of the team.
            robot: The robot that grows here; None for all.
            fields: Geodesic distances to be used again.

        Raises:
            InvalidInputError: If the problem is of a kind that these trees do not know.
        """
        check_problem(problem, graph, options)
        prepared = prepare(problem, options.tree(), fields, apart=True)
        check_prepared(prepared, problem)
        super().__init__(problem, options.tree(), prepared)
        self.options, self.graph = options, graph
        team = range(len(problem.robots))
        own = list(team) if robot is None else [robot]
        self.robots = own + [j for j in team if j not in own and j in graph.ever(own[0])]
        """Robot of each row; those that grow here come first."""
        # One robot looks, not the team.
        self.scratch = self.scratch._replace(rows=np.zeros(1, dtype=np.int64))
        degree = max(1, *(len(graph.ever(j)) for j in own))
        self.heard = make_heard(self.prepared, degree)
        self.forest = make_forest(self.prepared, len(self.robots), degree, _FIRST_NODES)
        self.links = links_of(graph, options, self.robots, len(own), degree)
        self._own = len(own)
        self._generators = [generators[j] for j in own]
        self._numbers = np.zeros((len(self.robots), 0))
        self._place = np.zeros((len(self.robots), 1), dtype=np.int64)
        self._more_numbers(RESERVE)
        most = self.prepared.setting.motions.relative.shape[1]
        self._ends = np.empty((most, 3))
        self._cells = np.zeros(most, dtype=np.int64)
        self._found = np.empty(most, dtype=np.int64)
        self.forest.known[self._own :] = np.iinfo(np.int64).max
        for row in range(self._own):
            self._plant(row)

    def run(self, sweeps: int) -> Ended:
        """Grow.

        Args:
            sweeps: How many more at most.

        Returns:
            Why it ended; ``feasible`` after a sweep with new goal nodes.
        """
        last = self.sweep + sweeps
        ended = self._grown(
            lambda: grow_forest(
                self.prepared.setting,
                self.settings,
                self.links,
                self.poses,
                self.forest,
                self.scratch,
                self.heard,
                self._ends,
                self._cells,
                self._found,
                self._numbers,
                self._place,
                last - self.sweep,
            )
        )
        return ended or "sweeps"

    @property
    def sweep(self) -> int:
        """Sweeps that are over."""
        return int(self.forest.clock[SWEEP])

    def nodes(self, row: int) -> int:
        """Number of nodes of a row that grows here.

        Args:
            row: The row.
        """
        return int(self.forest.trees.counts[row, NODES])

    def is_full(self, row: int) -> bool:
        """Whether the node budget of a row that grows here is spent.

        Args:
            row: The row.
        """
        return bool(self.forest.trees.counts[row, PENDING] == FULL)

    def goal_nodes(self, row: int, born_since: int = 0) -> list[int]:
        """Goal nodes of a row that grows here, cheapest first, at most ``goals_kept``.

        Args:
            row: The row.
            born_since: Only nodes made in this sweep or later.
        """
        made = slice(0, self.nodes(row))
        chosen = self.forest.is_goal[row, made] & (self.forest.born[row, made] >= born_since)
        found = np.flatnonzero(chosen)
        order = np.argsort(self.forest.trees.cost[row, found], kind="stable")
        return [int(node) for node in found[order][: self.options.goals_kept]]

    def goals_looked_at(self) -> None:
        """From now on ``run`` stops for new goal nodes only."""
        self.forest.goals[:] = self.forest.trees.counts[:, GOALS]

    def tighten(self, row: int) -> None:
        """Ask for more from now on: the replay has refused the goal nodes of a row.

        A tree knows neighbours that are left behind as they were; in the replay they go along, and
        take their share. So a tree may take for known what is not quite.

        Args:
            row: The row.
        """
        self.forest.margin[row] *= MARGIN

    def rest(self, rows: Sequence[int]) -> None:
        """Rows that grow no more.

        Args:
            rows: The rows.
        """
        grows = self.links.grows.copy()
        grows[list(rows)] = False
        self.links = self.links._replace(grows=grows)

    def made(self, row: int, first: int, wants: int = -1) -> Nodes:
        """Nodes of a row that grows here, from a number on.

        Args:
            row: The row.
            first: The first.
            wants: What to say of the receiver's nodes.
        """
        trees, made = self.forest.trees, slice(first, self.nodes(row))
        return Nodes(
            first=first,
            wants=wants,
            parents=trees.parent[row, made].copy(),
            depths=trees.depth[row, made].copy(),
            covariances=trees.covariance[row, made].copy(),
            assigned=trees.assigned[row, made, 0].astype(np.uint16),
            positions=self.forest.position[row, made].copy(),
        )

    def receive(self, robot: int, nodes: Nodes) -> None:
        """Enter nodes of a neighbour.

        Args:
            robot: The neighbour.
            nodes: What it sent; doubled or late ones do no harm. Where depths are not those of
                what is here, none is entered.
        """
        row, older = self.robots.index(robot), (nodes.parents >= 0) & (nodes.parents < nodes.first)
        here = nodes.parents[older] < self.forest.trees.depth.shape[1]
        parents, depths = nodes.parents[older][here], nodes.depths[older][here]
        known = self.forest.trees.depth[row, parents]
        if ((known >= 0) & (depths != known + 1)).any():
            return
        self._room_for(nodes.first + len(nodes.parents))
        receive_nodes(
            self.forest,
            row,
            nodes.first,
            *map(
                _read_only,
                (nodes.parents, nodes.depths, nodes.covariances, nodes.assigned, nodes.positions),
            ),
        )

    @property
    def bytes_per_node(self) -> float:
        """Memory by room for a node."""
        return bytes_per_node(self.forest)

    @property
    def shortfall(self) -> float:
        """Least shortfall of any node of a row that grows here."""
        return float(self.forest.trees.best[: self._own, SHORTFALL].min())

    def closest(self) -> tuple[int, int]:
        """Row and number of the node of least shortfall."""
        row = int(np.argmin(self.forest.trees.best[: self._own, SHORTFALL]))
        return row, int(self.forest.trees.counts[row, CLOSEST])

    @property
    def farthest(self) -> str:
        """Name of the target farthest from its limit there; empty of a joint constraint."""
        row, node = self.closest()
        trees = self.forest.trees
        judgement = Judgement(self.problem)
        return judgement.farthest(trees.covariance[row, node], int(trees.depth[row, node]))

    def counted(self) -> dict[str, int]:
        """What was counted, over all rows that grow here."""
        sums = self.forest.trees.counts[: self._own].sum(axis=0)
        return self._counted(sums, {"covariances_fused": FUSED, "measurement_models": MEASURED})

    def poses_to(self, row: int, nodes: Sequence[int]) -> FloatArray:
        """Poses of nodes of a row that grows here.

        Args:
            row: The row.
            nodes: Their numbers.

        Returns:
            Shape (n, 3), world frame.
        """
        groups = self.forest.trees.group[row, list(nodes)]
        return np.array(self.poses.pose[self.forest.trees.configuration[row, groups, 0]])

    def _plant(self, row: int) -> None:
        """Make the root q_i(0) = [p_i(0), Sigma_i(0), {}]."""
        tree = tree_of(self.forest, row)
        tree.drawn[0] = self._start(self.robots[row])
        tree.covariance[0] = self.prepared.root
        cost = self._objective(self.prepared.root)
        _, place = find_group(tree.slots, tree.configuration, tree.drawn)
        enter_node(
            self.prepared.setting,
            self.settings,
            self.poses,
            tree,
            self.scratch,
            self.forest,
            self.heard,
            row,
            -1,
            -1,
            place,
            cost,
        )

    def _made_room(self, ended: int) -> bool:
        """Make the room that a kernel asked for; False where it asked for none."""
        if ended == NEED_NODES:
            self._room_for(self.forest.trees.parent.shape[1] + 1)
        elif ended == NEED_NUMBERS:
            # Of the row that asks: others may have drawn none for long.
            left = self._numbers.shape[1] - int(self._place[self.forest.clock[TURN], 0])
            self._more_numbers(max(RESERVE, 2 * left))
        else:
            return super()._made_room(ended)
        return True

    def _more_numbers(self, least: int) -> None:
        """Draw further random numbers for every row that grows here."""
        own = slice(0, self._own)
        place = self._place[own]
        fresh = refilled(self._numbers[own], place, tuple(self._generators), least)
        self._numbers = np.zeros((len(self.robots), fresh.shape[1]))
        self._numbers[own] = fresh
        self._place[own] = place

    def _room_for(self, nodes: int) -> None:
        """Room for nodes up to a number, doubled where there is not enough."""
        room = self.forest.trees.parent.shape[1]
        if nodes > room:
            while room < nodes:
                room *= 2
            self.forest = with_room(self.forest, room)


def _read_only(array: np.ndarray) -> np.ndarray:
    """A view as of a decoded message: one type of arrays, for which a kernel is compiled once."""
    view = array.view()
    view.flags.writeable = False
    return view
