"""``fgplan reproduce tzes-fig4``: denser and sparser communication, section VI-B and figure 4.

Tzes et al. 2021: "the less dense a graph is the more the planning horizon increases"; without
communication F is the maximum over the robots. The horizons themselves are lost in the text at
hand, as is the size of the scene (``scene`` says what is ours), so the order is what is asked for.
Each plan ends where the terminal constraint holds at one robot; beside it stands the horizon of
the rule of section VI-B, by which a robot counts what its neighbours know.

Now and then trees run dry: nodes that were fused get no children, so that what neighbours know lags
for good while its weight goes on to dilute what a robot measures itself. A search that has no plan
after 3000 sweeps begins again with other random numbers, three times at most; ``attempts`` counts.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_true
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.planners.distributed_aia.search import search_distributed
from fgplan.planners.distributed_aia.stopping_rule import rule_steps
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.reproduce.tzes_fig4.behaviour import count_oscillations, count_revisits
from fgplan.reproduce.tzes_fig4.scene import (
    MOVING,
    ROBOTS,
    TARGETS,
    figure_graphs,
    figure_scene,
)
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.viz.distributed_gathering import (
    done_robot,
    draw_distributed_plan,
    draw_target_uncertainties,
    film_distributed_plan,
)
from fgplan.viz.figure import save

LABELS = {
    "full": "Fully connected",
    "degree 3": "Connected, average degree 3",
    "none": "No communication",
}
SCENE = (
    f"{ROBOTS} robots and {TARGETS} targets, {MOVING} of which move, on our map: the paper's "
    "numbers are lost in the text at hand; only the order of the horizons is compared"
)
_ITERATIONS = 3_000
_ATTEMPTS = 3
_COUNTED = ("horizon", "rule_horizon", "cost", "sweeps", "revisits", "oscillations")


def run(options: CommandOptions) -> CommandOutcome:
    """Plan the scene with every graph.

    Args:
        options: ``out`` takes figure 4(a)-(d) of seed 0 and a film.

    Returns:
        ``results.cases``: medians over the seeds by graph; ``results.runs``: each seed.
    """
    seeds = options.seed_range(10)
    runs: list[dict[str, Any]] = []
    figures: list[Path] = []
    for seed in seeds:
        problem = figure_scene(np.random.default_rng(seed))
        graphs = figure_graphs(problem, np.random.default_rng(seed))
        for name, graph in graphs.items():
            options.progress(len(runs), len(seeds) * len(graphs), f"seed {seed}: {name}")
            plan, work = plan_scene(problem, graph, seed)
            runs.append({"graph": name, "seed": seed} | work | numbers_of(problem, graph, plan))
            if plan is not None and options.out is not None and seed == seeds[0]:
                figures += _drawn(problem, graph, plan, name, options.out, options.quick)
        options.record({"runs": runs})
    cases = [case_of(name, runs) for name in LABELS]
    return CommandOutcome(
        results={"cases": cases, "runs": runs, "scene": SCENE, "preset": "reproduction"},
        requirements=requirements(cases),
        seeds=seeds,
        summary=(*summary(cases), SCENE),
        figures=tuple(figures),
    )


def plan_scene(
    problem: AcquisitionProblem, graph: CommunicationGraph, seed: int
) -> tuple[TeamPlan | None, dict[str, int]]:
    """Plan, again with other random numbers where a search has run dry.

    Args:
        problem: The scene.
        graph: Who hears whom.
        seed: Of the planner.

    Returns:
        The plan, and ``sweeps`` and ``attempts`` that it took.
    """
    options = distributed_options("reproduction", iterations=_ITERATIONS)
    sweeps = attempts = 0
    for generator in np.random.default_rng(seed).spawn(_ATTEMPTS):
        found = search_distributed(problem, options, graph, generator)
        sweeps, attempts = sweeps + found.sweeps, attempts + 1
        if found.plan is not None:
            break
    return found.plan, {"sweeps": sweeps, "attempts": attempts}


def numbers_of(
    problem: AcquisitionProblem, graph: CommunicationGraph, plan: TeamPlan | None
) -> dict[str, Any]:
    """What is reported of a plan.

    Args:
        problem: The scene.
        graph: Who hears whom.
        plan: The plan; None where there is none.

    Returns:
        Horizon (of robots on their own the greatest), that of the rule, cost, revisits and
        oscillations of the whole team; None for each where there is no plan.
    """
    names = ("horizon", "rule_horizon", "cost", "revisits", "oscillations")
    if plan is None:
        return dict.fromkeys(names)
    values = (
        plan.horizon,
        int(rule_steps(problem, graph, plan).max()),
        plan.cost,
        int(count_revisits(problem, plan).sum()),
        int(count_oscillations(plan).sum()),
    )
    return dict(zip(names, values, strict=True))


def case_of(graph: str, runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Medians over the seeds that were solved.

    Args:
        graph: Name of the graph.
        runs: As ``run`` collects them.

    Returns:
        Medians, number of seeds and of those solved, the mean horizon (nan for no seed) and most
        attempts.
    """
    own = [one for one in runs if one["graph"] == graph]
    solved = [one for one in own if one["horizon"] is not None]
    case: dict[str, Any] = {"graph": graph, "seeds": len(own), "solved": len(solved)}
    for name in _COUNTED:
        case[name] = float(np.median([one[name] for one in solved])) if solved else float("nan")
    mean = np.mean([one["horizon"] for one in solved]) if solved else float("nan")
    most = max((one["attempts"] for one in own), default=0)
    return case | {"horizon_mean": float(mean), "attempts_most": most}


def requirements(cases: Sequence[Mapping[str, Any]]) -> tuple[Requirement, ...]:
    """That every seed is solved and horizons rise as the graph gets sparser.

    Args:
        cases: As ``case_of`` gives them.

    Returns:
        The requirements.
    """
    mean = {case["graph"]: case["horizon_mean"] for case in cases}
    return (
        require_true("solved", all(case["solved"] == case["seeds"] for case in cases)),
        require_true("horizon_none_above_degree_3", mean["none"] > mean["degree 3"], "in the mean"),
        require_true(
            "horizon_degree_3_at_least_full", mean["degree 3"] >= mean["full"], "in the mean"
        ),
    )


def summary(cases: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Lines to print.

    Args:
        cases: As ``case_of`` gives them.

    Returns:
        A line a graph.
    """
    lines = [
        "graph      solved   F (mean)        F by the rule   cost     sweeps  revisits  oscill."
    ]
    lines += [
        f"{case['graph']:<10} {case['solved']}/{case['seeds']:<6} {case['horizon']:5.1f} "
        f"({case['horizon_mean']:5.1f})   {case['rule_horizon']:5.1f}           "
        f"{case['cost']:7.2f} {case['sweeps']:7.1f}   {case['revisits']:5.1f}    "
        f"{case['oscillations']:5.1f}"
        for case in cases
    ]
    return tuple(lines)


def _drawn(
    problem: AcquisitionProblem,
    graph: CommunicationGraph,
    plan: TeamPlan,
    name: str,
    out: Path,
    quick: bool,
) -> list[Path]:
    """Figure 4 of one graph: paths and uncertainties; a film of the sparser one."""
    label, suffix = LABELS[name], name.replace(" ", "-")
    figures = [
        save(draw_distributed_plan(problem, plan, graph, label), out / f"{suffix}.png"),
        save(
            draw_target_uncertainties(problem, plan, done_robot(plan), label),
            out / f"uncertainty-{suffix}.png",
        ),
    ]
    if name == "degree 3" and not quick:
        figures.append(film_distributed_plan(problem, plan, graph, out / "film.gif"))
    return figures
