"""The scenarios of section 7.1: starts, goals and roadmap stay, candidate paths are drawn again.

"In each such run, the scenario remains the same (goals, starting locations), while the candidate
paths randomly change." The paper prints neither starts nor goals nor roadmap; ours are one drawn
world for two robots and one for four.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fgplan.bench.open_world import (
    CRITERION_M,
    SPEED_M_PER_S,
    SPREAD,
    STEP_SIGMAS,
    OpenWorld,
    draw_world,
)
from fgplan.models.motion import MotionModel
from fgplan.paths.path_making import make_candidate_paths
from fgplan.typing import FloatArray
from roadmaps import RoadmapMatrix, find_perturbed_paths, read_roadmap

WORLD_SEEDS = {2: 6, 4: 0}
"""By number of robots. That of two is chosen for figure 7: the robots meet, and some announcement
impacts some of the candidates and not all, which few drawn worlds have; that of four is the first.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """One scenario.

    Attributes:
        world: Workspace, roadmap, problem; its candidates are not used.
        matrix: The roadmap as arrays.
        digest: Digest of the prior, computed once for all sessions.
    """

    world: OpenWorld
    matrix: RoadmapMatrix
    digest: str

    @property
    def robots(self) -> tuple[str, ...]:
        """Names in the order of the team."""
        return self.world.problem.robots

    @property
    def goals(self) -> Mapping[str, FloatArray]:
        """Goal of each robot, metres."""
        return dict(zip(self.robots, self.world.goals, strict=True))

    def with_candidates(self, count: int, number: int) -> OpenWorld:
        """The world with a set of candidate paths.

        Args:
            count: Candidates a robot.
            number: Number of the set; the same number and count give the same set.

        Returns:
            The world.
        """
        motion = MotionModel(sigmas=np.array(STEP_SIGMAS), speed_m_per_s=SPEED_M_PER_S)
        problem = self.world.problem
        paths = {
            name: make_candidate_paths(
                name,
                problem.prior.pose(problem.start_keys[name]),
                find_perturbed_paths(
                    self.matrix,
                    index,
                    len(self.robots) + index,
                    count,
                    np.random.default_rng((number, index)),
                    spread=SPREAD,
                ),
                motion,
            )
            for index, name in enumerate(self.robots)
        }
        return replace(self.world, candidates=paths)


def draw_scenario(robots: int, criterion_m: float = CRITERION_M) -> Scenario:
    """The scenario for a number of robots.

    Args:
        robots: 2 or 4.
        criterion_m: Distance below which two poses are joined by a factor, metres.

    Returns:
        The scenario; the criterion does not change anything else in it.
    """
    generator = np.random.default_rng(WORLD_SEEDS[robots])
    world = draw_world(robots, 1, generator, criterion_m=criterion_m)
    return Scenario(world, read_roadmap(world.roadmap), world.problem.prior.digest())
