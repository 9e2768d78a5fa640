"""Your own objective terms: a number of a path, and a number of a covariance.

A `PathTerm` maps a path to a number: here the seconds spent within 10 m of a loading dock. An
`UncertaintyFunction` maps covariances of shape (..., n, n) to numbers of shape (...): here the
standard deviation along the worst axis, in metres.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import fgplan

SCENARIO = Path(__file__).parent / "scenarios" / "two_robots.toml"
DOCK = np.array([30.0, 10.0])


def seconds_near_the_dock(path: fgplan.CandidatePath) -> float:
    """Time between poses, counted where the later pose is within 10 m of the dock."""
    near = np.linalg.norm(path.poses[1:, :2] - DOCK, axis=1) < 10.0
    return float(np.diff(path.times_s)[near].sum())


# Monotone: a larger covariance never gives a smaller number. With that promise (and no negative
# weight) lower bounds may exclude candidates unevaluated; a promise not kept excludes wrong ones.
fgplan.register_uncertainty(
    fgplan.UncertaintyFunction(
        name="worst_axis_sigma",
        evaluate=lambda covariance, prior: np.sqrt(np.linalg.eigvalsh(covariance)[..., -1]),
        monotone=True,
        positive=True,
    )
)


def objective(robots: tuple[str, ...], dock_weight: float) -> fgplan.Objective:
    """Length, worst axis at the end and time near the dock, of every robot."""
    terms: list = []
    for robot in robots:
        terms += [
            fgplan.PathLengthTerm(robot=robot, weight=0.1),
            fgplan.UncertaintyTerm(
                of=fgplan.PosesOf((robot,)), function="worst_axis_sigma", weight=5.0
            ),
            fgplan.PathTerm(
                robot=robot, name="dock", function=seconds_near_the_dock, weight=dock_weight
            ),
        ]
    return fgplan.Objective(tuple(terms))


mission = fgplan.load_mission(SCENARIO)
sets = fgplan.candidate_sets(mission, fgplan.CandidateOptions(candidates=40))
for dock_weight in (0.0, 0.5):
    problem = replace(sets.problem, objective=objective(sets.problem.robots, dock_weight))
    agreement = fgplan.coordinate(problem, sets.candidates)
    print(f"one second near the dock costs {dock_weight}: objective {agreement.value:.3f}")
    for robot, path in agreement.paths.items():
        print(
            f"  {robot}: candidate {agreement.chosen[robot]}, {path.length_m:.1f} m, "
            f"{seconds_near_the_dock(path):.0f} s near the dock"
        )
    reports = [record.decision.report for record in agreement.records if record.decision]
    skipped = sum(len(report.skipped) for report in reports)
    print(f"  {skipped} of {40 * len(reports)} evaluations were excluded by lower bounds")
