"""Time of one iteration, centralised and distributed, in dense and in block form.

An iteration expands one node: of the centralised tree for all N robots, of the distributed ones for
one robot. The forms:

    published    dense joint covariance; robots one after the other, by the same steps in both; a
                 row for every robot and target, as (3) stacks them (those not seen weigh nothing).
                 The Riccati map of Kantaros et al. 2019, which prints no formula, in its usual form
                 with a gain: a system of N M equations. The distributed filter in the form of (4):
                 information, M rows.
    information  the same, the centralised filter in the form of (4), too
    seen         dense joint covariance, rows of what is seen only, the centralised one vectorised
                 over robots: the stronger dense form
    block        the library: targets apart, compiled

The dense distributed forms fuse covariances that lag as they are, as Remark 3 says; the library
predicts them forward.

The ratio depends on the form of the centralised one more than on anything else; so all are
measured, in turn in one process, in processor time: another process on the same core does not
count.
"""

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fgplan.bench.dense_reference import centralised_reference, distributed_reference
from fgplan.planners.aia.arrays import prepare
from fgplan.planners.aia.growth import Growth
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.threads import one_blas_thread

FORMS = ("published", "information", "seen", "block")
_ENDLESS = {"until": "budget", "iterations": 10**9, "uniform_after": "never", "expand": "node"}
_MOST_ITERATIONS = {"block": 20_000}
"""Iterations of a part at most; dense ones keep a matrix of all targets a node, so 2,000."""


@one_blas_thread()
def iteration_times(
    problem: AcquisitionProblem,
    graph: CommunicationGraph,
    seed: int = 0,
    *,
    near_m: float = 0.3,
    forms: Sequence[str] = FORMS,
    repeats: int = 5,
    part_s: float = 0.2,
) -> dict[str, float]:
    """Medians over parts of long runs, taken in turn.

    Args:
        problem: What is planned for; robots of one kind, the targets' determinants below one limit.
        graph: Who hears whom.
        seed: Of the random numbers.
        near_m: Distance to the target within which controls are drawn uniformly: at least a step,
            or robots that can come no nearer stay, and groups of one configuration explode.
        forms: Those of ``FORMS`` that are measured.
        repeats: Parts of each run.
        part_s: Seconds that a part is meant to take; it has one iteration of each robot at least.

    Returns:
        Microseconds an iteration as ``centralised_FORM_us`` and ``distributed_FORM_us``.

    Raises:
        InvalidInputError: If the dense references are not there: they are in the checkout only.
    """
    runs = _runs(problem, graph, seed, near_m, forms)
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    counts = {}
    for name, (run, robots) in runs.items():
        run(1)  # compiles, or loads what is compiled
        began = time.process_time()
        run(2)
        one = (time.process_time() - began) / 2
        most = _MOST_ITERATIONS.get(name.split("_")[1], 2_000)
        counts[name] = int(np.clip(part_s / one, 1, max(most // robots, 1)))
    for _ in range(repeats):
        for name, (run, robots) in runs.items():
            began = time.process_time()
            run(counts[name])
            seconds[name].append((time.process_time() - began) / (counts[name] * robots))
    return {f"{name}_us": 1e6 * float(np.median(found)) for name, found in seconds.items()}


def ratios(times: Mapping[str, float]) -> dict[str, float]:
    """Distributed over centralised by form.

    Args:
        times: What ``iteration_times`` returns.

    Returns:
        ``ratio_FORM`` of each form measured.
    """
    return {
        f"ratio_{form}": times[f"distributed_{form}_us"] / times[f"centralised_{form}_us"]
        for form in FORMS
        if f"centralised_{form}_us" in times
    }


def _runs(
    problem: AcquisitionProblem,
    graph: CommunicationGraph,
    seed: int,
    near_m: float,
    forms: Sequence[str],
) -> dict[str, tuple[Callable[[int], object], int]]:
    """By name: what does so many iterations of each of its trees, and how many trees it has."""
    robots = len(problem.robots)
    tree = tree_options("reproduction", near_m=near_m, **_ENDLESS)
    options = distributed_options("reproduction", near_m=near_m, **_ENDLESS)
    literal = distributed_options("reproduction", empty_set="literal", **_ENDLESS)
    prepared = prepare(problem, tree)

    def generators() -> list[np.random.Generator]:
        return np.random.default_rng(seed).spawn(robots)

    runs: dict[str, tuple[Callable[[int], object], int]] = {}
    for form in forms:
        one = np.random.default_rng(seed)
        if form == "block":
            growth = Growth(problem, tree, prepared)
            growth.plant()
            forest = ForestGrowth(problem, options, graph, generators(), fields=prepared.fields)
            runs["centralised_block"] = (_with(growth.run, one), 1)
            runs["distributed_block"] = (forest.run, robots)
            continue
        every = form != "seen"
        dense = centralised_reference(
            problem,
            tree,
            prepared,
            every_row=every,
            information_form=form == "information",
            one_by_one=every,
        )
        team = distributed_reference(
            problem, literal, prepared, graph, generators(), every_row=every
        )
        runs[f"centralised_{form}"] = (_with(dense.run, one, False), 1)
        runs[f"distributed_{form}"] = (team.run, robots)
    return runs


def _with(run: Callable[..., object], *given: object) -> Callable[[int], object]:
    """A run with everything but the number of iterations given."""
    return lambda iterations: run(iterations, *given)
