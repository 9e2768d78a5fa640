"""``fgplan bench aia``: the sampling tree against a faithful dense implementation.

The opponent is ``benchmarks/aia_dense_reference.py``: Algorithm 1 in vectorised numpy with a dense
joint covariance. Both get the same scene, random stream, geodesic fields and test of sight, and
grow the same tree node for node, whose covariances are compared. Times a node are those of long
runs of each; *end to end* is from the problem to the first feasible plan, fields included for both.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from fgplan.bench.aia_scene import DELTA, kantaros_scene
from fgplan.bench.dense_reference import centralised_reference
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_least, require_at_most
from fgplan.planners.aia.arrays import Prepared, prepare, unpacked
from fgplan.planners.aia.growth import Growth
from fgplan.planners.aia.options import TreeOptions, tree_options
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.threads import one_blas_thread
from fgplan.typing import FloatArray

RATIO_PER_NODE = {(10, 20): 500.0, (30, 56): 1000.0}
REFERENCE_NODES_PER_SECOND = {(10, 20): 928.0, (30, 56): 134.0}
RATIO_END_TO_END = 10.0
LARGEST_DIFFERENCE = 1e-10
RATIO_UNCOMPILED = 5.0
_NODES = 100_000
_REFERENCE_NODES = 400
_UNCOMPILED_NODES = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this bench."""
    parser.add_argument("--robots", type=int, default=10, help="robots (default 10)")
    parser.add_argument("--targets", type=int, default=20, help="targets (default 20)")
    parser.add_argument(
        "--dynamics",
        choices=("first-order", "differential-drive"),
        default="first-order",
        help="of the robots (default first-order)",
    )
    parser.add_argument("--moving", action="store_true", help="targets move")


@one_blas_thread()
def run(options: CommandOptions) -> CommandOutcome:
    """Run the bench.

    Args:
        options: Arguments ``robots``, ``targets``, ``dynamics`` and ``moving``.

    Returns:
        The results and what is required of them.

    Raises:
        InvalidInputError: If the reference is not there: it is in the checkout, not in the package.
    """
    robots, targets = options.arguments["robots"], options.arguments["targets"]
    dynamics, moving = options.arguments["dynamics"], options.arguments["moving"]
    seeds = options.seed_range(5, quick=1)
    problem = kantaros_scene(
        robots, targets, np.random.default_rng(0), dynamics=dynamics, moving=moving
    )
    until_first = tree_options("reproduction")
    began = time.perf_counter()
    _first_plan(problem, until_first, 0)
    compile_seconds = time.perf_counter() - began
    firsts: dict[str, list[float]] = {name: [] for name in ("setup", "ours", "reference")}
    for seed in seeds:
        options.progress(seed - seeds[0], len(seeds), f"first plans, seed {seed}")
        problem = kantaros_scene(
            robots, targets, np.random.default_rng(seed), dynamics=dynamics, moving=moving
        )
        setup, ours, prepared = _first_plan(problem, until_first, seed)
        reference = centralised_reference(problem, until_first, prepared)
        began = time.perf_counter()
        reference.run(100_000, np.random.default_rng(seed), stop=True)
        for name, seconds in (
            ("setup", setup),
            ("ours", ours),
            ("reference", time.perf_counter() - began),
        ):
            firsts[name].append(1e3 * seconds)
    options.progress(len(seeds), len(seeds), "nodes a second")
    quick = 4 if options.quick else 1
    rates = _rates(
        problem,
        nodes=_NODES // quick,
        uncompiled={
            "robots": robots,
            "targets": targets,
            "dynamics": dynamics,
            "moving": moving,
            "seed": seeds[-1],
            "nodes": _UNCOMPILED_NODES // quick,
        },
    )
    setup_ms = float(np.median(firsts["setup"]))
    ours_ms = float(np.median(firsts["ours"]))
    reference_ms = float(np.median(firsts["reference"]))
    results = rates | {
        "robots": robots,
        "targets": targets,
        "dynamics": dynamics,
        "moving": moving,
        "first_plan_ms": ours_ms,
        "setup_ms": setup_ms,
        "reference_first_plan_ms": reference_ms,
        "ratio_first_plan": reference_ms / ours_ms,
        "ratio_end_to_end": (setup_ms + reference_ms) / (setup_ms + ours_ms),
        "compile_or_load_seconds": compile_seconds,
        "delta": DELTA,
    }
    return CommandOutcome(
        results=results,
        requirements=_requirements(results),
        seeds=seeds,
        summary=_summary(results),
    )


def _first_plan(
    problem: AcquisitionProblem, options: TreeOptions, seed: int
) -> tuple[float, float, Prepared]:
    """Seconds of setting up and of planning until the first feasible plan."""
    began = time.perf_counter()
    prepared = prepare(problem, options)
    ready = time.perf_counter()
    growth = Growth(problem, options, prepared)
    growth.plant()
    generator = np.random.default_rng(seed)
    while not growth.feasible:
        growth.run(100_000, generator)
    growth.best_path()
    return ready - began, time.perf_counter() - ready, growth.prepared


def _rates(
    problem: AcquisitionProblem, nodes: int, uncompiled: Mapping[str, Any]
) -> dict[str, Any]:
    """Nodes a second of both, on the same scene and stream, and how the trees differ."""
    options = tree_options(
        "reproduction", until="budget", iterations=10**9, node_budget=nodes, uniform_after="never"
    )
    prepared = prepare(problem, options)
    reference = centralised_reference(problem, options, prepared)
    began = time.perf_counter()
    reference.run(_REFERENCE_NODES, np.random.default_rng(0), stop=False)
    reference_seconds = time.perf_counter() - began
    shares = {part: spent / reference_seconds for part, spent in reference.seconds.items()}
    shares["the rest"] = 1.0 - sum(shares.values())
    same = Growth(problem, options, prepared)
    same.plant()
    same.run(_REFERENCE_NODES, np.random.default_rng(0))
    difference = _difference(same, reference)
    seconds = []
    for repeat in range(3):
        growth = Growth(problem, options, prepared)
        growth.plant()
        began = time.perf_counter()
        growth.run(10**9, np.random.default_rng(repeat))
        seconds.append((time.perf_counter() - began) / growth.nodes)
    rate = 1.0 / min(seconds)
    reference_rate = len(reference.nodes) / reference_seconds
    uncompiled_rate = _uncompiled(uncompiled)
    return {
        "nodes": len(reference.nodes),
        "nodes_of_long_run": growth.nodes,
        "same_nodes": same.nodes == len(reference.nodes),
        "max_abs_diff": difference,
        "nodes_per_second": rate,
        "reference_nodes_per_second": reference_rate,
        "reference_shares": shares,
        "ratio_per_node": rate / reference_rate,
        "uncompiled_nodes_per_second": uncompiled_rate,
        "ratio_uncompiled": uncompiled_rate / reference_rate,
        "bytes_per_node": growth.bytes_per_node,
    }


def _difference(growth: Growth, reference: Any) -> float:  # noqa: ANN401
    """Largest difference of a covariance of the nodes that both have."""
    count = min(growth.nodes, len(reference.nodes))
    ours: FloatArray = unpacked(growth.tree.covariance[:count], packed=True)
    worst = 0.0
    for node in range(count):
        dense = np.array(reference.nodes[node].covariance)
        for i, block in enumerate(ours[node]):
            part = slice(2 * i, 2 * i + 2)
            worst = max(worst, float(np.abs(dense[part, part] - block).max()))
            dense[part, part] = 0.0
        worst = max(worst, float(np.abs(dense).max()))
    return worst


def _uncompiled(arguments: Mapping[str, Any]) -> float:
    """Nodes a second without numba's compiler, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "fgplan.bench.aia_uncompiled", json.dumps(dict(arguments))],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def _requirements(results: Mapping[str, Any]) -> tuple[Requirement, ...]:
    """What the first-order scene of the size at hand must reach; exactness for all."""
    robots, targets = results["robots"], results["targets"]
    needs = [require_at_most("max_abs_diff", results["max_abs_diff"], LARGEST_DIFFERENCE)]
    if results["dynamics"] != "first-order" or results["moving"]:
        return tuple(needs)
    needs.append(
        require_at_least("ratio_end_to_end", results["ratio_end_to_end"], RATIO_END_TO_END)
    )
    needs.append(
        require_at_most(
            "bytes_per_node", results["bytes_per_node"], 24.0 * targets + 3.0 * robots + 100.0
        )
    )
    if (robots, targets) in RATIO_PER_NODE:
        needs.append(
            require_at_least(
                "ratio_per_node", results["ratio_per_node"], RATIO_PER_NODE[robots, targets]
            )
        )
        needs.append(
            require_at_least(
                "reference_nodes_per_second",
                results["reference_nodes_per_second"],
                REFERENCE_NODES_PER_SECOND[robots, targets],
            )
        )
        needs.append(
            require_at_least("ratio_uncompiled", results["ratio_uncompiled"], RATIO_UNCOMPILED)
        )
    return tuple(needs)


def _summary(results: Mapping[str, Any]) -> tuple[str, ...]:
    """Lines to print."""
    moving = ", moving targets" if results["moving"] else ""
    return (
        f"{results['robots']} robots, {results['targets']} targets, {results['dynamics']}{moving}",
        f"a node: {1e6 / results['nodes_per_second']:.2f} us against "
        f"{1e6 / results['reference_nodes_per_second']:.0f} us, ratio "
        f"{results['ratio_per_node']:.0f}; without the compiler {results['ratio_uncompiled']:.1f}",
        "the reference's time: "
        + ", ".join(f"{part} {share:.0%}" for part, share in results["reference_shares"].items()),
        f"first plan: {results['first_plan_ms']:.2f} ms against "
        f"{results['reference_first_plan_ms']:.1f} ms, set-up {results['setup_ms']:.1f} ms for "
        f"both: end to end {results['ratio_end_to_end']:.1f}",
        f"covariances differ by at most {results['max_abs_diff']:.1e}; "
        f"{results['bytes_per_node']:.0f} bytes a node",
    )
