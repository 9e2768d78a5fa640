"""Algorithms 1 and 2 of Tzes et al. 2021 in vectorised numpy with dense joint covariances.

Written from the paper, as the peer of ``aia_dense_reference``: a list of node objects a robot, a
dictionary of groups, stacked whitened rows, one 2M x 2M covariance a node. Nothing numerical is
shared with the planner ``distributed_aia`` but the geodesic fields and the tests of ways and sight.
It draws the same random numbers in the same order, each robot from its own generator, and so grows
the same trees.

The filter (4), with one weight w_j^k a robot j and target k, D_j = diag(sqrt(w_j^k)):

    Omega = sum_j D_j Sigma_j^-1 D_j + H' R^-1 H,    Sigma_i(t + 1) = A Omega^-1 A' + Q

over the robot itself and the nodes of its neighbours that are fused; H has the rows of what the
robot itself measures at t. Inverses of these 2M x 2M matrices are Cholesky's, of which LAPACK fills
one triangle: with Omega = L L', the prediction is X' X + Q with X = L^-1 A'. Formula, weights and
whatever else the text at hand has lost are those of ``fgplan.riccati.distributed`` and of the
planner's own headers.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri, dtrtrs

CATCH_UP = 8
MOST_TRIES = 64
CLOSE = 1e-9
"""Log-determinants of two recipes so near to each other are ordered by rounding: a close call."""


def cholesky(upper: np.ndarray) -> np.ndarray:
    """L of L L', given the upper triangle of the product in C order."""
    factor, failed = dpotrf(upper.T, lower=1)
    if failed:
        raise np.linalg.LinAlgError(f"not positive definite: leading minor {failed}")
    return factor


def inverse(covariance: np.ndarray) -> np.ndarray:
    """Upper triangle of a covariance's inverse; zeros below."""
    return dpotri(cholesky(covariance), lower=1, overwrite_c=1)[0].T


@dataclass(eq=False)
class Node:
    """q_i = [p_i, Sigma_i, S_i] with its place in the tree.

    ``sources`` is S_i: the node of each neighbour's tree that was fused. Nodes with one ``recipe``
    have covariances computed from the same numbers in the same way.
    """

    parent: int
    group: int
    depth: int
    cost: float
    covariance: np.ndarray
    dets: np.ndarray
    assigned: int
    sources: tuple
    recipe: int
    children: list = field(default_factory=list)
    made: set = field(default_factory=set)

    @cached_property
    def information(self) -> np.ndarray:
        """Inverse of the joint covariance, computed when a robot fuses it first."""
        return inverse(self.covariance)


@dataclass(eq=False)
class World:
    """What all robots know.

    ``relative`` (U, 3), ``waypoints`` (U, W, 2) and ``body`` say the controls, ``places``
    (T, M, 2) the predicted targets (one row if they stay), ``transition`` and ``process``
    (2M, 2M) their dynamics, ``delta`` (M,) the limits, ``distance`` (F, cells) and ``frame`` the
    geodesic fields, ``field_of`` (T, M) which one is a target's at a time. ``linked`` (T, N, N) is
    the schedule of links, each set for ``period`` steps. ``every_row`` stacks a row for every
    target, as (3) prints it: of those that are not seen, noise is infinite and the weight zero.
    """

    relative: np.ndarray
    waypoints: np.ndarray
    body: bool
    places: np.ndarray
    transition: np.ndarray
    process: np.ndarray
    prior: np.ndarray
    delta: np.ndarray
    distance: np.ndarray
    frame: np.ndarray
    field_of: np.ndarray
    are_free: Callable[[np.ndarray, np.ndarray], np.ndarray]
    is_seen: Callable[[np.ndarray, np.ndarray], bool]
    linked: np.ndarray
    period: int = 1
    link_range_m: float = np.inf
    range_m: float = 2.0
    slope: float = 0.25
    floor_m: float = 0.01
    near_m: float = 0.3
    p_group: float = 0.9
    p_control: float = 0.9
    p_candidate: float = 0.9
    kappa: float = 0.9
    one_node: bool = False
    literal: bool = False
    reject_jointly: bool = False
    uniform_after_goal: bool = False
    every_row: bool = False
    seen_of: dict = field(default_factory=dict)
    recipes: dict = field(default_factory=dict)
    uncertainty_of: dict = field(default_factory=dict)

    def at(self, series: np.ndarray, time: int) -> np.ndarray:
        """Entry of a series at a time; the last one for ever."""
        return series[min(time, len(series) - 1)]

    def cells(self, points: np.ndarray) -> np.ndarray:
        """Geodesic cell of points of shape (..., 2)."""
        x0, y0, side, columns, rows = self.frame
        column = np.clip(np.floor((points[..., 0] - x0) / side), 0, columns - 1)
        row = np.clip(np.floor((points[..., 1] - y0) / side), 0, rows - 1)
        return (row * columns + column).astype(np.int64)

    def dets(self, covariance: np.ndarray) -> np.ndarray:
        """Determinant of every target's block."""
        diagonal, beside = covariance.diagonal(), covariance.diagonal(1)[::2]
        return diagonal[::2] * diagonal[1::2] - beside * beside

    def predict(self, covariance: np.ndarray) -> np.ndarray:
        """One step of (2)."""
        return self.transition @ covariance @ self.transition.T + self.process

    def predict_inverse(self, omega: np.ndarray) -> np.ndarray:
        """One step of (2) from the information, of which the upper triangle counts."""
        half, _ = dtrtrs(cholesky(omega), self.transition.T, lower=1)
        return half.T @ half + self.process

    def forward(self, node: Node, lag: int) -> tuple[np.ndarray, np.ndarray]:
        """Inverse and determinants of a node's covariance, predicted over its lag (Remark 3)."""
        if lag == 0:
            return node.information, node.dets
        covariance = node.covariance
        for _ in range(lag):
            covariance = self.predict(covariance)
        return inverse(covariance), self.dets(covariance)

    def uncertainty(self, node: Node) -> float:
        """Log-determinant of the joint covariance, one number for all nodes of one recipe."""
        value = self.uncertainty_of.get(node.recipe)
        if value is None:
            value = float(np.linalg.slogdet(node.covariance)[1])
            self.uncertainty_of[node.recipe] = value
        return value

    def rows(self, pose: np.ndarray, time: int) -> tuple[np.ndarray, np.ndarray]:
        """H and the diagonal of R^-1 of one robot's measurements at a time."""
        places = self.at(self.places, time)
        offset = places - pose[:2]
        length = np.sqrt((offset**2).sum(axis=-1))
        near = (length <= self.range_m) & (length > 1e-9)
        x, y = pose[:2].tolist()
        for k in near.nonzero()[0]:
            key = (x, y, *places[k].tolist())
            seen = self.seen_of.get(key)
            if seen is None:
                seen = self.seen_of[key] = self.is_seen(pose[:2], places[k])
            near[k] = seen
        (target,) = near.nonzero()
        row, count = np.arange(len(target)), len(target)
        if self.every_row:
            row, count = target, len(places)
        rows, weight = np.zeros((count, 2 * len(places))), np.zeros(count)
        length = length[target]
        rows[row[:, None], 2 * target[:, None] + (0, 1)] = offset[target] / length[:, None]
        weight[row] = 1.0 / np.maximum(self.floor_m, self.slope * length) ** 2
        return rows, weight


@dataclass(eq=False)
class RobotTree:
    """One robot's tree; ``neighbours`` are the trees that it hears, in the order of the team."""

    index: int
    start: np.ndarray
    world: World
    generator: np.random.Generator
    neighbours: list = field(default_factory=list)

    def plant(self) -> None:
        """Line 1: the root."""
        self.nodes: list[Node] = []
        self.groups: dict = {}
        self.members: list[list[int]] = []
        self.poses: list[np.ndarray] = []
        self.keys: list[tuple] = []
        self.stamp: list[int] = []
        self.deepest: list[int] = []
        self.goals: list[int] = []
        self.depth = self.known = self.close_calls = 0
        self.fused = self.measured = self.rejected = self.repeated = 0
        self.recipes: dict = {}
        key, sources = self._key(self.start), (-1,) * len(self.neighbours)
        self._append(-1, self.start, key, 0, self.world.prior, sources, set(), 0)

    def iterate(self) -> None:
        """Lines 2 to 17, once."""
        world = self.world
        uniform = world.uniform_after_goal and bool(self.goals)
        k = self._draw_group(uniform)
        pose = self._draw_control(k, uniform)
        if pose is None:
            self.rejected += 1
            return
        chosen = list(self.members[k])
        if world.one_node:
            last = self.generator.random() < world.p_group
            place = len(chosen) - 1 if last else int(self.generator.random() * len(chosen))
            chosen = [chosen[place]]
        key = self._key(pose)
        for index in chosen:
            self._extend(index, pose, key)

    def _draw_group(self, uniform: bool) -> int:
        """Equation (8)."""
        random, groups, deep = self.generator.random, len(self.members), len(self.deepest)
        if uniform:
            return int(random() * groups)
        biased = random() < self.world.p_group
        if biased or groups == deep:
            return self.deepest[int(random() * deep)]
        for _ in range(MOST_TRIES):
            k = int(random() * groups)
            if self.stamp[k] != self.depth:
                return k
        others = [k for k in range(groups) if self.stamp[k] != self.depth]
        return others[int(random() * len(others))]

    def _successors(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends (U, 3) of all controls and whether their ways are free (U,)."""
        world = self.world
        cos, sin = (np.cos(pose[2]), np.sin(pose[2])) if world.body else (1.0, 0.0)
        turn = np.array([[cos, -sin], [sin, cos]])
        ends = np.empty((len(world.relative), 3))
        ends[:, :2] = pose[:2] + world.relative[:, :2] @ turn.T
        ends[:, 2] = pose[2] + world.relative[:, 2]
        ends[:, 2] -= 2 * np.pi * (ends[:, 2] > np.pi)
        ends[:, 2] += 2 * np.pi * (ends[:, 2] <= -np.pi)
        ways = pose[:2] + world.waypoints @ turn.T
        before = np.empty_like(ways)
        before[:, 0] = pose[:2]
        before[:, 1:] = ways[:, :-1]
        free = world.are_free(before.reshape(-1, 2), ways.reshape(-1, 2))
        return ends, free.reshape(ways.shape[:2]).all(axis=1)

    def _draw_control(self, k: int, uniform: bool) -> np.ndarray | None:
        """Equation (9); None where the draw is not free."""
        world, pose = self.world, self.poses[k]
        ends, free = self._successors(pose)
        best = -1 if uniform else self._preferred(self.nodes[self.members[k][-1]], ends, free)
        number = self.generator.random()
        if best >= 0:
            if number < world.p_control:
                return ends[best]
            number = (number - world.p_control) / (1.0 - world.p_control)
        if world.reject_jointly:
            u = int(number * len(ends))
            return ends[u] if free[u] else None
        among = np.flatnonzero(free)
        return ends[among[int(number * len(among))]] if len(among) else None

    def _preferred(self, node: Node, ends: np.ndarray, free: np.ndarray) -> int:
        """u* of (9) towards the node's target; -1 where controls are drawn uniformly."""
        world, t = self.world, node.depth + 1
        to_cell = world.distance[world.at(world.field_of, t)[node.assigned]]
        distance = to_cell[world.cells(ends[:, :2])].astype(np.float64)
        if world.body:  # a thousandth counts where the heading would lead
            reach = float(np.linalg.norm(world.waypoints, axis=-1).max())
            heading = np.stack([np.cos(ends[:, 2]), np.sin(ends[:, 2])], axis=-1)
            ahead = to_cell[world.cells(ends[:, :2] + reach * heading)]
            distance = distance + 1e-3 * np.minimum(ahead, distance + 2.0 * reach)
        distance = np.where(free, distance, np.inf)
        best = int(distance.argmin())
        offset = ends[best, :2] - world.at(world.places, t)[node.assigned]
        far = np.isfinite(distance[best]) and (offset**2).sum() > world.near_m**2
        return best if far else -1

    def _extend(self, index: int, pose: np.ndarray, key: tuple) -> None:
        """Section III-A2 for one node."""
        world, node = self.world, self.nodes[index]
        here, t = self.poses[node.group], node.depth
        sources, fused, late, taken = [], [(node.information, node.dets)], [False], set()
        recipe = [node.recipe]
        links = world.linked[t // world.period % len(world.linked), self.index]
        for other, before in zip(self.neighbours, node.sources, strict=True):
            number = self._draw_candidate(other, before, t)
            sources.append(number)
            if number < 0 or not links[other.index]:
                continue
            found = other.nodes[number]
            if math.dist(other.poses[found.group][:2], here[:2]) > world.link_range_m:
                continue
            lag = 0 if world.literal else t - found.depth
            fused.append(world.forward(found, lag))
            late.append(lag > 0)
            if lag <= CATCH_UP:
                taken.add(found.assigned)
            recipe.append((found.recipe, lag))
        made = (key, *sources)
        if made in node.made:
            self.repeated += 1
            return
        node.made.add(made)
        rows, weight = world.rows(here, t)
        self.fused += len(fused)
        self.measured += 1
        omega = (rows.T * weight) @ rows
        used = self._pool(omega, fused, late)
        recipe = [one for one, is_used in zip(recipe, used, strict=True) if is_used]
        covariance = world.predict_inverse(omega)
        looked = (self.index, self.keys[node.group]) if weight.any() else None
        number = world.recipes.setdefault((t, looked, *recipe), len(world.recipes) + 1)
        self._append(index, pose, key, t + 1, covariance, tuple(sources), taken, number)

    def _draw_candidate(self, other: "RobotTree", before: int, t: int) -> int:
        """The node of a neighbour's tree for time t, after the one used before; -1 for none."""
        if before < 0 and other.known == 0:
            return -1
        number = max(before, 0)
        for _ in range(CATCH_UP):
            if other.nodes[number].depth >= t:
                break
            children = [c for c in other.nodes[number].children if c < other.known]
            if not children:
                break
            number = children[0] if len(children) == 1 else self._draw_child(other, children)
        return number

    def _draw_child(self, other: "RobotTree", children: list[int]) -> int:
        """Equation (10)."""
        world = self.world
        uncertainty = [world.uncertainty(other.nodes[child]) for child in children]
        best = int(np.argmin(uncertainty))
        near = {
            other.nodes[child].recipe
            for child, value in zip(children, uncertainty, strict=True)
            if value <= uncertainty[best] + CLOSE
        }
        self.close_calls += len(near) > 1
        number = self.generator.random()
        if number < world.p_candidate:
            return children[best]
        share = (number - world.p_candidate) / (1.0 - world.p_candidate)
        others = [child for child in reversed(children) if child != children[best]]
        return others[min(int(share * len(others)), len(others) - 1)]

    def _pool(
        self, omega: np.ndarray, fused: list[tuple[np.ndarray, np.ndarray]], late: list[bool]
    ) -> list[bool]:
        """Add sum_j D_j Sigma_j^-1 D_j of (4), own node first; what lags where it knows more.

        Returns which of them were used for some target.
        """
        kappa, dets = self.world.kappa, np.array([one for _, one in fused])
        used, others = [True] * len(fused), np.array(len(fused) - 1)
        if any(late):
            dets[late] = np.where(dets[late] < dets[0] * (1.0 - 1e-9), dets[late], np.inf)
            counts = np.isfinite(dets)
            used, others = counts.any(axis=1).tolist(), counts.sum(axis=0) - 1
        weights = np.where(dets < np.inf, (1.0 - kappa) / np.maximum(others, 1), 0.0)
        weights[dets.argmin(axis=0), np.arange(dets.shape[1])] = np.where(others > 0, kappa, 1.0)
        scale = np.sqrt(weights).repeat(2, axis=1)
        part = np.empty_like(omega)
        for (information, _), root in zip(fused, scale, strict=True):
            np.multiply.outer(root, root, out=part)
            part *= information
            omega += part
        return used

    def _key(self, pose: np.ndarray) -> tuple:
        """A pose as a key: whole micrometres and millionths of a turn."""
        x, y, heading = pose.tolist()
        turns = round(heading * (1e6 / (2.0 * np.pi)))
        return round(x * 1e6), round(y * 1e6), turns % 1_000_000

    def _append(
        self,
        parent: int,
        pose: np.ndarray,
        key: tuple,
        depth: int,
        covariance: np.ndarray,
        sources: tuple,
        taken: set,
        recipe: int,
    ) -> None:
        """Insert a node into tree and group, test the goal, assign a target."""
        number = len(self.nodes)
        k = self.groups.get(key)
        if k is None:
            k = self.groups[key] = len(self.members)
            self.members.append([])
            self.poses.append(pose)
            self.keys.append(key)
            self.stamp.append(-1)
        self.members[k].append(number)
        if depth > self.depth:
            self.depth, self.deepest = depth, []
        if depth == self.depth and self.stamp[k] != depth:
            self.stamp[k] = depth
            self.deepest.append(k)
        dets = self.world.dets(covariance)
        satisfied = dets <= self.world.delta
        if satisfied.all():
            self.goals.append(number)
        cost, inherited = 0.0, -1
        if parent >= 0:
            cost, inherited = self.nodes[parent].cost, self.nodes[parent].assigned
            self.nodes[parent].children.append(number)
        assigned = self._assign(self.poses[k], depth, satisfied, inherited, taken)
        cost += float(dets.sum())
        self.nodes.append(Node(parent, k, depth, cost, covariance, dets, assigned, sources, recipe))

    def _assign(
        self, pose: np.ndarray, time: int, satisfied: np.ndarray, inherited: int, taken: set
    ) -> int:
        """Algorithm 2."""
        if inherited >= 0 and not satisfied[inherited]:
            return inherited
        world = self.world
        unsatisfied = np.flatnonzero(~satisfied).tolist()
        if not unsatisfied:
            return max(inherited, 0)
        among = [k for k in unsatisfied if k not in taken] or unsatisfied
        fields = world.at(world.field_of, time)[among]
        return among[int(world.distance[fields, world.cells(pose[:2])].argmin())]


@dataclass(eq=False)
class DistributedDenseReference:
    """A team: in a sweep every robot does one iteration with what the others had before it."""

    world: World
    robots: list[RobotTree]

    @classmethod
    def planted(
        cls, world: World, starts: np.ndarray, generators: list[np.random.Generator]
    ) -> "DistributedDenseReference":
        """Robots that hear those to whom the schedule ever links them."""
        robots = [RobotTree(j, start, world, generators[j]) for j, start in enumerate(starts)]
        for robot in robots:
            ever = world.linked[:, robot.index].any(axis=0)
            robot.neighbours = [robots[j] for j in np.flatnonzero(ever)]
        for robot in robots:
            robot.plant()
        return cls(world, robots)

    def run(self, sweeps: int) -> None:
        """Grow all trees."""
        for _ in range(sweeps):
            for robot in self.robots:
                robot.known = len(robot.nodes)
            for robot in self.robots:
                robot.iterate()
