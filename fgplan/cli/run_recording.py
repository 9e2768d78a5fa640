"""A plan and its mission to the record that figures are drawn from.

The planners that choose among candidate paths draw these first, from the run's seed; drawing them
again gives the same ones. Who announced what, and when, is read from the plan's turns.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from fgplan.factors.multi_robot import joined_pairs
from fgplan.io.run_record import ImpactRecord, Pairs, RunRecord, record_workspace
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.planners.impacted_paths.candidates import candidate_sets
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.planners.mission import Mission
from fgplan.planners.plan import Plan
from fgplan.typing import FloatArray
from fgplan.viz.ellipse import world_position_covariances

DRAWN_IMPACTS = 2
"""Re-evaluations of which a figure is drawn."""

Candidates = Mapping[str, tuple[CandidatePath, ...]]


def record_run(mission: Mission, plan: Plan) -> RunRecord:
    """Make the record of a run.

    Args:
        mission: What was given.
        plan: What was planned.

    Returns:
        The record.
    """
    candidates = draw_candidates(mission, plan)
    targets = target_tracks(plan)
    blocks = target_covariances(plan) if targets else np.zeros(0)
    known = [item for item in plan.objective if np.isfinite(item.value)]
    return RunRecord(
        name=mission.name,
        workspace=record_workspace(mission.workspace),
        goals={robot.name: robot.goals for robot in mission.robots},
        candidates=candidates,
        chosen=plan.paths,
        covariances={
            item.robot: world_position_covariances(item.poses, item.covariances)
            for item in plan.robots
            if item.path is not None and len(item.covariances)
        },
        joined=joined_states(mission, plan.paths),
        targets=targets,
        target_covariances={name: blocks[:, number, :2, :2] for number, name in enumerate(targets)},
        landmarks=mission.prior.landmarks(),
        values=tuple(item.value for item in known),
        announced_by=tuple(item.robot or "all" for item in known),
        impacts=_impacts(mission, candidates, plan.details.get("turns", ())),
    )


def target_tracks(plan: Plan) -> dict[str, FloatArray]:
    """Where the targets of a plan that gathers information are expected.

    Args:
        plan: The plan.

    Returns:
        Shape (S, 2) by target, metres, world frame; empty of plans that have no targets, or whose
        targets are no points.
    """
    names = plan.details.get("targets", ())
    means = np.array(plan.details.get("target_means", ()), dtype=np.float64)
    if not names or means.ndim < 2 or target_covariances(plan).ndim != 4:
        return {}
    places = means.reshape(len(means), len(names), -1)[..., :2]
    return {name: places[:, number] for number, name in enumerate(names)}


def target_covariances(plan: Plan) -> FloatArray:
    """How well the targets of a plan that gathers information will be known.

    Args:
        plan: The plan.

    Returns:
        Shape (K, M, d, d), square metres, of independent targets: at start and end, or at the end
        alone; (2, n, n) of coupled ones; (0,) of plans that have no targets.
    """
    every = plan.details.get("target_covariances")
    if every is not None:
        return np.array([every[0], every[-1]], dtype=np.float64)
    last = plan.details.get("target_covariance_at_end")
    return np.zeros(0) if last is None else np.array([last], dtype=np.float64)


def draw_candidates(mission: Mission, plan: Plan) -> dict[str, tuple[CandidatePath, ...]]:
    """The candidate paths that a plan was chosen from, drawn again from its seed.

    Args:
        mission: What was given.
        plan: What was planned.

    Returns:
        Candidates by robot; of a planner that has none, the paths of the plan alone.
    """
    names = [item.name for item in dataclasses.fields(CandidateOptions)]
    if not all(name in plan.options for name in names):
        return {robot: (path,) for robot, path in plan.paths.items()}
    options = CandidateOptions(**{name: plan.options[name] for name in names})
    generator = np.random.default_rng(plan.seed)
    sets = candidate_sets(mission, options, generator, without_path="stay")
    return dict(sets.candidates)


def joined_states(mission: Mission, paths: Mapping[str, CandidatePath]) -> Pairs:
    """States that multi-robot factors join when every path is followed.

    Args:
        mission: Multi-robot models, past states and the order of the team.
        paths: Path of each robot that has one.

    Returns:
        Pairs of states, the robot earlier in the team first.
    """
    team = [robot.name for robot in mission.robots]
    states = {name: _states(mission, name, paths.get(name)) for name in team}
    pairs: list[tuple[State, State]] = []
    for model in mission.multi_robot:
        for place, name in enumerate(team):
            for other in team[place + 1 :]:
                first = [s for s in states[name] if s.step >= 1 or model.include_past]
                second = [s for s in states[other] if s.step >= 1 or model.include_past]
                pairs += [
                    (first[i], second[j])
                    for i, j in joined_pairs(model, first, second)
                    if first[i].step >= 1 or second[j].step >= 1
                ]
    return tuple(pairs)


def _states(mission: Mission, robot: str, path: CandidatePath | None) -> list[State]:
    """Past states of a robot and those of its path."""
    past = [item.state for item in mission.past_states if item.state.robot == robot]
    return past if path is None else [*past, *path.states()]


def _impacts(mission: Mission, candidates: Candidates, turns: Any) -> tuple[ImpactRecord, ...]:  # noqa: ANN401
    """The first re-evaluations that found impacted paths."""
    announced = {robot: paths[0] for robot, paths in candidates.items() if paths}
    seen: dict[str, dict[str, CandidatePath]] = {}
    records: list[ImpactRecord] = []
    for turn in turns:
        robot = turn["robot"]
        if not turn["evaluated"]:
            continue
        others = {name: path for name, path in announced.items() if name != robot}
        before = seen.get(robot)
        if before is not None and turn["impacted"] and len(records) < DRAWN_IMPACTS:
            records.append(
                _impact(mission, robot, candidates, (before, others), tuple(turn["impacted"]))
            )
        seen[robot] = others
        if turn["announced"]:
            announced[robot] = candidates[robot][turn["candidate"]]
    return tuple(records)


def _impact(
    mission: Mission,
    robot: str,
    candidates: Candidates,
    announced: tuple[Mapping[str, CandidatePath], Mapping[str, CandidatePath]],
    impacted: tuple[int, ...],
) -> ImpactRecord:
    """What changed between two sets of announced paths for all candidates of a robot."""
    before, after = (
        {
            _identity(pair): pair
            for path in candidates[robot]
            for pair in joined_states(mission, {**others, robot: path})
            if robot in (pair[0].robot, pair[1].robot)
        }
        for others in announced
    )
    return ImpactRecord(
        robot=robot,
        impacted=impacted,
        before=announced[0],
        after=announced[1],
        kept=tuple(pair for key, pair in after.items() if key in before),
        removed=tuple(pair for key, pair in before.items() if key not in after),
        added=tuple(pair for key, pair in after.items() if key not in before),
    )


def _identity(pair: tuple[State, State]) -> tuple[object, ...]:
    """What makes two pairs of states the same."""
    return tuple((s.robot, s.step, s.time_s, s.pose.tobytes()) for s in pair)
