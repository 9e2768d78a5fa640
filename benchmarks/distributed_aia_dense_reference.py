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
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from dense_groups import DenseGroups
from dense_world import DenseWorld
from scipy.linalg.lapack import dpotrf, dpotri, dtrtrs

CATCH_UP = 8
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


@dataclass(eq=False, kw_only=True)
class World(DenseWorld):
    """What all robots know.

    Beside what both references know: ``transition`` and ``process`` (2M, 2M) of the targets, the
    joint ``prior``, ``delta`` (M,) their limits. ``linked`` (T, N, N) is the schedule of links,
    each set for ``period`` steps. What is not seen has infinite noise, and a row of zero weight.
    """

    transition: np.ndarray
    process: np.ndarray
    prior: np.ndarray
    delta: np.ndarray
    linked: np.ndarray
    period: int = 1
    link_range_m: float = np.inf
    p_candidate: float = 0.9
    kappa: float = 0.9
    one_node: bool = False
    literal: bool = False
    reject_jointly: bool = False
    uniform_after_goal: bool = False
    recipes: dict = field(default_factory=dict)
    uncertainty_of: dict = field(default_factory=dict)

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
        rows, row, noise = self.measurements(pose, time)
        weight = np.zeros(len(rows))
        weight[row] = 1.0 / noise
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
        self.groups = DenseGroups()
        self.goals: list[int] = []
        self.known = self.close_calls = 0
        self.fused = self.measured = self.rejected = self.repeated = 0
        self.recipes: dict = {}
        key, sources = self._key(self.start), (-1,) * len(self.neighbours)
        self._append(-1, self.start, key, 0, self.world.prior, sources, set(), 0)

    def iterate(self) -> None:
        """Lines 2 to 17, once."""
        world = self.world
        uniform = world.uniform_after_goal and bool(self.goals)
        k = self.groups.draw(self.generator, world.p_group, uniform=uniform)
        pose = self._draw_control(k, uniform)
        if pose is None:
            self.rejected += 1
            return
        chosen = list(self.groups.members[k])
        if world.one_node:
            last = self.generator.random() < world.p_group
            place = len(chosen) - 1 if last else int(self.generator.random() * len(chosen))
            chosen = [chosen[place]]
        key = self._key(pose)
        for index in chosen:
            self._extend(index, pose, key)

    def _draw_control(self, k: int, uniform: bool) -> np.ndarray | None:
        """Equation (9); None where the draw is not free."""
        world, pose = self.world, self.groups.poses[k]
        ends, free = world.successors(pose)
        best = (
            -1 if uniform else self._preferred(self.nodes[self.groups.members[k][-1]], ends, free)
        )
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
        distance = world.distances(world.at(world.field_of, t)[node.assigned], ends)
        distance = np.where(free, distance, np.inf)
        best = int(distance.argmin())
        offset = ends[best, :2] - world.at(world.places, t)[node.assigned]
        far = np.isfinite(distance[best]) and (offset**2).sum() > world.near_m**2
        return best if far else -1

    def _extend(self, index: int, pose: np.ndarray, key: tuple) -> None:
        """Section III-A2 for one node."""
        world, node = self.world, self.nodes[index]
        here, t = self.groups.poses[node.group], node.depth
        sources, fused, late, taken = [], [(node.information, node.dets)], [False], set()
        recipe = [node.recipe]
        links = world.linked[t // world.period % len(world.linked), self.index]
        for other, before in zip(self.neighbours, node.sources, strict=True):
            number = self._draw_candidate(other, before, t)
            sources.append(number)
            if number < 0 or not links[other.index]:
                continue
            found = other.nodes[number]
            if math.dist(other.groups.poses[found.group][:2], here[:2]) > world.link_range_m:
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
        looked = (self.index, self.groups.keys[node.group]) if weight.any() else None
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
        k = self.groups.enter(number, key, pose, depth)
        dets = self.world.dets(covariance)
        satisfied = dets <= self.world.delta
        if satisfied.all():
            self.goals.append(number)
        cost, inherited = 0.0, -1
        if parent >= 0:
            cost, inherited = self.nodes[parent].cost, self.nodes[parent].assigned
            self.nodes[parent].children.append(number)
        assigned = self._assign(self.groups.poses[k], depth, satisfied, inherited, taken)
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
