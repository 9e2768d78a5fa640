"""A planning session of a whole team in one process."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from fgplan.announcement.announcement import Sender, goal_of
from fgplan.announcement.term_data import terms_of
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.evaluation.problem import PlanningProblem
from fgplan.evaluation.registry import INEXACT, find_evaluator
from fgplan.paths.candidate_path import CandidatePath
from fgplan.team.agreement import Agreement, agreement_of
from fgplan.team.envelope import Inbox, Outbox
from fgplan.team.in_process import InProcessTransport
from fgplan.team.loop import run_robots
from fgplan.team.options import CoordinationOptions
from fgplan.team.report import report_of
from fgplan.team.robot import step
from fgplan.team.robot_setup import RobotSetup
from fgplan.team.robot_state import RobotState, TurnRecord, start_robot
from fgplan.team.transport import SimulatedTransport
from fgplan.typing import ArrayLike


def set_up_team(
    problem: PlanningProblem,
    candidates: Mapping[str, Sequence[CandidatePath]],
    evaluator: str | AbstractEvaluator = "incremental",
    *,
    options: CoordinationOptions | None = None,
    goals: Mapping[str, ArrayLike] | None = None,
    prior_digest: str | None = None,
    carried: Mapping[str, Any] | None = None,
) -> dict[str, RobotSetup]:
    """What each robot of a team knows before a planning session.

    Args:
        problem: Prior, team, objective and models.
        candidates: Candidate paths of each robot.
        evaluator: How every robot evaluates them: a registered name (``incremental``,
            ``from_scratch``, ``isam2``, ``as_published``), a user's own as ``module:object``, or
            an evaluator made with options of its own.
        options: How the team comes to agree; None is the default for this evaluator.
        goals: Goal of each robot, metres, world frame; travels with its announcements.
        prior_digest: Digest of the prior where the caller has it; None computes it.
        carried: By robot, what its evaluator carries over from an earlier session; evaluators
            without ``carry`` do not read it.

    Returns:
        Set-up of each robot, in the order of the team.

    Raises:
        UnknownNameError: If candidates or something carried are given for a robot that is not in
            the team, or there is no such evaluator.
        InvalidInputError: If the evaluator is none, or the candidates of a robot are no sequence.
    """
    robots = tuple(problem.robots)
    evaluating = find_evaluator(evaluator)
    memories = carried or {}
    for robot in memories:
        if robot not in robots:
            raise UnknownNameError(f"carried: robot {robot!r} is not one of {', '.join(robots)}")
    for robot in candidates:
        if robot not in robots:
            raise UnknownNameError(f"candidates: robot {robot!r} is not one of {', '.join(robots)}")
        if isinstance(candidates[robot], CandidatePath):
            raise InvalidInputError(
                f"candidates of robot {robot!r}: expected a list of paths, got one; write [path]"
            )
    chosen = options or default_options(evaluating)
    digest = problem.prior.digest() if prior_digest is None else prior_digest
    terms = {robot: terms_of(problem.objective, robot) for robot in robots}
    places = goals or {}
    return {
        robot: RobotSetup(
            robot=robot,
            robots=robots,
            problem=problem,
            candidates=tuple(candidates.get(robot, ())),
            evaluator=evaluating,
            options=chosen,
            sender=Sender(
                session=chosen.session,
                prior_digest=digest,
                goal=goal_of(places[robot]) if robot in places else (),
                terms=terms[robot],
            ),
            expected_terms=terms,
            carried=memories.get(robot),
        )
        for robot in robots
    }


def default_options(evaluator: AbstractEvaluator) -> CoordinationOptions:
    """Options where the caller gives none: a rise of the objective is an error of exact evaluators.

    Args:
        evaluator: How every robot evaluates.

    Returns:
        The options.
    """
    return CoordinationOptions(check_values=evaluator.name not in INEXACT)


def coordinate(
    problem: PlanningProblem,
    candidates: Mapping[str, Sequence[CandidatePath]],
    evaluator: str | AbstractEvaluator = "incremental",
    *,
    options: CoordinationOptions | None = None,
    goals: Mapping[str, ArrayLike] | None = None,
    transport: SimulatedTransport | None = None,
    prior_digest: str | None = None,
    carried: Mapping[str, Any] | None = None,
    progress: Callable[[TurnRecord], None] | None = None,
) -> Agreement:
    """Let a team agree on paths.

    Args:
        problem: Prior, team, objective and models.
        candidates: Candidate paths of each robot.
        evaluator: How every robot evaluates them: a registered name (``incremental``,
            ``from_scratch``, ``isam2``, ``as_published``), a user's own as ``module:object``, or
            an evaluator made with options of its own.
        options: How the team comes to agree; None is the default for this evaluator.
        goals: Goal of each robot, metres, world frame.
        transport: What carries the messages; None is in process without faults.
        prior_digest: Digest of the prior where the caller has it; None computes it.
        carried: By robot, what ``Incremental.carry`` made of its evaluator's state after an
            earlier session (``Agreement.evaluator_states``); evaluators without ``carry`` do not
            read it.
        progress: Called after each entry that a robot writes.

    Returns:
        What was agreed; ``agreed`` is False if turns or time ran out.

    Raises:
        NoCandidatePathError: If a robot has no candidate path and may not stay; names it.
        UnknownNameError: If candidates or something carried are given for a robot that is not in
            the team, or there is no such evaluator.
        InvalidInputError: If the evaluator is none, or the candidates of a robot are no sequence.
    """
    began = time.perf_counter()
    evaluating = find_evaluator(evaluator)
    chosen = options or default_options(evaluating)
    setups = set_up_team(
        problem,
        candidates,
        evaluating,
        options=chosen,
        goals=goals,
        prior_digest=prior_digest,
        carried=carried,
    )
    network = transport or InProcessTransport(tuple(setups))
    starting = time.perf_counter()
    states = {robot: start_robot(setup) for robot, setup in setups.items()}
    start_s = time.perf_counter() - starting
    following = step if progress is None else _reporting(progress)
    opened_s = network.now()
    limit_s = opened_s + chosen.time_limit_s
    states = run_robots(states, following, network, time_limit_s=limit_s)
    evaluated_s = sum(r.decision.seconds for s in states.values() for r in s.records if r.decision)
    return agreement_of(
        [report_of(state) for state in states.values()],
        chosen,
        traffic=network.traffic.copy(),
        clock_s=network.now() - opened_s,
        seconds={
            "start": start_s,
            "evaluation": evaluated_s,
            "coordination": time.perf_counter() - began - start_s - evaluated_s,
        },
        evaluator_states={
            r: s.evaluator_state for r, s in states.items() if s.evaluator_state is not None
        },
    )


def _reporting(
    progress: Callable[[TurnRecord], None],
) -> Callable[[RobotState, Inbox], tuple[RobotState, Outbox]]:
    """The step function, telling what a robot has written."""

    def reporting(state: RobotState, inbox: Inbox) -> tuple[RobotState, Outbox]:
        """Step and report."""
        after, outbox = step(state, inbox)
        for record in after.records[len(state.records) :]:
            progress(record)
        return after, outbox

    return reporting
