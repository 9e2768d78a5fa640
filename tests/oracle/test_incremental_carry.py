"""What is carried from session to session changes no value and is used wherever it still holds.

A mission is a random scene played over several planning sessions. Between two of them every robot
follows a path for some steps: the prior grows by those poses, their odometry, observations of
landmarks and a new landmark now and then; some landmarks' estimates move. One robot then has new
candidates and the others keep theirs: from the new estimate to a later state of the old candidate,
and on along its tail.
"""

from dataclasses import replace
from itertools import pairwise

import gtsam
import numpy as np
import pytest
import scenes
from hypothesis import given, settings
from hypothesis import strategies as st

from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError, NoCandidatePathError, UnknownNameError
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.incremental.preparation import FIRST_CAPACITY
from fgplan.evaluation.objective import Objective, PosesOf, UncertaintyTerm
from fgplan.evaluation.problem import PastState
from fgplan.models.pose import compose
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.team.coordination import coordinate

TOLERANCE = 1e-9
ENGINE = Incremental()


def scene(seed, **options):
    """A scene of three robots with landmarks and past poses."""
    chosen = {"robots": 3, "candidates": 4, "steps": (5, 9), "landmarks": 6, "past": 1}
    return scenes.random_scene(np.random.default_rng(seed), **{**chosen, **options})


def gtsam_pose(pose):
    return gtsam.Pose2(*pose) if pose.ndim == 1 else gtsam.Pose3(pose)


def nudged(generator, pose):
    """An estimate near a pose."""
    step = generator.normal(0.0, 1.0, 3) * [2.0, 2.0, 0.02]
    return compose(pose, step if pose.ndim == 1 else scenes.spatial(step))


class Mission:
    """A prior that grows, and candidates that are kept or drawn anew."""

    def __init__(self, seed, **options):
        self.generator = np.random.default_rng([seed, 1])
        self.problem, self.candidates = scene(seed, **options)
        self.graph = gtsam.NonlinearFactorGraph(self.problem.prior.graph)
        self.values = gtsam.Values(self.problem.prior.values)
        self.count = 0

    def move(self, share_moved=0.3, new_landmark=False, renewed="robot0"):
        """Execute some steps, take measurements, relinearise, keep candidates or draw new ones."""
        starts, past, steps = {}, [], {}
        for number, (robot, paths) in enumerate(self.candidates.items()):
            path = paths[int(self.generator.integers(len(paths)))]
            steps[robot] = min(int(self.generator.integers(1, 3)), path.steps)
            starts[robot] = self._drive(number, robot, path, steps[robot])
            past += [
                PastState(
                    p.key,
                    replace(
                        p.state, step=p.state.step - steps[robot], time_s=p.state.time_s - 10.0
                    ),
                )
                for p in self.problem.past_states
                if p.state.robot == robot
            ]
            past.append(PastState(starts[robot], State(robot, 0, 0.0, self._pose(starts[robot]))))
        for key in [k for k, kind in self.problem.prior.kinds.items() if kind.startswith("Point")]:
            if self.generator.random() < share_moved:
                self._shift(key)
        self.problem = replace(
            self.problem,
            prior=Belief(gtsam.NonlinearFactorGraph(self.graph), gtsam.Values(self.values)),
            start_keys=starts,
            past_states=tuple(past) if self.problem.past_states else (),
        )
        self.candidates = {
            robot: self._candidates(robot, paths, steps[robot], robot == renewed, new_landmark)
            for robot, paths in self.candidates.items()
        }

    def _pose(self, key):
        at = self.values.atPose2(key) if self._planar else self.values.atPose3(key)
        return scenes._array(at)

    @property
    def _planar(self):
        return self.problem.dim == 3

    def _shift(self, key):
        point = self.values.atPoint2(key) if self._planar else self.values.atPoint3(key)
        self.values.update(key, point + self.generator.normal(0.0, 0.5, point.size))

    def _drive(self, number, robot, path, steps):
        """Add the executed poses with odometry and observations; the key of the last."""
        before = self.problem.start_keys[robot]
        between = gtsam.BetweenFactorPose2 if self._planar else gtsam.BetweenFactorPose3
        for step in range(1, steps + 1):
            key = gtsam.symbol("uvwxyz"[number], self.count)
            self.count += 1
            pose = gtsam_pose(nudged(self.generator, path.poses[step]))
            noise = gtsam.noiseModel.Gaussian.Covariance(path.motion_covariances[step - 1])
            way = gtsam_pose(self._pose(before)).between(pose)
            self.values.insert(key, pose)
            self.graph.add(between(before, key, way, noise))
            for seen in path.observations:
                if seen.step == step:
                    self._observe(key, pose, seen.landmark)
            before = key
        return before

    def _observe(self, key, pose, landmark):
        planar = self._planar
        point = self.values.atPoint2(landmark) if planar else self.values.atPoint3(landmark)
        make = gtsam.BearingRangeFactor2D if planar else gtsam.BearingRangeFactor3D
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.02] * (1 if planar else 2) + [3.0]))
        self.graph.add(make(key, landmark, pose.bearing(point), pose.range(point), noise))

    def _candidates(self, robot, paths, done, renewed, new_landmark):
        start = self._pose(self.problem.start_keys[robot])
        left = [path for path in paths if path.steps > done + 1] or [paths[0]]
        return [
            self._shortened(path, min(done, path.steps - 1), start, renewed, new_landmark)
            for path in left
        ]

    def _shortened(self, path, done, start, renewed, new_landmark):
        """From the estimate to the state after those done and on, or past new poses."""
        poses = np.concatenate([start[None], path.poses[done + 1 :]])
        noise = path.motion_covariances[done:].copy()
        noise[0] = noise[0] * 1.7
        if renewed:
            poses[1:] = [nudged(self.generator, pose) for pose in poses[1:]]
        seen = [replace(o, step=o.step - done) for o in path.observations if o.step > done]
        if new_landmark and path.observations:
            extra = path.observations[-1]  # a landmark that was not seen from here before
            seen.append(replace(extra, step=1))
        return CandidatePath(
            robot=path.robot, poses=poses, times_s=np.arange(float(len(poses))) * 7.0,
            motion_covariances=noise, vertices=(-1, *path.vertices[done + 1 :]),
            observations=tuple(seen),
        )  # fmt: skip

    def announced(self, robot):
        """A path of each other robot."""
        return {
            name: paths[int(self.generator.integers(len(paths)))]
            for name, paths in self.candidates.items()
            if name != robot
        }


def agree(problem, robot, candidates, turns, memory):
    """Play turns beside the oracle and beside an engine that carries nothing; the reports."""
    oracle, plain = FromScratch("qr"), ENGINE.start(problem, robot, candidates)
    state, chosen = oracle.start(problem, robot, candidates), memory
    reports = []
    for announced in turns:
        memory, found = ENGINE.evaluate(memory, announced)
        plain, without = ENGINE.evaluate(plain, announced)
        state, exact = oracle.evaluate(state, announced)
        chosen, choice = ENGINE.choose(chosen, announced, 0)
        np.testing.assert_allclose(found.terms, exact.terms, rtol=TOLERANCE)
        np.testing.assert_allclose(found.terms, without.terms, rtol=TOLERANCE)
        assert choice.index == exact.best
        np.testing.assert_allclose(choice.value, exact.values.min(), rtol=TOLERANCE)
        assert without.report.segments_reused == without.report.segments_rebuilt == 0
        reports.append(found.report)
    return memory, reports


def segments_by_hand(problem, candidates):
    """Distinct segments by what they hold, found without the engine: each a tuple of steps."""
    found = set()
    for path in candidates:
        seen = [
            sorted(
                (o.landmark, o.sensor, o.covariance.tobytes())
                for o in path.observations
                if o.step == s
            )
            for s in range(1, path.steps + 1)
        ]
        others = [p for p in problem.past_states if p.state.robot != path.robot]
        for number, model in enumerate(problem.multi_robot):
            if model.include_past:
                for step in range(1, path.steps + 1):
                    for p in others:
                        order = sorted(
                            (path.state(step), p.state), key=lambda s: problem.robots.index(s.robot)
                        )
                        if model.joins(*order):
                            seen[step - 1].append((p.key, number, b""))
        keys = [{name[0] for name in here} for here in seen]
        free = [
            i for i in range(path.steps)
            if not set().union(*keys[:i]) & set().union(*keys[i:])
        ]  # fmt: skip
        for begin, end in pairwise([*free, path.steps]):
            found.add(
                tuple(
                    (
                        path.poses[i].tobytes(), path.poses[i + 1].tobytes(),
                        path.motion_covariances[i].tobytes(), tuple(seen[i]),
                    )
                    for i in range(begin, end)
                )
            )  # fmt: skip
    return found


OPTIONS = [
    {"kind": "relative_pose", "radius_m": 300.0},
    {"kind": "relative_pose", "shared_vertices": False, "full_motion_noise": True},
    {"kind": "range", "radius_m": 200.0, "prior_sigma": 1e-6},
    {"kind": None, "correlated": True, "prior_sigma": 100.0},
    {"kind": "bearing_range", "planar": False, "steps": (4, 6), "robots": 2},
    {"kind": "full_relative_pose", "past": 0, "landmarks": 10, "robots": 4},
]  # fmt: skip


@settings(max_examples=14)
@given(
    seed=st.integers(0, 2**20),
    options=st.sampled_from(OPTIONS),
    share_moved=st.sampled_from([0.0, 0.3, 1.0]),
    new_landmark=st.booleans(),
)
def test_sessions_that_carry_agree_with_qr(seed, options, share_moved, new_landmark):
    mission = Mission(seed, **options)
    carried, before = {}, {}
    for session in range(3):
        problem = mission.problem
        for robot in problem.robots[:2]:
            candidates = mission.candidates[robot]
            memory = ENGINE.start(problem, robot, candidates, carried.get(robot))
            turns = [mission.announced(robot), mission.announced(robot)]
            memory, (first, second) = agree(problem, robot, candidates, turns, memory)
            now = segments_by_hand(problem, candidates)
            assert first.segments_reused + first.segments_rebuilt == (len(now) if session else 0)
            assert second.segments_reused == second.segments_rebuilt == 0  # told once
            if session and share_moved == 0.0:
                assert first.segments_reused == len(now & before[robot])
            carried[robot], before[robot] = ENGINE.carry(memory), now
        mission.move(share_moved, new_landmark)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_moved_everything_reused(seed):
    problem, paths = scene(seed)
    robot = problem.robots[0]
    memory = ENGINE.start(problem, robot, paths[robot])
    others = {name: paths[name][0] for name in problem.robots[1:]}
    after, plain = ENGINE.evaluate(memory, others)
    carried = ENGINE.carry(after)
    again, found = ENGINE.evaluate(ENGINE.start(problem, robot, paths[robot], carried), others)
    distinct = len(segments_by_hand(problem, paths[robot]))
    assert (found.report.segments_reused, found.report.segments_rebuilt) == (distinct, 0)
    np.testing.assert_allclose(found.terms, plain.terms, rtol=1e-11)
    # what is carried depends on prior and candidates alone, however often it is carried on
    for memory_now in (memory, again):
        same = ENGINE.carry(memory_now)
        assert same.places == carried.places
        assert same.keys == carried.keys
        assert all(np.array_equal(a, b) for a, b in zip(same.pool, carried.pool, strict=True))


@pytest.mark.parametrize("seed", range(4))
def test_segments_that_see_a_landmark_that_moved_are_rebuilt(seed):
    problem, paths = scene(seed, steps=(8, 12), shared_vertices=False, kind=None)
    robot = problem.robots[0]
    counts = segments_by_hand(problem, paths[robot])
    seen = {o.landmark for path in paths[robot] for o in path.observations}
    carried = ENGINE.carry(ENGINE.start(problem, robot, paths[robot]))
    for landmark in sorted(seen):
        values = gtsam.Values(problem.prior.values)
        values.update(landmark, values.atPoint2(landmark) + np.array([0.5, -0.25]))
        moved = replace(problem, prior=Belief(problem.prior.graph, values))
        memory = ENGINE.start(moved, robot, paths[robot], carried)
        _, (report,) = agree(moved, robot, paths[robot], [{}], memory)
        touched = [s for s in counts if any(landmark == o[0] for step in s for o in step[3])]
        assert report.segments_rebuilt == len(touched) > 0
        assert report.segments_reused == len(counts) - len(touched) > 0


def test_a_tail_is_reused_whatever_its_step_and_time():
    """Without landmarks each step is a segment: all but the first motion of the kept paths."""
    problem, paths = scene(3, landmarks=0, past=0, shared_vertices=False)
    robot = problem.robots[0]
    mission = Mission(3, landmarks=0, past=0, shared_vertices=False)
    carried = ENGINE.carry(ENGINE.start(problem, robot, paths[robot]))
    mission.move(renewed=None)
    candidates = mission.candidates[robot]
    memory = ENGINE.start(mission.problem, robot, candidates, carried)
    turns = [mission.announced(robot)]
    _, (report,) = agree(mission.problem, robot, candidates, turns, memory)
    assert report.segments_rebuilt == len(candidates)
    assert report.segments_reused == sum(path.steps - 1 for path in candidates)


def test_other_robots_other_noise_and_other_sensors_find_nothing():
    problem, paths = scene(0, kind=None)
    robot, other = problem.robots[:2]
    others = ENGINE.carry(ENGINE.start(problem, other, paths[other]))
    own = ENGINE.carry(ENGINE.start(problem, robot, paths[robot]))
    noisy = [
        replace(path, motion_covariances=np.asarray(path.motion_covariances) * 1.001)
        for path in paths[robot]
    ]
    for candidates, carried in ((paths[robot], others), (noisy, own)):
        memory = ENGINE.start(problem, robot, candidates, carried)
        _, (report,) = agree(problem, robot, candidates, [{}], memory)
        assert report.segments_reused == 0
        assert report.segments_rebuilt == len(segments_by_hand(problem, candidates))

    # a sensor with another model under the old name: its observations are linearised anew

    class Skewed(BearingRangeSensor):
        def jacobians(self, pose, target):
            by_pose, by_target = super().jacobians(pose, target)
            return 1.5 * by_pose, 1.5 * by_target

    lidar = Skewed(bearing_sigma_rad=0.02, range_sigma_m=2.0)
    changed = replace(problem, sensors={**problem.sensors, "lidar": lidar})
    with_old = ENGINE.start(changed, robot, paths[robot], own)
    without = ENGINE.start(changed, robot, paths[robot])
    assert all(np.array_equal(a, b) for a, b in zip(with_old.fixed, without.fixed, strict=True))
    assert not np.array_equal(
        with_old.fixed.own, ENGINE.start(problem, robot, paths[robot]).fixed.own
    )


def test_lost_digits_are_carried_with_their_flag():
    """Bearing to 1e-7 rad beside range to 100 m: D has full rank, but no good triangle."""
    problem, paths = scene(5, kind=None, shared_vertices=False)
    robot = problem.robots[0]
    candidates = [
        replace(
            path,
            observations=tuple(
                replace(o, sensor="lidar", covariance=np.diag([1e-14, 1e4]))
                for o in path.observations
            ),
        )
        for path in paths[robot]
    ]  # fmt: skip
    plain, first = ENGINE.evaluate(ENGINE.start(problem, robot, candidates), {})
    memory = ENGINE.start(problem, robot, candidates, ENGINE.carry(plain))
    _, found = ENGINE.evaluate(memory, {})
    assert found.report.fallbacks == first.report.fallbacks > 0
    assert np.array_equal(found.terms, first.terms)  # both by QR


def test_terms_before_the_end_use_segments_up_to_the_cut():
    def make(robots, _):
        terms = [UncertaintyTerm(of=PosesOf((r,)), read=(1, 3, 4, 6)) for r in robots]
        return Objective(
            (*terms, UncertaintyTerm(of=PosesOf(robots), read="arrival", arrival_of="robot1"))
        )

    problem, paths = scene(7, objective=make)
    robot = problem.robots[0]
    carried = ENGINE.carry(ENGINE.start(problem, robot, paths[robot]))
    memory = ENGINE.start(problem, robot, paths[robot], carried)
    others = [{name: paths[name][k] for name in problem.robots[1:]} for k in (0, 1)]
    _, reports = agree(problem, robot, paths[robot], others, memory)
    assert reports[0].segments_reused > 0


def test_numbers_may_grow_under_carried_segments():
    problem, paths = scene(2, robots=2, correlated=True)
    robot, other = problem.robots
    carried = ENGINE.carry(ENGINE.start(problem, robot, paths[robot]))
    memory = ENGINE.start(problem, robot, paths[robot], carried)
    start = problem.prior.pose(problem.start_keys[other])
    size = FIRST_CAPACITY + 6
    poses = np.array([compose(start, np.array([3.0 * i, 0.0, 0.0])) for i in range(size)])
    poses[0] = start
    long = CandidatePath(
        robot=other, poses=poses, times_s=np.arange(float(size)),
        motion_covariances=np.tile(np.diag([0.1, 0.1, 1e-4]), (size - 1, 1, 1)),
    )  # fmt: skip
    turns = [{other: paths[other][0]}, {other: long}]
    memory, reports = agree(problem, robot, paths[robot], turns, memory)
    assert reports[0].segments_reused > 0
    again = ENGINE.start(problem, robot, paths[robot], ENGINE.carry(memory))
    _, found = ENGINE.evaluate(again, {})
    assert found.report.segments_rebuilt == 0


def test_memory_that_is_carried_is_bounded():
    problem, paths = scene(1)
    robot = problem.robots[0]
    memory = ENGINE.start(problem, robot, paths[robot])
    whole = ENGINE.carry(memory)
    known = []
    for bound in (0, whole.bytes // 4, whole.bytes // 2, whole.bytes + 200):
        engine = Incremental(memory_bytes=bound)
        carried = engine.carry(memory)
        assert carried.bytes <= bound + 200  # pointers of an empty table
        _, found = ENGINE.evaluate(ENGINE.start(problem, robot, paths[robot], carried), {})
        assert found.report.segments_reused == len(carried.places)
        known.append(len(carried.places))
        started = engine.start(problem, robot, paths[robot], whole)
        assert (started.carried is None) == (bound < whole.bytes)
        np.testing.assert_allclose(
            engine.evaluate(started, {})[1].terms, found.terms, rtol=TOLERANCE
        )
    assert known == sorted(known)
    assert known[0] == 0
    assert known[-1] == len(whole.places)


@pytest.mark.parametrize("with_carried", [False, True])
@pytest.mark.parametrize("kind", ["relative_pose", None])
def test_candidates_are_replaced_without_losing_the_others(kind, with_carried):
    """An obstacle blocks candidates 1 and 2; two new ones go round it."""
    problem, paths = scene(4, candidates=6, landmarks=8, kind=kind)
    robot = problem.robots[0]
    old, new = paths[robot][:4], paths[robot][4:]
    carried = ENGINE.carry(ENGINE.start(problem, robot, old)) if with_carried else None
    turns = [{name: paths[name][k] for name in problem.robots[1:]} for k in (0, 1)]
    memory, before = ENGINE.evaluate(ENGINE.start(problem, robot, old, carried), turns[0])
    memory = ENGINE.replace_candidates(memory, (0, 3), new)
    after, found = ENGINE.evaluate(memory, turns[0])
    report = found.report
    assert (report.messages_reused, report.messages_rebuilt, report.solves) == (2, 2, 2)
    assert report.impacted == ()
    assert np.array_equal(found.terms[:2], before.terms[[0, 3]])
    distinct = segments_by_hand(problem, old), segments_by_hand(problem, new)
    if with_carried:
        assert report.segments_reused == len(distinct[0] & distinct[1])
        assert report.segments_rebuilt == len(distinct[1] - distinct[0])
    agree(problem, robot, [old[0], old[3], *new], [turns[0], turns[1], {}], memory)
    # announced anew at once: kept messages are used where no factor changed
    _, both = ENGINE.evaluate(memory, turns[1])
    if kind is None:
        assert both.report.messages_reused == 2
    # none kept, and all kept
    agree(problem, robot, new, turns, ENGINE.replace_candidates(after, (), new))
    everything = [old[0], old[3], *new, old[1]]
    agree(problem, robot, everything, turns, ENGINE.add_candidates(after, [old[1]]))


def test_what_is_kept_must_be_told_in_order():
    problem, paths = scene(0)
    memory = ENGINE.start(problem, "robot0", paths["robot0"])
    for kept in ((1, 0), (0, 0), (-1,), (4,)):
        with pytest.raises(InvalidInputError, match="increasing numbers from 0 to 3"):
            ENGINE.replace_candidates(memory, kept, paths["robot0"][:1])
    with pytest.raises(NoCandidatePathError, match="robot0"):
        ENGINE.replace_candidates(memory, (), ())
    with pytest.raises(InvalidInputError, match="robot1"):
        ENGINE.replace_candidates(memory, (0,), paths["robot1"])


def test_a_team_carries_what_its_evaluators_know():
    mission = Mission(6, past=0, shared_vertices=False)
    first = coordinate(mission.problem, mission.candidates)
    assert list(first.evaluator_states) == list(mission.candidates)
    carried = {r: ENGINE.carry(state) for r, state in first.evaluator_states.items()}
    mission.move(share_moved=0.0)
    runs = {
        name: coordinate(mission.problem, mission.candidates, name, carried=carried)
        for name in ("incremental", "from_scratch")
    }
    plain = coordinate(mission.problem, mission.candidates)
    assert runs["incremental"].chosen == runs["from_scratch"].chosen == plain.chosen
    np.testing.assert_allclose(runs["incremental"].values, plain.values, rtol=TOLERANCE)
    for robot in mission.candidates:
        reports = [
            r.decision.report
            for r in runs["incremental"].records
            if r.robot == robot and r.decision
        ]
        assert (sum(report.segments_reused for report in reports) > 0) == (robot != "robot0")
    assert "Memory" not in repr(first)
    with pytest.raises(UnknownNameError, match="carried: robot 'nobody'"):
        coordinate(mission.problem, mission.candidates, carried={"nobody": None})
