"""The closed loop, pictures and the reproduction of Table I."""

import numpy as np
import pytest
from aia_scenes import lattice_problem, tiny_problem

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.errors import InvalidInputError
from fgplan.io.command import CommandOptions
from fgplan.models.position_sensor import PositionSensor
from fgplan.planners.aia.adaptive import track
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.search import search
from fgplan.reproduce.kantaros_table1.command import is_near, plan_row, read_rows, run
from fgplan.viz.figure import save
from fgplan.viz.information_gathering import draw_team_path, draw_uncertainty, film_team_path

OPTIONS = tree_options("reproduction", iterations=3000, expand="node")


def test_runs_of_one_seed_differ_in_their_plans_alone():
    problem = kantaros_scene(4, 6, np.random.default_rng(1), moving=True, delta=1e-4)
    runs = [
        track(
            problem, OPTIONS, np.random.default_rng(1), steps=40, replan_every=every, hypotheses=1
        )
        for every in (None, 5)
    ]
    np.testing.assert_array_equal(runs[0].truth, runs[1].truth)
    assert problem.workspace.are_positions_valid(runs[0].truth[0]).all()
    assert (runs[0].plans, runs[1].plans) == (1, 8)
    assert runs[1].rms_m[-1] < runs[1].rms_m[0]


@pytest.mark.full
def test_planning_again_helps_where_the_targets_move():
    offline, online = [], []
    for seed in range(3):
        problem = kantaros_scene(4, 6, np.random.default_rng(seed), moving=True, delta=1e-4)
        runs = [
            track(problem, OPTIONS, np.random.default_rng(seed), steps=100, replan_every=every)
            for every in (None, 5)
        ]
        np.testing.assert_array_equal(runs[0].truth, runs[1].truth)
        assert (runs[0].plans, runs[1].plans) == (1, 20)
        offline.append(runs[0].rms_m[-1])
        online.append(runs[1].rms_m[-1])
    assert np.mean(online) < np.mean(offline)
    assert np.mean(online) < 0.3


def test_a_linear_sensor_makes_the_filter_consistent():
    spread = []
    for seed in range(30):
        problem = lattice_problem(
            [(0.0, 0.0)],
            [(2.0, 2.0), (1.0, 3.0)],
            sensor=PositionSensor(sigma_m=0.2),
            process=1e-3,
            drifts=np.full((2, 2), 0.01),
            delta=1e-3,
        )
        run = track(
            problem, OPTIONS, np.random.default_rng(seed), steps=6, replan_every=2, hypotheses=1
        )
        spread.append(run.consistency)
    # Chi-square of two degrees of freedom, 60 of them: mean 2, deviation 2 / sqrt(60).
    assert abs(np.mean(spread) - 2.0) < 4 * 2 / np.sqrt(60)


def test_bad_loops_are_refused():
    with pytest.raises(InvalidInputError, match="at least 1"):
        track(tiny_problem(), OPTIONS, np.random.default_rng(0), steps=0, replan_every=None)


def test_pictures_are_written(tmp_path):
    problem = kantaros_scene(3, 4, np.random.default_rng(0), moving=True, delta=1e-3)
    plan = search(problem, OPTIONS, np.random.default_rng(0)).plan
    assert plan is not None
    for name, figure in (
        ("map", draw_team_path(problem, plan, "three robots")),
        ("worst", draw_uncertainty(problem, {"aia": plan})),
    ):
        path = save(figure, tmp_path / f"{name}.png")
        assert path.stat().st_size > 10_000
    film = film_team_path(problem, plan, tmp_path / "film.gif", frames=3)
    assert film.read_bytes()[:6] == b"GIF89a"
    with pytest.raises(InvalidInputError, match=r"\.gif"):
        film_team_path(problem, plan, tmp_path / "film.mp4")


def test_kantaros_table1_row_and_requirements():
    row = plan_row("first-order", 10, 10, (0, 1))
    assert row["solved"] == 2
    assert row["published_cost"] == 11.79
    assert is_near(row | {"cost": 11.0, "horizon": 60.0}) == (True, True)
    assert is_near(row | {"cost": 20.0, "horizon": 120.0}) == (False, False)
    arguments = {"rows": "10/10,10/20", "dynamics": "first-order"}
    outcome = run(CommandOptions(name="kantaros-table1", seeds=2, arguments=arguments))
    assert [one["targets"] for one in outcome.results["rows"]] == [10, 20]
    (need,) = outcome.requirements
    assert need.name == "cost_rises_with_targets_at_10"
    assert need.met
    with pytest.raises(InvalidInputError, match="1/5, 10/10"):
        read_rows("3/4")
