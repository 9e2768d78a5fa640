"""UTIAS MR.CLAM folders: what five robots with cameras logged, and the truth beside it.

    Barcodes.dat               subject  barcode                subjects 1, 2, ... are the robots
    Landmark_Groundtruth.dat   subject  x  y  x_sigma  y_sigma
    RobotN_Odometry.dat        time  forward_velocity  angular_velocity     (commanded, ~67 Hz)
    RobotN_Measurement.dat     time  barcode  range  bearing    of landmarks and of other robots
    RobotN_Groundtruth.dat     time  x  y  heading              (Vicon)

Seconds, metres, radians; lines that begin with # are remarks; each file may be gzip-compressed
(``.dat.gz``). The second column of a measurement is headed "Subject #" but holds the barcode. A
barcode that is not in Barcodes.dat (the camera misread it) or is the robot's own is left out and
counted; nothing else is.

The data are not part of fgplan: they are "for educational use", without a formal licence, from
http://asrl.utias.utoronto.ca/datasets/mrclam/. Cite K. Y. K. Leung, Y. Halpern, T. D. Barfoot,
H. H. T. Liu, "The UTIAS multi-robot cooperative localization and mapping dataset", International
Journal of Robotics Research 30(8):969-974, 2011.
"""

import gzip
import re
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fgplan.checks import check_finite, frozen
from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.typing import FloatArray, IntArray

_ROBOT_FILE = re.compile(r"Robot(\d+)_(?:Odometry|Measurement|Groundtruth)\.dat(?:\.gz)?")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MrclamRobot:
    """What one robot logged. Times are seconds since the log's ``origin_s``.

    Attributes:
        subject: Number of the robot.
        odometry: Shape (N, 3): time, forward velocity (m/s), angular velocity (rad/s).
        measured_at: Time of each measurement, shape (M,); those of one camera frame share it.
        measured: Subject that each measurement is of, shape (M,).
        ranges_m: Shape (M,).
        bearings_rad: Shape (M,), from straight ahead, to the left.
        truth: Shape (T, 4): time, x, y, heading; world frame, m, m, rad, heading unwrapped.
        unknown_barcodes: Measurements left out because their barcode is nobody's, by barcode.
        own_barcode: Measurements left out because their barcode is the robot's own.
    """

    subject: int
    odometry: FloatArray = field(repr=False)
    measured_at: FloatArray = field(repr=False)
    measured: IntArray = field(repr=False)
    ranges_m: FloatArray = field(repr=False)
    bearings_rad: FloatArray = field(repr=False)
    truth: FloatArray = field(repr=False)
    unknown_barcodes: Mapping[int, int]
    own_barcode: int

    def __post_init__(self) -> None:
        """Make arrays read-only and check their shapes.

        Raises:
            InvalidInputError: If sizes disagree, a number is not finite, or times run backwards.
        """
        name, count = f"MR.CLAM robot {self.subject}", len(self.measured_at)
        measured = np.array(self.measured, dtype=np.int64)
        if measured.shape != (count,):
            raise InvalidInputError(
                f"{name}: expected one subject a measurement, shape ({count},), got "
                f"{measured.shape}"
            )
        measured.setflags(write=False)
        object.__setattr__(self, "measured", measured)
        for what, shape in (
            ("odometry", (None, 3)),
            ("measured_at", (count,)),
            ("ranges_m", (count,)),
            ("bearings_rad", (count,)),
            ("truth", (None, 4)),
        ):
            object.__setattr__(
                self, what, check_finite(getattr(self, what), f"{name}: {what}", shape)
            )
        for what, times in (
            ("odometry", self.odometry[:, 0]),
            ("measured_at", self.measured_at),
            ("truth", self.truth[:, 0]),
        ):
            if (np.diff(times) < 0.0).any():
                raise InvalidInputError(f"{name}: {what}: expected times that never run backwards")

    def true_poses(self, times: FloatArray) -> FloatArray:
        """True pose at given times, linear between Vicon's; NaN outside of its first and last.

        Args:
            times: Shape (n,), seconds since the log's origin.

        Returns:
            Shape (n, 3), world frame: m, m, rad (unwrapped).
        """
        when = self.truth[:, 0]
        return np.column_stack(
            [np.interp(times, when, column, np.nan, np.nan) for column in self.truth[:, 1:].T]
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MrclamLog:
    """A folder as read.

    Attributes:
        folder: Where it is.
        origin_s: Time 0 of the log: the earliest stamp in it, seconds since 1970.
        robots: By subject, ascending.
        landmarks: True position of each landmark by subject, shape (2,), metres, world frame. For
            judging alone: to SLAM landmarks are unknown.
        barcodes: Subject by barcode.
    """

    folder: Path
    origin_s: float
    robots: tuple[MrclamRobot, ...]
    landmarks: Mapping[int, FloatArray] = field(repr=False)
    barcodes: Mapping[int, int] = field(repr=False)

    def robot(self, subject: int) -> MrclamRobot:
        """The robot of a subject number.

        Raises:
            InvalidInputError: If there is none; lists those there are.
        """
        for robot in self.robots:
            if robot.subject == subject:
                return robot
        known = ", ".join(str(robot.subject) for robot in self.robots)
        raise InvalidInputError(f"MR.CLAM robot: expected one of {known}, got {subject}")


def read_mrclam(folder: Path | str) -> MrclamLog:
    """Read an MR.CLAM folder.

    Args:
        folder: As the dataset's archive unpacks, for example MRCLAM_Dataset6; files plain or .gz.

    Returns:
        The log.

    Raises:
        ScenarioError: If a file is missing, there twice or unreadable, or at the first line that is
            not as the format says, with file and line.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ScenarioError(
            f"{folder}: expected a folder of an MR.CLAM dataset; obtain one from "
            "http://asrl.utias.utoronto.ca/datasets/mrclam/"
        )
    subjects = sorted(
        {int(m.group(1)) for path in folder.iterdir() if (m := _ROBOT_FILE.fullmatch(path.name))}
    )
    if not subjects:
        raise ScenarioError(f"{folder}: expected files Robot1_Odometry.dat and so on, got none")
    barcodes = _read_barcodes(folder, subjects)
    landmarks = _read_landmarks(folder, set(barcodes.values()), subjects)
    tables = {
        subject: {
            what: _Table.read(folder, f"Robot{subject}_{what}", columns)
            for what, columns in (("Odometry", 3), ("Measurement", 4), ("Groundtruth", 4))
        }
        for subject in subjects
    }
    for table in (table for of_robot in tables.values() for table in of_robot.values()):
        table.check_times()
    origin = min(
        float(table.rows[0, 0])
        for of_robot in tables.values()
        for table in of_robot.values()
        if len(table.rows)
    )
    robots = tuple(
        _robot(subject, of_robot, barcodes, set(landmarks) | set(subjects), origin)
        for subject, of_robot in tables.items()
    )
    return MrclamLog(
        folder=folder, origin_s=origin, robots=robots, landmarks=landmarks, barcodes=barcodes
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Numbers of one file and where each row stands in it."""

    path: Path
    rows: FloatArray
    lines: tuple[int, ...]

    @classmethod
    def read(cls, folder: Path, name: str, columns: int) -> "_Table":
        """Read ``name``.dat or ``name``.dat.gz."""
        path, text = _read_text(folder, name)
        numbered = [
            (number, line)
            for number, line in enumerate(text.splitlines(), start=1)
            if line.strip() and not line.lstrip().startswith("#")
        ]
        try:  # all at once: a log has half a million lines
            rows = np.array([line.split() for _, line in numbered], dtype=np.float64)
            understood = rows.shape == (len(numbered), columns) and bool(np.isfinite(rows).all())
        except ValueError:
            understood = False
        if numbered and not understood:
            raise _first_bad_line(path, numbered, columns)
        return cls(path, rows.reshape(-1, columns), tuple(number for number, _ in numbered))

    def where(self, row: int) -> str:
        """File and line of a row."""
        return f"{self.path}:{self.lines[row]}"

    def check_times(self) -> None:
        """Raise where the first column runs backwards."""
        backwards = np.flatnonzero(np.diff(self.rows[:, 0]) < 0.0)
        if backwards.size:
            row = int(backwards[0]) + 1
            raise ScenarioError(
                f"{self.where(row)}: expected times that never run backwards, got "
                f"{self.rows[row, 0]:.3f} after {self.rows[row - 1, 0]:.3f}"
            )

    def integers(self, column: int, what: str) -> IntArray:
        """A column of whole numbers above zero."""
        values = self.rows[:, column]
        wrong = np.flatnonzero((values != np.round(values)) | (values < 1.0))
        if wrong.size:
            row = int(wrong[0])
            raise ScenarioError(
                f"{self.where(row)}: expected {what}, a whole number above zero, got "
                f"{values[row]:g}"
            )
        return values.astype(np.int64)

    def check_distinct(self, values: IntArray, what: str) -> None:
        """Raise at the first value that is there twice."""
        seen: set[int] = set()
        for row, value in enumerate(values.tolist()):
            if value in seen:
                raise ScenarioError(f"{self.where(row)}: {what} {value} is there a second time")
            seen.add(value)


def _read_text(folder: Path, name: str) -> tuple[Path, str]:
    """The one file of a name, plain or compressed."""
    plain, packed = folder / f"{name}.dat", folder / f"{name}.dat.gz"
    found = [path for path in (plain, packed) if path.is_file()]
    if not found:
        raise ScenarioError(f"{folder}: expected {plain.name} (or {packed.name}), which is missing")
    if len(found) == 2:
        raise ScenarioError(f"{folder}: {plain.name} is there twice, plain and as .gz; remove one")
    try:
        content = found[0].read_bytes()
        if found[0] == packed:
            content = gzip.decompress(content)
        return found[0], content.decode()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise ScenarioError(f"{found[0]}: expected a readable text file: {error}") from error


def _first_bad_line(path: Path, numbered: list[tuple[int, str]], columns: int) -> ScenarioError:
    """The error of the first line that is not ``columns`` finite numbers."""
    for number, line in numbered:
        words = line.split()
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            numbers = []
        if len(numbers) != columns or not np.isfinite(numbers).all():
            return ScenarioError(
                f"{path}:{number}: expected {columns} finite numbers, got {line.strip()!r}"
            )
    raise AssertionError(f"{path}: every line is as expected")


def _read_barcodes(folder: Path, subjects: list[int]) -> dict[int, int]:
    """Subject by barcode; every robot must have one."""
    table = _Table.read(folder, "Barcodes", 2)
    found, codes = table.integers(0, "a subject"), table.integers(1, "a barcode")
    table.check_distinct(found, "subject")
    table.check_distinct(codes, "barcode")
    missing = [subject for subject in subjects if subject not in found]
    if missing:
        raise ScenarioError(
            f"{table.path}: expected a barcode of every robot, got none of robot {missing[0]}"
        )
    return dict(zip(codes.tolist(), found.tolist(), strict=True))


def _read_landmarks(
    folder: Path, with_barcode: set[int], subjects: list[int]
) -> dict[int, FloatArray]:
    """True positions by subject; a landmark is no robot and has a barcode, and so the reverse."""
    table = _Table.read(folder, "Landmark_Groundtruth", 5)
    found = table.integers(0, "a subject")
    table.check_distinct(found, "landmark")
    for row, subject in enumerate(found.tolist()):
        if subject in subjects or subject not in with_barcode:
            raise ScenarioError(
                f"{table.where(row)}: expected a landmark with a barcode that is no robot, got "
                f"subject {subject}"
            )
    rest = sorted(with_barcode - set(found.tolist()) - set(subjects))
    if rest:
        raise ScenarioError(
            f"{table.path}: expected every subject of Barcodes.dat that is no robot, subject "
            f"{rest[0]} is missing (robots are those with files: {subjects})"
        )
    return {
        subject: frozen(row[1:3]) for subject, row in zip(found.tolist(), table.rows, strict=True)
    }


def _robot(
    subject: int,
    tables: Mapping[str, _Table],
    barcodes: Mapping[int, int],
    known: set[int],
    origin: float,
) -> MrclamRobot:
    """One robot's log, its measurements by subject."""
    odometry, seen, truth = (tables[what] for what in ("Odometry", "Measurement", "Groundtruth"))
    for table in (odometry, truth):
        if not len(table.rows):
            raise ScenarioError(f"{table.path}: expected at least one line of numbers, got none")
    codes = seen.integers(1, "a barcode")
    wrong = np.flatnonzero((seen.rows[:, 2] <= 0.0) | (np.abs(seen.rows[:, 3]) > np.pi))
    if wrong.size:
        row = int(wrong[0])
        raise ScenarioError(
            f"{seen.where(row)}: expected a range above zero and a bearing within pi, got "
            f"{seen.rows[row, 2]:g} m and {seen.rows[row, 3]:g} rad"
        )
    subjects = np.array([barcodes.get(code, 0) for code in codes.tolist()], dtype=np.int64)
    kept = np.isin(subjects, sorted(known - {subject}))
    unknown = Counter(codes[subjects == 0].tolist())
    shifted = truth.rows - (origin, 0.0, 0.0, 0.0)
    shifted[:, 3] = np.unwrap(shifted[:, 3])
    return MrclamRobot(
        subject=subject,
        odometry=odometry.rows - (origin, 0.0, 0.0),
        measured_at=seen.rows[kept, 0] - origin,
        measured=subjects[kept],
        ranges_m=seen.rows[kept, 2],
        bearings_rad=seen.rows[kept, 3],
        truth=shifted,
        unknown_barcodes=dict(sorted(unknown.items())),
        own_barcode=int((subjects == subject).sum()),
    )
