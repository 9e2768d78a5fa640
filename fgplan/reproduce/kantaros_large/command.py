"""``fgplan reproduce kantaros-large``: seven robots and twenty targets in 500 m x 1000 m.

Section VI-B of Kantaros et al. 2019: differential drive with u in {0, 2} m/s, sensing range 20 m,
twenty targets that move; the published plan took 12.23 minutes and has F = 3769. The map (blocks of
houses), starts, targets and prior are ours, as is the distance of 5 m below which controls are
drawn uniformly; delta is that of Table I scaled by the fourth power of the range (a determinant of
square metres): 1.8e-6 x 10^4.
"""

import time
from typing import Any

import numpy as np

from fgplan.bench.aia_scene import DELTA, draw_targets
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import require_true
from fgplan.models.hidden_state import independent_targets
from fgplan.models.motion_primitives import differential_drive
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.problem import AcquisitionProblem, SensingRobot, TerminalConstraint
from fgplan.planners.aia.search import search
from fgplan.viz.figure import save
from fgplan.viz.information_gathering import draw_team_path
from roadmaps import Workspace

PUBLISHED_SECONDS = 12.23 * 60.0
PUBLISHED_HORIZON = 3769
ROBOTS, TARGETS = 7, 20
SCALE = 10.0
_NEAR_M = 5.0
_CELL_M = 2.0
_DRIFT_M = 0.001


def residential_world() -> Workspace:
    """Streets between blocks of houses, 500 m x 1000 m."""
    blocks = [
        [(x, y), (x + 60.0, y), (x + 60.0, y + 110.0), (x, y + 110.0)]
        for x in (40.0, 160.0, 280.0, 400.0)
        for y in (40.0, 240.0, 440.0, 640.0, 840.0)
    ]
    return Workspace(lower=np.zeros(2), upper=np.array([500.0, 1000.0]), obstacles=blocks)


def large_scene(generator: np.random.Generator) -> AcquisitionProblem:
    """The scene.

    Args:
        generator: Draws targets.

    Returns:
        The problem.
    """
    world = residential_world()
    means = draw_targets(world, TARGETS, generator, clearance_m=15.0)
    heading = generator.uniform(-np.pi, np.pi, TARGETS)
    drifts = _DRIFT_M * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    primitives = differential_drive((0.0, 2.0), spacing_m=0.5)
    sensor = ProportionalRangeSensor(max_range_m=20.0, floor_m=0.1)
    return AcquisitionProblem(
        workspace=world,
        robots=tuple(
            SensingRobot(
                name=f"r{j}",
                pose=np.array([6.0 + 4.0 * j, 8.0, 0.0]),
                primitives=primitives,
                sensors=(sensor,),
            )
            for j in range(ROBOTS)
        ),
        hidden=independent_targets([f"t{i}" for i in range(TARGETS)], drifts, 1e-6 * np.eye(2)),
        mean=means.ravel(),
        priors=(0.2 * SCALE**2 * np.eye(2),) * TARGETS,
        terminal=TerminalConstraint(limit=DELTA * SCALE**4),
    )


def run(options: CommandOptions) -> CommandOutcome:
    """Plan the large scene.

    Args:
        options: ``out`` takes the picture (figure 4).

    Returns:
        Time and horizon beside the published ones.
    """
    seeds = options.seed_range(1)
    rows: list[dict[str, Any]] = []
    figures = []
    for seed in seeds:
        options.progress(seed - seeds[0], len(seeds), "planning")
        problem = large_scene(np.random.default_rng(seed))
        changes = {"near_m": _NEAR_M, "geodesic_cell_m": _CELL_M}
        began = time.perf_counter()
        found = search(
            problem, tree_options("reproduction", **changes), np.random.default_rng(seed)
        )
        seconds = time.perf_counter() - began
        plan = found.plan
        rows.append(
            {
                "seed": seed,
                "feasible": plan is not None,
                "horizon": None if plan is None else plan.horizon,
                "cost": None if plan is None else plan.cost,
                "seconds": seconds,
                "nodes": found.nodes,
                "shortfall": found.shortfall,
            }
        )
        if plan is not None and options.out is not None:
            title = f"{ROBOTS} robots, {TARGETS} targets, 500 m x 1000 m"
            figures.append(
                save(draw_team_path(problem, plan, title), options.out / f"paths-{seed}.png")
            )
    return CommandOutcome(
        results={
            "rows": rows,
            "published_seconds": PUBLISHED_SECONDS,
            "published_horizon": PUBLISHED_HORIZON,
        },
        requirements=(require_true("feasible", all(row["feasible"] for row in rows)),),
        seeds=seeds,
        summary=tuple(
            f"seed {row['seed']}: F {row['horizon']} (published {PUBLISHED_HORIZON}) in "
            f"{row['seconds']:.1f} s (published {PUBLISHED_SECONDS:.0f} s), {row['nodes']} nodes"
            for row in rows
        ),
        figures=tuple(figures),
    )
