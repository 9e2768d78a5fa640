"""One announcement's worth of preparation: others' belief, factors, and what the change touched.

Order of work in a turn: blocks of the paths that changed; S; factors of the own states with
announced poses; the difference to the last turn. Everything after that is a candidate at a time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fgplan.evaluation.incremental.candidate_table import CandidateTable
from fgplan.evaluation.incremental.factor_blocks import (
    FactorBlocks,
    StateSet,
    multi_robot_blocks,
    no_blocks,
    past_states_of,
    states_of,
)
from fgplan.evaluation.incremental.impact import (
    Components,
    FactorChange,
    factor_change,
    same_path,
    touched_candidates,
)
from fgplan.evaluation.incremental.memory import Memory
from fgplan.evaluation.incremental.numbering import Numbering
from fgplan.evaluation.incremental.prior_marginal import eliminate_history, restrict
from fgplan.evaluation.incremental.universe import (
    InformationBlocks,
    Universe,
    build_universe,
    fixed_blocks,
    meeting_blocks,
    path_blocks,
)
from fgplan.evaluation.incremental.whitened_rows import universe_rows
from fgplan.evaluation.objective import PosesOf, Trajectory, UncertaintyTerm
from fgplan.evaluation.problem import PlanningProblem
from fgplan.evaluation.term_values import CutReadings, objective_readings, path_steps
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import BoolArray, FloatArray, Key


@dataclass(slots=True)
class Turn:
    """What one evaluation works with; lives as long as the evaluation.

    Attributes:
        memory: Memory with the new announcements and their pieces; terms and pools are the old.
        changed: Robots whose announced path changed since the last evaluation.
        change: Difference of the factors with announced poses.
        impacted: Shape (N,), candidates whose own belief may have changed.
        dirty: Shape (N,), candidates whose message changed.
        changed_robots: Robots whose own uncertainty may have changed without the candidate.
        universes: Others' belief by cut; None is the whole.
        rows: Whitened rows of others' belief by cut, made only where QR is needed.
        ends: What the objective reads at the end, once found.
    """

    memory: Memory
    changed: tuple[str, ...]
    change: FactorChange
    impacted: BoolArray
    dirty: BoolArray
    changed_robots: frozenset[str]
    universes: dict[int | None, Universe] = field(default_factory=dict)
    rows: dict[int | None, FloatArray] = field(default_factory=dict)
    ends: list[CutReadings] = field(default_factory=list)

    def end_readings(self) -> CutReadings:
        """What is read where all terms read the end; the own pose stands for every length."""
        if not self.ends:
            memory = self.memory
            steps = path_steps(memory.announced)
            steps[memory.robot] = int(memory.table.lengths.max())
            self.ends.extend(objective_readings(memory.problem, steps))
        return self.ends[0]

    def universe(self, cut: int | None) -> Universe:
        """Others' belief at a cut, built once a turn."""
        if cut not in self.universes:
            memory = self.memory
            self.universes[cut] = build_universe(
                memory.problem,
                memory.numbering,
                memory.prior,
                memory.announced,
                memory.pieces(),
                cut,
            )
        return self.universes[cut]

    def universe_rows(self, cut: int | None) -> FloatArray:
        """Whitened rows of others' belief at a cut, for the reference form."""
        if cut not in self.rows:
            memory, universe = self.memory, self.universe(cut)
            self.rows[cut] = universe_rows(
                memory.problem,
                memory.numbering,
                memory.prior,
                memory.announced,
                universe.column,
                len(universe.covariance),
            )
        return self.rows[cut]


def touched_keys(problem: PlanningProblem, own: StateSet, landmarks: list[Key]) -> list[Key]:
    """Prior variables that some states would touch: landmarks, and past poses they meet."""
    robot = problem.robots[own.places[0]]
    past = [p for p in problem.past_states if p.state.robot != robot]
    if not past:
        return landmarks
    others = past_states_of(problem, past)
    met = multi_robot_blocks(problem, own, others, np.arange(len(past)), past=True)
    return landmarks + [past[index].key for index in np.unique(met.variable).tolist()]


def own_states(problem: PlanningProblem, table: CandidateTable) -> StateSet:
    """Distinct own states of the candidates."""
    place = problem.robots.index(table.paths[0].robot)
    places = np.full(len(table.poses), place, np.int64)
    return StateSet(table.poses, places, table.distinct)


def begin_turn(memory: Memory, announced: Mapping[str, CandidatePath]) -> Turn:
    """Take in the others' announced paths.

    Args:
        memory: Memory of the last evaluation.
        announced: Announced paths by robot; the robot's own is not read.

    Returns:
        The turn, with new memory.
    """
    problem = memory.problem
    problem.check_announced(announced)
    new = {r: announced[r] for r in problem.robots if r != memory.robot and r in announced}
    old = memory.announced
    changed = tuple(
        r for r in problem.robots if r != memory.robot and not same_path(old.get(r), new.get(r))
    )
    new = {r: path if r in changed else old[r] for r, path in new.items()}
    grown = _grow(memory, new, changed)
    own = {r: grown.own_pieces[r] for r in new if r in grown.own_pieces and r not in changed}
    for robot in new:
        if robot not in own:
            own[robot] = (new[robot], path_blocks(problem, grown.numbering, new[robot]))
    meetings = grown.meetings
    if changed or meetings is None:
        meetings = _meetings(problem, grown.numbering, new)
    moving = factors_with_announced(grown, new)
    counted = memory.table.counted
    change = factor_change(grown.numbering, old, new, grown.moving, moving, changed, counted)
    after = replace(grown, announced=new, own_pieces=own, meetings=meetings, moving=moving)
    impacted, changed_robots = _impact(grown, after, changed)
    dirty = touched_candidates(memory.table.states, change.dirty)
    return Turn(after, changed, change, impacted, dirty, changed_robots)


def _grow(memory: Memory, new: Mapping[str, CandidatePath], changed: tuple[str, ...]) -> Memory:
    """Number variables that were not touched before; longer paths renumber everything."""
    problem, numbering = memory.problem, memory.numbering
    touched: list[Key] = []
    for robot in changed:
        if robot in new:
            path = new[robot]
            landmarks = [o.landmark for o in path.observations]
            touched += touched_keys(problem, states_of(problem, [path]), landmarks)
    grown = with_keys(memory, touched)
    longest = max((path.steps for path in new.values()), default=0)
    capacity = numbering.capacity
    if longest <= capacity:
        return grown
    while capacity < longest:
        capacity *= 2
    fresh = replace(grown.numbering, capacity=capacity)
    table = memory.table
    grown = replace(
        grown,
        numbering=fresh,
        fixed=fixed_blocks(problem, fresh, own_states(problem, table), table.observations),
        own_pieces={r: (p, path_blocks(problem, fresh, p)) for r, p in memory.announced.items()},
        meetings=_meetings(problem, fresh, memory.announced),
        pools=(),
    )
    return replace(grown, moving=factors_with_announced(grown, memory.announced))


def with_keys(memory: Memory, touched: Sequence[Key]) -> Memory:
    """Number prior variables that were not touched before.

    Args:
        memory: Memory of the last evaluation.
        touched: Prior variables.

    Returns:
        Memory in which they have numbers; new ones come last, so all other numbers still hold.
    """
    numbering, wide = memory.numbering, memory.wide
    keys = dict.fromkeys(numbering.prior_keys)
    keys.update(dict.fromkeys(touched))
    if len(keys) == len(numbering.prior_keys):
        return memory
    if not set(keys) <= set(wide.keys):
        wide = eliminate_history(memory.problem, keys)
    fresh = replace(numbering, prior_keys=tuple(keys))
    return replace(memory, wide=wide, numbering=fresh, prior=restrict(wide, fresh.prior_keys))


def _meetings(
    problem: PlanningProblem, numbering: Numbering, announced: Mapping[str, CandidatePath]
) -> InformationBlocks | None:
    """Blocks of the factors among the announced paths, if there are any paths."""
    return meeting_blocks(problem, numbering, list(announced.values())) if announced else None


def factors_with_announced(memory: Memory, announced: Mapping[str, CandidatePath]) -> FactorBlocks:
    """Factors of the distinct own states with all announced poses.

    Args:
        memory: Holds the candidates and numbers of variables.
        announced: The others' paths.

    Returns:
        The table over the distinct own states.
    """
    problem, table = memory.problem, memory.table
    if not announced or not problem.multi_robot:
        return no_blocks(len(table.poses), problem.dim)
    paths = list(announced.values())
    numbers = [memory.numbering.pose(path.robot, 1) + np.arange(path.steps) for path in paths]
    return multi_robot_blocks(
        problem, own_states(problem, table), states_of(problem, paths), np.concatenate(numbers)
    )


def _impact(
    before: Memory, after: Memory, changed: tuple[str, ...]
) -> tuple[BoolArray, frozenset[str]]:
    """Impacted candidates, and robots whose own uncertainty may have changed."""
    size = len(before.table.paths)
    if before.terms is None:
        return np.ones(size, bool), frozenset(after.numbering.robots)
    if not changed:
        return np.zeros(size, bool), frozenset()
    parts = Components(after.numbering, after.prior)
    base = len(after.numbering.robots) * after.numbering.capacity
    for robot in after.numbering.robots:
        if robot in before.announced or robot in after.announced:
            start = np.array([after.numbering.prior(after.problem.start_keys[robot])])
            parts.add_factors(robot, start)
    for memory in (before, after):
        for robot, (_, piece) in memory.own_pieces.items():
            parts.add_factors(robot, piece.column[piece.column >= base])
        if memory.meetings is not None:
            parts.join_chains(memory.meetings.row, memory.meetings.column)
    labels = parts.labels()
    touched = {int(labels[parts.robot(robot)]) for robot in changed}
    inside = np.array([label in touched for label in labels.tolist()])
    robots = frozenset(
        robot
        for robot in after.numbering.robots
        if inside[parts.robot(robot)] or inside[_start_node(parts, after, robot)]
    )
    if inside[_start_node(parts, after, after.robot)]:
        return np.ones(size, bool), robots
    flags = np.zeros(len(after.table.poses), bool)
    for blocks in (before.moving, after.moving, after.fixed):
        owner = np.repeat(np.arange(len(flags)), np.diff(blocks.pointer))
        flags[owner[inside[parts.nodes(blocks.variable)]]] = True
    return touched_candidates(after.table.states, flags), robots


def _start_node(parts: Components, memory: Memory, robot: str) -> int:
    """Node of a robot's current pose."""
    number = memory.numbering.prior(memory.problem.start_keys[robot])
    return int(parts.nodes(np.array([number]))[0])


def reads_only_the_end(problem: PlanningProblem, robot: str) -> bool:
    """Whether one batch serves all candidates: all terms read the end, none a whole own path."""
    return all(
        term.read == "end" and not (isinstance(term.of, Trajectory) and term.of.robot == robot)
        for term in problem.objective.terms
        if isinstance(term, UncertaintyTerm)
    )


def separable(problem: PlanningProblem) -> bool:
    """Whether every uncertainty term is of one robot's own poses, read at its own time."""
    for term in problem.objective.terms:
        if not isinstance(term, UncertaintyTerm):
            continue
        if isinstance(term.of, PosesOf) and len(term.of.robots) == 1:
            robot = term.of.robots[0]
        elif isinstance(term.of, Trajectory):
            robot = term.of.robot
        else:
            return False
        if term.arrival_of not in (None, robot):
            return False
    return True
