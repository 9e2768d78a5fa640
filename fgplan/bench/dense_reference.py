"""The dense implementations of ``benchmarks``, given a problem of the library.

They share the geodesic fields and the tests of ways and sight with the planners, nothing else.
"""

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from fgplan.errors import InvalidInputError
from fgplan.planners.aia.arrays import Prepared
from fgplan.planners.aia.obstacle_arrays import obstacle_arrays
from fgplan.planners.aia.obstacle_kernels import in_sight
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.options import DistributedOptions
from fgplan.team.communication_graph import CommunicationGraph

_FOLDER = Path(__file__).parents[2] / "benchmarks"
_STEPS = 600


def centralised_reference(
    problem: AcquisitionProblem,
    options: TreeOptions,
    prepared: Prepared,
    *,
    every_row: bool = False,
    information_form: bool = False,
    one_by_one: bool = False,
) -> Any:  # noqa: ANN401
    """Algorithm 1 of Kantaros et al. 2019, ``benchmarks/aia_dense_reference.py``, planted.

    Args:
        problem: What is planned for; robots of one kind, the targets' determinants below one limit.
        options: How.
        prepared: Arrays of the problem.
        every_row: Whether the filter stacks a row for every robot and target.
        information_form: Whether the filter adds information; otherwise it solves for a gain.
        one_by_one: Whether robots are treated one after the other; otherwise vectorised over them.

    Returns:
        The tree: ``run(iterations, generator, stop)`` grows it.

    Raises:
        InvalidInputError: If the reference is not there: it is in the checkout, not in the package.
    """
    setting = prepared.setting
    reference = _module("aia_dense_reference").DenseReference(
        starts=np.array([one.pose for one in problem.robots]),
        process=np.array([block.at(0)[2] for block in problem.hidden.blocks]),
        prior=np.asarray(problem.priors[0]),
        delta=float(np.max(problem.terminal.limit)),
        near_m=float(setting.near_m[0]),
        p_group=options.p_group,
        p_control=options.p_control,
        every_row=every_row,
        information_form=information_form,
        one_by_one=one_by_one,
        **_shared(problem, prepared),
    )
    reference.plant()
    return reference


def distributed_reference(
    problem: AcquisitionProblem,
    options: DistributedOptions,
    prepared: Prepared,
    graph: CommunicationGraph,
    generators: Sequence[np.random.Generator],
    *,
    every_row: bool = False,
) -> Any:  # noqa: ANN401
    """Algorithm 1 of Tzes et al. 2021, ``benchmarks/distributed_aia_dense_reference.py``, planted.

    Args:
        problem: What is planned for; robots of one kind, the targets' determinants below limits.
        options: How; controls near a target are drawn uniformly.
        prepared: Arrays of the problem.
        graph: Who hears whom.
        generators: Source of random numbers of each robot.
        every_row: Whether the filter stacks a row for every target.

    Returns:
        The team: ``run(sweeps)`` grows the trees in ``robots``.

    Raises:
        InvalidInputError: If the reference is not there: it is in the checkout, not in the package.
    """
    module = _module("distributed_aia_dense_reference")
    blocks = [block.at(0) for block in problem.hidden.blocks]
    world = module.World(
        transition=block_diag(*(A for A, _, _ in blocks)),
        process=block_diag(*(Q for _, _, Q in blocks)),
        prior=block_diag(*problem.priors),
        delta=np.broadcast_to(problem.terminal.limit, problem.targets),
        linked=graph.scheduled,
        period=graph.period,
        link_range_m=graph.range_m,
        near_m=float(prepared.setting.near_m[0]),
        p_group=options.p_group,
        p_control=options.p_control,
        p_candidate=options.p_candidate,
        kappa=options.kappa,
        one_node=options.expand == "node",
        literal=options.empty_set == "literal",
        reject_jointly=options.reject_jointly,
        uniform_after_goal=options.uniform_after == "feasible",
        every_row=every_row,
        **_shared(problem, prepared),
    )
    starts = np.array([one.pose for one in problem.robots])
    return module.DistributedDenseReference.planted(world, starts, list(generators))


def _shared(problem: AcquisitionProblem, prepared: Prepared) -> dict[str, Any]:
    """What both are given: controls, sensor, predicted targets, geodesic fields, obstacles."""
    world, setting, robot = obstacle_arrays(problem.workspace), prepared.setting, problem.robots[0]
    places, field_of = problem.places_until(_STEPS), setting.fields.of_target
    if not problem.fixed:
        field_of = prepared.fields.rows_of(places.reshape(-1, 2)).reshape(places.shape[:2])
    return {
        "relative": np.asarray(robot.primitives.relative),
        "waypoints": np.asarray(robot.primitives.waypoints),
        "body": robot.primitives.frame == "body",
        "places": places,
        "distance": prepared.fields.distance_m,
        "frame": prepared.fields.frame,
        "field_of": field_of,
        "are_free": problem.workspace.are_motions_valid,
        "is_seen": lambda a, b: bool(in_sight(world, a[0], a[1], b[0], b[1])),
        "range_m": float(getattr(robot.sensors[0], "max_range_m", np.inf)),
    }


def _module(name: str) -> ModuleType:
    """A file of ``benchmarks`` as a module, loaded once."""
    path = _FOLDER / f"{name}.py"
    if not path.exists():
        raise InvalidInputError(
            f"dense reference: expected it at {path}; run this from a checkout of the repository"
        )
    sys.path.insert(0, str(_FOLDER))  # what the references share stands beside them
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(_FOLDER))
