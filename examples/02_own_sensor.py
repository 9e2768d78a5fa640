"""Your own sensor: three methods, and every planner and evaluator can use it.

A stereo camera measures a landmark's position in the robot's frame. It looks ahead only, and its
depth is worth less and less with distance: its sigma grows with the square of it.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import fgplan

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
        return fgplan.rotation_matrix(pose).T @ (target - pose[:2])

    def jacobians(self, pose, target):
        """By the pose's tangent (forward, left, turn: increments on the right) and the point."""
        forward, left = self.predict(pose, target)
        return np.array([[-1.0, 0.0, left], [0.0, -1.0, -forward]]), fgplan.rotation_matrix(pose).T

    def noise(self, pose, target):
        """Covariance of the measurement, shape (2, 2), square metres."""
        depth = self.predict(pose, target)[0]
        return np.diag([self.sigma_m + self.depth_sigma_per_m * depth**2, self.sigma_m]) ** 2


# A wrong Jacobian plans quietly with wrong covariances: compare with central differences once.
camera = StereoCamera()
difference = fgplan.check_sensor(camera, pose=[1.0, 2.0, 0.5], target=[9.0, 4.0])
print(f"Jacobians differ from central differences by {difference:.0e} at most")

mission = fgplan.load_mission(SCENARIO)
for carried in ((), ("lidar",), ("camera",)):
    robots = tuple(replace(robot, sensors=carried) for robot in mission.robots)
    equipped = replace(mission, robots=robots, sensors={**mission.sensors, "camera": camera})
    sets = fgplan.candidate_sets(equipped, fgplan.CandidateOptions(candidates=20))
    agreement = fgplan.coordinate(sets.problem, sets.candidates)
    belief = fgplan.candidate_belief(sets.problem, agreement.paths)
    print(f"{carried[0] if carried else 'no sensor'}: objective {agreement.value:.3f}")
    for robot, path in agreement.paths.items():
        print(
            f"  {robot}: candidate {agreement.chosen[robot]}, {path.length_m:.1f} m, "
            f"{len(path.observations)} landmark observations, position on arrival "
            f"{belief.position_sigma_m(robot):.3f} m (1 sigma)"
        )
