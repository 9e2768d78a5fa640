"""Teams whose common objective is read from a table: quick, and never the same twice."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from fgplan.evaluation.evaluations import Evaluations, ReevaluationReport
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.paths.candidate_path import CandidatePath


def make_path(robot, index, length_m, steps=4):
    """A straight path whose last vertex is the index of the candidate."""
    poses = np.zeros((steps + 1, 3))
    poses[:, 0] = np.linspace(0.0, length_m, steps + 1)
    return CandidatePath(
        robot=robot,
        poses=poses,
        times_s=np.arange(steps + 1.0),
        motion_covariances=np.tile(0.01 * np.eye(3), (steps, 1, 1)),
        vertices=(*range(steps), index),
    )


class TableEvaluator:
    """Common objective from a table: lengths plus a number for every pair of paths."""

    name = "table"

    def __init__(self, robots, pairs):
        self.robots, self.pairs, self.calls = robots, pairs, 0

    def start(self, problem, robot, candidates):
        return (robot, tuple(candidates))

    def team_value(self, paths):
        total = 100.0 + sum(path.length_m for path in paths.values())
        for first, second in itertools.combinations(self.robots, 2):
            if first in paths and second in paths:
                place = (paths[first].vertices[-1], paths[second].vertices[-1])
                total += self.pairs[first, second][place]
        return total

    def evaluate(self, state, announced):
        self.calls += 1
        robot, candidates = state
        assert robot not in announced
        values = np.array([self.team_value({**announced, robot: path}) for path in candidates])
        report = ReevaluationReport(solves=len(values))
        return state, Evaluations(
            robot=robot, values=values, terms=np.zeros((len(values), 1)), report=report
        )


class ForgetfulEvaluator(TableEvaluator):
    """The same, but no two lives of a robot agree to the last digit (1e-12 relative)."""

    lives = 0

    def start(self, problem, robot, candidates):
        self.lives += 1
        return (robot, tuple(candidates), 1.0 + 1e-12 * self.lives)

    def evaluate(self, state, announced):
        *known, factor = state
        _, found = super().evaluate(tuple(known), announced)
        return state, replace(found, values=found.values * factor)


class ChoosingEvaluator(TableEvaluator):
    """The same, choosing by itself."""

    def choose(self, state, announced, incumbent_index):
        state, found = self.evaluate(state, announced)
        return state, SimpleNamespace(
            index=found.best,
            value=found.values[found.best],
            incumbent_value=found.values[incumbent_index],
            report=found.report,
        )


def make_team(count, candidates=5, seed=0, evaluator=TableEvaluator):
    """A problem with random tables; enough coupling that several announcements are made."""
    generator = np.random.default_rng(seed)
    robots = tuple(f"r{number}" for number in range(count))
    pairs = {
        (first, second): 10.0 * generator.random((candidates, candidates))
        for first, second in itertools.combinations(robots, 2)
    }
    paths = {
        robot: tuple(
            make_path(robot, index, 5.0 + generator.random()) for index in range(candidates)
        )
        for robot in robots
    }
    problem = SimpleNamespace(
        robots=robots,
        objective=length_and_uncertainty(robots),
        prior=SimpleNamespace(digest=lambda: "digest of the prior"),
        check_path=lambda path: None,
    )
    return problem, paths, evaluator(robots, pairs)


def outcome(agreement):
    """All that must not depend on the network."""
    return (
        agreement.agreed,
        agreement.chosen,
        agreement.values,
        agreement.turns,
        agreement.ledger.basis(),
        agreement.ledger.history,
        {robot: path.poses.tobytes() for robot, path in agreement.paths.items()},
        [(record.turn, record.robot, record.announced) for record in agreement.records],
    )
