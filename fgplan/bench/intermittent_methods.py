"""The three methods of section IV of Khodayi-mehr et al. 2019 on the same truth.

``intermittent``: teams that plan to their next meeting. ``heuristic``: the same teams and
schedules, random meeting points, short ways and waiting. ``all_time``: one formation. Targets,
noise, samples, step and duration are the same for all: noise is drawn for every step, robot and
target before anybody moves. Every method is judged by the filter over all its measurements.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fgplan.bench.intermittent_scene import (
    FORMATION_START_M,
    FOUR_TARGETS,
    STARTS_M,
    first_estimate,
    indoor_model,
    indoor_world,
    segment_options,
    team_graph,
)
from fgplan.planners.intermittent.all_time import run_formation
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.geodesic_way import geodesic_cells
from fgplan.planners.intermittent.meeting_points import plan_meeting_point
from fgplan.planners.intermittent.robot_state import TeamSetup
from fgplan.planners.intermittent.schedule import make_schedule
from fgplan.planners.intermittent.segment import plan_segment
from fgplan.planners.intermittent.team_run import TeamRun, first_legs, run_team
from fgplan.planners.intermittent.truth import Truth, draw_truth
from fgplan.typing import FloatArray
from roadmaps import sample_positions

Method = Literal["all_time", "heuristic", "intermittent"]
METHODS: tuple[Method, ...] = ("all_time", "heuristic", "intermittent")
LOOK_AHEAD = 1000
"""Steps past the end for which plans may want the targets' controls."""


@dataclass(frozen=True, slots=True, eq=False)
class IndoorCase:
    """A scene with its truth.

    Attributes:
        setup: Of the teams, with the paper's planner.
        starts: Of each robot, shape (2,), metres.
        estimate: The first.
        truth: States and noise.
        seed: Of everything.
    """

    setup: TeamSetup
    starts: dict[str, FloatArray]
    estimate: Estimate
    truth: Truth
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class MethodRun:
    """One method on one case.

    Attributes:
        positions: Of every robot, shape (steps + 1, N, 2), metres.
        means: Global estimate, shape (steps, n).
        error_m: Its distance from the true stacked state, (13a), shape (steps,).
        eigenvalue_m2: Largest eigenvalue of its covariance, (13b), shape (steps,).
        team: The run of the teams; None for the formation.
    """

    positions: FloatArray
    means: FloatArray
    error_m: FloatArray
    eigenvalue_m2: FloatArray
    team: TeamRun | None


def indoor_case(graph: str, seed: int, steps: int) -> IndoorCase:
    """The scene of the paper.

    Args:
        graph: ``G1`` or ``G2`` (eight robots and targets), or ``four`` (four of each).
        seed: Of starts, truth, noise and plans.
        steps: Number of steps.

    Returns:
        The case.
    """
    teams = team_graph(graph)
    robots = len(teams.robots)
    targets = FOUR_TARGETS if graph == "four" else tuple(range(len(STARTS_M)))
    model = indoor_model(targets, robots, steps + LOOK_AHEAD)
    world = indoor_world()
    generator = np.random.default_rng(seed)
    places = sample_positions(world, robots, generator)
    start = STARTS_M[list(targets)].reshape(-1)
    truth = draw_truth(model.hidden, start, steps, model, robots, generator, world)
    setup = TeamSetup(
        schedule=make_schedule(teams),
        model=model,
        workspace=world,
        grid=geodesic_cells(world),
        options=segment_options(),
        seed=seed,
    )
    starts = dict(zip(teams.robots, places, strict=True))
    return IndoorCase(setup, starts, first_estimate(targets), truth, seed)


def run_method(case: IndoorCase, method: Method) -> MethodRun:
    """Run one method.

    Args:
        case: Scene and truth.
        method: Which.

    Returns:
        Positions, error and uncertainty by step.
    """
    setup = case.setup
    if method == "all_time":
        positions, filtered, _ = run_formation(
            setup.workspace,
            setup.model,
            setup.options,
            np.array(FORMATION_START_M),
            case.estimate,
            case.truth,
            np.random.default_rng(case.seed),
        )
        return _judged(case, positions, filtered.means, filtered.uncertainty, None)
    chosen = plan_segment if method == "intermittent" else plan_meeting_point
    setup = TeamSetup(
        schedule=setup.schedule,
        model=setup.model,
        workspace=setup.workspace,
        grid=setup.grid,
        options=setup.options,
        planner=chosen,
        seed=setup.seed,
    )
    legs = first_legs(setup, case.starts, case.estimate)
    run = run_team(setup, legs, case.estimate, case.truth)
    whole = run.everything
    return _judged(case, run.positions, whole.means, whole.uncertainty, run)


def _judged(
    case: IndoorCase,
    positions: FloatArray,
    means: FloatArray,
    uncertainty: FloatArray,
    team: TeamRun | None,
) -> MethodRun:
    """Error against the truth."""
    error = np.linalg.norm(means - case.truth.states[1:], axis=1)
    return MethodRun(positions, means, error, uncertainty, team)
