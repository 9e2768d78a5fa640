"""The message by which a robot tells the team the path that it means to take.

Schema ``announcement.v1``, msgpack, columnar arrays. It holds what another robot needs to rebuild
the factors of the path - states, motion noise, planned observations of mapped landmarks - and what
it needs to accept or refuse the message: who sends it, in which planning session, computed from
which announcements (the *basis*), on which prior, for which objective. Row l of every column of
states is look-ahead step l.

A message is checked once, where it arrives; every fault names the robot and the field. The path is
made once a message and kept with it, so that robots in one process share it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import msgspec
import numpy as np

from fgplan.announcement.array_data import ArrayData, pack, unpack
from fgplan.announcement.term_data import Name, TermData
from fgplan.checks import check_covariances
from fgplan.errors import InvalidInputError
from fgplan.message_reader import MessageReader
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.typing import ArrayLike, Covariance, FloatArray, IntArray

MAX_BYTES = 64 * 1024 * 1024
"""Largest message that is read at all."""

MAX_STEPS = 100_000
MAX_OBSERVATIONS = 1_000_000

ROTATION_TOLERANCE = 1e-6
"""Largest |R R' - I| of a spatial pose."""

Sequence = Annotated[int, msgspec.Meta(ge=1)]
Session = Annotated[int, msgspec.Meta(ge=0)]
Basis = dict[Name, Sequence]


class Announcement(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    dict=True,
    forbid_unknown_fields=True,
    tag="announcement.v1",
    tag_field="schema",
):
    """A robot's announced path.

    Attributes:
        robot: Name of the robot.
        session: Planning session.
        sequence: Counts this robot's announcements of the session, from 1.
        basis: Sequence of each robot's announcement that this one was computed from.
        prior_digest: Digest of the prior that it was computed on.
        value: Common objective with this path; None in round 0, where nobody knows it.
        incumbent_value: Common objective with the path announced before; None in round 0.
        length_m: Length of the path, metres.
        poses: Shape (L + 1, 3) or (L + 1, 4, 4), world frame.
        times_s: Shape (L + 1,), seconds from planning time.
        motion: Shape (L, d) variances or (L, d, d) covariances of the motion steps.
        vertices: Shape (L + 1,), roadmap vertex or -1.
        sensors: Names of the sensors of the observations.
        observations: Shape (K, 3): step, index in ``sensors``, size m of the measurement.
        landmarks: Shape (K,), GTSAM keys.
        noise: All covariances of the observations, row by row, one after the other.
        goal: Coordinates of the robot's goal, metres, world frame; empty where there is none.
        terms: Objective terms that concern this robot, with their weights.
    """

    robot: Name
    session: Session
    sequence: Sequence
    basis: Basis
    prior_digest: Annotated[str, msgspec.Meta(max_length=256)]
    length_m: Annotated[float, msgspec.Meta(ge=0)]
    poses: ArrayData
    times_s: ArrayData
    motion: ArrayData
    vertices: ArrayData
    sensors: tuple[Name, ...]
    observations: ArrayData
    landmarks: ArrayData
    noise: ArrayData
    value: float | None = None
    incumbent_value: float | None = None
    goal: Annotated[tuple[float, ...], msgspec.Meta(max_length=6)] = ()
    terms: tuple[TermData, ...] = ()

    @property
    def steps(self) -> IntArray:
        """Look-ahead step of each state: shape (L + 1,)."""
        return np.arange(self.poses.shape[0])

    @cached_property
    def _path(self) -> CandidatePath:
        """The path, checked."""
        return _checked_path(self)

    @cached_property
    def encoded(self) -> bytes:
        """The message as msgpack."""
        return msgspec.msgpack.encode(self)

    @property
    def byte_size(self) -> int:
        """Bytes of the message on the wire."""
        return len(self.encoded)

    def path(self) -> CandidatePath:
        """The announced path; made and checked once a message.

        Raises:
            InvalidInputError: If a field is not usable; names robot and field.
        """
        return self._path


class Withdrawal(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag="withdrawal.v1",
    tag_field="schema",
):
    """A robot has no path (any more): it stays where the prior says it is.

    Attributes:
        robot: Whose path is withdrawn.
        session: Planning session.
        sequence: Takes a place in this robot's sequence of announcements.
        basis: As in an announcement.
        prior_digest: As in an announcement.
        by: Who says so: the robot itself, or a teammate that found it gone.
        reason: For people.
    """

    robot: Name
    session: Session
    sequence: Sequence
    basis: Basis
    prior_digest: Annotated[str, msgspec.Meta(max_length=256)]
    by: Name
    reason: Annotated[str, msgspec.Meta(max_length=4096)] = ""

    @property
    def encoded(self) -> bytes:
        """The message as msgpack."""
        return msgspec.msgpack.encode(self)

    @property
    def byte_size(self) -> int:
        """Bytes of the message on the wire."""
        return len(self.encoded)


Message = Announcement | Withdrawal

_READER: MessageReader[Message] = MessageReader(Message)
_JSON_READER: MessageReader[Message] = MessageReader(Message, json=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sender:
    """What every message of a robot says besides the path.

    Attributes:
        session: Planning session.
        prior_digest: Digest of the prior.
        goal: Coordinates of the robot's goal, metres, world frame.
        terms: Objective terms that concern the robot.
    """

    session: int = 0
    prior_digest: str = ""
    goal: tuple[float, ...] = ()
    terms: tuple[TermData, ...] = ()


def announcement_of(
    path: CandidatePath,
    *,
    sequence: int,
    basis: Mapping[str, int],
    sender: Sender | None = None,
    value: float | None = None,
    incumbent_value: float | None = None,
) -> Announcement:
    """Announcement of a path.

    Args:
        path: The path; it is kept with the message, which therefore needs no decoding here.
        sequence: Number of this announcement of the robot, from 1.
        basis: Sequence of each robot's announcement that it was computed from.
        sender: Session, prior digest, goal and terms.
        value: Common objective with this path.
        incumbent_value: Common objective with the path announced before.

    Returns:
        The message.
    """
    sender = sender or Sender()
    seen = path.observations
    names = tuple(dict.fromkeys(item.sensor for item in seen))
    index = {name: place for place, name in enumerate(names)}
    rows = [(item.step, index[item.sensor], len(item.covariance)) for item in seen]
    noise = [np.ravel(item.covariance) for item in seen]
    motion = path.motion_covariances
    variances = np.diagonal(motion, axis1=1, axis2=2)
    if np.count_nonzero(motion) == np.count_nonzero(variances):
        motion = variances
    announcement = Announcement(
        robot=path.robot,
        session=sender.session,
        sequence=sequence,
        basis=dict(basis),
        prior_digest=sender.prior_digest,
        value=value,
        incumbent_value=incumbent_value,
        length_m=path.length_m,
        poses=pack(path.poses, "<f8"),
        times_s=pack(path.times_s, "<f8"),
        motion=pack(motion, "<f8"),
        vertices=pack(path.vertices, "<i8"),
        sensors=names,
        observations=pack(np.reshape(rows, (-1, 3)) if rows else np.zeros((0, 3)), "<i8"),
        landmarks=pack([item.landmark for item in seen], "<u8"),
        noise=pack(np.concatenate(noise) if noise else np.zeros(0), "<f8"),
        goal=sender.goal,
        terms=sender.terms,
    )
    announcement.__dict__["_path"] = path
    return announcement


def goal_of(goal: ArrayLike) -> tuple[float, ...]:
    """Coordinates of a goal as an announcement carries them."""
    return tuple(float(value) for value in np.ravel(np.asarray(goal, dtype=np.float64)))


def decode_message(data: bytes, sender: str, *, json: bool = False) -> Message:
    """Read and check a message.

    Args:
        data: As received.
        sender: Robot that it came from, for messages of errors.
        json: Whether it is JSON (logs) instead of msgpack (the wire).

    Returns:
        The message, every field checked, its path made.

    Raises:
        InvalidInputError: If it is malformed, not finite, inconsistent or too large; names the
            robot and the field.
    """
    if len(data) > MAX_BYTES:
        raise InvalidInputError(
            f"message of robot {sender!r}: expected at most {MAX_BYTES} bytes, got {len(data)}"
        )
    message = (_JSON_READER if json else _READER).read(data, f"message of robot {sender!r}")
    if isinstance(message, Announcement):
        message.path()
    return message


def _checked_path(message: Announcement) -> CandidatePath:
    """Check every field of an announcement and make its path."""
    name = f"announcement {message.sequence} of robot {message.robot!r}"
    numbers = [("length_m", message.length_m), ("value", message.value)]
    numbers += [("incumbent_value", message.incumbent_value)]
    numbers += [("goal", coordinate) for coordinate in message.goal]
    numbers += [(f"terms[{place}].weight", term.weight) for place, term in enumerate(message.terms)]
    for field, number in numbers:
        if number is not None and not math.isfinite(number):
            raise InvalidInputError(f"{name}: {field}: expected a finite number, got {number}")
    poses = unpack(message.poses, f"{name}: poses", "<f8", (2, 3))
    if not 2 <= len(poses) <= MAX_STEPS + 1:
        raise InvalidInputError(
            f"{name}: poses: expected 2 to {MAX_STEPS + 1} rows, got {len(poses)}"
        )
    if poses.ndim == 3:
        _check_rigid(poses, name)
    motion = unpack(message.motion, f"{name}: motion", "<f8", (2, 3))
    if motion.ndim == 2:
        full = np.zeros((*motion.shape, motion.shape[1]))
        diagonal = np.arange(motion.shape[1])
        full[:, diagonal, diagonal] = motion
        motion = full
    try:
        return CandidatePath(
            robot=message.robot,
            poses=poses,
            times_s=unpack(message.times_s, f"{name}: times_s", "<f8", (1,)),
            motion_covariances=motion,
            vertices=tuple(unpack(message.vertices, f"{name}: vertices", "<i8", (1,)).tolist()),
            observations=_checked_observations(message, name),
            length_m=message.length_m,
        )
    except InvalidInputError as error:
        if str(error).startswith(name):
            raise
        raise InvalidInputError(f"{name}: {error}") from error


def _check_rigid(poses: FloatArray, name: str) -> None:
    """Check that spatial poses are rigid motions; their shape is the path's to check."""
    if poses.shape[1:] != (4, 4) or not np.isfinite(poses).all():
        return
    rotation = poses[:, :3, :3]
    drift = np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max(axis=(1, 2))
    wrong = (drift > ROTATION_TOLERANCE) | (np.linalg.det(rotation) < 0)
    wrong |= (poses[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1)
    if wrong.any():
        step = int(np.argmax(wrong))
        raise InvalidInputError(
            f"{name}: poses: expected rigid motions, got |R R' - I| up to {drift[step]:g} at step "
            f"{step}"
        )


def _checked_observations(message: Announcement, name: str) -> tuple[Observation, ...]:
    """Check the columns of the observations and make them."""
    rows = unpack(message.observations, f"{name}: observations", "<i8", (2,))
    landmarks = unpack(message.landmarks, f"{name}: landmarks", "<u8", (1,))
    noise = unpack(message.noise, f"{name}: noise", "<f8", (1,))
    if rows.shape[1] != 3 or len(rows) != len(landmarks) or len(rows) > MAX_OBSERVATIONS:
        raise InvalidInputError(
            f"{name}: observations: expected shape ({len(landmarks)}, 3), one row a landmark, at "
            f"most {MAX_OBSERVATIONS}, got {rows.shape}"
        )
    if len(rows) == 0:
        return ()
    sensors, sizes = rows[:, 1], rows[:, 2]
    if sensors.min() < 0 or sensors.max() >= len(message.sensors):
        raise InvalidInputError(
            f"{name}: observations: expected sensors 0 to {len(message.sensors) - 1}, got "
            f"{sensors.min()} to {sensors.max()}"
        )
    if sizes.min() < 1 or sizes.max() > 6 or int((sizes**2).sum()) != len(noise):
        raise InvalidInputError(
            f"{name}: noise: expected one covariance of 1 to 6 rows an observation, got "
            f"{len(noise)} numbers for sizes {np.unique(sizes).tolist()}"
        )
    covariances = _checked_noise(noise, rows, landmarks, name)
    return tuple(
        Observation(
            step=step, landmark=landmark, sensor=message.sensors[sensor], covariance=covariance
        )
        for (step, sensor, _), landmark, covariance in zip(
            rows.tolist(), landmarks.tolist(), covariances, strict=True
        )
    )


def _checked_noise(
    noise: FloatArray, rows: IntArray, landmarks: IntArray, name: str
) -> list[Covariance]:
    """The covariance of each observation; those of one size are checked at once."""
    sizes = rows[:, 2]
    ends = np.cumsum(sizes**2)
    covariances: list[Covariance] = [noise] * len(rows)
    for size in np.unique(sizes).tolist():
        which = np.flatnonzero(sizes == size)
        columns = ends[which, None] - size * size + np.arange(size * size)

        def named(place: int, which: IntArray = which) -> str:
            row = which[place]
            return f"{name}: noise of landmark {landmarks[row]} at step {rows[row, 0]}"

        stack = check_covariances(noise[columns].reshape(-1, size, size), named)
        for row, covariance in zip(which.tolist(), stack, strict=True):
            covariances[row] = covariance
    return covariances
