"""Your own criterion: which pairs of states of two robots admit a factor between them.

By default it is a distance: robots then "see" each other through walls, and recognise a place that
another passed a minute ago. Here they must be near, at the same time, with nothing in between. The
criterion must be symmetric, because every robot of the team asks it.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import fgplan
import roadmaps

SCENARIO = Path(__file__).parent / "scenarios" / "rooms.toml"


@dataclass(frozen=True)
class InSight:
    """Near each other, at about the same time, with a free line of sight."""

    workspace: roadmaps.Workspace
    distance_m: float
    window_s: float = 10.0

    def __call__(self, first: fgplan.State, second: fgplan.State) -> bool:
        """Whether a factor joins two states; it is asked for every pair, so cheap tests first."""
        if abs(first.time_s - second.time_s) > self.window_s:
            return False
        here, there = first.pose[:2], second.pose[:2]
        if np.hypot(*(here - there)) > self.distance_m:
            return False
        return bool(self.workspace.has_line_of_sight(here, there)[0])


mission = fgplan.load_mission(SCENARIO)
options = fgplan.CandidateOptions(candidates=12, vertices=2500, neighbours=16)
sets = fgplan.candidate_sets(mission, options)
for name, criterion in (
    ("nearer than 6 m", fgplan.DistanceCriterion(6.0)),
    ("nearer than 6 m, within 10 s, in sight", InSight(mission.workspace, 6.0)),
):
    sensor = fgplan.RelativePoseSensor(covariance=np.diag([0.1, 0.1, 0.01]) ** 2)
    model = fgplan.MultiRobotModel(criterion=criterion, sensor=sensor)
    problem = replace(sets.problem, multi_robot=(model,))
    agreement = fgplan.coordinate(problem, sets.candidates)
    joint = fgplan.candidate_belief(problem, agreement.paths)
    kinds = Counter(planned.identity.kind for planned in joint.factors)
    print(f"{name}: objective {agreement.value:.2f}, {kinds['multi_robot']} factors between robots")
    for robot, path in agreement.paths.items():
        print(
            f"  {robot}: candidate {agreement.chosen[robot]}, {path.length_m:.1f} m, "
            f"position on arrival {joint.position_sigma_m(robot):.2f} m (1 sigma)"
        )
