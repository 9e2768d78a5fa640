"""The pieces of the incremental evaluator, each against its definition."""

import os
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes

from fgplan.evaluation.incremental import prior_marginal
from fgplan.evaluation.incremental.candidate_table import tabulate
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.incremental.factor_blocks import merge, no_blocks, stack_rows
from fgplan.evaluation.incremental.prior_marginal import (
    eliminate_history,
    needed_keys,
    restrict,
)
from fgplan.evaluation.objective import Objective, PriorVariables, UncertaintyTerm
from fgplan.models.relative_pose import RelativePoseSensor

TESTS = Path(__file__).parents[1]


def rich_scene(seed=0, **options):
    settings = {"robots": 3, "landmarks": 6, "past": 3, "correlated": True} | options
    return scenes.random_scene(np.random.default_rng(seed), **settings)


def covariance_of(marginal):
    """Inverse of R'R."""
    half = np.linalg.inv(marginal.rows)
    return half @ half.T


def test_what_the_history_leaves_is_the_marginal():
    problem, _ = rich_scene()
    wide = eliminate_history(problem, ())
    assert wide.keys[:3] == tuple(problem.start_keys.values())
    assert set(wide.keys) == set(problem.prior.keys)
    np.testing.assert_allclose(
        covariance_of(wide), problem.prior.covariance(wide.keys), rtol=1e-9, atol=1e-12
    )
    assert np.array_equal(wide.offsets + wide.dims, np.cumsum(wide.dims))


@pytest.mark.parametrize("planar", [True, False])
def test_restriction_is_the_marginal_of_fewer_variables(planar):
    problem, _ = rich_scene(planar=planar)
    wide = eliminate_history(problem, ())
    starts = list(problem.start_keys.values())
    for keys in (starts, [*starts, scenes.landmark_key(4)], [scenes.landmark_key(1), starts[2]]):
        marginal = restrict(wide, keys)
        assert marginal.keys == tuple(keys)
        assert np.array_equal(marginal.rows, np.triu(marginal.rows))
        expected = problem.prior.covariance(keys)
        scale = np.sqrt(np.diag(expected))
        wrong = (covariance_of(marginal) - expected) / np.outer(scale, scale)
        assert np.abs(wrong).max() < 1e-9
    assert restrict(wide, wide.keys) is wide


def test_groups_are_the_connected_components_of_the_prior():
    problem, _ = rich_scene(correlated=False, landmarks=2)
    groups = dict(zip(*_keys_and_groups(problem), strict=True))
    starts = list(problem.start_keys.values())
    # landmark i is tied to robot i; nothing ties robots
    assert groups[starts[0]] == groups[scenes.landmark_key(0)]
    assert groups[starts[1]] == groups[scenes.landmark_key(1)]
    assert len({groups[key] for key in starts}) == 3
    together, _ = rich_scene(correlated=True, landmarks=2)
    assert len(set(_keys_and_groups(together)[1])) == 1


def _keys_and_groups(problem):
    marginal = eliminate_history(problem, ())
    return marginal.keys, marginal.groups.tolist()


def test_a_long_history_leaves_only_what_is_needed(monkeypatch):
    problem, _ = rich_scene()
    landmark = scenes.landmark_key(5)
    term = UncertaintyTerm(of=PriorVariables((scenes.landmark_key(3),)))
    problem = replace(problem, objective=Objective((term,)))
    monkeypatch.setattr(prior_marginal, "KEPT_SCALARS", 5)
    kept = eliminate_history(problem, [landmark])
    expected = (*problem.start_keys.values(), scenes.landmark_key(3), landmark)
    assert kept.keys == expected == needed_keys(problem, [landmark])


def test_candidates_share_the_states_of_their_prefix():
    _, paths = rich_scene(steps=(4, 6))
    first = paths["robot0"][0]
    poses = first.poses.copy()
    poses[3:, :2] += 5.0
    branched = replace(first, poses=poses, length_m=-1.0)
    table = tabulate([first, branched, first])
    length = first.steps
    assert table.states.shape == (3, length)
    assert np.array_equal(table.states[0], table.states[2])
    assert np.array_equal(table.states[0, :2], table.states[1, :2])
    assert not set(table.states[0, 2:]) & set(table.states[1, 2:])
    assert len(table.poses) == len(table.counted) == 2 * length - 2
    assert np.array_equal(table.poses[table.states[1]], branched.poses[1:])
    assert [s.step for s in table.distinct()] == table.owner[:, 1].tolist()
    # another time, vertex or observation at the same pose is another state
    late = replace(first, times_s=first.times_s * 2.0)
    moved = replace(first, vertices=(-1, *range(50, 50 + length)))
    assert not set(tabulate([first, late]).states[0]) & set(tabulate([first, late]).states[1])
    assert not set(tabulate([first, moved]).states[0]) & set(tabulate([first, moved]).states[1])
    blind = replace(first, observations=())
    seeing_steps = {seen.step for seen in first.observations}
    assert seeing_steps
    both = tabulate([first, blind])
    differ = np.flatnonzero(both.states[0] != both.states[1]) + 1
    assert set(differ.tolist()) == seeing_steps
    assert both.counted.sum() == length


def test_shorter_paths_are_padded():
    _, paths = rich_scene(steps=(2, 7), candidates=8)
    table = tabulate(paths["robot1"])
    for place, path in enumerate(paths["robot1"]):
        assert table.lengths[place] == path.steps
        assert (table.states[place, path.steps :] == -1).all()
        assert (table.states[place, : path.steps] >= 0).all()
        for step in range(path.steps):
            sensor = RelativePoseSensor(covariance=path.motion_covariances[step])
            early, late = sensor.linearise_between(path.poses[step], path.poses[step + 1])
            for block, expected in (
                (table.motion.late, late.T @ late),
                (table.motion.cross, late.T @ early),
                (table.motion.early, early.T @ early),
            ):
                np.testing.assert_allclose(
                    block[place, step], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
                )


def random_table(generator, counts, width=2, dim=3):
    """A table with given numbers of factors a state."""
    rows = [
        [
            (
                int(generator.integers(9)),
                generator.normal(size=(2, dim)),
                generator.normal(size=(2, width)),
            )
            for _ in range(count)
        ]
        for count in counts
    ]
    return stack_rows(rows, dim), rows


def test_blocks_are_products_of_rows():
    table, rows = random_table(np.random.default_rng(0), [2, 0, 3])
    assert table.pointer.tolist() == [0, 2, 2, 5]
    flat = [factor for state in rows for factor in state]
    for m, (variable, own, other) in enumerate(flat):
        assert (table.variable[m], table.rank[m]) == (variable, 2)
        np.testing.assert_allclose(table.own[m], own.T @ own, rtol=1e-14)
        np.testing.assert_allclose(table.cross[m, :2], other.T @ own, rtol=1e-14)
        np.testing.assert_allclose(table.other[m, :2, :2], other.T @ other, rtol=1e-14)
        assert not table.cross[m, 2:].any()
        assert not table.other[m, 2:].any()
        assert not table.other[m, :, 2:].any()


def test_merged_tables_hold_all_factors_by_state():
    generator = np.random.default_rng(1)
    tables = [random_table(generator, counts)[0] for counts in ([2, 0, 1], [0, 3, 1], [0, 0, 0])]
    merged = merge(tables)
    assert merged.pointer.tolist() == [0, 2, 5, 7]
    assert merged.bytes == sum(t.bytes for t in tables) - 2 * tables[0].pointer.nbytes
    for state in range(3):
        inside = slice(merged.pointer[state], merged.pointer[state + 1])
        for name in ("variable", "rank", "own", "cross", "other"):
            expected = [getattr(t, name)[t.pointer[state] : t.pointer[state + 1]] for t in tables]
            assert np.array_equal(getattr(merged, name)[inside], np.concatenate(expected))
    assert merge(tables[:1]) is tables[0]
    assert no_blocks(3, 3).bytes == 4 * 8


def test_memory_for_messages_is_bounded_and_told():
    problem, paths = rich_scene()
    turns = [{r: paths[r][k] for r in problem.robots[1:]} for k in (0, 1, 1, 0)]
    results = {}
    for bound in (0, 20_000, 32_000_000):
        engine = Incremental(memory_bytes=bound)
        memory = engine.start(problem, "robot0", paths["robot0"])
        results[bound] = []
        for announced in turns:
            memory, found = engine.evaluate(memory, announced)
            results[bound].append(found)
            assert sum(pool.bytes for pool in memory.pools) <= bound
            assert found.report.bytes_held == memory.bytes > 0
        assert (memory.pools == ()) == (bound < 32_000_000)  # 20 kB hold not even one pool
    held = {bound: found[-1].report.bytes_held for bound, found in results.items()}
    assert held[0] < held[32_000_000]
    for kept, dropped in zip(results[32_000_000], results[0], strict=True):
        assert np.array_equal(kept.terms, dropped.terms)


def test_messages_are_used_again_where_no_factor_changed():
    """Robot 2 is out of reach of robot 0, but the prior ties them: new S, old messages."""
    problem, paths = rich_scene(landmarks=0, past=0)
    model = problem.multi_robot[0]

    def not_first_with_third(first, second):
        return {first.robot, second.robot} != {"robot0", "robot2"}

    problem = replace(problem, multi_robot=(replace(model, criterion=not_first_with_third),))
    engine = Incremental()
    memory = engine.start(problem, "robot0", paths["robot0"])
    middle = {"robot1": paths["robot1"][0]}
    memory, first = engine.evaluate(memory, middle)
    memory, second = engine.evaluate(memory, {**middle, "robot2": paths["robot2"][0]})
    assert second.report.impacted == (0, 1, 2, 3)
    assert (second.report.messages_reused, second.report.messages_rebuilt) == (4, 0)
    assert second.report.solves == 4
    assert (first.values != second.values).all()


TINY = """
import sys
import numpy as np
import scenes
from fgplan.evaluation.incremental.evaluator import Incremental

problem, paths = scenes.random_scene(
    np.random.default_rng(5), robots=3, candidates=3, steps=(2, 3), landmarks=3, past=1,
    correlated=True, kind=sys.argv[1],
)
engine = Incremental()
memory = engine.start(problem, "robot0", paths["robot0"])
for k in (0, 1):
    announced = {name: paths[name][k] for name in problem.robots[1:]}
    before = memory
    memory, found = engine.evaluate(memory, announced)
    _, choice = engine.choose(before, announced, 1)
    print(*found.terms.ravel().tolist(), choice.index, choice.value)
"""


def in_another_process(program, *arguments, **environment):
    """Standard output of a Python program that sees the tests' folder."""
    path = os.pathsep.join([str(TESTS), str(TESTS.parent)])
    fixed = {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, **fixed, **environment},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("kind", ["relative_pose", "bearing_range"])
def test_kernels_give_the_same_values_uncompiled(kind):
    """1e-12: compiled sums are reassociated."""
    compiled, plain = (
        np.array(in_another_process(TINY, kind, NUMBA_DISABLE_JIT=flag).split(), float)
        for flag in ("0", "1")
    )
    assert compiled.size > 30
    np.testing.assert_allclose(plain, compiled, rtol=1e-12)


LARGE = """
import resource
import numpy as np
import gtsam
from dataclasses import replace
import scenes
from fgplan.beliefs.belief import Belief
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath

generator = np.random.default_rng(0)
robots = [f"r{i}" for i in range(16)]
graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([1e-3, 1e-3, 1e-4]))
poses = [np.array([*generator.uniform(0, 2000, 2), 0.0]) for _ in robots]
for i, pose in enumerate(poses):
    values.insert(i, gtsam.Pose2(*pose))
    graph.add(gtsam.PriorFactorPose2(i, gtsam.Pose2(*pose), noise))
model = scenes.multi_robot_model(generator, "relative_pose", 300.0, True)
problem = PlanningProblem(
    prior=Belief(graph, values), start_keys={r: i for i, r in enumerate(robots)},
    objective=length_and_uncertainty(tuple(robots)), multi_robot=(model,),
)

def paths(i):
    for _ in range(50):
        there = np.array([2000.0, 2500.0]) - poses[i][:2]
        way = np.linspace(poses[i][:2], there, 20) + generator.normal(0, 60, (20, 2))
        way[0] = poses[i][:2]
        step = np.diff(way, axis=0)
        headings = np.concatenate([[0.0], np.arctan2(step[:, 1], step[:, 0])])
        yield CandidatePath(
            robot=robots[i], poses=np.column_stack([way, headings]), times_s=np.arange(20.0) * 10,
            motion_covariances=np.tile(np.diag([1.0, 1.0, 1e-4]), (19, 1, 1)),
        )

candidates = {r: list(paths(i)) for i, r in enumerate(robots)}
engine = Incremental()
memories = {r: engine.start(problem, r, candidates[r]) for r in robots}
announced = {r: options[0] for r, options in candidates.items()}
largest = 0
for _ in range(2):
    for r in robots:
        memories[r], found = engine.evaluate(memories[r], announced)
        assert np.isfinite(found.values).all()
        largest = max(largest, found.report.bytes_held)
        announced[r] = candidates[r][found.best]
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, largest)
"""


@pytest.mark.full
def test_sixteen_robots_with_fifty_candidates_each_stay_below_a_gigabyte():
    """Peak of a process that holds the memories of all sixteen, two rounds; ru_maxrss in KiB."""
    peak, largest = map(int, in_another_process(LARGE).split())
    unit = 1 if sys.platform == "darwin" else 1024
    assert peak * unit < 1_000_000_000
    assert 0 < largest < 100_000_000
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss >= peak
