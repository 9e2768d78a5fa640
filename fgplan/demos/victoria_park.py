"""``fgplan demo victoria-park``: a team plans over the real Victoria Park log.

The log is cut into the pasts of four robots (victoria_log), which plan to places across the park
(victoria_team) by announcements until nobody changes. Then: what each will know on arrival with and
without the factors between robots (arrival), how much was re-evaluated in each round, and how long
the evaluators take on what the robots evaluated (evaluator_times).
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fgplan.demos.announced_views import (
    announced_views,
    announcers,
    drawn_reevaluation,
    impact_record,
    joined_states,
)
from fgplan.demos.arrival import Arrival, know_on_arrival
from fgplan.demos.evaluator_times import EvaluatorTimes, TimedEvaluator, time_evaluators
from fgplan.demos.victoria_figures import draw_figures
from fgplan.demos.victoria_log import TeamPast, read_log, team_past
from fgplan.demos.victoria_results import (
    ALL_CANDIDATES,
    Session,
    log_lines,
    results_of,
    session_lines,
    team_lines,
    time_lines,
    values_agree,
)
from fgplan.demos.victoria_team import TeamOptions, VictoriaTeam, prepare_team
from fgplan.errors import MissingExtraError
from fgplan.evaluation.as_published import AsPublished
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.isam2 import Isam2
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_most, require_true
from fgplan.io.run_folder import write_record
from fgplan.io.run_record import ImpactRecord, Pairs, RunRecord, record_workspace
from fgplan.team.coordination import coordinate
from fgplan.viz.ellipse import world_position_covariances

ROBOTS = ("r1", "r2", "r3", "r4")
QUICK_POSES, QUICK_CANDIDATES = 1500, 6
TIMED_CANDIDATES, QUICK_TIMED = 5, 2
WARM_POSES = 700
MOST_SECONDS = 60.0
TIMED = (
    TimedEvaluator(label="incremental", evaluator=Incremental()),
    TimedEvaluator(label=ALL_CANDIDATES, evaluator=Incremental(), every_candidate=True),
    TimedEvaluator(label="from_scratch", evaluator=FromScratch()),
    TimedEvaluator(label="isam2", evaluator=Isam2()),
    TimedEvaluator(label="as_published", evaluator=AsPublished()),
)


def victoria_park(options: CommandOptions) -> CommandOutcome:
    """Plan over the Victoria Park log.

    Args:
        options: ``quick`` takes the log's first 1500 poses and 6 candidates a robot; ``seeds``
            plans on as many roadmaps, the first of which is timed and drawn.

    Returns:
        Choices, knowledge on arrival, counts of the work and times of the evaluators.

    Raises:
        IllPosedBeliefError: If the trees do not tie the robots together.
        NoCandidatePathError: If a goal cannot be reached.
    """
    stages = _Stages(options)
    log = read_log(QUICK_POSES if options.quick else None)
    stages.end("read")
    _warm_up()
    stages.end("compile or load kernels")
    past = team_past(log, ROBOTS)
    stages.end("estimate the past")
    choices = TeamOptions(candidates=QUICK_CANDIDATES) if options.quick else TeamOptions()
    seeds = options.seed_range(1)
    sessions = []
    for seed in seeds:
        team = prepare_team(log, past, choices, np.random.default_rng(seed))
        stages.end("roadmap and candidates")
        sessions.append(_plan(seed, team))
        stages.end("plan")
    session = sessions[0]
    team = session.team
    arrival = know_on_arrival(team.problem, session.agreement.paths)
    stages.end("knowledge on arrival")
    times = time_evaluators(
        team.problem,
        team.candidates,
        session.views,
        TIMED,
        count=QUICK_TIMED if options.quick else TIMED_CANDIDATES,
        progress=options.progress,
    )
    stages.end("time evaluators")
    impact = _impact(session)
    joined = joined_states(team.problem, session.agreement.paths)
    figures, notes = _write(options, past, session, joined, arrival, impact, times)
    stages.end("figures")
    results = results_of(log, past, sessions, arrival, times, stages.seconds)
    return CommandOutcome(
        results=results,
        requirements=_requirements(options, sessions, arrival, times, stages.total),
        seeds=seeds,
        summary=(
            *log_lines(log, past),
            *team_lines(team, choices),
            *session_lines(session, arrival, sessions[1:]),
            *time_lines(times),
            stages.line(),
            *notes,
        ),
        figures=figures,
    )


class _Stages:
    """Seconds by stage; tells progress when one ends."""

    def __init__(self, options: CommandOptions) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = options.progress
        self._began = self._last = time.perf_counter()

    def end(self, stage: str) -> None:
        """Note the seconds since the last stage ended."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
        self._progress(len(self.seconds), 0, stage)

    @property
    def total(self) -> float:
        """Seconds since the demo began."""
        return self._last - self._began

    def line(self) -> str:
        """All stages in one line."""
        parts = ", ".join(f"{stage} {seconds:.1f}" for stage, seconds in self.seconds.items())
        return f"seconds: {self.total:.1f} in all: {parts}"


def _warm_up() -> None:
    """Run every compiled kernel once on a small piece of the log."""
    log = read_log(WARM_POSES)
    past = team_past(log, ROBOTS[:2])
    choices = TeamOptions(candidates=2, vertices=150)
    team = prepare_team(log, past, choices, np.random.default_rng(0))
    session = _plan(0, team)
    know_on_arrival(team.problem, session.agreement.paths)
    time_evaluators(
        team.problem,
        team.candidates,
        session.views,
        TIMED[:1],
        count=2,
        progress=lambda done, total, doing: None,
    )


def _plan(seed: int, team: VictoriaTeam) -> Session:
    """Let the team agree."""
    began = time.perf_counter()
    agreement = coordinate(team.problem, team.candidates, Incremental(), goals=team.goals)
    return Session(
        seed=seed,
        team=team,
        agreement=agreement,
        views=announced_views(agreement, team.candidates),
        seconds=time.perf_counter() - began,
    )


def _impact(session: Session) -> ImpactRecord | None:
    """One re-evaluation to draw."""
    pair = drawn_reevaluation(session.views)
    if pair is None:
        return None
    return impact_record(session.team.problem, session.team.candidates, *pair)


def _write(
    options: CommandOptions,
    past: TeamPast,
    session: Session,
    joined: Pairs,
    arrival: Arrival,
    impact: ImpactRecord | None,
    times: Sequence[EvaluatorTimes],
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Record and figures; without matplotlib the record alone, and a note."""
    if options.out is None:
        return (), ()
    team, agreement = session.team, session.agreement
    record = RunRecord(
        name="victoria-park",
        workspace=record_workspace(team.workspace),
        goals={robot: goal[None] for robot, goal in team.goals.items()},
        candidates=team.candidates,
        chosen=agreement.paths,
        covariances={
            robot: world_position_covariances(path.poses, arrival.covariances[robot])
            for robot, path in agreement.paths.items()
        },
        joined=joined,
        landmarks=past.belief.landmarks(),
        values=agreement.values,
        announced_by=announcers(agreement),
        impacts=() if impact is None else (impact,),
    )
    write_record(options.out, record)
    try:
        return draw_figures(
            options.out, past, team, agreement.paths, joined, arrival, impact, times
        ), ()
    except MissingExtraError as error:
        return (), (f"no figures: {error}",)


def _requirements(
    options: CommandOptions,
    sessions: Sequence[Session],
    arrival: Arrival,
    times: Sequence[EvaluatorTimes],
    total_s: float,
) -> tuple[Requirement, ...]:
    """What the demo must show."""
    agreement = sessions[0].agreement
    exactness = abs(arrival.objective - agreement.value) / abs(arrival.objective)
    rises = any((np.diff(item.agreement.values) > 0.0).any() for item in sessions)
    required = [
        require_true("agreed", all(item.agreement.agreed for item in sessions)),
        require_true("objective_never_rises", not rises),
        require_at_most("objective_against_qr", exactness, 1e-9),
        require_at_most("max_rel_diff_of_cholesky_evaluators", values_agree(times), 1e-6),
    ]
    if not options.quick:
        required.append(require_at_most("seconds", total_s, MOST_SECONDS))
    return tuple(required)
