"""``fgplan run SCENARIO or LOG``: read, plan, write the run folder, say what each robot chose.

A scenario with ``[simulation]`` is executed too: see fgplan/cli/loop_command.py.

A log (a .g2o or .pyfg file, a folder of one robot's file each) gets a scenario derived from it,
which goes into the run folder: see fgplan/io/past_scenario.py for its rules.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.cli.loop_command import run_loop_scenario
from fgplan.cli.open_run import OpenRun, begin_folder, open_run, planning
from fgplan.cli.run_figures import draw_run_figures
from fgplan.cli.run_past import past_lines
from fgplan.cli.run_recording import record_run, target_covariances
from fgplan.errors import (
    MissingExtraError,
)
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.loop_mission import PLANNER
from fgplan.io.past_estimate import PastEstimate
from fgplan.io.past_files import plan_start_s, write_past_files
from fgplan.io.plan_file import PLANS, write_plans
from fgplan.io.result_file import Requirement, require_true
from fgplan.io.run_folder import write_record
from fgplan.planners.mission import Mission
from fgplan.planners.plan import Plan, RobotPlan
from fgplan.planners.registry import check_plan
from fgplan.viz.ellipse import world_position_covariances


def run_scenario(options: CommandOptions) -> CommandOutcome:
    """Plan a scenario.

    Args:
        options: ``arguments["scenario"]`` is the scenario file or log; ``seeds`` plans it with as
            many seeds, from ``first_seed`` or the scenario's on; figures show the first.

    Returns:
        Plans by seed under ``plans``.

    Raises:
        ScenarioError: If the scenario or log is wrong.
        NoCandidatePathError: If a robot has no path.
    """
    run = open_run(Path(options.arguments["scenario"]), quick=options.quick)
    scenario, mission = run.scenario, run.mission
    if scenario.simulation is not None and scenario.planner_name == PLANNER:
        return run_loop_scenario(options, scenario, scenario.simulation, mission, run.path)
    options.record({})
    if options.out is not None:
        begin_folder(run, options.out)
    first = scenario.seed if options.first_seed is None else options.first_seed
    seeds = tuple(range(first, first + (options.seeds or 1)))
    plans: list[Plan] = []
    for seed in seeds:
        seeded = dataclasses.replace(mission, seed=seed)
        with planning(run):
            plan = run.planner.plan(seeded, np.random.default_rng(seed), options.progress)
            plans.append(check_plan(plan, scenario.planner_name))
        options.record({"plans": [plan.to_data() for plan in plans]})
    return outcome_of(run, plans, options.out)


def outcome_of(
    run: OpenRun,
    plans: list[Plan],
    folder: Path | None,
    *,
    results: Mapping[str, Any] | None = None,
    lines: Sequence[str] = (),
) -> CommandOutcome:
    """Draw and write what was planned, and say it.

    Args:
        run: What was planned.
        plans: By seed; figures show the first.
        folder: The run folder; None writes nothing.
        results: More results.
        lines: More lines to print.

    Returns:
        The outcome.
    """
    mission, estimate = run.mission, run.prior.estimate
    figures, note = _draw(mission, plans[0], folder)
    if folder is not None:
        start_s = 0.0 if estimate is None else plan_start_s(estimate)
        figures += (write_plans(folder / PLANS, plans[0], start_s),)
        if estimate is not None:
            written, left_out = write_past_files(folder, estimate)
            figures, note = figures + written, (*note, *left_out)
    return CommandOutcome(
        results={
            "plans": [plan.to_data() for plan in plans],
            **(results or {}),
            **_estimate_results(estimate),
        },
        requirements=(*_requirements(plans), *_estimate_requirements(estimate)),
        seeds=tuple(plan.seed for plan in plans),
        summary=(
            *past_lines(estimate, run.log),
            *summary_lines(plans[0]),
            *lines,
            *_over_seeds(plans),
            *_not_simulated(mission),
            *note,
        ),
        figures=figures,
    )


def summary_lines(plan: Plan) -> list[str]:
    """What was planned, a line a robot.

    Args:
        plan: The plan.

    Returns:
        Lines to print.
    """
    lines = [f"{plan.mission}: planner {plan.planner}, seed {plan.seed}"]
    lost = plan.details.get("lost", ())
    lines += [_robot_line(item, lost=item.robot in lost) for item in plan.robots]
    lines += _target_lines(plan)
    if plan.objective:
        first, last = plan.objective[0].value, plan.objective[-1].value
        count = len(plan.objective) - 1
        fall = f"{first:.6g} -> {last:.6g} in {count} announcement{'s' if count > 1 else ''}"
        lines.append(f"objective {fall if count else f'{last:.6g}'}")
    if plan.seconds:
        lines.append(
            "seconds: " + ", ".join(f"{name} {value:.3f}" for name, value in plan.seconds.items())
        )
    if not plan.agreed:
        lines.append("the team did not come to an agreement")
    return lines + [f"warning: {warning}" for warning in plan.warnings]


def _robot_line(item: RobotPlan, *, lost: bool) -> str:
    """What one robot is to do and what it will know of where it is."""
    if item.path is None:
        return f"  {item.robot}: {'was lost before it had a path' if lost else 'stays'}"
    line = f"  {item.robot}: "
    if item.candidate >= 0:
        line += f"candidate {item.candidate} of {item.candidates}, "
    line += f"{item.path.length_m:.1f} m in {item.path.times_s[-1]:.1f} s"
    if len(item.covariances):
        spread = world_position_covariances(item.poses, item.covariances)
        sigma = np.sqrt(np.trace(spread[-1]))
        line += f", position on arrival to {sigma:.3g} m (1 sigma)"
    return line


def _target_lines(plan: Plan) -> list[str]:
    """What a plan that gathers information will know of the targets at its end."""
    details, known = plan.details, target_covariances(plan)
    if not len(known):
        return []
    steps = max([item.path.steps for item in plan.robots if item.path is not None], default=0)
    by = f" at {details['seen_by']}" if "seen_by" in details else ""
    lines = [f"  after {steps} steps{by}:"]
    if known.ndim == 4:  # independent targets
        sigmas = np.sqrt(np.linalg.eigvalsh(known[-1])[:, -1])
        said = (
            f"{n} to {sigma:.3g} m" for n, sigma in zip(details["targets"], sigmas, strict=True)
        )
        lines.append(f"    {', '.join(said)} (1 sigma, worst direction)")
    return lines


def _over_seeds(plans: list[Plan]) -> list[str]:
    """The objective over all seeds, where there are several."""
    values = [plan.value for plan in plans]
    if len(values) == 1 or not np.isfinite(values).all():
        return []
    return [f"{len(values)} seeds: objective {min(values):.6g} to {max(values):.6g}"]


def _requirements(plans: list[Plan]) -> tuple[Requirement, ...]:
    """What every run must satisfy."""
    rises = 0
    for plan in plans:
        values = np.array([item.value for item in plan.objective])
        rises += int((np.diff(values) > 0.0).sum())
    return (
        require_true("agreed", all(plan.agreed for plan in plans)),
        require_true("objective_never_rises", rises == 0),
    )


def _estimate_requirements(estimate: PastEstimate | None) -> tuple[Requirement, ...]:
    """What the estimate of a log must satisfy."""
    if estimate is None or not estimate.optimised:
        return ()
    return (require_true("estimate_converged", estimate.converged),)


def _estimate_results(estimate: PastEstimate | None) -> dict[str, Any]:
    """Numbers of the estimate of a log."""
    if estimate is None:
        return {}
    past = estimate.past
    return {
        "past": {
            "format": past.format,
            "poses": {robot: len(keys) for robot, keys in past.robots.items()},
            "factors": past.graph.size(),
            "error_before": estimate.error_before,
            "error_after": estimate.error_after,
            "iterations": estimate.iterations,
            "seconds": estimate.seconds,
            "notes": [*past.notes, *estimate.notes],
        }
    }


def _not_simulated(mission: Mission) -> list[str]:
    """That a plan is not executed, where the scenario asks for a simulation."""
    if mission.simulation is None:
        return []
    return [f"note: [simulation] was checked but not run: closed loops plan by {PLANNER}"]


def _draw(
    mission: Mission, plan: Plan, folder: Path | None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Record and figures; without matplotlib the record alone, and a note."""
    if folder is None:
        return (), ()
    write_record(folder, record_run(mission, plan))
    try:
        return draw_run_figures(folder), ()
    except MissingExtraError as error:
        return (), (f"no figures: {error}",)
