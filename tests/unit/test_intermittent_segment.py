"""Algorithms 1, 2, 3 and 6: steering, goal set, whole paths, fallbacks."""

import os
import subprocess
import sys
from ast import literal_eval

import numpy as np
import pytest
from example_counts import FEWER
from hypothesis import given, settings
from hypothesis import strategies as st
from intermittent_scenes import block_model, estimate_of, room, segment_problem

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.geodesic_way import geodesic_cells, geodesic_way, walk
from fgplan.planners.intermittent.joint_tree import JointTree
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.segment import (
    algebraic_connectivity,
    draw_samples,
    grow_tree,
    meeting_nodes,
    plan_segment,
    stretched,
)
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.planners.intermittent.tree_kernels import arrive, steer
from roadmaps import Workspace, sample_positions

SYNCS = ["slowdown", "strict", "relaxed"]


def drawn_problem(seed, bodies=2):
    """Random starts in the room, at random times."""
    generator = np.random.default_rng(seed)
    model = block_model(bodies)
    starts = sample_positions(model.workspace, bodies, generator)
    return segment_problem(model, starts, generator.integers(0, 30, bodies))


def assert_path_is_sound(problem, options, segment):
    """Speed, obstacles and bounds along every step, and the meeting at its end."""
    ends = []
    for start, time, places in zip(problem.starts, problem.times, segment.places, strict=True):
        assert len(places) == segment.end - time + 1
        np.testing.assert_array_equal(places[0], start)
        steps = np.hypot(*np.diff(places, axis=0).T)
        assert (steps <= options.step_m * (1 + 1e-9)).all()
        free = problem.workspace.are_motions_valid(places[:-1], places[1:])
        assert free.all() or len(places) == 1
        ends.append(places[-1])
    if problem.meets:
        assert algebraic_connectivity(np.array(ends), options.range_m) > 1e-9


@given(st.integers(0, 10_000), st.sampled_from(SYNCS), st.integers(1, 4))
def test_steering_never_increases_the_delay(seed, sync, bodies):
    problem = drawn_problem(seed, bodies)
    options = SegmentOptions(samples=25, explore=20, sync=sync, epsilon_m=0.7)
    grown = JointTree(problem, options)
    tree, space = grown.tree, grown.space
    position, time = np.zeros((bodies, 2)), np.zeros(bodies, dtype=np.int64)
    for wanted in draw_samples(problem, options, np.random.default_rng(seed)):
        for origin in range(0, grown.count, 5):
            if steer(tree, space, origin, wanted, 7, position):
                arrive(tree, space, origin, position, time)
                assert np.ptp(time) <= np.ptp(tree.time[origin])
                assert (time >= tree.time[origin]).all()
                ways = np.linalg.norm(position - tree.position[origin], axis=1)
                assert (ways <= 0.7 + 1e-9).all()
                assert (ways <= 0.1 * (time - tree.time[origin]) + 1e-9).all()
                if sync != "slowdown":  # full speed, to the step
                    assert (np.ceil(ways / 0.1 - 1e-9) == time - tree.time[origin]).all()
        grown.extend(wanted)


def test_steering_by_hand():
    problem = segment_problem(block_model(2), [(1, 1), (2, 1)], [0, 3])
    position, time = np.zeros((2, 2)), np.zeros(2, dtype=np.int64)
    wanted = np.array([(1.0, 3.0), (2.0, 3.5)])
    for sync in SYNCS:
        grown = JointTree(problem, SegmentOptions(samples=1, sync=sync, epsilon_m=0.5))
        # Five steps for the earlier body; the later one, three steps ahead, takes two.
        assert steer(grown.tree, grown.space, 0, wanted, 5, position)
        np.testing.assert_allclose(position, [(1.0, 1.5), (2.0, 1.2)], rtol=1e-12)
        arrive(grown.tree, grown.space, 0, position, time)
        assert time.tolist() == [5, 5]
    # A body with more lead than a whole step stays.
    later = segment_problem(block_model(2), [(1, 1), (2, 1)], [0, 9])
    grown = JointTree(later, SegmentOptions(samples=1, sync="strict", epsilon_m=0.5))
    assert steer(grown.tree, grown.space, 0, wanted, 5, position)
    np.testing.assert_allclose(position, [(1.0, 1.5), (2.0, 1.0)], rtol=1e-12)
    arrive(grown.tree, grown.space, 0, position, time)
    assert time.tolist() == [5, 9]


@pytest.mark.parametrize("sync", SYNCS)
@pytest.mark.parametrize("bodies", [2, 3])
def test_goal_nodes_are_connected_and_simultaneous_and_whole_paths_sound(sync, bodies):
    met = 0
    for seed in range(3):
        problem = drawn_problem(seed, bodies)
        options = SegmentOptions(samples=250, explore=120, sync=sync)
        grown = grow_tree(problem, options, np.random.default_rng(seed))
        meets, simultaneous, _ = meeting_nodes(grown)
        for node in np.flatnonzero(meets):
            met += 1
            places = grown.tree.position[node]
            assert algebraic_connectivity(places, options.range_m) > 1e-9
            assert sync == "relaxed" or np.ptp(grown.tree.time[node]) <= 1e-9
            assert sync == "relaxed" or simultaneous[node]
        for node in range(1, grown.count):
            parent = grown.tree.parent[node]
            # Equal only where the earliest body of an unsynchronised parent stays.
            assert grown.tree.cost[node] >= grown.tree.cost[parent]
            ways = grown.tree.position[node] - grown.tree.position[parent]
            steps = grown.tree.time[node] - grown.tree.time[parent]
            assert (np.hypot(*ways.T) <= options.step_m * steps + 1e-9).all()
            np.testing.assert_allclose(
                grown.tree.travelled[node],
                grown.tree.travelled[parent] + np.hypot(*ways.T),
                rtol=1e-12,
            )
        segment = plan_segment(problem, options, np.random.default_rng(seed))
        assert_path_is_sound(problem, options, segment)
        if not segment.failed:
            assert segment.rank >= 0
    assert met > 0


@pytest.mark.parametrize("sync", ["strict", "slowdown"])
def test_rewiring_keeps_simultaneous_nodes_simultaneous_and_times_those_of_the_path(sync):
    problem = drawn_problem(2)
    options = SegmentOptions(samples=250, explore=150, sync=sync)
    grown = JointTree(problem, options)
    tree = grown.tree
    was, parents, rewired = np.zeros(0, dtype=bool), np.zeros(0, dtype=int), 0
    for wanted in draw_samples(problem, options, np.random.default_rng(2)):
        grown.extend(wanted)
        now = np.ptp(tree.time[: grown.count], axis=1) == 0
        assert now[: len(was)][was].all()
        changed = tree.parent[: len(parents)] != parents
        assert (was | ~changed).all()  # only simultaneous nodes are rewired
        rewired += int(changed.sum())
        was, parents = now, tree.parent[: grown.count].copy()
    assert rewired > 0
    time = np.zeros(2, dtype=np.int64)
    for node in range(1, grown.count):
        arrive(tree, grown.space, int(parents[node]), tree.position[node], time)
        np.testing.assert_array_equal(time, tree.time[node])


def test_limit_of_the_most_uncertain_target_holds_at_the_end():
    problem = segment_problem(block_model(2), [(8, 1), (9, 1)], [0, 0])
    grown = grow_tree(problem, SegmentOptions(), np.random.default_rng(0))
    rows = np.flatnonzero(meeting_nodes(grown)[0])
    # Target 0 has the largest variance, 0.3 and more.
    values = np.array([problem.model.uncertainties(grown.tree.covariance[v])[0] for v in rows])
    cheapest = int(rows[np.argmin(grown.tree.cost[rows])])
    limit = 0.5 * (values.min() + problem.model.uncertainties(grown.tree.covariance[cheapest])[0])
    good = rows[values <= limit]
    assert cheapest not in good  # so the limit decides
    options = SegmentOptions(delta=float(limit))
    segment = plan_segment(problem, options, np.random.default_rng(0))
    assert segment.at_first_attempt
    assert segment.target == 0
    assert segment.cost == min(grown.tree.cost[good])
    assert_path_is_sound(problem, options, segment)


def test_next_most_uncertain_target_is_tried_then_the_limit_is_dropped():
    start = estimate_of(3)
    # The first target cannot be seen from anywhere: it is out of range, above the room.
    mean = start.mean.copy()
    mean[2] = 30.0
    problem = segment_problem(
        block_model(2), [(1, 1), (1, 4)], [0, 5], Estimate(0, mean, start.covariance)
    )
    segment = plan_segment(problem, SegmentOptions(delta=0.05), np.random.default_rng(1))
    assert segment.rank > 0
    assert segment.target in (1, 2)
    assert segment.failed == ()
    assert not segment.at_first_attempt
    hopeless = plan_segment(problem, SegmentOptions(delta=1e-9), np.random.default_rng(1))
    assert hopeless.failed == ("uncertainty",)
    assert_path_is_sound(problem, SegmentOptions(), hopeless)


def test_a_team_that_finds_no_connected_node_meets_all_the_same():
    problem = segment_problem(block_model(3), [(1, 1), (9, 1), (1, 9)], [0, 40, 3])
    options = SegmentOptions(samples=3, explore=3)
    segment = plan_segment(problem, options, np.random.default_rng(0))
    assert "connection" in segment.failed
    assert np.isnan(segment.cost)
    assert_path_is_sound(problem, options, segment)


def test_least_travel_takes_the_place_of_the_limit():
    problem = segment_problem(block_model(2), [(1, 1), (1.1, 1)], [0, 0])
    options = SegmentOptions(goal="travel", travel_m=3.0)
    segment = plan_segment(problem, options, np.random.default_rng(0))
    assert segment.failed == ()
    for places in segment.places:
        assert np.hypot(*np.diff(places, axis=0).T).sum() >= 3.0 - 1e-9
    assert_path_is_sound(problem, options, segment)
    far = SegmentOptions(goal="travel", travel_m=300.0)
    assert plan_segment(problem, far, np.random.default_rng(0)).failed == ("travel",)


def test_robots_that_cannot_reach_each_other_are_told_apart():
    world = Workspace(
        lower=[0, 0], upper=[10, 10], obstacles=[[(4, -1), (5, -1), (5, 11), (4, 11)]]
    )
    blocks = block_model(2)
    problem = SegmentProblem(
        workspace=world,
        model=blocks,
        estimate=estimate_of(3),
        starts=np.array([(1.0, 1.0), (9.0, 1.0)]),
        times=np.array([0, 0]),
    )
    with pytest.raises(NoCandidatePathError, match="apart"):
        plan_segment(problem, SegmentOptions(samples=5), np.random.default_rng(0))


def test_formation_needs_no_meeting_and_keeps_its_shape_free():
    blocks = block_model(2)
    offsets = np.array([(-0.5, 0.0), (0.5, 0.0)])
    problem = segment_problem(
        blocks,
        [(2.0, 2.0)],
        [0],
        carriers=np.array([0, 1]),
        bodies=np.array([0, 0]),
        offsets=offsets,
        meets=False,
    )
    options = SegmentOptions(samples=200, explore=200, delta=0.05)
    segment = plan_segment(problem, options, np.random.default_rng(0))
    assert segment.failed == ()
    for offset in offsets:
        places = segment.places[0] + offset
        assert problem.workspace.are_motions_valid(places[:-1], places[1:]).all()
    grown = grow_tree(problem, options, np.random.default_rng(0))
    ends = grown.tree.position[1 : grown.count, 0]
    begins = grown.tree.position[grown.tree.parent[1 : grown.count], 0]
    for offset in offsets:
        assert problem.workspace.are_motions_valid(begins + offset, ends + offset).all()
    # A single robot at the centre would have gone nearer to the wall.
    assert np.abs(ends[:, 0] - 4.2).min() < 1.2


@given(st.integers(0, 10_000))
def test_samples_are_free_then_about_meeting_places(seed):
    problem = drawn_problem(3)
    options = SegmentOptions(samples=200, explore=100)
    samples = draw_samples(problem, options, np.random.default_rng(seed))
    assert room().are_positions_valid(samples[:100].reshape(-1, 2)).all()
    gaps = np.linalg.norm(samples[100:, 0] - samples[100:, 1], axis=1)
    # Two normal draws of standard deviation 2 R = 0.4 m differ by 0.57 sqrt(pi / 2) = 0.71 m.
    assert 0.5 < gaps.mean() < 0.9
    np.testing.assert_array_equal(
        samples, draw_samples(problem, options, np.random.default_rng(seed))
    )


@given(st.integers(0, 10_000))
@settings(max_examples=FEWER)
def test_short_ways_are_free_and_end_together(seed):
    generator = np.random.default_rng(seed)
    world = room()
    grid = geodesic_cells(world)
    starts = sample_positions(world, 3, generator)
    end = sample_positions(world, 1, generator)[0]
    ways = [geodesic_way(grid, start, end) for start in starts]
    for way, start in zip(ways, starts, strict=True):
        assert world.are_motions_valid(way[:-1], way[1:]).all()
        np.testing.assert_array_equal(way[[0, -1]], [start, end])
        # Past the wall's upper end if need be; eight directions cost at most 8.3 %, and cells.
        over = [
            np.linalg.norm(corner - start) + np.linalg.norm(end - corner)
            for corner in np.array([(4.0, 6.0), (4.4, 6.0)])
        ]
        straight = world.are_motions_valid(start, end)[0]
        least = np.linalg.norm(end - start) if straight else max(over)
        assert np.hypot(*np.diff(way, axis=0).T).sum() <= 1.1 * least + 0.6
    times = generator.integers(0, 20, 3)
    last = max(int(t) + len(walk(way, 0.1)) - 1 for t, way in zip(times, ways, strict=True))
    last += int(generator.integers(0, 30))
    for places, time in zip(stretched(ways, times, last, 0.1), times, strict=True):
        assert len(places) == last - time + 1
        assert (np.hypot(*np.diff(places, axis=0).T) <= 0.1 + 1e-9).all()
        assert world.are_motions_valid(places[:-1], places[1:]).all()
        np.testing.assert_allclose(places[-1], end, rtol=1e-12)


_UNCOMPILED = """
import numpy as np
from intermittent_scenes import block_model, segment_problem
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.segment import grow_tree
problem = segment_problem(block_model(2), [(1, 1), (3, 2)], [0, 7])
tree = grow_tree(problem, SegmentOptions(samples=25, explore=15), np.random.default_rng(0)).tree
print(repr(tree.cost.tolist()), repr(tree.parent.tolist()))
"""


@pytest.mark.full
def test_kernels_give_the_same_tree_without_the_compiler():
    printed = []
    for disabled in ("0", "1"):
        done = subprocess.run(
            [sys.executable, "-c", _UNCOMPILED],
            env={
                **os.environ,
                "NUMBA_DISABLE_JIT": disabled,
                "PYTHONPATH": os.pathsep.join(sys.path),
            },
            capture_output=True,
            text=True,
            check=True,
        )
        printed.append(done.stdout)
    costs = [np.array(literal_eval(text.split("] [")[0] + "]")) for text in printed]
    # The compiler may fuse a product and a sum into one rounding.
    np.testing.assert_allclose(costs[0], costs[1], rtol=1e-12)
    assert printed[0].split("] [")[1] == printed[1].split("] [")[1]


def test_algebraic_connectivity_by_hand():
    # A chain of three: Laplacian eigenvalues 0, 1, 3.
    chain = np.array([(0.0, 0.0), (0.2, 0.0), (0.4, 0.0)])
    assert algebraic_connectivity(chain, 0.2) == pytest.approx(1.0, rel=1e-12)
    assert algebraic_connectivity(chain[[0, 2]], 0.2) == pytest.approx(0.0, abs=1e-12)
    assert algebraic_connectivity(chain[:1], 0.2) == np.inf


def test_options_and_problems_that_cannot_be_used_are_refused():
    for bad in (
        {"sync": "never"},
        {"goal": "none"},
        {"samples": 0},
        {"delta": 0.0},
        {"epsilon_m": 0.05},
        {"spread_m": -1.0},
        {"explore": 1.5},
    ):
        with pytest.raises(InvalidInputError):
            SegmentOptions(**bad)
    model = block_model(2)
    with pytest.raises(InvalidInputError, match="free space"):
        segment_problem(model, [(4.2, 1.0), (1.0, 1.0)], [0, 0])
    with pytest.raises(InvalidInputError, match="one start time a body"):
        segment_problem(model, [(1.0, 1.0), (2.0, 1.0)], [0, -1])
    with pytest.raises(InvalidInputError, match="a body of 0 to 1"):
        segment_problem(
            model, [(1.0, 1.0), (2.0, 1.0)], [0, 0], carriers=np.array([0]), bodies=np.array([2])
        )
