"""``fgplan bench distributed-aia``: an iteration's time grows with degree, not with robots.

In block form, compiled: every robot expands one node an iteration, on random connected graphs of
one average degree for teams of different sizes, and of different degrees for one team. All teams of
a seed are held at once and grow in turn. Times are processor time of long runs over their number of
iterations, sweeps times robots; the exponent is the slope of log time over log robots.

Messages are measured as they are sent: the new nodes of a sweep, as msgpack, without envelope.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fgplan.bench.distributed_aia_scene import tzes_scene
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_most, require_true
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.node_message import NodeMessage
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.threads import one_blas_thread

TARGETS = 20
DEGREE = 5.6
"""Average degree of the first row of Table I of Tzes et al. 2021."""
LARGEST_EXPONENT = 0.3
_ENDLESS = {"until": "budget", "iterations": 10**9, "uniform_after": "never", "expand": "node"}


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSize:
    """How much is measured.

    Attributes:
        robots: Sizes of the teams at one degree.
        degrees: Average degrees for one team; infinite for all-to-all.
        team: Size of that team.
        parts: Parts of each run that are timed.
        sweeps: Sweeps of a part.
        told: Sweeps whose messages are measured.
    """

    robots: tuple[int, ...] = (10, 20, 40, 70, 100)
    degrees: tuple[float, ...] = (2.0, DEGREE, 9.0, np.inf)
    team: int = 30
    parts: int = 6
    sweeps: int = 200
    told: int = 50


QUICK = BenchSize(robots=(10, 20, 40), parts=4, sweeps=60, told=10)


@one_blas_thread()
def run(options: CommandOptions) -> CommandOutcome:
    """Run the bench.

    Args:
        options: ``quick`` measures smaller teams for a shorter time.

    Returns:
        The results and what is required of them.
    """
    size = QUICK if options.quick else BenchSize()
    seeds = options.seed_range(5, quick=1)
    teams = [(robots, DEGREE) for robots in size.robots]
    teams += [(size.team, degree) for degree in size.degrees]
    seconds: list[list[float]] = [[] for _ in teams]
    bytes_sent: list[list[float]] = [[] for _ in teams]
    degrees: list[list[float]] = [[] for _ in teams]
    for seed in seeds:
        options.progress(seed - seeds[0], len(seeds), f"seed {seed}")
        growths = [make_growth(robots, degree, seed) for robots, degree in teams]
        for place, growth in enumerate(growths):
            degrees[place].append(growth.graph.average_degree())
            bytes_sent[place].append(bytes_a_sweep(growth, size.told))
        for _ in range(size.parts):
            for place, growth in enumerate(growths):
                began = time.process_time()
                growth.run(size.sweeps)
                iterations = size.sweeps * len(growth.robots)
                seconds[place].append((time.process_time() - began) / iterations)
    microseconds = [1e6 * float(np.median(found)) for found in seconds]
    measured = [float(np.mean(found)) for found in degrees]
    told = [float(np.mean(found)) for found in bytes_sent]
    count = len(size.robots)
    by_degree = microseconds[count:]
    results = {
        "robots": list(size.robots),
        "degree": measured[:count],
        "iteration_us": microseconds[:count],
        "message_bytes": told[:count],
        "robot_bytes": [n * d for n, d in zip(told, measured, strict=True)][:count],
        "exponent": exponent(size.robots, microseconds[:count]),
        "of_degree": {
            "robots": size.team,
            "degree": measured[count:],
            "iteration_us": by_degree,
            "exponent": exponent(np.array(measured[count:]) + 1.0, by_degree),
            "message_bytes": told[count:],
            "robot_bytes": [n * d for n, d in zip(told, measured, strict=True)][count:],
        },
        "targets": TARGETS,
        "notes": [
            "iteration_us: processor time of one iteration of one robot, which expands one node; "
            "median over parts and seeds, all teams of a seed grown in turn",
            "message_bytes: a sweep and neighbour, mean; robot_bytes: what one robot sends a sweep",
            "of_degree.exponent: slope over covariances fused, degree + 1",
        ],
    }
    return CommandOutcome(
        results=results,
        requirements=_requirements(results),
        seeds=seeds,
        summary=_summary(results),
    )


def make_growth(robots: int, degree: float, seed: int) -> ForestGrowth:
    """The trees of a team, planted.

    Args:
        robots: N.
        degree: Average degree of a random connected graph; infinite for all-to-all.
        seed: Of scene, graph and draws.

    Returns:
        Trees that stop for no plan.
    """
    problem = tzes_scene(robots, TARGETS, np.random.default_rng(seed))
    names = [robot.name for robot in problem.robots]
    graph = CommunicationGraph.complete(names)
    if np.isfinite(degree):
        generator = np.random.default_rng(seed)
        graph = CommunicationGraph.random_connected(names, degree, generator)
    options = distributed_options("reproduction", **_ENDLESS)
    return ForestGrowth(problem, options, graph, np.random.default_rng(seed).spawn(robots))


def bytes_a_sweep(growth: ForestGrowth, sweeps: int) -> float:
    """Size of the message that a robot sends to one neighbour after a sweep.

    Args:
        growth: Trees; they grow.
        sweeps: How many are measured.

    Returns:
        Mean over robots and sweeps.
    """
    rows = range(len(growth.robots))
    total = 0
    for _ in range(sweeps):
        before = [growth.nodes(row) for row in rows]
        growth.run(1)
        total += sum(NodeMessage.of(growth.made(row, before[row])).byte_size for row in rows)
    return total / (sweeps * len(rows))


def exponent(sizes: Any, values: Any) -> float:  # noqa: ANN401 - sequences of numbers
    """Slope of log values over log sizes.

    Args:
        sizes: Shape (n,), positive.
        values: Shape (n,), positive.

    Returns:
        Least squares.
    """
    return float(np.polyfit(np.log(np.asarray(sizes, dtype=float)), np.log(values), 1)[0])


def _requirements(results: Mapping[str, Any]) -> tuple[Requirement, ...]:
    """Hardly any growth with robots, some with degree."""
    times = results["of_degree"]["iteration_us"]
    return (
        require_at_most("exponent", results["exponent"], LARGEST_EXPONENT),
        require_true(
            "of_degree.iteration_us",
            times[-1] > times[0],
            "all-to-all slower than the least degree",
        ),
    )


def _summary(results: Mapping[str, Any]) -> tuple[str, ...]:
    """Lines to print."""
    columns = ("robots", "degree", "iteration_us", "message_bytes")
    lines = [
        f"{robots} robots, degree {degree:.1f}: {us:.2f} us an iteration, {told:.0f} bytes a sweep "
        "and neighbour"
        for robots, degree, us, told in zip(*(results[name] for name in columns), strict=True)
    ]
    by = results["of_degree"]
    lines.append(f"exponent over robots {results['exponent']:.2f}")
    lines += [
        f"{by['robots']} robots, degree {degree:.1f}: {us:.2f} us an iteration"
        for degree, us in zip(by["degree"], by["iteration_us"], strict=True)
    ]
    return tuple(lines)
