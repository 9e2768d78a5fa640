"""Messages of nodes for tests of robots that talk."""

import numpy as np

from fgplan.planners.distributed_aia.node_message import NodeMessage, Nodes


def two_nodes(targets, **changes):
    """A message of a root and its child, some of it changed."""
    good = {
        "first": 0,
        "wants": -1,
        "parents": np.array([-1, 0]),
        "depths": np.array([0, 1]),
        "covariances": np.tile([0.2, 0.0, 0.2], (2, targets)),
        "assigned": np.array([0, 1]),
        "positions": np.zeros((2, 2)),
    }
    return NodeMessage.of(Nodes(**good | changes))
