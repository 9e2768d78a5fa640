"""Nodes a second of the sampling tree in this process: run with NUMBA_DISABLE_JIT=1.

NUMBA_DISABLE_JIT=1 python -m fgplan.bench.aia_uncompiled '{"robots": 10, "targets": 20, ...}'
"""

import json
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.planners.aia.growth import Growth
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.options import tree_options

_NODES = 1000


def nodes_per_second(arguments: Mapping[str, Any]) -> float:
    """Grow one tree and time it.

    Args:
        arguments: ``robots``, ``targets``, ``dynamics``, ``moving``.

    Returns:
        Nodes a second.
    """
    problem = kantaros_scene(
        arguments["robots"],
        arguments["targets"],
        np.random.default_rng(0),
        dynamics=arguments["dynamics"],
        moving=arguments["moving"],
    )
    options = tree_options(
        "reproduction", until="budget", iterations=10**9, node_budget=_NODES, uniform_after="never"
    )
    growth = make_growth(problem, options)
    assert type(growth) is Growth
    growth.plant()
    began = time.perf_counter()
    growth.run(10**9, np.random.default_rng(0))
    return growth.nodes / (time.perf_counter() - began)


if __name__ == "__main__":
    sys.stdout.write(f"{nodes_per_second(json.loads(sys.argv[1]))}\n")
