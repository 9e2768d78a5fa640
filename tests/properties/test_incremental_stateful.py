"""Announce, replace, withdraw, add candidates in any order: incremental equals from scratch.

After every step all values equal those of QR to 1e-9 relative, and the report is checked against a
count of the factors by brute force: identities are pairs of states (robot, step, time, vertex,
pose) by model.
"""

import numpy as np
import scenes
from example_counts import FEWER
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from fgplan.evaluation.evaluations import Evaluations
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.objective import PosesOf, Trajectory, UncertaintyTerm
from fgplan.factors.factor_set import state_identity

CANDIDATES = 6
FIRST = 3
ROBOTS = st.integers(0, 4)
PATHS = st.integers(0, CANDIDATES - 1)


def factors_now(problem, candidates, announced):
    """Identities of all multi-robot factors between candidates and announced paths."""
    found = set()
    for model_number, model in enumerate(problem.multi_robot):
        for mine in candidates:
            for theirs in announced.values():
                order = [problem.robots.index(path.robot) for path in (mine, theirs)]
                for state in mine.states():
                    for other in theirs.states():
                        pair = (state, other) if order[0] < order[1] else (other, state)
                        if model.joins(*pair):
                            found.add((model_number, *map(state_identity, pair)))
    return found


def own_columns(problem, robot):
    """Columns of the terms that read the robot's own belief."""
    columns = []
    for place, term in enumerate(problem.objective.terms):
        if isinstance(term, UncertaintyTerm):
            of = term.of
            own = isinstance(of, PosesOf) and of.robots == (robot,)
            if own or (isinstance(of, Trajectory) and of.robot == robot):
                columns.append(place)
    return columns


class Announcing(RuleBasedStateMachine):
    """One robot's evaluator while the others announce; the oracle beside it."""

    @initialize(
        seed=st.integers(0, 2**20),
        robots=st.integers(2, 4),
        kind=st.sampled_from(["relative_pose", "relative_pose", "range", None]),
        radius=st.sampled_from([60.0, 150.0, 300.0]),
        correlated=st.booleans(),
        landmarks=st.sampled_from([0, 4]),
        past=st.sampled_from([0, 1]),
        prior=st.sampled_from([1e-3, 1.0, 100.0]),
    )
    def draw(self, seed, robots, kind, radius, correlated, landmarks, past, prior):
        generator = np.random.default_rng(seed)
        self.problem, self.paths = scenes.random_scene(
            generator, robots=robots, candidates=CANDIDATES, steps=(2, 4), kind=kind,
            radius_m=radius, correlated=correlated, landmarks=landmarks, past=past,
            prior_sigma=prior,
        )  # fmt: skip
        self.robot = self.problem.robots[seed % robots]
        self.others = [name for name in self.problem.robots if name != self.robot]
        self.candidates = self.paths[self.robot][:FIRST]
        self.engine, self.oracle = Incremental(), FromScratch("qr")
        self.memory = self.engine.start(self.problem, self.robot, self.candidates)
        self.exact_state = self.oracle.start(self.problem, self.robot, self.candidates)
        self.announced, self.factors = {}, set()
        self.last: Evaluations | None = None
        self.fresh = 0
        self.step({})

    def step(self, announced):
        """Evaluate both and check everything that must hold."""
        memory, found = self.engine.evaluate(self.memory, announced)
        self.exact_state, exact = self.oracle.evaluate(self.exact_state, announced)
        np.testing.assert_allclose(found.values, exact.values, rtol=1e-9)
        np.testing.assert_allclose(found.terms, exact.terms, rtol=1e-9)
        report, size = found.report, len(self.candidates)
        assert sorted((*report.impacted, *report.untouched)) == list(range(size))
        now = factors_now(self.problem, self.candidates, announced)
        # factors of new candidates with old announcements were there when they were added
        before = factors_now(self.problem, self.candidates, self.announced)
        assert report.factors_kept + report.factors_added == len(now)
        assert report.factors_removed == len(before - now)
        assert report.factors_added == len(now - before)
        assert report.bytes_held > 0
        if self.last is not None and self.fresh == 0:
            columns = own_columns(self.problem, self.robot)
            kept = list(report.untouched)
            old, new = self.last.terms[kept][:, columns], found.terms[kept][:, columns]
            assert np.array_equal(old, new)
        self.memory, self.announced, self.last, self.fresh = memory, dict(announced), found, 0
        return found

    @rule(who=ROBOTS, which=PATHS)
    def announce_or_replace(self, who, which):
        robot = self.others[who % len(self.others)]
        self.step({**self.announced, robot: self.paths[robot][which]})

    @precondition(lambda self: self.announced)
    @rule(who=ROBOTS)
    def withdraw(self, who):
        robot = list(self.announced)[who % len(self.announced)]
        self.step({name: path for name, path in self.announced.items() if name != robot})

    @rule(who=ROBOTS, first=PATHS, second=PATHS)
    def there_and_back(self, who, first, second):
        robot = self.others[who % len(self.others)]
        start = self.step({**self.announced, robot: self.paths[robot][first]})
        self.step({**self.announced, robot: self.paths[robot][second]})
        back = self.step({**self.announced, robot: self.paths[robot][first]})
        np.testing.assert_allclose(back.values, start.values, rtol=1e-9)

    @rule()
    def announce_the_same_again(self):
        before = self.last
        found = self.step(self.announced)
        assert found.report.impacted == ()
        assert found.report.solves == found.report.messages_rebuilt == 0
        assert found.report.factors_added == found.report.factors_removed == 0
        assert np.array_equal(found.terms, before.terms)

    @precondition(lambda self: len(self.candidates) < CANDIDATES)
    @rule(count=st.integers(1, 2), who=ROBOTS, which=PATHS, at_once=st.booleans())
    def add_candidates(self, count, who, which, at_once):
        known = len(self.candidates)
        new = self.paths[self.robot][known : known + count]
        self.candidates = self.paths[self.robot][: known + len(new)]
        self.memory = self.engine.add_candidates(self.memory, new)
        self.exact_state = self.oracle.start(self.problem, self.robot, self.candidates)
        self.fresh = len(new)
        old = self.last.terms.copy()
        announced = self.announced
        if at_once:
            robot = self.others[who % len(self.others)]
            announced = {**announced, robot: self.paths[robot][which]}
        found = self.step(announced)
        if not at_once:
            assert np.array_equal(found.terms[:known], old)
            assert found.report.solves == len(new)

    @precondition(lambda self: self.announced)
    @rule(incumbent=st.integers(0, FIRST - 1), who=ROBOTS, which=PATHS)
    def choose_between_evaluations(self, incumbent, who, which):
        """Values left out by a choice are made up for by the next evaluation."""
        robot = self.others[who % len(self.others)]
        announced = {**self.announced, robot: self.paths[robot][which]}
        memory, choice = self.engine.choose(self.memory, announced, incumbent)
        self.memory, self.announced, self.last = memory, announced, None
        found = self.step(announced)
        np.testing.assert_allclose(choice.incumbent_value, found.values[incumbent], rtol=1e-9)
        np.testing.assert_allclose(choice.value, found.values.min(), rtol=2e-9)

    @invariant()
    def memory_is_a_value(self):
        """An evaluation from old memory is the same again."""
        if self.last is not None:
            _, again = self.engine.evaluate(self.memory, self.announced)
            assert np.array_equal(again.terms, self.last.terms)


TestAnnouncing = Announcing.TestCase
TestAnnouncing.settings = settings(stateful_step_count=8, max_examples=FEWER)
