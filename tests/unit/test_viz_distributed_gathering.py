"""Figures 3 and 4 of Tzes et al. 2021: what is in them is counted."""

import numpy as np
import pytest
from aia_scenes import lattice_problem
from PIL import Image, ImageSequence

from fgplan.errors import InvalidInputError
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.viz.distributed_gathering import (
    done_robot,
    draw_distributed_plan,
    draw_target_uncertainties,
    film_distributed_plan,
    iteration_time_figure,
)
from fgplan.viz.figure import save

matplotlib = pytest.importorskip("matplotlib")
NAMES = ("r0", "r1", "r2")


@pytest.fixture(scope="module")
def scene():
    drifts = np.zeros((10, 2))
    drifts[0] = 0.02
    places = [(0.5 + 0.5 * k, 3.0) for k in range(10)]
    problem = lattice_problem(
        [(0.5, 0.5), (2.5, 0.5), (5.5, 0.5)], places, boxes=[(3, 4, 4, 5)], drifts=drifts
    )
    poses = np.array([[robot.pose for robot in problem.robots]] * 5)
    poses[:, :, 1] += 0.5 * np.arange(5)[:, None]
    shrinks = 0.2 * 0.5 ** np.arange(5)[:, None, None, None, None] * np.eye(2)
    plan = TeamPlan(
        poses=poses,
        covariances=np.broadcast_to(shrinks, (5, 3, 10, 2, 2)),
        horizons=np.array([4, 4, 4]),
        satisfied=np.array([False, True, True]),
        cost=1.0,
        assigned=np.zeros((5, 3), dtype=np.int64),
        origins=((1, 7),),
    )
    return problem, plan


def written(figure, folder):
    target = save(figure, folder / "figure.png")
    assert matplotlib.image.imread(target).shape[1] == 1000
    return figure


def link_lines(axes):
    link = matplotlib.colors.to_rgb("#56B4E9")
    return sum(
        len(one.get_segments())
        for one in axes.collections
        if isinstance(one, matplotlib.collections.LineCollection)
        and np.allclose(one.get_colors()[0][:3], link)
    )


def test_a_plan_on_a_map_with_links(scene, tmp_path):
    problem, plan = scene
    graph = CommunicationGraph.within_range(NAMES, 2.0)
    figure = written(draw_distributed_plan(problem, plan, graph, "Near ones"), tmp_path)
    (axes,) = figure.axes
    assert axes.get_title() == "Near ones: F = 4 steps; ellipses are those of r1"
    assert link_lines(axes) == 1
    assert [text.get_text() for text in axes.texts] == list(NAMES)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "robots that hear\neach other at the start" in labels
    none = CommunicationGraph.none(NAMES)
    figure = draw_distributed_plan(problem, plan, none, "None", robot=2)
    assert figure.axes[0].get_title().endswith("of r2")
    assert link_lines(figure.axes[0]) == 0


def test_the_robot_that_is_looked_at(scene):
    _, plan = scene
    assert done_robot(plan) == 1

    def changed(horizons, satisfied):
        parts = {name: getattr(plan, name) for name in ("poses", "covariances", "cost", "assigned")}
        return TeamPlan(**parts, horizons=horizons, satisfied=satisfied, origins=())

    assert done_robot(changed(np.array([4, 2, 3]), np.array([False, True, True]))) == 2
    assert done_robot(changed(np.array([4, 2, 3]), np.zeros(3, dtype=bool))) == 0


def test_uncertainty_of_every_target_at_one_robot(scene, tmp_path):
    problem, plan = scene
    figure = written(draw_target_uncertainties(problem, plan, 2, "Full"), tmp_path)
    (axes,) = figure.axes
    assert axes.get_yscale() == "log"
    assert axes.get_ylabel() == "determinant (m⁴)"
    assert axes.get_xlabel() == "step"
    assert axes.get_title() == "Full: targets as r2 knows them"
    assert len(axes.lines) == 11
    np.testing.assert_allclose(axes.lines[3].get_ydata(), (0.2 * 0.5 ** np.arange(5)) ** 2)
    assert [line.get_linestyle() for line in axes.lines] == ["--", *["-"] * 9, ":"]
    looks = {(line.get_color(), line.get_marker()) for line in axes.lines[:10]}
    assert len(looks) == 10
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["t0, moves", *[f"t{k}" for k in range(1, 10)], "limit δ = 0.002"]


def test_links_come_and_go_in_the_film(scene, tmp_path):
    problem, plan = scene
    full, none = CommunicationGraph.complete(NAMES), CommunicationGraph.none(NAMES)
    films = []
    for name, graph in (
        ("both", CommunicationGraph.on_schedule([full, none])),
        ("none", none),
    ):
        file = film_distributed_plan(problem, plan, graph, tmp_path / f"{name}.gif", frames=3)
        with Image.open(file) as frames:
            films.append([np.array(one.convert("RGB")) for one in ImageSequence.Iterator(frames)])
    assert [len(film) for film in films] == [3, 3]
    # Steps 0, 2 and 4 have links in the schedule.
    assert all((a != b).any() for a, b in zip(*films, strict=True))
    with pytest.raises(InvalidInputError, match=r"\.gif"):
        film_distributed_plan(problem, plan, none, tmp_path / "film.mp4")


def test_bars_of_iteration_times(tmp_path):
    rows = [
        {"robots": 10, "targets": 10, "iteration_us_centralised": 400.0, "iteration_us_block": 9.0},
        {"robots": 10, "targets": 20, "iteration_us_centralised": 800.0, "horizon": 7},
    ]
    figure = written(iteration_time_figure(rows), tmp_path)
    (axes,) = figure.axes
    assert axes.get_yscale() == "log"
    assert axes.get_ylabel() == "time of an iteration (µs)"
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["10/10", "10/20"]
    heights = [bar.get_height() for bar in axes.patches]
    np.testing.assert_array_equal(heights, [400.0, 800.0, 9.0, np.nan])
    assert [text.get_text() for text in axes.texts] == ["400", "800", "9", ""]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["centralised", "block"]
    with pytest.raises(InvalidInputError, match="iteration_us_"):
        iteration_time_figure([{"robots": 1, "targets": 2}])
    with pytest.raises(InvalidInputError, match="above zero"):
        iteration_time_figure([{"robots": 1, "targets": 2, "iteration_us_block": 0.0}])
