"""What RRT, RRT* and RRG have in common: one sample, one step, one new vertex.

    x_rand <- sample;  x_near <- the vertex nearest to it;  x_new <- steer(x_near, x_rand)
    if the motion x_near -> x_new is valid: attach x_new

The three differ in `attach` only: RRT joins x_new to x_near, RRT* to the parent of least cost and
rewires, RRG to all that are near. So with one seed all three have the same vertices.

Any-time: `grow` may be called again and again; products are snapshots. Vertex 0 is the start.
With a goal, a share `goal_bias` of the samples is the goal itself until it has become a vertex.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Self, cast

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from roadmaps.checks import check_count, check_generator, check_positive
from roadmaps.collision import CollisionChecker, check_position_valid
from roadmaps.errors import ParameterError, UnreachableError
from roadmaps.sampling import draw_position
from roadmaps.steering import Steering, euclidean_steering
from roadmaps.tree import Tree
from roadmaps.typing import BoolArray, FloatArray, IntArray
from roadmaps.vertex_path import VertexPath

Sampler = Callable[[CollisionChecker, np.random.Generator], FloatArray]


class AbstractGrowth(ABC):
    """A tree or graph that grows from a start; final classes are `RRT`, `RRTStar`, `RRG`.

    Any dimension d; feasibility is the checker, steering and cost are the `Steering`.

    Args:
        checker: The world.
        start: Vertex 0, shape (d,), metres.
        rng: Source of randomness; the same seed and samples give the same product.
        step_m: Greatest step of the Euclidean default steering, metres; or give `steering`.
        steering: How to grow, in place of `step_m`.
        goal: Position to reach, shape (d,), metres, or None.
        goal_bias: Share of samples that are the goal, in [0, 1).
        sampler: Draws a position; the default is uniform in the bounds.

    Raises:
        InvalidPositionError: If start or goal is not free.
        ParameterError: If not exactly one of `step_m` and `steering` is given, or `goal_bias` is
            out of range, or `rng` is no Generator.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        start: ArrayLike,
        rng: np.random.Generator,
        *,
        step_m: float | None = None,
        steering: Steering | None = None,
        goal: ArrayLike | None = None,
        goal_bias: float = 0.05,
        sampler: Sampler = draw_position,
    ) -> None:
        if (step_m is None) == (steering is None):
            raise ParameterError("expected one of step_m and steering, got both or neither")
        if not 0.0 <= goal_bias < 1.0:
            raise ParameterError(f"goal_bias: expected a share in [0, 1), got {goal_bias!r}")
        if steering is None:
            steering = euclidean_steering(cast(float, step_m), checker.lower, checker.upper)
        root = check_position_valid(checker, start, "start")
        self.checker = checker
        self.steering = steering
        self.goal = None if goal is None else check_position_valid(checker, goal, "goal")
        self.goal_vertex: int | None = None
        self._rng = check_generator(rng)
        self._goal_bias = goal_bias
        self._sampler = sampler
        self._count = 1
        self._storage = np.zeros((64, len(root)))
        self._storage[0] = root
        if self.goal is not None and np.array_equal(root, self.goal):
            self.goal_vertex = 0
        self._begin()

    def __len__(self) -> int:
        return self._count

    @property
    def positions(self) -> FloatArray:
        """Positions of the vertices so far, shape (n, d), metres; a view, not to be changed."""
        return self._storage[: self._count]

    @abstractmethod
    def tree(self) -> Tree:
        """Give the tree of best known paths from the start, as it is now."""

    @abstractmethod
    def roadmap(self) -> nx.Graph:
        """Give all edges as a roadmap, as they are now; the start is vertex 0."""

    @abstractmethod
    def _begin(self) -> None:
        """Set up what is kept beside the positions, for the start alone."""

    @abstractmethod
    def _attach(self, vertex: int, nearest: int) -> None:
        """Join the newly stored vertex; the motion nearest -> vertex is valid."""

    def extend(self) -> int | None:
        """Draw one sample and grow by at most one vertex.

        Returns:
            The new vertex, or None if the motion to it was not valid or had no length.
        """
        target = self._draw()
        nearest = int(np.argmin(self.steering.distances(self.positions, target)))
        origin = self._storage[nearest]
        position = np.asarray(self.steering.steer(origin, target), dtype=np.float64)
        if np.array_equal(position, origin):
            return None
        if not self.checker.are_motions_valid(origin, position)[0]:
            return None
        vertex = self._count
        if vertex == len(self._storage):
            self._storage = np.concatenate([self._storage, np.zeros_like(self._storage)])
        self._storage[vertex] = position
        self._count += 1
        reached = self.goal is not None and np.array_equal(position, self.goal)
        if reached and self.goal_vertex is None:
            self.goal_vertex = vertex
        self._attach(vertex, nearest)
        return vertex

    def grow(self, sample_count: int | None = None, time_limit_s: float | None = None) -> Self:
        """Draw samples until a number is drawn or time is up, whichever is first.

        Args:
            sample_count: Number of samples.
            time_limit_s: Seconds; the result then depends on the machine.

        Returns:
            This builder, for chaining.

        Raises:
            ParameterError: If neither is given, or one is out of range.
        """
        if sample_count is None and time_limit_s is None:
            raise ParameterError("expected sample_count or time_limit_s, got neither")
        if sample_count is not None:
            check_count(sample_count, "sample_count", minimum=0)
        if time_limit_s is not None:
            check_positive(time_limit_s, "time_limit_s")
        stop_at = float("inf") if time_limit_s is None else time.perf_counter() + time_limit_s
        drawn = 0
        while (sample_count is None or drawn < sample_count) and time.perf_counter() < stop_at:
            self.extend()
            drawn += 1
        return self

    def path_to_goal(self) -> VertexPath:
        """Give the best known path from start to goal.

        Returns:
            The path.

        Raises:
            ParameterError: If there is no goal.
            UnreachableError: If the goal has not been reached yet.
        """
        if self.goal is None:
            raise ParameterError("goal: expected one at construction, got None")
        if self.goal_vertex is None:
            raise UnreachableError(
                f"the goal {self.goal.tolist()} has not been reached by {self._count} vertices "
                f"from {self.positions[0].tolist()}; grow more, take longer steps, or check that "
                "it can be reached"
            )
        return self.tree().path_to(self.goal_vertex)

    def _draw(self) -> FloatArray:
        """The goal with probability `goal_bias` until it is reached, else a sample."""
        if self.goal is not None and self.goal_vertex is None:
            biased = self._rng.random() < self._goal_bias
            if biased:
                return self.goal
        return self._sampler(self.checker, self._rng)

    def _near(self, vertex: int, nearest: int) -> tuple[IntArray, BoolArray, FloatArray]:
        """Vertices near a new one with the validity and cost of the motions from them to it.

        The nearest vertex is always among them: the motion from it is known to be valid.
        """
        position = self._storage[vertex]
        distances = self.steering.distances(self._storage[:vertex], position)
        near = distances <= self.steering.near_radius(self._count)
        near[nearest] = True
        rows = np.flatnonzero(near)
        ends = np.broadcast_to(position, (len(rows), len(position)))
        costs = np.asarray(self.steering.costs(self._storage[rows], ends), dtype=np.float64)
        valid = self.checker.are_motions_valid(self._storage[rows], ends)
        valid[rows == nearest] = True
        valid &= (costs > 0.0) | (rows == nearest)
        return rows, valid, costs
