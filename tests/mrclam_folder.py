"""A small MR.CLAM folder with a known truth, written in the dataset's own format."""

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np

REMARK = "# UTIAS Multi-Robot Cooperative Localization and Mapping Dataset\n"
ORIGIN_S = 1_248_444_175.0
BARCODES = {1: 5, 2: 14, 3: 41, 6: 63, 7: 81, 8: 7, 9: 70, 10: 45, 11: 27}
LANDMARKS = {
    6: (0.2, 0.1),
    7: (3.9, 0.3),
    8: (4.1, 4.8),
    9: (-0.1, 4.9),
    10: (2.0, 6.6),
    11: (2.1, -1.3),
}
STARTS = {1: (0.5, 1.0, 0.4), 2: (3.5, 1.2, 2.2), 3: (1.8, 4.2, -1.4)}
STEP_S, FRAME_S = 0.02, 0.24
VIEW_RAD = 0.8
"""Half of the field of view."""


@dataclass
class World:
    """Fine truth: times (n,), poses by robot (n, 3)."""

    times: np.ndarray
    poses: dict[int, np.ndarray]

    def at(self, subject: int, when: np.ndarray) -> np.ndarray:
        """True poses at given times."""
        return np.column_stack(
            [np.interp(when, self.times, column) for column in self.poses[subject].T]
        )


def drive(seconds: float) -> tuple[World, dict[int, np.ndarray]]:
    """Robots that go ahead and turn by pieces of 2 s; rest during the first second."""
    times = STEP_S * np.arange(round(seconds / STEP_S) + 1)
    poses, commands = {}, {}
    for subject, start in STARTS.items():
        rng = np.random.default_rng(subject)
        pieces = rng.choice([-0.35, 0.0, 0.0, 0.4], size=int(seconds // 2) + 1)
        forward = np.where(times < 1.0, 0.0, 0.08)
        turn = np.where(times < 1.0, 0.0, pieces[(times // 2.0).astype(int)])
        driven = [np.array(start)]
        for v, w in zip(forward[:-1], turn[:-1], strict=True):
            x, y, heading = driven[-1]
            middle = heading + 0.5 * w * STEP_S
            driven.append(
                np.array(
                    [
                        x + v * STEP_S * np.cos(middle),
                        y + v * STEP_S * np.sin(middle),
                        heading + w * STEP_S,
                    ]
                )
            )
        poses[subject] = np.array(driven)
        commands[subject] = np.column_stack([times, forward, turn])
    return World(times, poses), commands


def sightings(world: World, subject: int) -> list[tuple[float, int, float, float]]:
    """What a robot's camera sees, exact, in order of time."""
    found = []
    for when in np.arange(0.1 + 0.03 * subject, world.times[-1], FRAME_S):
        moment = np.array([when])
        x, y, heading = world.at(subject, moment)[0]
        places = {
            **LANDMARKS,
            **{other: world.at(other, moment)[0, :2] for other in STARTS if other != subject},
        }
        for target, (px, py) in places.items():
            angle = np.arctan2(py - y, px - x) - heading
            bearing = float(np.arctan2(np.sin(angle), np.cos(angle)))
            if abs(bearing) < VIEW_RAD:
                found.append((float(when), target, float(np.hypot(px - x, py - y)), bearing))
    return found


def write_folder(
    folder: Path,
    seconds: float = 40.0,
    lag_s: float = 0.0,
    noise: np.random.Generator | None = None,
    compressed: bool = False,
) -> World:
    """Write a folder; the odometry's stamps are early by the lag."""
    folder.mkdir(parents=True, exist_ok=True)
    world, commands = drive(seconds)
    lines = [f"  {subject} \t {code}" for subject, code in BARCODES.items()]
    (folder / "Barcodes.dat").write_text(REMARK + "\n".join(lines) + "\n")
    lines = [f"  {s} \t {x:.8f} \t {y:.8f} \t 0.0001 \t 0.0002" for s, (x, y) in LANDMARKS.items()]
    (folder / "Landmark_Groundtruth.dat").write_text(REMARK + "\n".join(lines) + "\n")
    for subject in STARTS:
        odometry = commands[subject].copy()
        if noise is not None:
            odometry[:, 1:] *= 1.0 + 0.05 * noise.standard_normal((len(odometry), 2))
            odometry[:, 2] += 0.01
        # Its first row is 1 s before the first motion, whatever the lag.
        text = "".join(
            f"{ORIGIN_S + t - lag_s:.3f} \t {v:.6f} \t {w:.6f}\n"
            for t, v, w in odometry
            if t >= lag_s
        )
        (folder / f"Robot{subject}_Odometry.dat").write_text(REMARK + text)
        text = ""
        for when, target, distance, bearing in sightings(world, subject):
            if noise is not None:
                distance *= 1.0 + 0.02 * noise.standard_normal()
                bearing += 0.005 * noise.standard_normal()
            text += (
                f"{ORIGIN_S + when:.3f} \t {BARCODES[target]:4d} \t {distance:.6f} \t "
                f"{bearing:.6f}\n"
            )
        name, content = f"Robot{subject}_Measurement.dat", REMARK + text
        if compressed:
            (folder / f"{name}.gz").write_bytes(gzip.compress(content.encode()))
        else:
            (folder / name).write_text(content)
        wrapped = world.poses[subject].copy()
        wrapped[:, 2] = np.arctan2(np.sin(wrapped[:, 2]), np.cos(wrapped[:, 2]))
        text = "".join(
            f"{ORIGIN_S + t:.3f} \t {x:.8f} \t {y:.8f} \t {h:.8f}\n"
            for t, (x, y, h) in zip(world.times, wrapped, strict=True)
        )
        (folder / f"Robot{subject}_Groundtruth.dat").write_text(REMARK + text)
    return world
