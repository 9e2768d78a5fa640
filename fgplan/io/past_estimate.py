"""The joint belief of a team's past: a batch estimate, and which poses hold the frame.

    min sum |h_i(x) - z_i|^2 over all variables of all robots, by Levenberg-Marquardt with QR (with
    Cholesky GTSAM gives up on the Intel log); the belief is the graph linearised at the minimum

It starts from the initial values, or, in a graph of relative poses alone, from rotations first and
positions after (fgplan/io/rotation_first.py) where these have the lower error. It has converged
where one more Gauss-Newton step changes the error by less than a millionth.

Factors between poses fix everything but a rigid motion of each connected part of the graph. A part
that no prior factor and no FIX line holds is held at its first pose of the first robot, to 1 mm and
1 mrad, and that is said: where parts share no measurement, how they lie to each other is what the
initial values say, not what was measured.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import gtsam
import networkx as nx
import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.factors.keys import describe_key
from fgplan.io.rotation_first import rotations_first
from fgplan.io.team_past import TeamPast, is_pose
from fgplan.typing import FloatArray, Key

GAUGE_SIGMA = 1e-3
"""Standard deviation of a held pose where nothing says it: 1 mm and 1 mrad."""

MAX_ITERATIONS = 100
"""Iterations of Levenberg-Marquardt, at most."""

CONVERGED = 1e-6
"""Relative change of the error by a Gauss-Newton step below which the estimate has converged."""

_STOP = 1e-9
"""Relative fall of the error in an iteration at which Levenberg-Marquardt ends."""

_ROUNDING = 1e-9
"""Half squared whitened errors below this are zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PastEstimate:
    """A team's past with its joint belief.

    Attributes:
        past: The past.
        belief: Linearised at the estimate.
        held: Standard deviations of each pose that is held, shape (d,), by key.
        error_before: Half the sum of squared whitened errors at the initial values.
        error_after: The same at the estimate.
        iterations: Of Levenberg-Marquardt.
        optimised: Whether it was optimised; the initial values were kept otherwise.
        converged: Whether the estimate is a minimum.
        seconds: Real seconds of estimating.
        notes: Plain sentences: what was held and why.
    """

    past: TeamPast
    belief: Belief
    held: Mapping[Key, FloatArray]
    error_before: float
    error_after: float
    iterations: int = 0
    optimised: bool = False
    converged: bool = True
    seconds: float = 0.0
    notes: tuple[str, ...] = field(default=())

    @property
    def current_keys(self) -> dict[str, Key]:
        """Last pose of each robot."""
        return {robot: keys[-1] for robot, keys in self.past.robots.items()}


def estimate_past(
    past: TeamPast,
    hold: Sequence[Key] = (),
    sigmas: Sequence[float] = (),
    *,
    optimise: bool = True,
) -> PastEstimate:
    """Estimate the joint belief of a team's past.

    Args:
        past: The past.
        hold: Poses to hold; if none are given those that the files name and, in every connected
            part that neither they nor a prior factor hold, the first pose of the first robot.
        sigmas: Standard deviations of held poses, 3 or 6 in GTSAM's order; 1 mm and 1 mrad if
            left out.
        optimise: Whether to optimise what is not estimated yet; the values are kept otherwise.

    Returns:
        The estimate.

    Raises:
        InvalidInputError: If a pose to hold is not there, or sigmas have another size than poses.
        IllPosedBeliefError: If a variable is not determined by the measurements; names it.
    """
    notes = []
    held = list(hold)
    if not held:
        held = list(past.held)
        for key, robots in _free_parts(past, held):
            held.append(key)
            of = "" if len(robots) == len(past.robots) else f" of {', '.join(robots)}"
            notes.append(
                f"nothing in the files fixes the frame{of}: pose {describe_key(key)} is held where "
                "they have it"
            )
        if len(held) - len(past.held) > 1:
            notes.append(
                "parts of the team share no measurement: how they lie to each other is not measured"
            )
    graph, values = gtsam.NonlinearFactorGraph(past.graph), past.values
    chosen: dict[Key, FloatArray] = {}
    for key in held:
        if not (values.exists(key) and is_pose(values, key)):
            raise InvalidInputError(f"expected a pose to hold, got {describe_key(key)}")
        planar = values.dims()[key] == 3
        size = 3 if planar else 6
        chosen[key] = np.array(sigmas if len(sigmas) else (GAUGE_SIGMA,) * size, dtype=np.float64)
        if chosen[key].shape != (size,):
            raise InvalidInputError(f"gauge sigmas: expected {size} numbers, got {len(sigmas)}")
        noise = gtsam.noiseModel.Diagonal.Sigmas(chosen[key])
        graph.add(
            gtsam.PriorFactorPose2(key, values.atPose2(key), noise)
            if planar
            else gtsam.PriorFactorPose3(key, values.atPose3(key), noise)
        )
    began = time.perf_counter()
    with gtsam_boundary("evaluating the past at its initial values"):
        before = after = float(graph.error(values))
    iterations, converged = 0, True
    optimise = optimise and not past.estimated
    if optimise:
        relaxed = rotations_first(graph, values, next(iter(chosen))) if chosen else None
        if relaxed is not None and graph.error(relaxed) < before:
            values = relaxed
            notes.append(
                "estimated from rotations first and positions after, error "
                f"{graph.error(relaxed):.6g}, nearer than the files' values"
            )
        with gtsam_boundary("estimating the past"):
            values, iterations = _minimised(graph, values)
            after = float(graph.error(values))
            converged = _is_minimum(graph, values)
    seconds = time.perf_counter() - began
    return PastEstimate(
        past=past,
        belief=Belief(graph, values),
        held=chosen,
        error_before=before,
        error_after=after,
        iterations=iterations,
        optimised=optimise,
        converged=converged,
        seconds=seconds,
        notes=tuple(notes),
    )


def _minimised(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> tuple[gtsam.Values, int]:
    """Values at a minimum, and the iterations it took."""
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(MAX_ITERATIONS)
    params.setRelativeErrorTol(_STOP)
    params.setAbsoluteErrorTol(_STOP)
    params.setLinearSolverType("MULTIFRONTAL_QR")
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, params)
    return optimizer.optimize(), int(optimizer.iterations())


def _is_minimum(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> bool:
    """Whether a Gauss-Newton step changes next to nothing."""
    params = gtsam.GaussNewtonParams()
    params.setLinearSolverType("MULTIFRONTAL_QR")
    optimizer = gtsam.GaussNewtonOptimizer(graph, values, params)
    before = float(optimizer.error())
    optimizer.iterate()
    return bool(abs(optimizer.error() - before) <= CONVERGED * before + _ROUNDING)


def _free_parts(past: TeamPast, held: Sequence[Key]) -> list[tuple[Key, list[str]]]:
    """First pose and robots of every connected part that nothing holds, in the team's order."""
    joined, fixed = nx.Graph(), set(held)
    for index in range(past.graph.size()):
        ends = list(past.graph.at(index).keys())
        nx.add_path(joined, ends)
        if len(ends) == 1:
            fixed.add(ends[0])
    free = []
    seen: set[Key] = set()
    for keys in past.robots.values():
        for key in keys:
            if key in seen or key not in joined:
                continue
            part = nx.node_connected_component(joined, key)
            seen |= part
            if not part & fixed:
                robots = [name for name, own in past.robots.items() if part & set(own)]
                free.append((key, robots))
    return free
