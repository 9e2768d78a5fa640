"""Algorithm 1 of Kantaros et al. 2019 in vectorised numpy with a dense joint covariance.

The opponent of ``fgplan bench aia``, written from the paper and sharing no numerical code with the
planner: node objects, a dictionary of groups, stacked whitened rows, a dense 2M x 2M Kalman filter,
determinants of all targets in one call, Algorithm 2 over numpy arrays. Shared with the planner are
the geodesic fields and visibility, remembered by pair of places; the rest is computed whenever
Algorithm 1 asks for it: the ends of all controls of all robots, and whether their ways are free, in
one vectorised test. It draws the same random numbers as the planner.
"""

from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from dense_groups import DenseGroups
from dense_world import DenseWorld


@dataclass
class Node:
    """One node: depth, cost, dense covariance, assignment, and its parent."""

    parent: int
    group: int
    depth: int
    cost: float
    covariance: np.ndarray
    assigned: np.ndarray
    children: set = field(default_factory=set)


@dataclass(eq=False, kw_only=True)
class DenseReference(DenseWorld):
    """The whole problem and the tree.

    Beside the world: ``starts`` (N, 3), ``process`` (M, 2, 2), the ``prior`` of every target and
    the limit ``delta`` of its determinant. ``information_form`` adds H' R^-1 H to the inverse
    covariance, as the distributed filter does, and solves for no gain. ``one_by_one`` treats one
    robot after the other, as Algorithm 1 of Tzes et al. 2021 must; otherwise all are treated in one
    vectorised go.
    """

    starts: np.ndarray
    process: np.ndarray
    prior: np.ndarray
    delta: float
    information_form: bool = False
    one_by_one: bool = False

    def plant(self) -> None:
        """Line 1: the root."""
        targets = self.places.shape[1]
        self.prior_covariance = np.kron(np.eye(targets), self.prior)
        self.process_covariance = np.zeros((2 * targets, 2 * targets))
        for i in range(targets):
            self.process_covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = self.process[i]
        self.transition = np.eye(2 * targets)
        self.block = np.arange(targets)
        self.nodes: list[Node] = []
        self.groups = DenseGroups()
        self.best = np.inf
        self.iterations = 0
        self.seconds: dict[str, float] = {}
        dets = self._dets(self.prior_covariance)
        self._append(
            -1, self.starts, self._key(self.starts), 0, dets.sum(), self.prior_covariance, dets
        )

    def run(self, iterations: int, generator: np.random.Generator, stop: bool) -> None:
        """Lines 2 to 17, until the iterations are spent or, if asked, a plan is feasible."""
        for _ in range(iterations):
            self.iterations += 1
            k = self.groups.draw(generator, self.p_group, uniform=False)
            begun = perf_counter()
            drawn = self._draw_controls(k, generator)
            self._spent("drawing controls", begun)
            if drawn is None:
                continue
            key = self._key(drawn)
            for index in list(self.groups.members[k]):
                self._extend(index, drawn, key)
            if stop and np.isfinite(self.best):
                return

    def _spent(self, part: str, begun: float) -> float:
        """Add the seconds since then to a part; now."""
        now = perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - begun
        return now

    def _key(self, poses: np.ndarray) -> tuple:
        """A configuration as a key."""
        digits = np.rint(poses * 1e6).astype(np.int64)
        digits[:, 2] %= round(2e6 * np.pi)
        return tuple(digits.ravel().tolist())

    def _dets(self, covariance: np.ndarray) -> np.ndarray:
        """Determinant of every target's block."""
        blocks = covariance.reshape(len(self.block), 2, len(self.block), 2)
        return np.linalg.det(blocks[self.block, :, self.block, :])

    def _draw_controls(self, k: int, generator: np.random.Generator) -> np.ndarray | None:
        """Equation (9), from the controls that are free."""
        node, poses = self.nodes[self.groups.members[k][-1]], self.groups.poses[k]
        numbers, time = generator.random(len(poses)), node.depth + 1
        if not self.one_by_one:
            return self._drawn(poses, node.assigned, time, numbers)
        drawn = []
        for j in range(len(poses)):
            part = slice(j, j + 1)
            end = self._drawn(poses[part], node.assigned[part], time, numbers[part])
            if end is None:
                return None
            drawn.append(end)
        return np.concatenate(drawn)

    def _drawn(
        self, poses: np.ndarray, assigned: np.ndarray, time: int, numbers: np.ndarray
    ) -> np.ndarray | None:
        """Equation (9) for some robots, all at once; None where one has no free control."""
        ends, free = self.successors(poses)
        distance = self.distances(self.at(self.field_of, time)[assigned][:, None], ends)
        distance = np.where(free, distance, np.inf)
        best = distance.argmin(axis=1)
        robots = np.arange(len(poses))
        offset = ends[robots, best, :2] - self.at(self.places, time)[assigned]
        far = (offset**2).sum(axis=1) > self.near_m**2
        far &= np.isfinite(distance[robots, best])
        take = far & (numbers < self.p_control)
        rest = (numbers - self.p_control) / (1.0 - self.p_control)
        share = np.where(far, rest, numbers)
        counts = free.sum(axis=1)
        if (counts == 0).any():
            return None
        place = (np.maximum(share, 0.0) * counts).astype(np.int64)
        among = (np.cumsum(free, axis=1) == (place + 1)[:, None]).argmax(axis=1)
        return ends[robots, np.where(take, best, among)]

    def _rows(self, poses: np.ndarray, time: int) -> tuple[np.ndarray, np.ndarray]:
        """Measurement matrix and noise of all robots and targets at a time."""
        if not self.one_by_one:
            return self._rows_of(poses, time)
        parts = [self._rows_of(poses[j : j + 1], time) for j in range(len(poses))]
        return np.concatenate([one[0] for one in parts]), np.concatenate([one[1] for one in parts])

    def _rows_of(self, poses: np.ndarray, time: int) -> tuple[np.ndarray, np.ndarray]:
        """Those of some robots."""
        rows, row, noise = self.measurements(poses, time)
        if not self.every_row:
            return rows, noise
        every = np.ones(len(rows))
        every[row] = noise
        return rows, every

    def _extend(self, index: int, poses: np.ndarray, key: tuple) -> None:
        """Lines 7 to 17 for one node."""
        node = self.nodes[index]
        if key in node.children:
            return
        node.children.add(key)
        begun = perf_counter()
        rows, noise = self._rows(self.groups.poses[node.group], node.depth)
        begun = self._spent("measurement rows", begun)
        covariance = node.covariance
        if self.information_form:
            covariance = np.linalg.inv(np.linalg.inv(covariance) + (rows.T / noise) @ rows)
        elif len(rows):
            cross = covariance @ rows.T
            innovation = rows @ cross
            innovation[np.diag_indices(len(rows))] += noise
            covariance = covariance - cross @ np.linalg.solve(innovation, cross.T)
        covariance = self.transition @ covariance @ self.transition.T + self.process_covariance
        dets = self._dets(covariance)
        self._spent("dense Riccati map", begun)
        self._append(index, poses, key, node.depth + 1, node.cost + dets.sum(), covariance, dets)

    def _append(
        self,
        parent: int,
        poses: np.ndarray,
        key: tuple,
        depth: int,
        cost: float,
        covariance: np.ndarray,
        dets: np.ndarray,
    ) -> None:
        """Insert a node into tree and group, test the goal, assign targets."""
        k = self.groups.enter(len(self.nodes), key, poses, depth)
        satisfied = dets <= self.delta
        if satisfied.all():
            self.best = min(self.best, cost)
        before = None if parent < 0 else self.nodes[parent].assigned
        begun = perf_counter()
        assigned = self._assign(poses, depth, satisfied, before)
        self._spent("assignment", begun)
        self.nodes.append(Node(parent, k, depth, cost, covariance, assigned))

    def _assign(
        self, poses: np.ndarray, time: int, satisfied: np.ndarray, before: np.ndarray | None
    ) -> np.ndarray:
        """Algorithm 2; all robots among all targets at the root."""
        targets = len(satisfied)
        unsatisfied = ~satisfied
        if before is None:
            assigned = np.zeros(len(poses), dtype=np.int64)
            choosing = range(len(poses))
            available = np.ones(targets, dtype=bool)
        else:
            assigned = before.copy()
            if not unsatisfied.any():
                return assigned
            holders = np.bincount(assigned, minlength=targets)
            choosing = np.flatnonzero(satisfied[assigned] | (holders[assigned] > 1))
            available = unsatisfied & (holders == 0)
        again = unsatisfied if unsatisfied.any() else np.ones(targets, dtype=bool)
        if not available.any():
            available = again.copy()
        cells = self.cells(poses[:, :2])
        fields = self.at(self.field_of, time)
        for j in choosing:
            if not available.any():
                available = again.copy()
            distance = np.where(available, self.distance[fields, cells[j]], np.inf)
            nearest = int(distance.argmin())
            if not available[nearest]:
                nearest = int(available.argmax())
            assigned[j] = nearest
            available[nearest] = False
        return assigned
