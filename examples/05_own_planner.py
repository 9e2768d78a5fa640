"""Your own planner, named in a scenario: the same file runs from the command line and from here.

    fgplan run examples/scenarios/own_planner.toml

The class is in scenarios/greedy_planner.py: each robot chooses once, given those before it, and
never again. Below it is compared with announcing until nobody changes, and with the optimum.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import fgplan
from fgplan.cli import main

SCENARIO = Path(__file__).parent / "scenarios" / "own_planner.toml"

# As on the command line: reads, plans, writes the run folder, says what each robot chose.
with tempfile.TemporaryDirectory() as folder:
    status = main(["run", str(SCENARIO), "--out", folder])
print(f"exit status {status}\n")

# The same mission under three planners. The command line searches the scenario's folder for a
# user's module; in Python that is the import path.
sys.path.insert(0, str(SCENARIO.parent))
mission = fgplan.load_mission(SCENARIO)
for name in ("greedy_planner:GreedyPlanner", "impacted_paths", "exhaustive"):
    planner = fgplan.find_planner(name)
    plan = planner.plan(mission, np.random.default_rng(mission.seed))
    chosen = ", ".join(f"{robot.robot} {robot.candidate}" for robot in plan.robots)
    print(f"{name}: objective {plan.value:.4f} with candidates {chosen}")

# Or register a short name once, for scenarios and find_planner alike.
fgplan.register_planner("one_pass", "greedy_planner:GreedyPlanner")
print("registered:", type(fgplan.find_planner("one_pass")).__name__)
try:
    fgplan.find_planner("gredy")
except fgplan.UnknownNameError as error:
    print("a name that is not known:", error)
