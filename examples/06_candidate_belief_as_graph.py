"""A candidate path's belief is an ordinary GTSAM graph: look at it, solve it, add to it.

`candidate_belief` puts together the prior, both robots' paths and the factors between them, cut at
a look-ahead step if you like. What fgplan says about it your own GTSAM code can check.
"""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np

import fgplan

SCENARIO = Path(__file__).parent / "scenarios" / "two_robots.toml"

mission = fgplan.load_mission(SCENARIO)
sets = fgplan.candidate_sets(mission, fgplan.CandidateOptions(candidates=10))
terms = tuple(fgplan.UncertaintyTerm(of=fgplan.PosesOf((name,))) for name in ("ann", "bob"))
problem = replace(sets.problem, objective=fgplan.Objective(terms))

# fgplan's numbers: position covariance traces of both robots, for each of Bob's candidates.
announced = {"ann": sets.candidates["ann"][1]}
evaluator = fgplan.Incremental()
state = evaluator.start(problem, "bob", sets.candidates["bob"])
_, evaluations = evaluator.evaluate(state, announced)
candidate = sets.candidates["bob"][evaluations.best]

# The same as a graph.
joint = fgplan.candidate_belief(problem, {**announced, "bob": candidate})
print(f"{joint.graph.size()} factors, {joint.values.size()} variables, planned ones by kind:")
for kind, count in Counter(planned.identity.kind for planned in joint.factors).items():
    print(f"  {kind}: {count}")
meeting = next(planned for planned in joint.factors if planned.identity.kind == "multi_robot")
names = " and ".join(fgplan.describe_key(key) for key in meeting.identity.variables)
print(f"first meeting: {type(meeting.factor).__name__} between {names} (robot.step)")

# Your own GTSAM code: optimise (the planned measurements fit, so nothing moves) and read marginals.
solved = gtsam.LevenbergMarquardtOptimizer(joint.graph, joint.values).optimize()
marginals = gtsam.Marginals(joint.graph, solved)
print(f"error at the planned poses {joint.graph.error(joint.values):.1e}")
for place, robot in enumerate(("ann", "bob")):
    by_gtsam = np.trace(marginals.marginalCovariance(joint.key(robot))[:2, :2])
    by_fgplan = evaluations.terms[evaluations.best, place]
    print(
        f"{robot}: trace on arrival {by_fgplan:.9f} m2, gtsam.Marginals {by_gtsam:.9f} m2, "
        f"relative difference {abs(by_gtsam / by_fgplan - 1.0):.0e}"
    )

# What if Ann had GPS half way? Add a factor of your own and ask again.
halfway = joint.key("ann", len(joint.keys["ann"]) // 2)
gps = gtsam.PoseTranslationPrior2D(
    halfway, joint.values.atPose2(halfway), gtsam.noiseModel.Isotropic.Sigma(2, 0.05)
)
with_gps = gtsam.NonlinearFactorGraph(joint.graph)
with_gps.add(gps)
belief = fgplan.Belief(with_gps, joint.values)
for robot in ("ann", "bob"):
    covariance = belief.covariance(joint.key(robot))
    print(f"{robot}: trace on arrival {np.trace(covariance[:2, :2]):.6f} m2, with Ann's GPS")
