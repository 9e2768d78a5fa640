"""What the robots look for and cannot see directly: a linear Gaussian hidden state.

    x(t + 1) = A(t) x(t) + w(t),    w(t) ~ N(d(t), Q(t))

(section II of Kantaros et al. 2019; d is a known mean, it moves the mean only). The state is a
stack of targets. Targets that move independently are one block each, A = blkdiag(A_i), Q =
blkdiag(Q_i), and nothing dense is ever made of them. Targets that are coupled (the cells of a
temperature field) share a block, whose A and Q are dense. A planner has no measurements beforehand:
its predicted mean runs open loop, x(t + 1) = A(t) x(t) + d(t).

A, d and Q are constant, or vary with a leading axis over time; past its end the last one holds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag

from fgplan.checks import SYMMETRY_TOLERANCE, check_finite, frozen
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.typing import ArrayLike, Covariance, FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class HiddenBlock:
    """Targets that move together: one target, or several that are coupled.

    Attributes:
        targets: Unique names, in the order of the block's state.
        sizes: Number of coordinates of each target; may be left out for one target.
        transition: A, shape (n, n) or (T, n, n).
        drift: d, shape (n,) or (T, n), metres a step, world frame; zero if left out.
        process: Q, shape (n, n) or (T, n, n), square metres a step, positive semidefinite; zero
            if left out: a state without process noise.
    """

    targets: tuple[str, ...]
    transition: FloatArray
    drift: FloatArray = field(default_factory=lambda: np.zeros(0))
    process: FloatArray = field(default_factory=lambda: np.zeros(0))
    sizes: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Check shapes and that Q is a covariance."""
        targets = tuple(self.targets)
        name = f"hidden state of {', '.join(map(repr, targets)) or 'no target'}"
        shape = np.shape(self.transition)
        if not targets or len(shape) not in (2, 3) or shape[-1] != shape[-2] or 0 in shape:
            raise InvalidInputError(
                f"{name}: expected at least one target and a transition of shape (n, n) or "
                f"(T, n, n), got {len(targets)} targets and {shape}"
            )
        size = shape[-1]
        sizes = tuple(self.sizes) or (size,)
        if len(sizes) != len(targets) or sum(sizes) != size or min(sizes) < 1:
            raise InvalidInputError(
                f"{name}: expected one size a target with sum {size}, got {self.sizes} for "
                f"{len(targets)} targets"
            )
        drift = self.drift if np.size(self.drift) else np.zeros(size)
        process = self.process if np.size(self.process) else np.zeros((size, size))
        for key, value in (
            ("targets", targets),
            ("sizes", sizes),
            ("transition", _check_series(self.transition, f"{name}: transition", (size, size))),
            ("drift", _check_series(drift, f"{name}: drift", (size,))),
            ("process", _check_process(process, f"{name}: process", size)),
        ):
            object.__setattr__(self, key, value)

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return int(self.transition.shape[-1])

    def at(self, time: int) -> tuple[FloatArray, FloatArray, Covariance]:
        """A, d and Q of the step from ``time`` to ``time + 1``.

        Args:
            time: Step, 0 or more.

        Returns:
            Shapes (n, n), (n,) and (n, n).
        """
        return (
            _entry(self.transition, time, 2),
            _entry(self.drift, time, 1),
            _entry(self.process, time, 2),
        )


@dataclass(frozen=True, slots=True)
class HiddenState:
    """The dynamics of all targets: independent blocks.

    Attributes:
        blocks: In the order of the stacked state.

    Example:
        >>> import numpy as np
        >>> static = HiddenBlock(targets=("a",), transition=np.eye(2))
        >>> moving = HiddenBlock(targets=("b",), transition=np.eye(2), drift=np.array([0.5, 0.0]))
        >>> HiddenState((static, moving)).predicted_means([0, 0, 5, 5], 2)[-1].tolist()
        [0.0, 0.0, 6.0, 5.0]
    """

    blocks: tuple[HiddenBlock, ...]

    def __post_init__(self) -> None:
        """Check that names are unique."""
        object.__setattr__(self, "blocks", tuple(self.blocks))
        names = self.targets
        for name in names:
            if names.count(name) > 1:
                raise InvalidInputError(f"hidden state: expected unique names, got {name!r} twice")

    @property
    def targets(self) -> tuple[str, ...]:
        """Names in the order of the stacked state."""
        return tuple(name for block in self.blocks for name in block.targets)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of coordinates of each target."""
        return tuple(size for block in self.blocks for size in block.sizes)

    @property
    def size(self) -> int:
        """Number of coordinates of the stacked state."""
        return sum(block.size for block in self.blocks)

    @property
    def independent(self) -> bool:
        """Whether every target is a block of its own."""
        return all(len(block.targets) == 1 for block in self.blocks)

    def slice_of(self, target: str) -> slice:
        """Where a target sits in the stacked state.

        Raises:
            UnknownNameError: If there is no such target.
        """
        if target not in self.targets:
            known = ", ".join(self.targets) or "none"
            raise UnknownNameError(f"hidden state: target {target!r} is not one of: {known}")
        place = self.targets.index(target)
        start = sum(self.sizes[:place])
        return slice(start, start + self.sizes[place])

    def dense(self, time: int) -> tuple[FloatArray, FloatArray, Covariance]:
        """A, d and Q of the stacked state for the step from ``time`` to ``time + 1``.

        Args:
            time: Step, 0 or more.

        Returns:
            Shapes (n, n), (n,) and (n, n); blocks on the diagonal.
        """
        transitions, drifts, processes = zip(
            *(block.at(time) for block in self.blocks), strict=True
        )
        return block_diag(*transitions), np.concatenate(drifts), block_diag(*processes)

    def predicted_means(self, mean: ArrayLike, steps: int, time: int = 0) -> FloatArray:
        """Mean of the hidden state, open loop: x(t + 1) = A x(t) + d(t).

        Args:
            mean: Mean at ``time``, shape (n,), metres, world frame.
            steps: Number of steps, zero or more.
            time: Time of the first row.

        Returns:
            Shape (steps + 1, n); row 0 is the mean given.

        Raises:
            InvalidInputError: If the mean has another size or the steps are negative.
        """
        if steps < 0 or time < 0:
            raise InvalidInputError(
                f"hidden state: expected steps and time of zero or more, got {steps} and {time}"
            )
        means = np.empty((steps + 1, self.size))
        means[0] = check_finite(mean, "hidden state mean", (self.size,))
        start = 0
        for block in self.blocks:
            span = slice(start, start + block.size)
            for step in range(steps):
                transition, drift, _ = block.at(time + step)
                means[step + 1, span] = transition @ means[step, span] + drift
            start += block.size
        return frozen(means)

    def later(self, time: int) -> "HiddenState":
        """The same dynamics with the clock set to zero at a later time.

        Args:
            time: Step, 0 or more.

        Returns:
            Blocks whose series begin there.
        """
        return HiddenState(tuple(_later(block, time) for block in self.blocks))

    def sample(self, state: ArrayLike, time: int, generator: np.random.Generator) -> FloatArray:
        """Draw x(t + 1) given x(t).

        Args:
            state: x(t), shape (n,), metres, world frame.
            time: t.
            generator: Takes n standard normal numbers whatever Q is, so that runs that differ in
                Q alone stay comparable.

        Returns:
            Shape (n,).

        Raises:
            InvalidInputError: If the state has another size.
        """
        now = check_finite(state, "hidden state", (self.size,))
        normal = generator.standard_normal(self.size)
        after = np.empty(self.size)
        start = 0
        for block in self.blocks:
            span = slice(start, start + block.size)
            transition, drift, process = block.at(time)
            after[span] = transition @ now[span] + drift + square_root(process) @ normal[span]
            start += block.size
        return frozen(after)


def square_root(covariance: Covariance) -> FloatArray:
    """L with L L' = covariance, for positive semidefinite matrices: zero noise is allowed.

    Args:
        covariance: Shape (n, n), symmetric, positive semidefinite.

    Returns:
        Shape (n, n), V sqrt(D) of the eigendecomposition.
    """
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.clip(values, 0.0, None))


def coupled(state: HiddenState) -> HiddenState:
    """The same dynamics as one dense block, for what needs a joint covariance of all targets.

    Args:
        state: Blocks, each constant or varying.

    Returns:
        One block; varying over as many steps as the longest of the given.
    """
    lengths = [
        len(values)
        for block in state.blocks
        for values, axes in ((block.transition, 2), (block.drift, 1), (block.process, 2))
        if values.ndim > axes
    ]
    steps = [state.dense(time) for time in range(max(lengths, default=1))]
    transition, drift, process = (np.array(values) for values in zip(*steps, strict=True))
    constant = len(steps) == 1
    block = HiddenBlock(
        targets=state.targets,
        sizes=state.sizes,
        transition=transition[0] if constant else transition,
        drift=drift[0] if constant else drift,
        process=process[0] if constant else process,
    )
    return HiddenState((block,))


def independent_targets(
    targets: Sequence[str], drifts: ArrayLike, process: ArrayLike
) -> HiddenState:
    """Targets that drift by known steps: A = I.

    Args:
        targets: Unique names.
        drifts: Shape (M, n), metres a step, world frame; zero for static targets.
        process: Shape (n, n), the same for each, square metres a step; zero is allowed.

    Returns:
        One block a target.

    Raises:
        InvalidInputError: If there is not one drift a target.
    """
    steps = check_finite(drifts, "target drifts", (len(targets), None))
    blocks = [
        HiddenBlock(
            targets=(name,),
            transition=np.eye(steps.shape[1]),
            drift=drift,
            process=np.asarray(process, dtype=np.float64),
        )
        for name, drift in zip(targets, steps, strict=True)
    ]
    return HiddenState(tuple(blocks))


def _entry(series: FloatArray, time: int, axes: int) -> FloatArray:
    """The entry of a step: constant, or the last one past the end."""
    return series if series.ndim == axes else series[min(time, len(series) - 1)]


def _later(block: HiddenBlock, time: int) -> HiddenBlock:
    """A block whose series begin at a later time; the last entry holds."""

    def rest(series: FloatArray, axes: int) -> FloatArray:
        return series if series.ndim == axes else series[min(time, len(series) - 1) :]

    return replace(
        block,
        transition=rest(block.transition, 2),
        drift=rest(block.drift, 1),
        process=rest(block.process, 2),
    )


def _check_series(values: ArrayLike, name: str, shape: tuple[int, ...]) -> FloatArray:
    """Check an array that is constant or has a leading axis over time."""
    varies = np.ndim(values) == len(shape) + 1
    array = check_finite(values, name, (None, *shape) if varies else shape)
    if len(array) == 0:
        raise InvalidInputError(f"{name}: expected at least one step, got none")
    return array


def _check_process(values: ArrayLike, name: str, size: int) -> FloatArray:
    """Check that every Q is symmetric and positive semidefinite; zero is allowed."""
    array = _check_series(values, name, (size, size))
    largest = float(np.abs(array).max())
    if np.abs(array - np.swapaxes(array, -1, -2)).max() > SYMMETRY_TOLERANCE * largest:
        raise InvalidInputError(f"{name}: expected a symmetric matrix; write it as (Q + Q') / 2")
    smallest = float(np.linalg.eigvalsh(array).min())
    if smallest < -SYMMETRY_TOLERANCE * largest:
        raise InvalidInputError(
            f"{name}: expected a positive semidefinite matrix, got an eigenvalue of {smallest:g}"
        )
    return array
