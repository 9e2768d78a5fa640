"""An MR.CLAM folder as a team's past: SLAM over the log, its graph at its estimate.

Every robot has a pose a second (the ticks of fgplan/io/mrclam_steps.py). Measurements have Huber's
loss; the graph that is handed on is Gaussian, each factor with the weight that the loss gives it at
the estimate, so it is not estimated again.
"""

import re
from pathlib import Path

from fgplan.io.mrclam import read_mrclam
from fgplan.io.mrclam_slam import mrclam_slam
from fgplan.io.mrclam_steps import mrclam_steps
from fgplan.io.team_past import TeamPast

_FILES = re.compile(
    r"(Barcodes|Landmark_Groundtruth|Robot\d+_(Odometry|Measurement|Groundtruth))\.dat(\.gz)?"
)


def is_mrclam(path: Path) -> bool:
    """Whether a path is a folder of an MR.CLAM dataset."""
    return path.is_dir() and any(_FILES.fullmatch(file.name) for file in path.iterdir())


def mrclam_files(folder: Path) -> tuple[Path, ...]:
    """Files of the dataset in a folder, by name."""
    return tuple(sorted(path for path in folder.iterdir() if _FILES.fullmatch(path.name)))


def read_mrclam_past(folder: Path, until_s: float | None = None) -> TeamPast:
    """Read an MR.CLAM folder and estimate all robots' poses and landmarks.

    Args:
        folder: The folder.
        until_s: Seconds after the first tick at which to stop; None takes the whole log.

    Returns:
        The past; its values are the estimate.

    Raises:
        ScenarioError: If a file is missing or malformed.
    """
    log = read_mrclam(folder)
    steps = mrclam_steps(log, until_s=until_s)
    slam = mrclam_slam(steps)
    left_out = steps.counts.get("unknown_barcode", 0) + steps.counts.get("own_barcode", 0)
    outside = steps.counts.get("outside", 0)
    times = {}
    for robot in slam.robots:
        for key, step in zip(slam.keys(robot), slam.steps(robot), strict=True):
            times[key] = float(log.origin_s + steps.times_s[step])
    return TeamPast(
        format="mrclam",
        files=mrclam_files(folder),
        graph=slam.graph(),
        values=slam.values(),
        robots={robot: slam.keys(robot) for robot in slam.robots},
        times_s=times,
        estimated=True,
        notes=(
            "estimated by iSAM2 with Huber's loss; each robot's first pose is Vicon's, to 1 mm",
            f"left out: {left_out} measurements with a barcode of nobody or the robot itself, "
            f"{outside} before the first tick or after the last",
        ),
    )
