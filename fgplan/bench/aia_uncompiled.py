"""Nodes a second of the sampling tree in this process: run with NUMBA_DISABLE_JIT=1.

NUMBA_DISABLE_JIT=1 python -m fgplan.bench.aia_uncompiled '{"robots": 10, ...}'
"""

import json
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.options import tree_options

_REPEATS = 3


def nodes_per_second(arguments: Mapping[str, Any]) -> float:
    """Grow trees from nothing and time them; as ``fgplan bench aia`` does the compiled ones.

    Args:
        arguments: ``robots``, ``targets``, ``dynamics``, ``moving``, ``seed`` of the scene,
            ``nodes`` of a tree.

    Returns:
        Nodes a second of the fastest.
    """
    problem = kantaros_scene(
        arguments["robots"],
        arguments["targets"],
        np.random.default_rng(arguments["seed"]),
        dynamics=arguments["dynamics"],
        moving=arguments["moving"],
    )
    options = tree_options(
        "reproduction",
        until="budget",
        iterations=10**9,
        node_budget=arguments["nodes"],
        uniform_after="never",
    )
    seconds = []
    for repeat in range(_REPEATS):
        growth = make_growth(problem, options)
        growth.plant()
        began = time.perf_counter()
        growth.run(10**9, np.random.default_rng(repeat))
        seconds.append((time.perf_counter() - began) / growth.nodes)
    return 1.0 / min(seconds)


if __name__ == "__main__":
    sys.stdout.write(f"{nodes_per_second(json.loads(sys.argv[1]))}\n")
