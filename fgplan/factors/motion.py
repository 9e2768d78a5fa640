"""Motion factors of a path: P(x_l | x_{l-1}, u_{l-1}) of equation (9).

Planning expects the motion to go as planned, so the measured relative pose is the relative pose of
the path's own states and the factor's error is zero at them:

    h = x_{l-1}^-1 x_l,   whitened Jacobians  -W Ad(h^-1)  and  W,   W'W = noise^-1
"""

from collections.abc import Sequence

import gtsam

from fgplan.factors.factor_set import FactorId, PlannedFactor, state_identity
from fgplan.factors.gaussian_noise import gaussian_noise, noise_digest
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Key, Pose


def gtsam_pose(pose: Pose) -> gtsam.Pose2 | gtsam.Pose3:
    """GTSAM's pose of (x, y, heading) or a 4 x 4 matrix."""
    return gtsam.Pose2(pose[0], pose[1], pose[2]) if pose.ndim == 1 else gtsam.Pose3(pose)


def between_factor(
    first_key: Key, second_key: Key, first: Pose, second: Pose, noise: gtsam.noiseModel.Base
) -> gtsam.NonlinearFactor:
    """Relative-pose factor with zero error at the two poses, noise in the second's tangent."""
    if first.ndim == 1:
        step = gtsam.Pose2(*first).between(gtsam.Pose2(*second))
        return gtsam.BetweenFactorPose2(first_key, second_key, step, noise)
    motion = gtsam.Pose3(first).between(gtsam.Pose3(second))
    return gtsam.BetweenFactorPose3(first_key, second_key, motion, noise)


def motion_factors(path: CandidatePath, keys: Sequence[Key]) -> tuple[PlannedFactor, ...]:
    """Motion factors between consecutive states of a path.

    Args:
        path: The path; its noise is in the tangent of the later pose of each step.
        keys: Key of each pose, length L + 1; the first is the current pose's in the prior.

    Returns:
        L factors by increasing step.
    """
    identities = [state_identity(path.state(step)) for step in range(path.steps + 1)]
    factors = []
    for step in range(1, path.steps + 1):
        covariance = path.motion_covariances[step - 1]
        noise = gaussian_noise(covariance, f"motion of robot {path.robot!r} at step {step}")
        variables = (keys[step - 1], keys[step])
        identity = FactorId(
            "motion",
            "between",
            variables,
            (identities[step - 1], identities[step]),
            noise_digest(covariance),
        )
        factor = between_factor(*variables, path.poses[step - 1], path.poses[step], noise)
        factors.append(PlannedFactor(identity, factor, step))
    return tuple(factors)
