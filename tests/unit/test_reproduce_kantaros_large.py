"""fgplan reproduce kantaros-large: a feasible plan beside the published numbers, and a picture."""

import numpy as np

from fgplan.io.command import CommandOptions
from fgplan.reproduce.kantaros_large.command import large_scene, run


def test_the_large_scene_is_solved_and_drawn(tmp_path):
    outcome = run(CommandOptions(out=tmp_path))
    (row,) = outcome.results["rows"]
    assert row["feasible"]
    assert row["shortfall"] <= 1.0
    assert outcome.results["published_horizon"] == 3769
    assert all(need.met for need in outcome.requirements)
    assert [path.name for path in outcome.figures] == ["paths-0.png"]


def test_the_scene_is_the_paper_s_in_what_the_paper_says():
    problem = large_scene(np.random.default_rng(0))
    assert (len(problem.robots), problem.targets) == (7, 20)
    np.testing.assert_array_equal(problem.workspace.upper, [500.0, 1000.0])
    assert problem.robots[0].sensors[0].max_range_m == 20.0
    assert problem.robots[0].primitives.reach_m() == 2.0
    assert not problem.fixed
