"""``fgplan reproduce khodayi-mehr-fig5`` to ``-fig9``: the curves of section IV.

Khodayi-mehr, Kantaros and Zavlanos, T-RO 2019. Figures 5 and 7 compare the two graphs of teams,
figure 6 shows what team 2 of the first graph knows, figure 8 paths to two meetings, figure 9 the
two baselines. Scene and what is not printed are those of ``khodayi-mehr-table1``, but runs are
longer, so that news of the bound's age show. For the second graph the paper prints a delay bound of
4 epochs, but its teams 1 and 3 share no robot, so the bound by its definition is 6: that one is
tested.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.bench.intermittent_methods import METHODS, IndoorCase, indoor_case, run_method
from fgplan.bench.intermittent_scene import UNPRINTED
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_most, require_true
from fgplan.planners.intermittent.delay import TeamDelay, team_delays, team_series
from fgplan.planners.intermittent.ekf import stored_bytes
from fgplan.planners.intermittent.team_run import TeamRun
from fgplan.threads import one_blas_thread
from fgplan.typing import FloatArray

PUBLISHED_GRAPHS = {"G1": (0.929, 0.177), "G2": (1.127, 0.532)}
"""Mean error in metres and mean eigenvalue in square metres."""

PUBLISHED_TEAM_2 = (1.044, 0.177)
PUBLISHED_BOUNDS = {"G1": 5, "G2": 4}
TEAM = 1
"""Team 2 of the paper."""

QUICK_STEPS = 400
"""By then team 2 has met in both graphs."""


@one_blas_thread()
def fig5(options: CommandOptions) -> CommandOutcome:
    """Error and eigenvalue for the two graphs of teams.

    Args:
        options: Number of seeds; the curves are those of the first.

    Returns:
        Means by graph, and whether the first graph is the better one.
    """
    seeds = options.seed_range(5)
    means: dict[str, list[tuple[float, float]]] = {"G1": [], "G2": []}
    curves: dict[str, tuple[FloatArray, FloatArray]] = {}
    for turn, seed in enumerate(seeds):
        for graph in means:
            options.progress(turn, len(seeds), graph)
            run = run_method(indoor_case(graph, seed, _steps(options)), "intermittent")
            means[graph].append((float(run.error_m.mean()), float(run.eigenvalue_m2.mean())))
            curves.setdefault(graph, (run.error_m, run.eigenvalue_m2))
    found = {graph: np.mean(values, axis=0) for graph, values in means.items()}
    results = _results(
        options,
        graphs={
            graph: {
                "error_m": float(found[graph][0]),
                "eigenvalue_m2": float(found[graph][1]),
                "by_seed": means[graph],
                "published_error_m": PUBLISHED_GRAPHS[graph][0],
                "published_eigenvalue_m2": PUBLISHED_GRAPHS[graph][1],
            }
            for graph in means
        },
    )
    needs = (
        require_true("error_of_g1_below_g2", found["G1"][0] < found["G2"][0]),
        require_true("eigenvalue_of_g1_below_g2", found["G1"][1] < found["G2"][1]),
    )
    lines = [
        f"{graph}: error {found[graph][0]:.3f} m ({PUBLISHED_GRAPHS[graph][0]}), eigenvalue "
        f"{found[graph][1]:.3f} m2 ({PUBLISHED_GRAPHS[graph][1]})"
        for graph in means
    ]
    figures = _series_figure(options, "fig5", curves, "Two graphs of teams")
    return _outcome(options, results, needs, seeds, lines, figures)


@one_blas_thread()
def fig6(options: CommandOptions) -> CommandOutcome:
    """What team 2 of the first graph knows at its last meeting.

    Args:
        options: Seed 0 is drawn; numbers are means over the seeds.

    Returns:
        The team's numbers beside the global ones, and the bound.
    """
    seeds = options.seed_range(5)
    local, whole = [], []
    figures: tuple[Path, ...] = ()
    kept = True
    first: dict[str, Any] = {}
    for turn, seed in enumerate(seeds):
        options.progress(turn, len(seeds), "team 2")
        case, run, team = _team_run("G1", seed, _steps(options))
        snapshot = [one for one in team.snapshots if one.team == TEAM][-1]
        means, uncertainty = team_series(team, snapshot)
        error = np.linalg.norm(means - case.truth.states[1 : snapshot.time + 1], axis=1)
        local.append((float(error.mean()), float(uncertainty.mean())))
        end = snapshot.time
        whole.append((float(run.error_m[:end].mean()), float(run.eigenvalue_m2[:end].mean())))
        last = team_delays(team, TEAM)[-1]
        bound = case.setup.schedule.delay_bound
        limit = _time_of_epoch(team, last.epoch - bound)
        kept = kept and last.agrees_until >= limit
        if seed == seeds[0]:
            marks = [_time_of_epoch(team, epoch) for epoch in range(1, last.epoch + 1)]
            first = {"bound_step": limit, "agrees_until": last.agrees_until, "step": last.time}
            figures = _series_figure(
                options,
                "fig6",
                {
                    "all measurements": (run.error_m[:end], run.eigenvalue_m2[:end]),
                    "team 2": (error, uncertainty),
                },
                "What team 2 knows at its last meeting",
                marks=marks,
                bound=limit,
            )
    ours, everything = np.mean(local, axis=0), np.mean(whole, axis=0)
    results = _results(
        options,
        team_2={"error_m": float(ours[0]), "eigenvalue_m2": float(ours[1]), "by_seed": local},
        all_measurements={
            "error_m": float(everything[0]),
            "eigenvalue_m2": float(everything[1]),
            "by_seed": whole,
        },
        published_team_2={"error_m": PUBLISHED_TEAM_2[0], "eigenvalue_m2": PUBLISHED_TEAM_2[1]},
        bound_epochs=5,
        first_seed=first,
    )
    needs = (require_true("team_agrees_with_all_up_to_the_bound", kept, "on every seed"),)
    lines = (
        f"team 2: error {ours[0]:.3f} m ({PUBLISHED_TEAM_2[0]}), eigenvalue {ours[1]:.3f} m2 "
        f"({PUBLISHED_TEAM_2[1]}); with all measurements {everything[0]:.3f} m, "
        f"{everything[1]:.3f} m2",
    )
    return _outcome(options, results, needs, seeds, lines, figures)


@one_blas_thread()
def fig7(options: CommandOptions) -> CommandOutcome:
    """Delays of team 2 for the two graphs.

    Args:
        options: Seed 0 is drawn; the bound is tested on all, for every team.

    Returns:
        Largest delays in epochs beside the bounds, and mean delay errors.
    """
    seeds = options.seed_range(5)
    graphs: dict[str, dict[str, Any]] = {}
    curves: dict[str, tuple[FloatArray, FloatArray, FloatArray]] = {}
    needs: list[Requirement] = []
    for graph in ("G1", "G2"):
        worst, errors, lags = 0, [], []
        for turn, seed in enumerate(seeds):
            options.progress(turn, len(seeds), graph)
            case, _, team = _team_run(graph, seed, _steps(options))
            bound = case.setup.schedule.delay_bound
            teams = range(len(case.setup.schedule.graph.teams))
            worst = max(
                worst, *(one.age_epochs for index in teams for one in team_delays(team, index))
            )
            own = team_delays(team, TEAM)
            errors.append(float(np.mean([one.error_m for one in own])))
            lags.append(float(np.mean([one.time - one.agrees_until for one in own])))
            curves.setdefault(graph, _delay_curve(own))
        graphs[graph] = {
            "largest_age_epochs": worst,
            "bound_epochs": bound,
            "published_bound_epochs": PUBLISHED_BOUNDS[graph],
            "mean_delay_error_m": float(np.mean(errors)),
            "mean_lag_steps": float(np.mean(lags)),
            "stored_bytes_at_end": _stored_bytes(case, team),
        }
        needs.append(require_at_most(f"largest_age_of_{graph}_epochs", worst, bound))
    lines = [
        f"{graph}: oldest news {one['largest_age_epochs']} epochs (bound {one['bound_epochs']}, "
        f"printed {one['published_bound_epochs']}), lag {one['mean_lag_steps']:.0f} steps, delay "
        f"error {one['mean_delay_error_m']:.3f} m"
        for graph, one in graphs.items()
    ]
    figures: tuple[Path, ...] = ()
    if options.out is not None:
        from fgplan.viz.figure import save
        from fgplan.viz.intermittent import draw_delays

        drawn = draw_delays(curves, "How late team 2 knows what all have measured")
        figures = (save(drawn, options.out / "fig7.png"),)
    return _outcome(options, _results(options, graphs=graphs), tuple(needs), seeds, lines, figures)


@one_blas_thread()
def fig8(options: CommandOptions) -> CommandOutcome:
    """Paths of teams 4 and 3 of the first graph to their meetings in epochs 6 and 7.

    Args:
        options: Seed 0.

    Returns:
        Times and places, and whether the paths are free and the teams meet.
    """
    case, _, team = _team_run("G1", 0, max(_steps(options), 600))
    panels, meetings = {}, []
    for index, epoch in ((3, 6), (2, 7)):
        found = [one for one in team.snapshots if (one.team, one.epoch) == (index, epoch)]
        if not found:
            continue
        members = case.setup.schedule.graph.teams[index]
        rows = [case.setup.robots.index(name) for name in members]
        begins = [_start_of_leg(team, row, found[0].time) for row in rows]
        ways = {
            name: team.positions[begin : found[0].time + 1, row]
            for name, row, begin in zip(members, rows, begins, strict=True)
        }
        targets = _places(case)[min(begins) : found[0].time + 1]
        panels[f"team {index + 1}, epoch {epoch}: steps {min(begins)} to {found[0].time}"] = (
            ways,
            targets,
        )
        ends = team.positions[found[0].time, rows]
        gap = float(np.linalg.norm(ends[0] - ends[1]))
        meetings.append(
            {"team": index + 1, "epoch": epoch, "step": found[0].time, "distance_m": gap}
        )
    figures: tuple[Path, ...] = ()
    if options.out is not None and panels:
        from fgplan.viz.figure import save
        from fgplan.viz.intermittent import draw_team_paths, draw_team_run, film_team_run

        world, names = case.setup.workspace, case.setup.robots
        drawn = draw_team_paths(world, panels, names, "Paths to two meetings")
        whole = draw_team_run(
            world, team, names, _places(case), "Steps 0 to 200", until=min(200, case.truth.steps)
        )
        figures = (
            save(drawn, options.out / "fig8.png"),
            save(whole, options.out / "paths.png"),
            film_team_run(
                world, team, names, _places(case), options.out / "team.gif",
                frames=12 if options.quick else 80,
            ),
        )  # fmt: skip
    reach = case.setup.options.range_m + 1e-9
    needs = (
        require_true("teams_meet_in_range", all(one["distance_m"] <= reach for one in meetings)),
        require_true("meetings_found", len(meetings) == 2, "of team 4 in epoch 6, 3 in epoch 7"),
    )
    lines = [
        f"team {one['team']} meets in epoch {one['epoch']}, step {one['step']}, "
        f"{one['distance_m']:.2f} m apart"
        for one in meetings
    ]
    return _outcome(options, _results(options, meetings=meetings), needs, (0,), lines, figures)


@one_blas_thread()
def fig9(options: CommandOptions) -> CommandOutcome:
    """Error and eigenvalue of the three methods over time, eight targets.

    Args:
        options: The curves are those of seed 0.

    Returns:
        Means over the run.
    """
    case = indoor_case("G1", 0, _steps(options))
    curves, found = {}, {}
    for place, method in enumerate(METHODS):
        options.progress(place, len(METHODS), method)
        run = run_method(case, method)
        curves[method.replace("_", "-")] = (run.error_m, run.eigenvalue_m2)
        found[method] = {
            "error_m": float(run.error_m.mean()),
            "eigenvalue_m2": float(run.eigenvalue_m2.mean()),
        }
    lines = [
        f"{method}: error {one['error_m']:.3f} m, eigenvalue {one['eigenvalue_m2']:.3f} m2"
        for method, one in found.items()
    ]
    figures = _series_figure(options, "fig9", curves, "Three methods, eight targets")
    return _outcome(options, _results(options, methods=found), (), (0,), lines, figures)


def _steps(options: CommandOptions) -> int:
    """Duration of a run."""
    return QUICK_STEPS if options.quick else int(UNPRINTED["figure_steps"])


def _team_run(graph: str, seed: int, steps: int) -> tuple[IndoorCase, Any, TeamRun]:
    """A case, its run, and the run of its teams."""
    case = indoor_case(graph, seed, steps)
    run = run_method(case, "intermittent")
    assert run.team is not None
    return case, run, run.team


def _stored_bytes(case: IndoorCase, team: TeamRun) -> dict[str, int]:
    """Bytes of late measurements that one robot keeps, by form of the filter (Remark III.4)."""
    records = [record for _, record in team.robots[0].knowledge.records()]
    sizes = stored_bytes(records, case.setup.model.size)
    return {str(form): count for form, count in sizes.items()}


def _delay_curve(delays: tuple[TeamDelay, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, t* and errors as arrays."""
    rows = np.array([(one.time, one.agrees_until, one.error_m) for one in delays], dtype=float)
    return rows[:, 0], rows[:, 1], rows[:, 2]


def _time_of_epoch(team: TeamRun, epoch: int) -> int:
    """Step up to which what was measured was measured by all before their epoch had passed."""
    times = []
    for state in team.robots:
        passed = [one.time for one in state.meetings if one.epoch <= epoch]
        times.append(max(passed, default=0))
    return min(times)


def _start_of_leg(team: TeamRun, row: int, time: int) -> int:
    """Step at which a robot set out for a meeting."""
    return max((one.time for one in team.robots[row].meetings if one.time < time), default=0)


def _places(case: IndoorCase) -> FloatArray:
    """True places of the targets from above, shape (steps + 1, M, 2)."""
    states = case.truth.states
    return states.reshape(len(states), -1, 3)[:, :, :2]


def _series_figure(
    options: CommandOptions,
    name: str,
    curves: Mapping[str, tuple[FloatArray, FloatArray]],
    title: str,
    *,
    marks: list[int] | None = None,
    bound: int | None = None,
) -> tuple[Path, ...]:
    """Draw error and eigenvalue where there is a folder for it."""
    if options.out is None:
        return ()
    from fgplan.viz.figure import save
    from fgplan.viz.intermittent import draw_two_series

    figure = draw_two_series(curves, title, marks=marks or (), bound=bound)
    return (save(figure, options.out / f"{name}.png"),)


def _results(options: CommandOptions, **found: Any) -> dict[str, Any]:  # noqa: ANN401
    """What every figure's result holds."""
    return {**found, "steps": _steps(options), "unprinted": UNPRINTED}


def _outcome(
    options: CommandOptions,
    results: Mapping[str, Any],
    needs: tuple[Requirement, ...],
    seeds: tuple[int, ...],
    lines: Any,  # noqa: ANN401
    figures: tuple[Path, ...],
) -> CommandOutcome:
    """An outcome; a short run is not judged."""
    return CommandOutcome(
        results=results,
        requirements=() if options.quick else needs,
        seeds=seeds,
        summary=tuple(lines),
        figures=figures,
    )
