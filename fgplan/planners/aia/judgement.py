"""Objective and terminal constraint by the registry of uncertainty functions.

The numbers are those of ``covariance_kernels`` where both know the function (a test compares them).
"""

import numpy as np

from fgplan.models.uncertainty import uncertainty_function
from fgplan.planners.aia.arrays import unpacked
from fgplan.planners.aia.covariance_kernels import DETERMINANT
from fgplan.planners.aia.criteria_arrays import BUILT_IN, criteria_arrays
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.typing import BoolArray, FloatArray


class Judgement:
    """Reads covariances of one problem."""

    def __init__(self, problem: AcquisitionProblem) -> None:
        """Look at the problem once.

        Args:
            problem: The problem.
        """
        self._problem = problem
        self._criteria, self._compiled = criteria_arrays(problem)
        sizes = problem.hidden.sizes
        ends = np.cumsum(sizes)
        self._parts = [slice(int(e - n), int(e)) for e, n in zip(ends, sizes, strict=True)]
        self._open_loop = problem.open_loop_covariances(0)

    def _blocks(self, row: FloatArray) -> list[FloatArray]:
        """Covariance of each target."""
        whole = unpacked(row, packed=self._problem.packed)
        return list(whole) if self._problem.packed else [whole[p, p] for p in self._parts]

    def _joint(self, row: FloatArray) -> FloatArray:
        """Covariance of the stacked state."""
        whole = unpacked(row, packed=self._problem.packed)
        if not self._problem.packed:
            return whole
        joint = np.zeros((self._problem.hidden.size,) * 2)
        for part, block in zip(self._parts, whole, strict=True):
            joint[part, part] = block
        return joint

    def _unmeasured(self, time: int) -> FloatArray:
        """Covariance of the stacked state without any measurement, which what is gained is of."""
        time = 0 if self._problem.still else time
        if time >= len(self._open_loop):
            self._open_loop = self._problem.open_loop_covariances(2 * time)
        return self._open_loop[time]

    def _numbers(self, row: FloatArray, name: str, time: int = 0, *, joint: bool) -> FloatArray:
        """Numbers of each target's covariance, or one of the joint covariance."""
        function = uncertainty_function(name)
        whole = self._unmeasured(time) if function.needs_prior else None
        if joint:
            return np.atleast_1d(function.evaluate(self._joint(row), whole))
        before = None if whole is None else [whole[part, part] for part in self._parts]
        if self._problem.packed:  # of one size: all at once
            blocks = unpacked(row, packed=True)
            return np.asarray(
                function.evaluate(blocks, None if before is None else np.array(before))
            )
        return np.array(
            [
                float(function.evaluate(block, None if before is None else before[i]))
                for i, block in enumerate(self._blocks(row))
            ]
        )

    def term(self, row: FloatArray) -> float:
        """The objective's term of one step.

        Args:
            row: Covariances, shape (width,).
        """
        joint = self._problem.objective_scope == "joint"
        return float(self._numbers(row, self._problem.objective, joint=joint).sum())

    def judge(self, row: FloatArray, time: int) -> tuple[float, BoolArray]:
        """Shortfall of the terminal constraint, and which targets are satisfied.

        Args:
            row: Covariances, shape (width,).
            time: When: what would be known without measuring changes.
        """
        terminal, criteria = self._problem.terminal, self._criteria
        joint = terminal.scope == "joint"
        if not self._compiled:
            over = self._ratios(row, time)
            each = over <= 1.0
            return float(over.max()), np.broadcast_to(each, (self._problem.targets,)).copy()
        name = next(name for name, code in BUILT_IN.items() if code == criteria.terminal)
        numbers = self._numbers(row, name, joint=False)
        satisfied = numbers <= criteria.satisfied
        if not joint:
            return float((numbers / criteria.threshold).max()), satisfied
        if criteria.terminal == DETERMINANT:
            over = np.linalg.slogdet(self._joint(row))[1] - criteria.threshold[0]
            return float(np.exp(over / self._problem.hidden.size)), satisfied
        whole = self._numbers(row, name, joint=True)[0]
        return float(whole / criteria.threshold[0]), satisfied

    def farthest(self, row: FloatArray, time: int) -> str:
        """Name of the target farthest from the terminal constraint; empty of a joint one.

        Args:
            row: Covariances, shape (width,).
            time: As for ``judge``.
        """
        if self._problem.terminal.scope == "joint":
            return ""
        if not self._compiled:
            over = self._ratios(row, time)
        else:
            name = next(one for one, code in BUILT_IN.items() if code == self._criteria.terminal)
            over = self._numbers(row, name, joint=False) / self._criteria.threshold
        return self._problem.hidden.targets[int(np.argmax(over))]

    def _ratios(self, row: FloatArray, time: int) -> FloatArray:
        """Numbers of a function that the kernels do not know, over their limits."""
        terminal = self._problem.terminal
        joint = terminal.scope == "joint"
        values = self._numbers(row, terminal.function, time, joint=joint)
        limits = terminal.limits(self._problem.targets)
        if terminal.function == "mutual_information":
            # As of a determinant, of the joint one its root: at least the limit is wanted.
            return np.asarray(
                np.exp(2.0 * (limits - values) / (self._problem.hidden.size if joint else 1))
            )
        over = np.where(limits > 0.0, values / np.where(limits > 0.0, limits, 1.0), 0.0)
        return np.where(limits > 0.0, over, np.exp(values - limits))
