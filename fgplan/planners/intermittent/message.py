"""What robots tell each other at a meeting, and what their sensors tell them.

``sensed`` comes from the robot's own sensors; ``known`` carries everything that a robot knows and
the ways that it has agreed on with other teams; ``agreed`` carries the ways to the team's next
meeting, and everything known once more, so that whoever has it has all.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.message_reader import MessageReader
from fgplan.planners.intermittent.estimate import Estimate, Record
from fgplan.planners.intermittent.knowledge import Knowledge
from fgplan.planners.intermittent.leg import Leg
from fgplan.team.envelope import Envelope
from fgplan.typing import FloatArray

Count = Annotated[int, msgspec.Meta(ge=0)]


class Sensed(msgspec.Struct, frozen=True):
    """Where a robot is and what it measured; its payload carries the step's record."""

    record: Record


class Numbers(msgspec.Struct, frozen=True, array_like=True):
    """An array of numbers: its shape and its bytes, little-endian float64."""

    shape: tuple[Count, ...]
    data: bytes


class LegData(msgspec.Struct, frozen=True):
    """A ``Leg``."""

    team: Count
    epoch: Count
    due: Count
    start: Count
    places: Numbers
    slack: Count = 0


class Offer(msgspec.Struct, frozen=True):
    """Where a robot is and the ways that it goes before it meets this team again."""

    position: tuple[float, float]
    legs: tuple[LegData, ...]


class Known(msgspec.Struct, frozen=True):
    """All that a robot knows, and the offers of those present that it has heard."""

    robot: Count
    time: Count
    mean: Numbers
    covariance: Numbers
    logs: tuple[tuple[Record, ...], ...]
    heard: tuple[Count, ...]
    discarded: Count
    offers: dict[str, Offer]


class Agreed(msgspec.Struct, frozen=True):
    """The ways to the team's next meeting, by robot."""

    known: Known
    legs: dict[str, LegData]


def numbers_of(array: FloatArray) -> Numbers:
    """An array as a message.

    Args:
        array: Any shape.

    Returns:
        Shape and bytes.
    """
    return Numbers(np.shape(array), np.asarray(array, dtype="<f8").tobytes())


def array_of(numbers: Numbers) -> FloatArray:
    """An array of a message.

    Args:
        numbers: Shape and bytes.

    Returns:
        The array.

    Raises:
        InvalidInputError: If the bytes do not fit the shape, or a number is not finite.
    """
    wanted = 8 * math.prod(numbers.shape)
    if len(numbers.data) != wanted:
        raise InvalidInputError(
            f"message: expected {wanted} bytes for shape {numbers.shape}, got {len(numbers.data)}"
        )
    array = np.frombuffer(numbers.data, dtype="<f8").reshape(numbers.shape).astype(np.float64)
    if not np.isfinite(array).all():
        raise InvalidInputError("message: expected finite numbers, got some that are not")
    return array


def leg_data(leg: Leg) -> LegData:
    """A leg as a message.

    Args:
        leg: The leg.

    Returns:
        Its data.
    """
    return LegData(leg.team, leg.epoch, leg.due, leg.start, numbers_of(leg.places), leg.slack)


def leg_of(data: LegData) -> Leg:
    """A leg of a message.

    Args:
        data: As ``leg_data`` gives it.

    Returns:
        The leg.

    Raises:
        InvalidInputError: If its places are not usable.
    """
    places = array_of(data.places)
    if places.ndim != 2 or places.shape[1] != 2 or len(places) == 0:
        raise InvalidInputError(f"message: expected places of shape (steps, 2), got {places.shape}")
    return Leg(data.team, data.epoch, data.due, data.start, places, data.slack)


def known_of(knowledge: Knowledge, offers: dict[str, Offer]) -> Known:
    """Knowledge as a message.

    Args:
        knowledge: What the robot knows.
        offers: Of those present.

    Returns:
        The message.
    """
    return Known(
        robot=knowledge.robot,
        time=knowledge.checkpoint.time,
        mean=numbers_of(knowledge.checkpoint.mean),
        covariance=numbers_of(knowledge.checkpoint.covariance),
        logs=knowledge.logs,
        heard=tuple(knowledge.heard.tolist()),
        discarded=knowledge.discarded,
        offers=offers,
    )


def knowledge_of(known: Known) -> Knowledge:
    """Knowledge of a message.

    Args:
        known: As ``known_of`` gives it.

    Returns:
        What the sender knows.

    Raises:
        InvalidInputError: If an array is not usable.
    """
    return Knowledge(
        robot=known.robot,
        checkpoint=Estimate(known.time, array_of(known.mean), array_of(known.covariance)),
        logs=known.logs,
        heard=np.array(known.heard, dtype=np.int64),
        discarded=known.discarded,
    )


def wrap(robot: str, team: int, epoch: int, content: msgspec.Struct) -> Envelope:
    """Put a message into an envelope: the team is its session, the epoch its sequence.

    Args:
        robot: Who sends.
        team: Team that meets; 0 for ``sensed``.
        epoch: Epoch of the meeting, or the step of ``sensed``.
        content: The message.

    Returns:
        The envelope; its content is kept with it.
    """
    return Envelope(
        robot=robot,
        session=team,
        sequence=epoch,
        kind=type(content).__name__.lower(),
        payload=msgspec.msgpack.encode(content),
    ).keep(content)


_READERS: dict[str, MessageReader[Any]] = {
    "sensed": MessageReader(Sensed),
    "known": MessageReader(Known),
    "agreed": MessageReader(Agreed),
}


def unwrap(
    envelope: Envelope, readers: Mapping[str, MessageReader[Any]] = _READERS, whose: str = "robot "
) -> Any:  # noqa: ANN401 - one of the kinds
    """Read a message.

    Args:
        envelope: As received.
        readers: Readers by kind; those that robots tell each other if left out.
        whose: What errors call the sender, before its name.

    Returns:
        The message: of robots a ``Sensed``, ``Known`` or ``Agreed``.

    Raises:
        InvalidInputError: If it is malformed or of another kind.
    """
    if envelope.kind not in readers:
        raise InvalidInputError(
            f"message of {whose}{envelope.robot!r}: expected one of {', '.join(readers)}, got "
            f"{envelope.kind!r}"
        )
    if envelope.content is not None:
        return envelope.content
    name = f"message {envelope.kind!r} of {whose}{envelope.robot!r}"
    content = readers[envelope.kind].read(envelope.payload, name)
    envelope.keep(content)
    return content
