"""Robots that plan their own trees and fuse what they know, over three communication graphs.

Run it from anywhere: `python examples/15_distributed_gathering.py [FOLDER]`.
"""

import sys
from pathlib import Path

import numpy as np

from fgplan.bench.distributed_aia_scene import tzes_scene
from fgplan.planners.distributed_aia.message_search import search_by_messages
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.planners.distributed_aia.search import search_distributed
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.in_process import InProcessTransport, NetworkFaults
from fgplan.viz.distributed_gathering import draw_distributed_plan, draw_target_uncertainties
from fgplan.viz.figure import save


def main(out: Path | None) -> None:
    """Plan with three graphs, then over a network that loses a fifth of all messages."""
    scene = tzes_scene(8, 10, np.random.default_rng(2), step_m=0.6, delta=1e-3)
    names = tuple(robot.name for robot in scene.robots)
    graphs = {
        "all-to-all": CommunicationGraph.complete(names),
        "average degree 3": CommunicationGraph.random_connected(
            names, 3.0, np.random.default_rng(0)
        ),
        "within 4 m": CommunicationGraph.within_range(names, 4.0),
    }
    options = distributed_options(near_m=0.6, iterations=5000)
    for name, graph in graphs.items():
        plan = search_distributed(scene, options, graph, np.random.default_rng(0)).plan
        assert plan is not None
        done = names[plan.first_origin]
        print(f"{name:17} horizon {plan.horizon}, cost {plan.cost:.2f}; {done} knows all targets")
        if out is not None and name == "average degree 3":
            print(save(draw_distributed_plan(scene, plan, graph, name), out / "plan.png"))
            drawn = draw_target_uncertainties(scene, plan, plan.first_origin, name)
            print(save(drawn, out / "uncertainty.png"))
    faults = NetworkFaults(loss=0.2, delay_s=(0.0, 0.1))
    network = InProcessTransport(names, faults, np.random.default_rng(1))
    graph = graphs["average degree 3"]
    found = search_by_messages(scene, options, graph, np.random.default_rng(0), network, wait_s=0.2)
    assert found.plan is not None
    counts = network.traffic.of("nodes")
    print(
        f"a fifth of messages lost: horizon {found.plan.horizon}; {counts.sent_bytes / 1e3:.0f} kB"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
