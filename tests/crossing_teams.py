"""Small real planning problems: robots that cross a place between two blocks, all coupled.

In process the team of four takes 10 turns with 4 announcements, that of eight 19 with 5.
"""

import dataclasses

import numpy as np

from fgplan.io.mission_file import load_mission
from fgplan.planners.registry import find_planner

NAMES = ("ann", "bob", "cid", "dan", "eve", "fay", "gus", "hal")


def crossing_text(count, candidates=8):
    """Scenario of so many robots from edge to edge; odd ones are poorly localised."""
    robots = []
    for number, name in enumerate(NAMES[:count]):
        angle = 2.0 * np.pi * number / count + 0.3
        way = np.array([np.cos(angle), np.sin(angle)])
        (x, y), (far_x, far_y) = 30.0 + 26.0 * way, 30.0 - 26.0 * way
        sigma = 1.0 if number % 2 else 0.05
        robots.append(
            f"""
[[robots]]
name = "{name}"
start = [{x:.3f}, {y:.3f}, {angle + np.pi:.3f}]
start_sigmas = [{sigma}, {sigma}, {0.1 * sigma}]
goal = [{far_x:.3f}, {far_y:.3f}]
motion = {{ sigmas = [0.1, 0.1, 0.01], per_metre = [0.05, 0.05, 0.01] }}
"""
        )
    return f"""schema = 1
seed = 3

[world]
bounds = [[0.0, 0.0], [60.0, 60.0]]
obstacles = [
  [[14.0, 22.0], [24.0, 22.0], [24.0, 38.0], [14.0, 38.0]],
  [[36.0, 22.0], [46.0, 22.0], [46.0, 38.0], [36.0, 38.0]],
]
{"".join(robots)}
[[team.multi_robot]]
distance_m = 8.0
sensor = {{ kind = "relative_pose", sigmas = [0.1, 0.1, 0.01] }}

[objective]
preset = "length_and_uncertainty"
path_weight = 0.1
uncertainty_weight = 3.0

[planner]
name = "impacted_paths"

[planner.impacted_paths]
candidates = {candidates}
vertices = 80
"""


def crossing(folder, count, candidates=8):
    """The scenario as a file."""
    path = folder / f"crossing_{count}.toml"
    path.write_text(crossing_text(count, candidates), encoding="utf-8")
    return path


def mission_with(path, **options):
    """The mission of a scenario, some options of its planner changed."""
    mission = load_mission(path)
    return dataclasses.replace(mission, options={**mission.options, **options})


def program_of(mission, robot):
    """Program of a robot, as each process makes it."""
    planner = find_planner("impacted_paths")
    return planner.program(mission, robot, np.random.default_rng(mission.seed))


def plan_of(mission):
    """The plan in process."""
    planner = find_planner("impacted_paths")
    return planner.plan(mission, np.random.default_rng(mission.seed))
