"""fgplan reproduce tzes-fig4: cases, order of the horizons, revisits and oscillations by hand."""

import numpy as np
from aia_scenes import lattice_problem

from fgplan.io.command import CommandOptions
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.reproduce.tzes_fig4.behaviour import count_oscillations, count_revisits, sensed
from fgplan.reproduce.tzes_fig4.command import LABELS, case_of, requirements, run, summary
from fgplan.reproduce.tzes_fig4.scene import figure_graphs, figure_scene


def test_quick_run_draws_figure_4(tmp_path):
    outcome = run(CommandOptions(out=tmp_path, quick=True))
    cases = {case["graph"]: case for case in outcome.results["cases"]}
    assert list(cases) == list(LABELS)
    assert all(case["solved"] == case["seeds"] == 1 for case in cases.values())
    assert cases["none"]["horizon"] > 2 * cases["degree 3"]["horizon"]
    for one in outcome.results["runs"]:
        assert one["rule_horizon"] <= one["horizon"]
        assert one["attempts"] >= 1
        assert one["sweeps"] >= one["horizon"]
    assert cases["none"]["revisits"] > cases["full"]["revisits"]
    assert [path.name for path in outcome.figures] == [
        "full.png",
        "uncertainty-full.png",
        "degree-3.png",
        "uncertainty-degree-3.png",
        "none.png",
        "uncertainty-none.png",
    ]
    assert all(path.stat().st_size > 10_000 for path in outcome.figures)


def test_the_scene():
    problem = figure_scene(np.random.default_rng(0))
    assert (len(problem.robots), problem.targets) == (6, 10)
    assert problem.robots[0].sensors[0].max_range_m == 1.0
    moves = [bool(block.drift.any() and block.process.any()) for block in problem.hidden.blocks]
    assert moves == [True, True] + [False] * 8
    ways = problem.hidden.predicted_means(problem.mean, 800).reshape(801, 10, 2)
    assert all(problem.workspace.are_positions_valid(ways[:, k]).all() for k in range(2))
    graphs = figure_graphs(problem, np.random.default_rng(0))
    assert [graph.average_degree() for graph in graphs.values()] == [5.0, 3.0, 0.0]
    assert graphs["degree 3"].is_connected()


def plan_of(xs, variances, held, horizon):
    """One robot on a line below one or two targets."""
    poses = np.zeros((len(xs), 1, 3))
    poses[:, 0, 0], poses[:, 0, 1] = xs, 1.0
    spreads = np.array(variances, dtype=float)[:, None, :, None, None] * np.eye(2)
    return TeamPlan(
        poses=poses,
        covariances=spreads,
        horizons=np.array([horizon]),
        satisfied=np.array([True]),
        cost=0.0,
        assigned=np.array(held)[:, None],
        origins=((0, 0),),
    )


def test_revisits_and_oscillations_by_hand():
    problem = lattice_problem([(1.0, 1.0)], [(1.0, 2.0), (5.0, 2.0)], delta=0.01)
    # Sensing range 2: x within sqrt(3) of 1 or of 5.
    xs = [1, 2, 3, 4, 3, 2, 3, 4]
    known = [(0.2, 0.2), (0.05, 0.2), (0.05, 0.2), (0.05, 0.2)] + [(0.05, 0.05)] * 4
    plan = plan_of(xs, known, [0, 1, 1, 0, 0, 1, 1, 1], 7)
    expected = [[x < 3, x > 3] for x in xs]
    assert sensed(problem, plan)[:, 0].tolist() == expected
    # Step 3 enters the second target's range, which is not satisfied; 5 and 7 are revisits.
    assert count_revisits(problem, plan).tolist() == [2]
    # 0 at step 3 and 1 at step 5 are goals of before.
    assert count_oscillations(plan).tolist() == [2]
    short = plan_of(xs, known, [0, 1, 1, 0, 0, 1, 1, 1], 4)
    assert count_revisits(problem, short).tolist() == [0]
    assert count_oscillations(short).tolist() == [1]


def test_requirements_and_lines():
    def runs(full, sparse, none):
        values = {"rule_horizon": 1, "cost": 1.0, "sweeps": 1, "revisits": 0, "oscillations": 0}
        return [
            {"graph": name, "horizon": horizon, "attempts": 1} | values
            for name, each in (("full", full), ("degree 3", sparse), ("none", none))
            for horizon in each
        ]

    def cases(*horizons):
        return [case_of(name, runs(*horizons)) for name in LABELS]

    good = cases([70, 80], [80, 70], [300, 400])
    assert [need.met for need in requirements(good)] == [True, True, True]
    assert good[2]["horizon"] == good[2]["horizon_mean"] == 350.0
    assert [need.met for need in requirements(cases([70], [69], [69]))] == [True, False, False]
    unsolved = cases([70, None], [80, 80], [None, None])
    assert [need.met for need in requirements(unsolved)] == [False, False, True]
    assert unsolved[0]["solved"] == 1
    lines = summary(good)
    assert len(lines) == 4
    assert "2/2" in lines[1]
