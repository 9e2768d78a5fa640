"""Which demos, benches and reproductions there are, each as "module:function".

The function takes ``fgplan.io.command.CommandOptions`` and returns a ``CommandOutcome``; its module
may define ``add_arguments(parser)``. Nothing is imported before it is asked for.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RegisteredCommand:
    """One demo, bench or reproduction.

    Attributes:
        target: "module:function".
        summary: One line for ``--help``.
    """

    target: str
    summary: str


DEMOS: dict[str, RegisteredCommand] = {
    "victoria-park": RegisteredCommand(
        "fgplan.demos.victoria_park:victoria_park",
        "four robots plan over the real Victoria Park log that is inside the GTSAM wheel",
    ),
    "multi-robot-slam": RegisteredCommand(
        "fgplan.demos.multi_robot_slam:multi_robot_slam",
        "four robots map an unknown world and plan as they go, with a film; resumes in its folder",
    ),
    "mrclam": RegisteredCommand(
        "fgplan.demos.mrclam:mrclam",
        "five real robots (UTIAS MR.CLAM, your folder): joint SLAM, errors against Vicon, a plan",
    ),
}

BENCHES: dict[str, RegisteredCommand] = {
    "roadmap": RegisteredCommand(
        "fgplan.bench.roadmap:run", "a PRM among polygons, with shapely and without"
    ),
    "impacted": RegisteredCommand(
        "fgplan.bench.impacted:run", "whole planning sessions, evaluators side by side"
    ),
    "history": RegisteredCommand(
        "fgplan.bench.history:run", "milliseconds a candidate when the past grows"
    ),
    "consistency": RegisteredCommand(
        "fgplan.bench.consistency:run",
        "closed loops over many seeds: estimates against truth, plans against SLAM",
    ),
    "aia": RegisteredCommand(
        "fgplan.bench.aia:run", "the sampling tree of planner aia against a dense reference"
    ),
    "distributed-aia": RegisteredCommand(
        "fgplan.bench.distributed_aia:run",
        "an iteration of planner distributed_aia for 10 to 100 robots, and its messages",
    ),
    "team": RegisteredCommand(
        "fgplan.bench.team:run", "agreeing in process and over zenoh: time, bytes, same result"
    ),
    "intermittent": RegisteredCommand(
        "fgplan.bench.intermittent:run", "plans of small teams to their next meeting"
    ),
}

REPRODUCTIONS: dict[str, RegisteredCommand] = {
    "regev-fig6": RegisteredCommand(
        "fgplan.reproduce.regev_fig6.command:run",
        "running times and figures 5, 6 and 7 of Regev and Indelman 2017",
    ),
    "regev-scenarios": RegisteredCommand(
        "fgplan.reproduce.regev_scenarios.command:run",
        "scenarios 1, 2 and 3 of Regev and Indelman 2017, and figures 8 to 19",
    ),
    "kantaros-table1": RegisteredCommand(
        "fgplan.reproduce.kantaros_table1.command:run", "Table I of Kantaros et al. 2019"
    ),
    "kantaros-large": RegisteredCommand(
        "fgplan.reproduce.kantaros_large.command:run",
        "7 robots and 20 targets in 500 x 1000 m, as in Kantaros et al. 2019",
    ),
    "kantaros-comparison": RegisteredCommand(
        "fgplan.reproduce.kantaros_comparison.command:run",
        "planner aia beside greedy, FVI, RIG-tree and Dec-MCTS, as in Kantaros et al. 2019",
    ),
    "kantaros-convergence": RegisteredCommand(
        "fgplan.reproduce.kantaros_convergence.command:run",
        "how often the optimal path is in the tree, against bound (7) of Kantaros et al. 2019",
    ),
    "kantaros-adaptive": RegisteredCommand(
        "fgplan.reproduce.kantaros_adaptive.command:run",
        "moving targets: planning again every few measurements, as Kantaros et al. 2019 propose",
    ),
    "tzes-table1": RegisteredCommand(
        "fgplan.reproduce.tzes_table1.command:run",
        "Table I and figure 3 of Tzes et al. 2021: horizons by communication graph",
    ),
    "tzes-fig4": RegisteredCommand(
        "fgplan.reproduce.tzes_fig4.command:run",
        "denser and sparser communication, figure 4 of Tzes et al. 2021",
    ),
    "khodayi-mehr-table1": RegisteredCommand(
        "fgplan.reproduce.khodayi_mehr_table1.command:run",
        "Table I of Khodayi-mehr et al. 2019: intermittent connection against two baselines",
    ),
    "khodayi-mehr-fig5": RegisteredCommand(
        "fgplan.reproduce.khodayi_mehr_figures.command:fig5",
        "figure 5 of Khodayi-mehr et al. 2019: two graphs of teams",
    ),
    "khodayi-mehr-fig6": RegisteredCommand(
        "fgplan.reproduce.khodayi_mehr_figures.command:fig6",
        "figure 6 of Khodayi-mehr et al. 2019: what team 2 knows",
    ),
    "khodayi-mehr-fig7": RegisteredCommand(
        "fgplan.reproduce.khodayi_mehr_figures.command:fig7",
        "figure 7 of Khodayi-mehr et al. 2019: delays of team 2",
    ),
    "khodayi-mehr-fig8": RegisteredCommand(
        "fgplan.reproduce.khodayi_mehr_figures.command:fig8",
        "figure 8 of Khodayi-mehr et al. 2019: paths to two meetings, and a film",
    ),
    "khodayi-mehr-fig9": RegisteredCommand(
        "fgplan.reproduce.khodayi_mehr_figures.command:fig9",
        "figure 9 of Khodayi-mehr et al. 2019: three methods over time",
    ),
}

REGISTRY: dict[str, dict[str, RegisteredCommand]] = {
    "demo": DEMOS,
    "bench": BENCHES,
    "reproduce": REPRODUCTIONS,
}
