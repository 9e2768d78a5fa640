"""Probabilistic roadmaps.

Valid positions are sampled uniformly; pairs that the connection rule names are joined where the
straight motion between them is valid. All pairs are checked in one batch. Unlike Kavraki et al.,
edges within one connected component are kept: candidate paths need the alternatives (this is the
"simplified PRM" of Karaman and Frazzoli).
"""

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from roadmaps.checks import as_positions, check_count, check_generator
from roadmaps.collision import CollisionChecker, check_position_valid
from roadmaps.connection import Connection, KNearest, neighbor_pairs
from roadmaps.roadmap import build_roadmap
from roadmaps.sampling import sample_positions


def build_prm(
    checker: CollisionChecker,
    vertex_count: int,
    rng: np.random.Generator,
    *,
    connection: Connection | None = None,
    required_positions: ArrayLike | None = None,
) -> nx.Graph:
    """Build a probabilistic roadmap.

    Args:
        checker: The world, of any dimension d.
        vertex_count: Number of vertices, the required ones included.
        rng: Source of randomness; the same seed gives the same roadmap.
        connection: Which vertices to try to join; None means the 10 nearest.
        required_positions: Positions that become vertices 0, 1, ... (starts, goals), shape
            (m, d), metres. They may stay unconnected if nothing near them can be reached.

    Returns:
        The roadmap, ids 0 to vertex_count - 1.

    Raises:
        InvalidPositionError: If a required position is not free.
        SamplingError: If the free space is too small a part of the bounds.
        ParameterError: If `vertex_count` is less than 1 or than the required positions, or `rng`
            is no Generator.

    References:
        Kavraki, Svestka, Latombe and Overmars, "Probabilistic roadmaps for path planning in
        high-dimensional configuration spaces", IEEE Transactions on Robotics and Automation
        12(4), 1996, doi:10.1109/70.508439.

    Example:
        >>> from roadmaps import Workspace
        >>> hall = Workspace(lower=[0, 0], upper=[20, 20])
        >>> roadmap = build_prm(hall, 50, np.random.default_rng(1), required_positions=[[1, 1]])
        >>> len(roadmap), roadmap.nodes[0]["position"]
        (50, array([1., 1.]))
    """
    check_generator(rng)
    check_count(vertex_count, "vertex_count")
    dimension = len(checker.lower)
    fixed = np.zeros((0, dimension))
    if required_positions is not None:
        fixed = as_positions(required_positions, dimension, "required_positions")
    check_count(vertex_count, "vertex_count", minimum=len(fixed))
    for index, position in enumerate(fixed):
        check_position_valid(checker, position, f"required_positions[{index}]")
    sampled = sample_positions(checker, vertex_count - len(fixed), rng)
    positions = np.concatenate([fixed, sampled])
    pairs = neighbor_pairs(positions, connection or KNearest())
    valid = checker.are_motions_valid(positions[pairs[:, 0]], positions[pairs[:, 1]])
    return build_roadmap(positions, pairs[valid])
