"""What a robot knows before a planning session."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fgplan.announcement.announcement import Sender
from fgplan.announcement.term_data import TermData
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath
from fgplan.team.options import CoordinationOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSetup:
    """What a robot knows before the session and does not change.

    Attributes:
        robot: Name.
        robots: All names, in the order of the team.
        problem: Prior, objective and models.
        candidates: Its candidate paths; may be empty where it may stay.
        evaluator: How it evaluates them.
        options: How the team comes to agree.
        sender: Session, prior digest, goal and terms that its messages carry.
        expected_terms: Objective terms that each robot must announce.
        carried: What its evaluator carries over from an earlier session, or None; only for
            evaluators that have ``carry``.
    """

    robot: str
    robots: tuple[str, ...]
    problem: PlanningProblem
    candidates: tuple[CandidatePath, ...]
    evaluator: AbstractEvaluator
    options: CoordinationOptions
    sender: Sender
    expected_terms: Mapping[str, tuple[TermData, ...]]
    carried: Any = None

    @property
    def others(self) -> tuple[str, ...]:
        """Its teammates, in the order of the team."""
        return tuple(robot for robot in self.robots if robot != self.robot)
