"""Active SLAM in closed loop: plan, move, observe, estimate, plan again, in a world of your own.

Nobody knows the landmarks beforehand. Ann and Bob have two goals each; whenever one is reached, the
team plans again from what SLAM has made of it: new candidate paths for who arrived, and what is
still valid of the other's candidates is reused. Every value is compared with from scratch by QR.
"""

import numpy as np

import fgplan
from roadmaps import Workspace

STARTS = {"ann": (10.0, 10.0, np.pi / 2), "bob": (60.0, 10.0, np.pi / 2)}
GOALS = {"ann": [(15.0, 85.0), (55.0, 40.0)], "bob": [(70.0, 60.0), (100.0, 20.0)]}

field = Workspace(lower=np.zeros(2), upper=np.array([120.0, 100.0]))
drive = fgplan.MotionModel(sigmas=[0.05, 0.05, 0.002], per_metre=[0.05, 0.05, 0.002])
eye = fgplan.BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.2, max_range_m=12.0)
rng = np.random.default_rng(3)

# The truth: where landmarks are, how the robots really move and what they carry.
world = fgplan.World(
    robots=tuple(
        fgplan.WorldRobot(
            name=name,
            pose=np.array(pose),
            actuation=drive,
            odometry=drive,
            landmark_sensors=("eye",),
        )
        for name, pose in STARTS.items()
    ),
    sensors={"eye": eye},
    landmark_keys=tuple(fgplan.symbol_key("l", index) for index in range(30)),
    landmark_positions=rng.uniform(field.lower, field.upper, (30, 2)),
)
# What the team plans with: bounds, models of noise, and where it may measure each other.
meeting = fgplan.MultiRobotModel(
    criterion=fgplan.DistanceCriterion(25.0),
    sensor=fgplan.RelativePoseSensor(covariance=np.diag([0.3, 0.3, 0.02]) ** 2),
)
mission = fgplan.LoopMission(
    name="field",
    world=world,
    workspace=field,
    robots=tuple(
        fgplan.LoopRobot(
            name=name,
            goals=np.array(GOALS[name]),
            motion=drive,
            start_covariance=1e-6 * np.eye(3),
            sensors=("eye",),
        )
        for name in STARTS
    ),
    multi_robot=(meeting,),
    candidates=fgplan.CandidateOptions(candidates=8, vertices=80, spacing_m=10.0),
)
for record in fgplan.run_loop(mission, compare=True):
    if isinstance(record, fgplan.SessionRecord):
        print(f"session {record.session} at step {record.step}:")
        print(f"  new candidates {dict(record.candidates_replaced)}")
        print(
            f"  kept {dict(record.candidates_kept)}, messages reused {dict(record.segments_reused)}"
        )
        print(f"  chosen {dict(record.chosen_index)}; as from scratch to {record.max_rel_diff:.0e}")
    elif isinstance(record, fgplan.StepRecord) and record.arrived:
        print(f"step {record.step}: {', '.join(record.arrived)} at the goal")
    elif isinstance(record, fgplan.SlamRecord):
        print(f"{len(record.landmarks)} landmarks mapped in {record.step} steps")
