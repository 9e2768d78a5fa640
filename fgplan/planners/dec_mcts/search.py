"""Dec-MCTS (Best, Cliff, Patten, Mettu and Fitch, IJRR 2019) on the objective of Kantaros et al.

Each robot grows a tree over its own controls for ``_AHEAD`` steps, with a bound that forgets old
rewards (discounted UCT, factor 0.95). A rollout draws the others' controls from what they last
told: their ``_SEQUENCES`` best sequences with probabilities q. After each round every robot moves
its q towards what the rollouts say, at a falling temperature,

    q(x) <- q(x) - a q(x) [ (E[f] - E[f | x]) / b + H(q) + ln q(x) ],

and tells the others. The utility is the decrease of the sum of the objective over the steps ahead.
The team executes the most probable sequences and plans again. Rollouts past a tree's leaves follow
f_U (9), so that robots that see nothing move towards targets.
"""

from dataclasses import dataclass, field

import numpy as np

from fgplan.planners.aia.baseline import BaselineResult, Budget, Clock
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.team_model import TeamModel, TeamState

_AHEAD = 6
_ROUNDS = 3
_ROLLOUTS = 12
_SEQUENCES = 4
_DISCOUNT = 0.95
_EXPLORE = 0.5
_MOVE = 0.3
_COOLING = 0.6

Sequence = tuple[int, ...]


@dataclass(slots=True)
class _Branch:
    """A control in one robot's tree: discounted visits and rewards."""

    visits: float = 0.0
    reward: float = 0.0
    children: "dict[int, _Branch]" = field(default_factory=dict)


@dataclass(slots=True)
class _Robot:
    """What one robot knows: its tree, and its sequences with their probabilities and rewards."""

    root: _Branch = field(default_factory=_Branch)
    seen: dict[Sequence, tuple[float, int]] = field(default_factory=dict)
    sequences: list[Sequence] = field(default_factory=list)
    chances: list[float] = field(default_factory=list)


def search_decentralised(
    problem: AcquisitionProblem, budget: Budget, generator: np.random.Generator
) -> BaselineResult:
    """Plan by Dec-MCTS, again and again until the terminal constraint holds.

    Args:
        problem: What is planned for.
        budget: Steps, simulated steps (nodes) and seconds.
        generator: Source of random numbers.

    Returns:
        The path.
    """
    model = TeamModel(problem)
    clock = budget.start()
    state = model.start()
    while not model.is_final(state) and state.time < budget.steps and not clock.late:
        for rows in zip(*_agree(model, state, clock, generator), strict=True):
            state = model.advance(state, np.array(rows))
            if model.is_final(state):
                break
    path = model.path(state) if model.is_final(state) else None
    return clock.result(path, model.shortfall(state), model.farthest(state))


def _agree(
    model: TeamModel, state: TeamState, clock: Clock, generator: np.random.Generator
) -> list[Sequence]:
    """The most probable sequence of each robot after some rounds."""
    robots = [_Robot() for _ in state.rows]
    for robot, one in enumerate(robots):
        one.sequences = [_drift(model, state, robot, generator)]
        one.chances = [1.0]
    temperature = 1.0
    for _ in range(_ROUNDS):
        for robot in range(len(robots)):
            for _ in range(_ROLLOUTS):
                _roll_out(model, state, robots, robot, clock, generator)
            _tell(robots[robot], temperature)
        temperature *= _COOLING
    return [one.sequences[int(np.argmax(one.chances))] for one in robots]


def _drift(
    model: TeamModel, state: TeamState, robot: int, generator: np.random.Generator
) -> Sequence:
    """A sequence drawn from f_U alone."""
    return _completed(model, state, robot, (), generator)


def _completed(
    model: TeamModel,
    state: TeamState,
    robot: int,
    sequence: Sequence,
    generator: np.random.Generator,
) -> Sequence:
    """A sequence continued by f_U to its full length."""
    row = sequence[-1] if sequence else int(state.rows[robot])
    found = list(sequence)
    for step in range(len(sequence), _AHEAD):
        rows = state.rows.copy()
        rows[robot] = row
        there = TeamState(rows, state.covariance, state.time + step, 0.0, state.assigned)
        row = model.draw(there, robot, generator)
        found.append(row)
    return tuple(found)


def _roll_out(
    model: TeamModel,
    state: TeamState,
    robots: list[_Robot],
    robot: int,
    clock: Clock,
    generator: np.random.Generator,
) -> None:
    """One pass of a robot's tree: select, expand, simulate, back up."""
    one = robots[robot]
    branches = [one.root]
    sequence: Sequence = ()
    row = int(state.rows[robot])
    while len(sequence) < _AHEAD:
        rows = model.controls(robot, row)
        branch = branches[-1]
        fresh = [int(r) for r in rows if int(r) not in branch.children]
        if fresh:
            row = fresh[int(generator.random() * len(fresh))]
            branch.children[row] = _Branch()
        else:
            row = _best_bound(branch)
        sequence = (*sequence, row)
        branches.append(branch.children[row])
        if fresh:
            break
    sequence = _completed(model, state, robot, sequence, generator)
    others = [
        sequence
        if place == robot
        else other.sequences[int(generator.choice(len(other.chances), p=other.chances))]
        for place, other in enumerate(robots)
    ]
    reward = _reward(model, state, others, clock)
    for branch in branches:
        branch.visits = _DISCOUNT * branch.visits + 1.0
        branch.reward = _DISCOUNT * branch.reward + reward
    mean, count = one.seen.get(sequence, (0.0, 0))
    one.seen[sequence] = (mean + (reward - mean) / (count + 1), count + 1)


def _best_bound(branch: _Branch) -> int:
    """Child with the largest upper confidence bound."""
    total = sum(child.visits for child in branch.children.values())
    bounds = {
        row: child.reward / child.visits
        + _EXPLORE * np.sqrt(2.0 * np.log(max(total, 1.0)) / child.visits)
        for row, child in branch.children.items()
    }
    return max(bounds, key=lambda row: bounds[row])


def _reward(model: TeamModel, state: TeamState, sequences: list[Sequence], clock: Clock) -> float:
    """Share by which the objective falls over the steps ahead, between 0 and 1."""
    covariance = state.covariance
    known = [model.information(j, int(row), state.time) for j, row in enumerate(state.rows)]
    first = total = 0.0
    for step in range(_AHEAD + 1):
        covariance, term = model.propagate(covariance, np.sum(known, axis=0), state.time + step)
        total += term
        first = first or term
        if step < _AHEAD:
            known = [
                model.information(j, one[step], state.time + step + 1)
                for j, one in enumerate(sequences)
            ]
    clock.nodes += _AHEAD
    return float(np.clip(1.0 - total / ((_AHEAD + 1) * first), 0.0, 1.0))


def _tell(one: _Robot, temperature: float) -> None:
    """Choose a robot's best sequences and move their probabilities."""
    ranked = sorted(one.seen, key=lambda sequence: -one.seen[sequence][0])[:_SEQUENCES]
    before = dict(zip(one.sequences, one.chances, strict=True))
    chances = np.array([before.get(sequence, 1.0 / len(ranked)) for sequence in ranked])
    chances = np.maximum(chances / chances.sum(), 1e-6)
    rewards = np.array([one.seen[sequence][0] for sequence in ranked])
    entropy = -float((chances * np.log(chances)).sum())
    gap = float(chances @ rewards) - rewards
    moved = chances - _MOVE * chances * (gap / temperature + entropy + np.log(chances))
    moved = np.maximum(moved, 1e-6)
    one.sequences = ranked
    one.chances = (moved / moved.sum()).tolist()
