"""Multi-robot SLAM of an MR.CLAM log, tick by tick as the robots would have run it.

Odometry, cameras and the prior of each start go into iSAM2 (fgplan.slam.team_slam); no position of
a landmark and no later Vicon pose does. Every measurement has Huber's loss, because about one range
in fifty is wrong by several sigmas and a few barcodes are misread: with Gaussian noise alone errors
are two to six times as large (docs/mrclam.md). A loss that redescends is worse: Cauchy's costs
0.01 to 0.03 m here, and in one batch from the odometry it takes all landmarks for outliers that a
robot sees after half a minute of seeing none (robot 3, after 500 s: 2 m off for a minute).
"""

from collections.abc import Callable

from fgplan.io.mrclam_steps import CAMERA, CAMERA_ROBOT, MrclamOptions, MrclamSteps
from fgplan.slam.robust_noise import RobustLoss
from fgplan.slam.slam_options import SlamOptions, SlamStart
from fgplan.slam.team_slam import TeamSlam

HUBER = RobustLoss(loss="huber", parameter=1.345)

RELINEARISE_M, RELINEARISE_EVERY = 0.05, 5
"""iSAM2's threshold (m, rad) and updates between checks: half of its usual threshold is worth 6 mm
of error; checking at every update is worth nothing and takes a third longer."""


def _no_progress(done: int, total: int) -> None:
    """Say nothing."""
    del done, total


def mrclam_slam(
    steps: MrclamSteps,
    options: MrclamOptions | None = None,
    loss: RobustLoss | None = HUBER,
    progress: Callable[[int, int], None] = _no_progress,
) -> TeamSlam:
    """Estimate all robots' poses and the landmarks.

    Args:
        steps: What the robots read.
        options: Those that the steps were made with; for the camera.
        loss: Robust loss of every measurement; None for Gaussian noise.
        progress: Called as ``progress(done, total)`` after each tick.

    Returns:
        SLAM after the last tick; step k is ``steps.times_s[k]``, and every robot has a pose at
        every step.

    Raises:
        IllPosedBeliefError: If iSAM2 finds a variable not determined.
    """
    camera = (options or MrclamOptions()).camera
    sensors = (CAMERA, CAMERA_ROBOT)
    slam = TeamSlam(
        {
            name: SlamStart(pose=pose, covariance=steps.start_covariance)
            for name, pose in steps.starts.items()
        },
        dict.fromkeys(sensors, camera),
        SlamOptions(
            relinearise_threshold=RELINEARISE_M,
            relinearise_every=RELINEARISE_EVERY,
            iterations=1,
            robust={} if loss is None else dict.fromkeys(sensors, loss),
        ),
    )
    for step, measurements in enumerate(steps.measurements):
        slam.update(step, steps.odometry[step - 1] if step else (), measurements)
        progress(step + 1, len(steps.measurements))
    return slam
