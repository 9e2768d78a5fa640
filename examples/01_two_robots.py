"""Two robots agree on paths: your own GTSAM prior, a roadmap, candidate paths, an agreement.

Ann knows where she is; Bob does not. Where they pass within 12 m of each other they measure their
relative pose, so Bob gains by meeting Ann, and the team decides whether that is worth the way.
"""

import gtsam
import numpy as np

import fgplan
import roadmaps

# The belief at planning time is an ordinary GTSAM graph with values.
ANN, BOB = gtsam.symbol("a", 0), gtsam.symbol("b", 0)
graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
for key, pose, sigmas in (
    (ANN, gtsam.Pose2(5, 5, 0.0), [0.1, 0.1, 0.01]),
    (BOB, gtsam.Pose2(5, 35, 0.0), [2.0, 2.0, 0.05]),
):
    graph.add(gtsam.PriorFactorPose2(key, pose, gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
    values.insert(key, pose)
prior = fgplan.Belief(graph, values)

# One roadmap; vertices 0 to 3 are the two starts and the two goals.
yard = roadmaps.Workspace(
    lower=[0, 0],
    upper=[100, 40],
    obstacles=[[(30, 15), (50, 15), (50, 30), (30, 30)]],
    robot_radius_m=0.5,
)
corners = [[5, 5], [95, 5], [5, 35], [95, 35]]
rng = np.random.default_rng(1)
roadmap = roadmaps.build_prm(yard, 300, rng, required_positions=corners)

# Ten candidate paths each, with the noise that grows along the way.
motion = fgplan.MotionModel(sigmas=[0.02, 0.02, 0.002], per_metre=[0.03, 0.03, 0.002])
candidates = {}
for name, key, start, goal in (("ann", ANN, 0, 1), ("bob", BOB, 2, 3)):
    ways = roadmaps.find_candidate_paths(roadmap, start, goal, 10)
    candidates[name] = fgplan.make_candidate_paths(name, prior.pose(key), ways, motion)

# What all robots know alike, and what they minimise: path length and uncertainty at the goal.
problem = fgplan.PlanningProblem(
    prior=prior,
    start_keys={"ann": ANN, "bob": BOB},
    objective=fgplan.length_and_uncertainty(["ann", "bob"], path_weight=0.1),
    multi_robot=(
        fgplan.MultiRobotModel(
            criterion=fgplan.DistanceCriterion(12.0),
            sensor=fgplan.RelativePoseSensor(covariance=np.diag([0.2, 0.2, 0.02]) ** 2),
        ),
    ),
)
agreement = fgplan.coordinate(problem, candidates)

together = fgplan.candidate_belief(problem, agreement.paths)
for name, path in agreement.paths.items():
    alone = fgplan.candidate_belief(problem, {name: path})
    print(
        f"{name}: candidate {agreement.chosen[name]} of {len(candidates[name])}, "
        f"{path.length_m:.1f} m (shortest {candidates[name][0].length_m:.1f} m); "
        f"position on arrival {together.position_sigma_m(name):.2f} m, without the team "
        f"{alone.position_sigma_m(name):.2f} m (1 sigma)"
    )
print("objective by announcement:", " -> ".join(f"{value:.3f}" for value in agreement.values))
