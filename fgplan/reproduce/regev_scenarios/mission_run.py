"""One mission of section 7.2 from start to end, and of it what is judged.

Every session is planned by all contestants and what ours chooses is executed. Of a finished mission
only numbers are left; the mission that is drawn hands its figures over and is forgotten too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from fgplan.closed_loop.comparison import EVERYBODY, OURS, Contestant
from fgplan.closed_loop.loop import Record, run_loop
from fgplan.closed_loop.mission import LoopMission
from fgplan.closed_loop.records import LoopHistory, SessionRecord, SlamRecord, StepRecord
from fgplan.closed_loop.unknown_world import Scenario, draw_mission
from fgplan.io.mission_digest import mission_digest
from fgplan.io.result_file import package_versions
from fgplan.simulation.sweep import SweepTask

Variant = Literal["as_published", "own_landmarks"]
"""Whether planning uses landmarks that only other robots have mapped: it does in the paper."""

REFERENCE, FASTEST = "from_scratch", "from_scratch_fastest"
RATIOS: Mapping[str, tuple[str, str]] = {
    "ratio": (REFERENCE, "incremental"),
    "ratio_choose": (REFERENCE, "incremental_choose"),
    "ratio_fastest": (FASTEST, "incremental"),
    "ratio_choose_fastest": (FASTEST, "incremental_choose"),
}
"""By name, whose seconds are divided by whose."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionCase:
    """Which mission.

    Attributes:
        scenario: Of Table 1.
        variant: Which landmarks planning uses.
        seed: Of world, roadmap and noise; the same world for all scenarios.
        candidates: Candidate paths a robot.
        goals: Goals a robot.
    """

    scenario: Scenario
    variant: Variant
    seed: int
    candidates: int
    goals: int

    @property
    def timed(self) -> bool:
        """Whether all contestants plan every session, and all values are compared."""
        return self.variant == "as_published"

    @property
    def drawn(self) -> bool:
        """Whether its figures are those that are shown."""
        return self.seed == 0 and self.timed

    def mission(self) -> LoopMission:
        """The mission itself."""
        return draw_mission(
            self.seed,
            self.scenario,
            others_landmarks=self.variant == "as_published",
            candidates=self.candidates,
            goals=self.goals,
        )

    def with_own_landmarks(self) -> "MissionCase":
        """The same mission, planned without landmarks that only other robots have mapped."""
        return replace(self, variant="own_landmarks")

    def task(self) -> SweepTask:
        """As a task of a sweep; with other numbers or other versions it is another task."""
        return SweepTask(
            seed=self.seed,
            arguments={
                "scenario": self.scenario,
                "variant": self.variant,
                "candidates": self.candidates,
                "goals": self.goals,
                "mission": mission_digest(self.mission()),
                "versions": package_versions(),
            },
        )


def run_mission(task: SweepTask, folder: Path | None = None) -> dict[str, Any]:
    """Run one mission; in a process of its own.

    Args:
        task: Made by ``MissionCase.task``.
        folder: Where the figures of a drawn case go; None draws none.

    Returns:
        Plain data: the case, ``sessions``, totals over them, traces of position covariances by
        robot (square metres), paths of figures.
    """
    case = MissionCase(
        scenario=cast(Scenario, task.arguments["scenario"]),
        variant=cast(Variant, task.arguments["variant"]),
        seed=task.seed,
        candidates=task.arguments["candidates"],
        goals=task.arguments["goals"],
    )
    mission = case.mission()
    contestants = EVERYBODY if case.timed else OURS
    warm_up(case.scenario, contestants)
    shown = case.drawn and folder is not None
    kept: list[Record] = []
    sessions: list[dict[str, Any]] = []
    traces: dict[str, list[float]] = {robot.name: [] for robot in mission.robots}
    for record in run_loop(mission, contestants=contestants, compare=case.timed):
        if isinstance(record, StepRecord):
            for robot, covariance in record.covariances.items():
                traces[robot].append(float(np.trace(covariance[:2, :2])))
        elif isinstance(record, SessionRecord):
            sessions.append(session_result(record))
        if shown:
            kept.append(record)
    figures = _draw(mission, kept, folder / f"scenario_{case.scenario}") if shown and folder else ()
    return {
        "scenario": case.scenario,
        "variant": case.variant,
        "seed": case.seed,
        "sessions": sessions,
        **totals(sessions),
        "steps": len(next(iter(traces.values()))) - 1,
        "position_trace_start": {robot: each[0] for robot, each in traces.items()},
        "position_trace_max": {robot: max(each) for robot, each in traces.items()},
        "position_trace_end": {robot: each[-1] for robot, each in traces.items()},
        "largest_position_trace": max(max(each) for each in traces.values()),
        "largest_position_trace_by_step": [max(at) for at in zip(*traces.values(), strict=True)],
        "figures": [str(path) for path in figures],
    }


def warm_up(scenario: Scenario, contestants: Mapping[str, Contestant]) -> None:
    """Run a small mission by everybody: kernels are compiled and loaded before they are timed."""
    for _ in run_loop(draw_mission(0, scenario, candidates=2, goals=1), contestants=contestants):
        pass


def session_result(record: SessionRecord) -> dict[str, Any]:
    """What is judged of a session.

    Args:
        record: The session.

    Returns:
        Plain data; ratios, ``same_choices`` and ``max_rel_diff`` are None where it was not planned
        from scratch too.
    """
    runs = record.runs
    seconds = {name: run.seconds for name, run in runs.items()}
    compared = REFERENCE in runs
    return {
        "session": record.session,
        "step": record.step,
        "trigger": record.trigger,
        "renewed": list(record.renewed),
        "seconds": seconds,
        **ratios(seconds),
        "impacted_share": runs["incremental" if compared else "incremental_choose"].impacted_share,
        "same_choices": _same_choices(record) if compared else None,
        "max_rel_diff": record.max_rel_diff,
        "turns": runs["incremental_choose"].turns,
        "factors": {
            "multi_robot": record.counts["multi_robot_factors"],
            "landmark": record.counts["landmark_factors"],
        },
        "messages_reused": dict(record.segments_reused),
        "messages_rebuilt": dict(record.segments_rebuilt),
        "candidates_kept": dict(record.candidates_kept),
        "steps_left": {robot: path.steps for robot, path in record.chosen.items()},
        "candidates_replaced": dict(record.candidates_replaced),
    }


def totals(sessions: list[dict[str, Any]]) -> dict[str, Any]:
    """What the sessions of a mission come to.

    Args:
        sessions: Made by ``session_result``.

    Returns:
        Sums of seconds by contestant and their ratios; whether all choices are the same and the
        largest difference, None where they were not compared.
    """
    names = sessions[0]["seconds"]
    seconds = {name: sum(one["seconds"][name] for one in sessions) for name in names}
    compared = REFERENCE in names
    return {
        "seconds_total": seconds,
        **ratios(seconds, "_total"),
        "same_choices": all(one["same_choices"] for one in sessions) if compared else None,
        "max_rel_diff": max(one["max_rel_diff"] for one in sessions) if compared else None,
    }


def ratios(seconds: Mapping[str, float], of: str = "") -> dict[str, float | None]:
    """How many times faster ours is.

    Args:
        seconds: By contestant.
        of: Appended to the name of each ratio.

    Returns:
        By name; None where one of the two was not timed.
    """
    return {
        name + of: seconds[slow] / seconds[fast] if {slow, fast} <= seconds.keys() else None
        for name, (slow, fast) in RATIOS.items()
    }


def _same_choices(record: SessionRecord) -> bool:
    """Whether every contestant ended with the choice of from scratch, and that was executed."""
    wanted = dict(record.runs[REFERENCE].chosen)
    return all(dict(run.chosen) == wanted for run in record.runs.values())


def _draw(mission: LoopMission, records: list[Record], folder: Path) -> tuple[Path, ...]:
    """Figures 8 to 19 of this mission."""
    from fgplan.viz.loop_figures import draw_loop_figures

    world = mission.world
    history = LoopHistory(
        name=mission.name,
        robots=tuple(robot.name for robot in mission.robots),
        goals=mission.goals,
        landmarks=dict(zip(world.landmark_keys, world.landmark_positions, strict=True)),
        steps=tuple(r for r in records if isinstance(r, StepRecord)),
        sessions=tuple(r for r in records if isinstance(r, SessionRecord)),
        final=next((r for r in records if isinstance(r, SlamRecord)), None),
    )
    return draw_loop_figures(history, folder, mission.workspace)
