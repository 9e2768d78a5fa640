"""A communication graph as the kernels read it."""

from collections.abc import Sequence

import numpy as np

from fgplan.planners.distributed_aia.forest_kernels import Links
from fgplan.planners.distributed_aia.options import DistributedOptions
from fgplan.team.communication_graph import CommunicationGraph


def links_of(
    graph: CommunicationGraph,
    options: DistributedOptions,
    robots: Sequence[int],
    own: int,
    degree: int,
) -> Links:
    """The links of some rows.

    Args:
        graph: Who hears whom.
        options: How what is heard is used.
        robots: Robot of each row.
        own: Rows that grow; they come first.
        degree: Most neighbours of a row that grows.

    Returns:
        Arrays.
    """
    neighbour = np.full((len(robots), degree), -1, dtype=np.int64)
    for row in range(own):
        for place, other in enumerate(graph.ever(robots[row])):
            neighbour[row, place] = robots.index(other)
    masses = np.array([options.masses(graph.robots[robot]) for robot in robots])
    return Links(
        robot=np.array(robots, dtype=np.int64),
        grows=np.arange(len(robots)) < own,
        neighbour=neighbour,
        linked=graph.scheduled,
        period=graph.period,
        range_m=graph.range_m,
        p_group=masses[:, 0].copy(),
        p_control=masses[:, 1].copy(),
        p_candidate=masses[:, 2].copy(),
        kappa=options.kappa,
        literal=options.empty_set == "literal",
    )
