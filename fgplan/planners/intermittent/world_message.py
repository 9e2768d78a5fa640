"""What the simulated world and the robots tell each other when each runs in its own process.

The world says ``tick``: a step has passed, the robot is here, measured this, and has these
teammates in range; ``quiet``: no message is under way; ``over``. A robot answers with ``stood``
whenever it has taken something in: where it stands and how many messages went to and came from
each teammate, from which the world sees when none is under way any more.
"""

from typing import Annotated, Any

import msgspec

from fgplan.message_reader import MessageReader
from fgplan.planners.intermittent.estimate import Record
from fgplan.planners.intermittent.message import unwrap, wrap
from fgplan.team.envelope import Envelope

WORLD = "world"
"""Name of the world among the participants."""

Count = Annotated[int, msgspec.Meta(ge=0)]
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=256)]


class Tick(msgspec.Struct, frozen=True, kw_only=True):
    """A step has passed.

    Attributes:
        number: Of the world's messages.
        record: Step, place, and what the robot measured.
        in_range: Teammates within range of radio.
    """

    number: Count
    record: Record
    in_range: tuple[Name, ...]


class Quiet(msgspec.Struct, frozen=True, kw_only=True):
    """No message is under way: whoever leads a complete team plans now.

    Attributes:
        number: Of the world's messages.
    """

    number: Count


class Over(msgspec.Struct, frozen=True, kw_only=True):
    """The last step is over.

    Attributes:
        number: Of the world's messages.
    """

    number: Count


class Stood(msgspec.Struct, frozen=True, kw_only=True):
    """Where a robot stands.

    Attributes:
        number: Of the world's last message that it has taken in.
        meeting: Whether it is at a meeting.
        place: Where it wants to be in the next step, metres.
        sent: Messages to each teammate so far.
        heard: Messages of each teammate so far.
        failed: Why it cannot go on, or nothing.
    """

    number: Count
    meeting: bool
    place: tuple[float, float]
    sent: dict[Name, Count]
    heard: dict[Name, Count]
    failed: Annotated[str, msgspec.Meta(max_length=10_000)] = ""


WorldMessage = Tick | Quiet | Over | Stood
_READERS: dict[str, MessageReader[Any]] = {
    kind.__name__.lower(): MessageReader(kind) for kind in (Tick, Quiet, Over, Stood)
}


def wrap_world(sender: str, sequence: int, content: WorldMessage) -> Envelope:
    """Put a message to or from the world into an envelope.

    Args:
        sender: Who sends.
        sequence: Its place among the sender's.
        content: The message.

    Returns:
        The envelope; its content is kept with it.
    """
    return wrap(sender, 0, sequence, content)


def unwrap_world(envelope: Envelope) -> Any:  # noqa: ANN401 - one of four kinds
    """Read a message to or from the world.

    Args:
        envelope: As received.

    Returns:
        A ``Tick``, ``Quiet``, ``Over`` or ``Stood``.

    Raises:
        InvalidInputError: If it is malformed or of another kind.
    """
    return unwrap(envelope, _READERS, whose="")
