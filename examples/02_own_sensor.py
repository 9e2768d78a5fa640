"""Your own sensor: four methods, and every planner and evaluator can use it.

A stereo camera measures a landmark's position in the robot's frame. It looks ahead only, and its
depth is worth less and less with distance: its sigma grows with the square of it.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import fgplan
from fgplan.models.pose import compose, rotation_matrix
from fgplan.planners.impacted_paths.candidates import candidate_sets
from fgplan.planners.impacted_paths.options import CandidateOptions

SCENARIO = Path(__file__).parent / "scenarios" / "two_robots.toml"


@dataclass(frozen=True, kw_only=True)
class StereoCamera(fgplan.AbstractSensor):
    """Position of a point in the frame of a planar robot, z = R' (point - position)."""

    kind = "stereo_camera"
    sigma_m: float = 0.02
    depth_sigma_per_m: float = 0.002
    max_range_m: float = 20.0
    field_of_view_rad: float = np.radians(100.0)

    def predict(self, pose, target):
        """Noise-free measurement, shape (2,), metres."""
        return rotation_matrix(pose).T @ (target - pose[:2])

    def jacobians(self, pose, target):
        """By the pose's tangent (forward, left, turn: increments on the right) and the point."""
        forward, left = self.predict(pose, target)
        return np.array([[-1.0, 0.0, left], [0.0, -1.0, -forward]]), rotation_matrix(pose).T

    def noise(self, pose, target):
        """Covariance of the measurement, shape (2, 2), square metres."""
        depth = self.predict(pose, target)[0]
        return np.diag([self.sigma_m + self.depth_sigma_per_m * depth**2, self.sigma_m]) ** 2


# A wrong Jacobian plans quietly with wrong covariances: compare with finite differences once.
camera, pose, point = StereoCamera(), np.array([1.0, 2.0, 0.5]), np.array([9.0, 4.0])
by_pose, by_point = camera.jacobians(pose, point)
moved = [camera.predict(compose(pose, step), point) for step in 1e-6 * np.eye(3)]
shifted = [camera.predict(pose, point + step) for step in 1e-6 * np.eye(2)]
for name, exact, after in (("pose", by_pose, moved), ("point", by_point, shifted)):
    difference = (np.array(after) - camera.predict(pose, point)).T / 1e-6
    print(f"Jacobian by {name}: differs by {np.abs(exact - difference).max():.0e} at most")

mission = fgplan.load_mission(SCENARIO)
for carried in ((), ("lidar",), ("camera",)):
    robots = tuple(replace(robot, sensors=carried) for robot in mission.robots)
    equipped = replace(mission, robots=robots, sensors={**mission.sensors, "camera": camera})
    rng = np.random.default_rng(mission.seed)
    sets = candidate_sets(equipped, CandidateOptions(candidates=20), rng)
    agreement = fgplan.coordinate(sets.problem, sets.candidates, fgplan.Incremental())
    belief = fgplan.candidate_belief(sets.problem, agreement.paths)
    print(f"{carried[0] if carried else 'no sensor'}: objective {agreement.value:.3f}")
    for robot, path in agreement.paths.items():
        covariance = belief.belief().covariance(belief.key(robot, path.steps))
        print(
            f"  {robot}: candidate {agreement.chosen[robot]}, {path.length_m:.1f} m, "
            f"{len(path.observations)} landmark observations, position on arrival "
            f"{np.sqrt(np.trace(covariance[:2, :2])):.3f} m (1 sigma)"
        )
