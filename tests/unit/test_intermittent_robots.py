"""Algorithm 5: robots that meet, exchange everything, fuse late measurements and forget."""

import numpy as np
import pytest
from intermittent_scenes import (
    block_model,
    dense_estimate,
    dense_model,
    estimate_of,
    moving_targets,
    room,
)

from fgplan.bench.intermittent_scene import team_graph
from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.delay import team_delays
from fgplan.planners.intermittent.geodesic_way import geodesic_cells
from fgplan.planners.intermittent.meeting_points import plan_meeting_point
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.robot_state import TeamSetup, start_robot
from fgplan.planners.intermittent.schedule import make_schedule
from fgplan.planners.intermittent.segment import algebraic_connectivity
from fgplan.planners.intermittent.team_graph import propose_teams
from fgplan.planners.intermittent.team_run import Absence, first_legs, run_team
from fgplan.planners.intermittent.truth import draw_truth, expected_truth
from roadmaps import sample_positions

FULL = pytest.mark.full
# Fast robots: as much happens in a fifth of the steps.
OPTIONS = SegmentOptions(samples=60, explore=30, delta=0.05, step_m=0.5, range_m=0.3)


def small_team(graph, planner=plan_meeting_point, model=None, **kwargs):
    """A team in the room, its first legs, estimate and truth maker."""
    model = block_model(len(graph.robots)) if model is None else model
    setup = TeamSetup(
        schedule=make_schedule(graph),
        model=model,
        workspace=room(),
        grid=geodesic_cells(room(), 0.5),
        options=OPTIONS,
        planner=planner,
        **kwargs,
    )
    generator = np.random.default_rng(1)
    places = sample_positions(room(), len(graph.robots), generator)
    return setup, dict(zip(graph.robots, places, strict=True))


def run_small(graph, steps, seed=0, absences=(), **kwargs):
    """Run a team; returns setup, run and truth."""
    setup, starts = small_team(graph, **kwargs)
    start = estimate_of(3)
    truth = draw_truth(
        setup.model.hidden,
        start.mean,
        steps,
        setup.model,
        len(graph.robots),
        np.random.default_rng(seed),
    )
    legs = first_legs(setup, starts, start)
    return setup, run_team(setup, legs, start, truth, absences=absences), truth


def assert_checkpoints_and_logs_are_exact(setup, run):
    """What any robot knows is what was measured: a prefix of every log, nothing twice."""
    measured = {}
    for row, record in run.records:
        if record.readings:
            measured.setdefault(row, []).append(record)
    for state in run.robots:
        known = state.knowledge
        until = known.checkpoint.time
        if until:
            np.testing.assert_allclose(
                known.checkpoint.mean, run.everything.means[until - 1], rtol=1e-9, atol=1e-12
            )
        for row, log in enumerate(known.logs):
            heard = known.heard[row]
            wanted = [r for r in measured.get(row, []) if until < r.time <= heard]
            assert list(log) == wanted


def epochs_passed(state):
    """Time and epoch of a robot's meetings."""
    return [(record.time, record.epoch) for record in state.meetings]


def ages_of_news(setup, run):
    """Largest age, in epochs, of what a robot first heard at a meeting, by robot and time."""
    passed = {state.robot: epochs_passed(state) for state in run.robots}
    ages = {}
    for state in run.robots:
        before = np.zeros(len(setup.robots), dtype=int)
        for record in state.meetings:
            heard = np.array(record.heard)
            worst = 0
            for row in np.flatnonzero(heard > before):
                name = setup.robots[row]
                oldest = before[row] + 1  # first step that was new
                own = [epoch for time, epoch in passed[name] if time < oldest]
                worst = max(worst, record.epoch - max(own, default=0))
            before = heard
            ages[state.robot, record.time] = worst
    return ages


@pytest.mark.parametrize(
    "graph",
    [propose_teams(4), propose_teams(5, 3), team_graph("G2")],
    ids=["ring of 4", "threes of 5", "G2"],
)
def test_team_estimates_equal_the_global_one_up_to_the_bound(graph):
    setup, run, _ = run_small(graph, 220)
    schedule = setup.schedule
    assert all(record.complete for state in run.robots for record in state.meetings)
    assert all(record.time == record.due for state in run.robots for record in state.meetings)
    assert min(len(state.meetings) for state in run.robots) > schedule.delay_bound
    assert_checkpoints_and_logs_are_exact(setup, run)
    ages = ages_of_news(setup, run)
    assert 1 < max(ages.values()) <= schedule.delay_bound
    delays = {}
    for team in range(len(graph.teams)):
        delays |= {(team, one.time): one for one in team_delays(run, team)}
    assert len(delays) == len(run.snapshots)
    for snapshot in run.snapshots:
        delay = delays[snapshot.team, snapshot.time]
        assert delay.age_epochs == ages[snapshot.robot, snapshot.time]
        # t*: up to there the estimates are the same, in the step after it they differ.
        whole = run.everything.means[snapshot.begun : snapshot.time]
        gaps = np.linalg.norm(snapshot.filtered.means - whole, axis=1)
        same = delay.agrees_until - snapshot.begun
        assert (gaps[:same] <= 1e-9).all()
        assert same == len(gaps) or gaps[same] > 1e-9
        assert delay.error_m == (0.0 if same == len(gaps) else gaps[same:].mean())
        means = run.everything.means[snapshot.begun : snapshot.time]
        state = next(s for s in run.robots if s.robot == snapshot.robot)
        record = next(r for r in state.meetings if r.time == snapshot.time)
        until = record.complete_until - snapshot.begun
        np.testing.assert_allclose(
            snapshot.filtered.means[:until], means[:until], rtol=1e-9, atol=1e-12
        )
        # In epochs: everything measured before epoch k - D is here.
        for row, other in enumerate(run.robots):
            old = [
                t
                for t, epoch in epochs_passed(other)
                if epoch <= snapshot.epoch - schedule.delay_bound
            ]
            if old:
                assert record.heard[row] >= old[-1]


def test_plans_know_where_everybody_goes_until_it_starts():
    problems = []

    def plan(problem, options, generator):
        problems.append(problem)
        return plan_meeting_point(problem, options, generator)

    _, run, _ = run_small(propose_teams(4), 100, planner=plan)
    checked = 0
    for problem in problems:
        now = problem.estimate.time
        for body, robot in enumerate(problem.carriers):
            rows = np.arange(now, min(problem.times[body], 100) + 1)
            np.testing.assert_allclose(
                problem.tracks[rows - now, body], run.positions[rows, robot], atol=1e-12
            )
            checked += len(rows) > 5
    assert checked > 10


def test_positions_keep_speed_and_walls_and_teams_meet_in_range():
    setup, run, _ = run_small(propose_teams(4), 100)
    ways = np.diff(run.positions, axis=0)
    assert np.hypot(ways[..., 0], ways[..., 1]).max() <= 0.5 + 1e-9
    for row in range(4):
        places = run.positions[:, row]
        assert room().are_motions_valid(places[:-1], places[1:]).all()
    for snapshot in run.snapshots:
        rows = [setup.robots.index(r) for r in setup.schedule.graph.teams[snapshot.team]]
        places = run.positions[snapshot.time, rows]
        assert algebraic_connectivity(places, setup.options.range_m) > 0.0


def test_nothing_older_than_the_bound_is_stored():
    setup, run, _ = run_small(propose_teams(4), 400)
    bound = setup.schedule.delay_bound
    for state in run.robots:
        for record in state.meetings:
            # Remark III.5: what all had measured by epoch k - D has been dropped at epoch k.
            passed = [
                max((t for t, e in epochs_passed(one) if e <= record.epoch - bound), default=0)
                for one in run.robots
            ]
            assert record.checkpoint >= min(passed)
    epochs = [epoch for _, epoch in epochs_passed(run.robots[0])]
    assert max(epochs) > 4 * bound
    quarter = len(run.readings) // 4
    # The longest legs differ; a memory that grew would be three times larger at the end.
    assert run.readings[-quarter:].max() <= 1.5 * run.readings[quarter : 2 * quarter].max()


def drawn_absences(graph, seed):
    """Robots that stand still, blind and silent, at random times of the first 350 steps."""
    generator = np.random.default_rng(seed)
    absences = []
    for _ in range(6 + len(graph.robots)):
        start = int(generator.integers(10, 300))
        robot = graph.robots[int(generator.integers(len(graph.robots)))]
        absences.append(Absence(robot, start, start + int(generator.integers(1, 50))))
    return absences


RING, THREES, SECOND = propose_teams(4), propose_teams(5, 3), team_graph("G2")


# G2, 10: one comes just when another falls silent. Threes, 5: teams in each other's way.
@pytest.mark.parametrize(
    ("graph", "seed"),
    [
        pytest.param(RING, 1, id="ring"),
        pytest.param(THREES, 5, id="threes"),
        pytest.param(SECOND, 10, id="G2"),
        pytest.param(THREES, 1, id="threes, 1", marks=FULL),
        *(pytest.param(RING, seed, id=f"ring, {seed}", marks=FULL) for seed in (2, 3, 4)),
        *(pytest.param(SECOND, seed, id=f"G2, {seed}", marks=FULL) for seed in (3, 6, 7)),
    ],
)
def test_random_absences_lose_nothing_and_count_nothing_twice(graph, seed):
    absences = drawn_absences(graph, seed)
    setup, run, _ = run_small(graph, 800, seed, absences, wait_steps=6, recovery_steps=40)
    meetings = [record for state in run.robots for record in state.meetings]
    missed = [record for record in meetings if not record.complete]
    late = [record for record in meetings if record.complete and record.time > record.due]
    assert missed
    assert late or graph is THREES
    for record in missed:
        assert record.time >= record.due + 6
    ways = np.diff(run.positions, axis=0)
    assert np.hypot(ways[..., 0], ways[..., 1]).max() <= 0.5 + 1e-9
    for row in range(len(graph.robots)):
        places = run.positions[:, row]
        assert room().are_motions_valid(places[:-1], places[1:]).all()
    # Nobody goes to a meeting that is over; who wakes up in one leaves in the same step.
    woken = {(absence.robot, absence.end) for absence in absences}
    for state in run.robots:
        for record in state.meetings:
            assert record.time <= record.due + 6 or (state.robot, record.time) in woken
    assert_checkpoints_and_logs_are_exact(setup, run)
    # Long after the last absence everybody has what was measured in it.
    last = max(absence.end for absence in absences)
    assert min(state.knowledge.complete_until for state in run.robots) > last
    assert all(state.knowledge.discarded == 0 for state in run.robots)
    again = [record for record in meetings if record.time > 600 and record.complete]
    assert {record.team for record in again} == set(range(len(graph.teams)))


def test_a_robot_that_is_gone_is_waited_for_and_not_remembered_for_ever():
    graph = propose_teams(5)
    gone = (Absence("r2", 20, np.inf),)
    setup, run, _ = run_small(graph, 500, 0, gone, wait_steps=4, recovery_steps=20, gone_after=120)
    assert not any(
        record.complete
        for state in run.robots
        for record in state.meetings
        if record.time > 25 and "r2" in setup.schedule.graph.teams[record.team]
    )
    others = [state for state in run.robots if state.robot != "r2"]
    # Teams without it go on, and what they know is forgotten in time.
    met = [r for state in others for r in state.meetings if r.complete and r.time > 350]
    assert {record.team for record in met} == {2, 3, 4}
    for state in others:
        rows = [row for row, name in enumerate(setup.robots) if name != "r2"]
        assert state.knowledge.heard[rows].min() > 240
        assert state.knowledge.checkpoint.time > 160


def test_users_own_models_run_through_the_same_robots():
    graph = propose_teams(3)
    blocks = block_model(3)
    setup, starts = small_team(graph, model=blocks)
    dense_setup, _ = small_team(graph, model=dense_model(blocks))
    start = estimate_of(3)
    truth = draw_truth(blocks.hidden, start.mean, 40, blocks, 3, np.random.default_rng(0))
    ours = run_team(setup, first_legs(setup, starts, start), start, truth)
    dense = dense_estimate(start)
    theirs = run_team(dense_setup, first_legs(dense_setup, starts, dense), dense, truth)
    assert [r for r, _ in ours.records] == [r for r, _ in theirs.records]
    np.testing.assert_array_equal(ours.positions, theirs.positions)
    np.testing.assert_allclose(ours.everything.means, theirs.everything.means, rtol=1e-8, atol=1e-9)


def test_same_seed_same_run_and_planned_truth_has_no_surprise():
    graph = propose_teams(3)
    setup, starts = small_team(graph, planner=TeamSetup.__dataclass_fields__["planner"].default)
    start = estimate_of(3)
    truth = expected_truth(setup.model, start, 40, 3)
    runs = [run_team(setup, first_legs(setup, starts, start), start, truth) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].positions, runs[1].positions)
    np.testing.assert_allclose(runs[0].everything.means, truth.states[1:], rtol=1e-12)
    assert any(record.nodes > 10 for state in runs[0].robots for record in state.meetings)


def test_what_does_not_fit_is_refused():
    graph = propose_teams(3)
    setup, starts = small_team(graph)
    legs = first_legs(setup, starts, estimate_of(3))
    with pytest.raises(InvalidInputError, match="one initial path"):
        start_robot(setup, "r1", {}, estimate_of(3))
    assert start_robot(setup, "r1", legs["r1"], estimate_of(3)).phase == "moving"
    with pytest.raises(InvalidInputError, match="wait_steps"):
        small_team(graph, wait_steps=-1)
    with pytest.raises(InvalidInputError, match="start < end"):
        Absence("r1", 5, 5)


def test_targets_avoid_walls_and_bounds_and_who_is_free_moves_as_drawn():
    model, start = block_model(1), estimate_of(3)
    # Large steps: a metre is a common one.
    hidden = moving_targets(3, process=0.2)
    truths = [
        draw_truth(hidden, start.mean, 200, model, 1, np.random.default_rng(3), world)
        for world in (None, room())
    ]
    free, kept = (truth.states.reshape(201, 3, 3) for truth in truths)
    assert not room().are_motions_valid(free[:-1, 0, :2], free[1:, 0, :2]).all()
    for target in range(3):
        ways = kept[:, target, :2]
        assert room().are_motions_valid(ways[:-1], ways[1:]).all()
        assert (kept[:, target, 2] >= 0.0).all()
        assert (np.ptp(ways, axis=0) > 0.5).all()
    # Up to the first draw anew, nothing differs.
    first = int(np.flatnonzero((free != kept).any(axis=(1, 2)))[0])
    assert first > 0
    stays = room().are_motions_valid(free[first - 1, :, :2], free[first, :, :2])
    stays &= free[first, :, 2] >= 0.0
    assert not stays.all()
    np.testing.assert_array_equal(free[first, stays], kept[first, stays])
