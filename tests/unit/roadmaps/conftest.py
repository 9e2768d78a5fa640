"""Worlds and maps for the tests of `roadmaps`."""

from pathlib import Path

import numpy as np
import pytest

from roadmaps import Workspace, build_prm

MAPS = Path(__file__).parents[2] / "data" / "maps"


@pytest.fixture
def maps():
    return MAPS


def star_polygons(rng, count, size_m):
    """Random star-shaped polygons of 4 to 7 corners, radius 2 to 5 m."""
    polygons = []
    for _ in range(count):
        angles = np.linspace(0, 2 * np.pi, int(rng.integers(4, 8)), endpoint=False)
        angles += rng.uniform(0.0, 0.7, len(angles))  # gaps below pi: the star is simple
        radii = rng.uniform(2.0, 5.0, len(angles))
        center = rng.uniform(5.0, size_m - 5.0, 2)
        polygons.append(center + radii[:, None] * np.c_[np.cos(angles), np.sin(angles)])
    return polygons


@pytest.fixture
def polygons():
    """50 polygons in 100 m x 100 m."""
    return star_polygons(np.random.default_rng(3), 50, 100.0)


@pytest.fixture
def field(polygons):
    """100 m x 100 m among 50 polygons, a robot of 0.5 m."""
    return Workspace(lower=[0, 0], upper=[100, 100], obstacles=polygons, robot_radius_m=0.5)


@pytest.fixture
def roadmap(field):
    """300 vertices in the field, vertices 0 and 1 in opposite corners."""
    rng = np.random.default_rng(7)
    return build_prm(field, 300, rng, required_positions=[[2, 2], [98, 98]])
