"""The bench of distributed_aia runs and measures (its times are claimed by the bench itself)."""

import numpy as np
import pytest

from fgplan.bench import dense_reference
from fgplan.bench.dense_iteration import FORMS, iteration_times, ratios
from fgplan.bench.dense_reference import centralised_reference
from fgplan.bench.distributed_aia import (
    QUICK,
    TARGETS,
    bytes_a_sweep,
    exponent,
    make_growth,
    run,
)
from fgplan.bench.distributed_aia_scene import tzes_scene
from fgplan.errors import InvalidInputError
from fgplan.io.command import CommandOptions
from fgplan.planners.aia.arrays import prepare
from fgplan.planners.aia.options import tree_options
from fgplan.team.communication_graph import CommunicationGraph

NODE_BYTES = 26 + 24 * TARGETS


def test_quick_bench_measures_every_size():
    seen = []
    options = CommandOptions(quick=True, progress=lambda *told: seen.append(told))
    outcome = run(options)
    results = outcome.results
    assert results["robots"] == [10, 20, 40]
    assert results["degree"] == pytest.approx([5.6] * 3, abs=0.05)
    for name in ("iteration_us", "message_bytes", "robot_bytes"):
        assert len(results[name]) == 3
        assert min(results[name]) > 0.0
    assert results["of_degree"]["degree"][-1] == QUICK.team - 1
    assert len(results["of_degree"]["iteration_us"]) == len(QUICK.degrees)
    sent = np.array(results["robot_bytes"]) / results["message_bytes"]
    np.testing.assert_allclose(sent, results["degree"])
    assert [one.name for one in outcome.requirements] == ["exponent", "of_degree.iteration_us"]
    assert outcome.requirements[0].required == "at most 0.3"
    assert len(outcome.summary) == 8
    assert outcome.seeds == (0,)
    assert len(seen) == 1


def test_a_message_holds_the_nodes_of_a_sweep():
    growth = make_growth(4, np.inf, 0)
    assert growth.graph.average_degree() == 3.0
    before = sum(growth.nodes(row) for row in range(4))
    size = bytes_a_sweep(growth, 10)
    made = sum(growth.nodes(row) for row in range(4)) - before
    assert made > 30
    assert growth.sweep == 10
    envelope = size - made / 40 * NODE_BYTES
    assert 60.0 < envelope < 120.0, "names of the fields and lengths"


def test_exponent_is_the_slope_in_logarithms():
    sizes = [10, 20, 40]
    assert exponent(sizes, [3.0 * size**1.5 for size in sizes]) == pytest.approx(1.5)


def test_times_of_an_iteration_are_taken_in_every_form():
    problem = tzes_scene(4, 3, np.random.default_rng(0))
    graph = CommunicationGraph.complete([robot.name for robot in problem.robots])
    times = iteration_times(problem, graph, repeats=2, part_s=0.005)
    names = {f"{where}_{form}_us" for where in ("centralised", "distributed") for form in FORMS}
    assert set(times) == names
    assert min(times.values()) > 0.0
    found = ratios(times)
    assert list(found) == [f"ratio_{form}" for form in FORMS]
    assert found["ratio_seen"] == times["distributed_seen_us"] / times["centralised_seen_us"]
    assert times["distributed_block_us"] < times["distributed_seen_us"]
    some = iteration_times(problem, graph, forms=("block",), repeats=1, part_s=0.001)
    assert list(ratios(some)) == ["ratio_block"]


@pytest.mark.parametrize("form", [{}, {"every_row": True, "information_form": True}])
def test_the_centralised_form_changes_no_tree(form):
    problem = tzes_scene(3, 4, np.random.default_rng(2), range_m=3.0)
    options = tree_options("reproduction")
    prepared = prepare(problem, options)
    plain = centralised_reference(problem, options, prepared)
    other = centralised_reference(problem, options, prepared, one_by_one=True, **form)
    for tree in (plain, other):
        tree.run(40, np.random.default_rng(0), stop=False)
    assert len(plain.nodes) == len(other.nodes) > 30
    for a, b in zip(plain.nodes, other.nodes, strict=True):
        assert a.parent == b.parent
        np.testing.assert_array_equal(a.assigned, b.assigned)
        np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-9, atol=1e-12)


def test_references_outside_a_checkout_are_missed_by_name(monkeypatch, tmp_path):
    monkeypatch.setattr(dense_reference, "_FOLDER", tmp_path)
    problem = tzes_scene(1, 1, np.random.default_rng(0))
    options = tree_options("reproduction")
    with pytest.raises(InvalidInputError, match=r"aia_dense_reference\.py; run this"):
        centralised_reference(problem, options, prepare(problem, options))


def test_scene_is_drawn_from_its_seed_and_free():
    one, other = (tzes_scene(100, 20, np.random.default_rng(3), moving=True) for _ in range(2))
    starts = np.array([robot.pose for robot in one.robots])
    np.testing.assert_array_equal(starts, [robot.pose for robot in other.robots])
    np.testing.assert_array_equal(one.mean, other.mean)
    assert not one.fixed
    assert one.workspace.are_positions_valid(starts[:, :2]).all()
    assert np.ptp(starts[:, :2], axis=0).min() > 8.0
    assert set((2.0 * starts[:, 2] / np.pi).round(9)) == {-1.0, 0.0, 1.0, 2.0}
    assert one.robots[0].sensors[0].max_range_m == 1.0
    given = tzes_scene(
        2,
        3,
        np.random.default_rng(0),
        dynamics="first-order",
        delta=1e-3,
        step_m=0.5,
        range_m=2.5,
    )
    assert given.terminal.limits(3).tolist() == [1e-3] * 3
    assert given.robots[1].primitives.reach_m() == pytest.approx(0.5 * np.sqrt(2.0))
    assert given.robots[1].sensors[0].max_range_m == 2.5
    assert given.robots[1].pose[2] == 0.0


@pytest.mark.parametrize(
    ("robots", "targets", "given", "message"),
    [
        (0, 3, {}, "at least one of robots, got 0"),
        (3, 0, {}, "at least one of targets, got 0"),
        (1, 1, {"step_m": 0.0}, "scene: step_m"),
        (1, 1, {"range_m": -1.0}, "scene: range_m"),
        (1, 1, {"dynamics": "hover"}, "first-order"),
    ],
)
def test_scenes_that_cannot_be_are_refused(robots, targets, given, message):
    with pytest.raises(InvalidInputError, match=message):
        tzes_scene(robots, targets, np.random.default_rng(0), **given)
