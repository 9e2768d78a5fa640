"""What robots say to each other to make a plan of their trees: claims, ways and reports.

A claim goes from the robot with a goal node to those that its plan needs, hop by hop; each answers
with its way, which goes back the same hops. A report says that a robot has looked at all its goal
nodes up to a sweep, with the best plan that it found among them, if any; it is passed on to all. A
robot that misses reports asks for them.
"""

from typing import Annotated

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.message_reader import MessageReader
from fgplan.planners.distributed_aia.way import Way
from fgplan.typing import FloatArray, IntArray

Count = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]
Node = Annotated[int, msgspec.Meta(ge=-1, le=2**31 - 1)]
MOST_STEPS = 1_000_000


class _Message(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="schema"
):
    """What all have in common: nothing in them executes."""


class Claim(_Message, frozen=True, kw_only=True, tag="claim.v1"):
    """A plan needs a robot at a node.

    Attributes:
        origin: Robot with the goal node.
        goal: Its goal node.
        robot: Who is claimed.
        node: Node of its tree; -1 for its root.
        steps: Steps of the way that is asked for.
        born_by: Sweep in which the goal node was made.
    """

    origin: Count
    goal: Count
    robot: Count
    node: Node
    steps: Annotated[int, msgspec.Meta(ge=0, le=MOST_STEPS)]
    born_by: Count


class WayMessage(_Message, frozen=True, kw_only=True, tag="way.v1"):
    """The way of a robot that was claimed.

    Attributes:
        origin: Robot with the goal node.
        goal: Its goal node.
        robot: Whose way.
        poses: x, y, heading of each step, float64.
        assigned: Its target at each step, uint16.
    """

    origin: Count
    goal: Count
    robot: Count
    poses: bytes
    assigned: bytes


class PlanMessage(_Message, frozen=True, kw_only=True, tag="plan.v1"):
    """A plan of a part of the team; who would follow it replays it first.

    Attributes:
        rank: What counts before the cost: the sweep in which the goal node was made where the
            first feasible plan is wanted, 0 where the cheapest is.
        cost: Cost by the sender's replay.
        origin: Robot with the goal node.
        goal: The goal node.
        robots: Members of the part.
        poses: Of each of them, x, y, heading of each step, float64.
        assigned: Of each of them, its target at each step, uint16.
    """

    rank: Count
    cost: float
    origin: Count
    goal: Count
    robots: tuple[Count, ...]
    poses: tuple[bytes, ...]
    assigned: tuple[bytes, ...]

    @property
    def key(self) -> tuple[int, float, int, int]:
        """What the better of two plans is less by."""
        return self.rank, self.cost, self.origin, self.goal

    def ways(self) -> dict[int, Way]:
        """The way of each member.

        Raises:
            InvalidInputError: If sizes do not fit each other.
        """
        if not len(self.robots) == len(self.poses) == len(self.assigned):
            raise InvalidInputError(
                f"plan: expected poses and targets of {len(self.robots)} robots, got "
                f"{len(self.poses)} and {len(self.assigned)}"
            )
        return {
            robot: read_way(poses, assigned)
            for robot, poses, assigned in zip(self.robots, self.poses, self.assigned, strict=True)
        }


class Report(_Message, frozen=True, kw_only=True, tag="report.v1"):
    """A robot has looked at its goal nodes.

    Attributes:
        robot: Who reports; teammates pass it on unchanged.
        through: Sweeps whose goal nodes have been looked at.
        plan: The best plan among them; None for none.
    """

    robot: Count
    through: Count
    plan: PlanMessage | None = None


class Ask(_Message, frozen=True, kw_only=True, tag="ask.v1"):
    """A robot misses reports.

    Attributes:
        has: Robots whose reports it has.
    """

    has: tuple[Count, ...]


PlanningMessage = Claim | WayMessage | Report | Ask
_READER: MessageReader[PlanningMessage] = MessageReader(PlanningMessage)


def read_planning_message(data: bytes) -> PlanningMessage:
    """Read a claim, way, report or ask.

    Args:
        data: Payload of an envelope.

    Returns:
        The message, its fields checked.

    Raises:
        InvalidInputError: If it is malformed.
    """
    return _READER.read(data, "planning message")


def written_way(way: Way) -> tuple[bytes, bytes]:
    """Poses and targets of a way as bytes.

    Args:
        way: The way.
    """
    poses = np.ascontiguousarray(way.poses, dtype="<f8").tobytes()
    return poses, np.ascontiguousarray(way.assigned, dtype="<u2").tobytes()


def read_way(poses: bytes, assigned: bytes) -> Way:
    """A way from its bytes; which nodes it was made with did not travel.

    Args:
        poses: As ``written_way`` gives them.
        assigned: As ``written_way`` gives them.

    Returns:
        The way.

    Raises:
        InvalidInputError: If sizes do not fit, or a pose is not finite.
    """
    if len(poses) == 0 or len(poses) % 24 or len(assigned) * 12 != len(poses):
        raise InvalidInputError(
            f"way: expected 24 bytes of pose and 2 of target a step, got {len(poses)} and "
            f"{len(assigned)}"
        )
    found: FloatArray = np.frombuffer(poses, dtype="<f8").reshape(-1, 3)
    if not np.isfinite(found).all():
        raise InvalidInputError("way: expected finite poses")
    targets: IntArray = np.frombuffer(assigned, dtype="<u2").astype(np.int64)
    return Way(poses=found, assigned=targets, sources=())
