"""``fgplan bench roadmap``: a PRM of 500 vertices among 50 polygons, with shapely and without.

World: 100 x 100 m, 50 polygons of 4 to 7 corners and 2 to 5 m radius; k = 10 nearest neighbours.
"""

import time
from importlib.util import find_spec

import numpy as np

from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_most
from fgplan.typing import FloatArray
from roadmaps import KNearest, Workspace, build_prm

SIDE_M = 100.0
POLYGONS = 50
VERTICES = 500
LIMITS_MS = {"shapely": 50.0, "numpy": 120.0}


def run(options: CommandOptions) -> CommandOutcome:
    """Run the bench.

    Args:
        options: ``seeds`` is the number of worlds.

    Returns:
        Median milliseconds by engine; shapely only where it is installed.
    """
    seeds = options.seed_range(20, quick=3)
    engines = [name for name in LIMITS_MS if name == "numpy" or find_spec(name) is not None]
    times: dict[str, list[float]] = {engine: [] for engine in engines}
    for place, seed in enumerate((seeds[0], *seeds)):  # the first once more: to warm up
        obstacles = _polygons(np.random.default_rng(seed))
        for engine in engines:
            workspace = Workspace(
                lower=np.zeros(2),
                upper=np.full(2, SIDE_M),
                obstacles=obstacles,
                polygon_engine=engine,  # type: ignore[arg-type]
            )
            began = time.perf_counter()
            build_prm(workspace, VERTICES, np.random.default_rng(seed), connection=KNearest(10))
            if place:
                times[engine].append(1e3 * (time.perf_counter() - began))
    results = {f"prm_ms_{engine}": float(np.median(times[engine])) for engine in engines}
    requirements: tuple[Requirement, ...] = tuple(
        require_at_most(f"prm_ms_{engine}", results[f"prm_ms_{engine}"], LIMITS_MS[engine])
        for engine in engines
    )
    lines = tuple(f"{name} {value:.1f} ms" for name, value in results.items())
    return CommandOutcome(results=results, requirements=requirements, seeds=seeds, summary=lines)


def _polygons(generator: np.random.Generator) -> list[FloatArray]:
    """Star-shaped polygons, corners by increasing angle, metres."""
    polygons = []
    for _ in range(POLYGONS):
        angles = np.sort(generator.uniform(0.0, 2.0 * np.pi, generator.integers(4, 8)))
        radius = generator.uniform(2.0, 5.0)
        around = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        polygons.append(generator.uniform(0.0, SIDE_M, 2) + around)
    return polygons
