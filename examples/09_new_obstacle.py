"""An obstacle that is on no map: seen for the first time, it changes only what it touches.

The closed loop of `scenarios/closed_loop.toml` until a shed is seen in Ann's way. The edges of the
roadmap that cross it go, her candidates through it are replaced, all others are kept with the
messages computed for them, and the team agrees again: on the values of from scratch.
"""

from pathlib import Path

import numpy as np

import fgplan

SCENARIO = Path(__file__).parent / "scenarios" / "closed_loop.toml"

mission = fgplan.load_loop_mission(SCENARIO)
before, truth = None, {name: [] for name in mission.goals}
for record in fgplan.run_loop(mission, compare=True):
    if isinstance(record, fgplan.StepRecord):
        for name, pose in record.truth.items():
            truth[name].append(pose[:2])
        continue
    if not isinstance(record, fgplan.SessionRecord):
        break
    if not record.obstacles:
        before = record
        continue
    print(f"step {record.step}: an obstacle is seen, corners {record.obstacles[0].tolist()}")
    print(f"  edges of the roadmap removed: {record.counts['roadmap_edges_removed']}")
    for name, path in record.chosen.items():
        kept, new = record.candidates_kept[name], record.candidates_replaced[name]
        reused, built = record.segments_reused[name], record.segments_rebuilt[name]
        print(f"  {name}: of {len(before.candidates[name])} candidates {kept} kept, {new} new;")
        print(f"    {reused} messages reused, {built} built; now {path.length_m:.0f} m to the goal")
    print(f"  values as from scratch to {record.max_rel_diff:.0e}")

world = mission.world.workspace
for name, places in truth.items():
    free = world.are_motions_valid(np.array(places[:-1]), np.array(places[1:])).all()
    print(f"{name} {'hit nothing' if free else 'collided'} in {len(places) - 1} steps")
