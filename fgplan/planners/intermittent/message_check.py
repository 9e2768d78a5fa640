"""What a robot takes from its teammates at a meeting: nothing that they cannot have to say.

    times      nobody has measured, or filtered into a checkpoint, what is still to come
    logs       one a robot, ascending, after the checkpoint and no later than heard
    numbers    finite, of the model's shapes; covariances positive semidefinite
    readings   of things that the robot can measure, as many numbers as that has
    ways       of this team's robots, inside the workspace, no step longer than a robot's

Only what would be used is looked at closely: the later checkpoint, the longer logs. What is
refused changes nothing.
"""

from itertools import chain, pairwise

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.estimate import Record
from fgplan.planners.intermittent.leg import Leg
from fgplan.planners.intermittent.message import Agreed, Known, LegData, Offer, array_of, leg_of
from fgplan.planners.intermittent.robot_state import RobotState
from fgplan.typing import FloatArray

MOST_STEPS_AHEAD = 100_000
"""Steps from now within which every way begins, ends and meets."""

_LARGEST = 1e100
"""Square metres, or whatever the state is in: beyond it arithmetic overflows."""
_TOLERANCE = 1e-6
"""Metres: ways are made by the planner of a teammate, whose arithmetic may differ."""


def check_message(state: RobotState, sender: str, content: Known | Agreed) -> None:
    """Refuse what no teammate can have to say at this robot's meeting.

    Args:
        state: The robot, at a meeting.
        sender: Who says it.
        content: Its message.

    Raises:
        InvalidInputError: If the sender is not of the team that meets, or a field cannot be.
    """
    setup = state.setup
    members = setup.schedule.graph.teams[state.leg.team]
    what = f"message of robot {sender!r}"
    if sender not in members:
        raise InvalidInputError(f"{what}: expected one of {', '.join(members)}")
    known = content.known if isinstance(content, Agreed) else content
    _check_known(state, what, known)
    if known.robot not in [setup.robots.index(name) for name in members] or (
        known is content and setup.robots[known.robot] != sender
    ):
        raise InvalidInputError(f"{what}: robot: expected the sender's row, got {known.robot}")
    for name, offer in known.offers.items():
        if name not in members:
            raise InvalidInputError(f"{what}: offers: robot {name!r} is not of the team")
        _check_offer(state, f"{what}: offer of {name!r}", offer)
    if isinstance(content, Agreed):
        _check_agreed(state, what, content)


def _check_known(state: RobotState, what: str, known: Known) -> None:
    """Checkpoint and logs."""
    own, count = state.knowledge, len(state.setup.robots)
    if len(known.logs) != count or len(known.heard) != count:
        raise InvalidInputError(
            f"{what}: expected logs and times of {count} robots, got {len(known.logs)} and "
            f"{len(known.heard)}"
        )
    # A teammate may be in the step that this robot's sensors are about to tell of.
    if known.time > state.now or max(known.heard) > state.now + 1:
        raise InvalidInputError(
            f"{what}: expected what was measured by step {state.now}, got a checkpoint of step "
            f"{known.time} and measurements until {max(known.heard)}"
        )
    mean, covariance = array_of(known.mean), array_of(known.covariance)
    _check_shape(f"{what}: mean", mean, own.checkpoint.mean)
    _check_shape(f"{what}: covariance", covariance, own.checkpoint.covariance)
    if np.abs(mean).max(initial=0.0) > _LARGEST:
        raise InvalidInputError(f"{what}: mean: expected numbers of at most {_LARGEST:g}")
    if known.time > own.checkpoint.time:
        _check_semidefinite(f"{what}: covariance", covariance)
    for row, log in enumerate(known.logs):
        if known.heard[row] > own.heard[row]:
            _check_log(state, f"{what}: log of robot {state.setup.robots[row]!r}", known, row, log)


def _check_shape(what: str, array: FloatArray, own: FloatArray) -> None:
    """The shape of this robot's own."""
    if array.shape != np.shape(own):
        raise InvalidInputError(f"{what}: expected shape {np.shape(own)}, got {array.shape}")


def _check_semidefinite(what: str, blocks: FloatArray) -> None:
    """Symmetric, and positive semidefinite up to rounding."""
    largest = float(np.abs(blocks).max(initial=0.0))
    if largest > _LARGEST:
        raise InvalidInputError(f"{what}: expected numbers of at most {_LARGEST:g}")
    if np.abs(blocks - np.swapaxes(blocks, -1, -2)).max(initial=0.0) > 1e-9 * largest:
        raise InvalidInputError(f"{what}: expected symmetric blocks")
    smallest = float(np.linalg.eigvalsh(blocks).min(initial=0.0))
    if smallest < -1e-9 * largest:
        raise InvalidInputError(
            f"{what}: expected positive semidefinite blocks, got an eigenvalue of {smallest:g}"
        )


def _check_log(
    state: RobotState, what: str, known: Known, row: int, log: tuple[Record, ...]
) -> None:
    """A log that is longer than this robot's."""
    times = [known.time, *[record.time for record in log]]
    if any(after <= before for before, after in pairwise(times)) or times[-1] > max(
        known.heard[row], known.time
    ):
        raise InvalidInputError(
            f"{what}: expected times ascending from {known.time} to at most {known.heard[row]}"
        )
    model, sizes = state.setup.model, dict[int, int]()
    observations = model.observation_count(row)
    mean = state.knowledge.checkpoint.mean
    for record in log:
        numbers = chain(record.position, *[value for _, value in record.readings])
        if not all(abs(number) <= _LARGEST for number in numbers):  # nor is what is not a number
            raise InvalidInputError(
                f"{what}: step {record.time}: expected finite numbers of at most {_LARGEST:g}"
            )
        for index, value in record.readings:
            if not 0 <= index < observations:
                raise InvalidInputError(
                    f"{what}: step {record.time}: expected readings of things below "
                    f"{observations}, got {index}"
                )
            if index not in sizes:
                sizes[index] = model.reading_size(row, index, mean, np.array(record.position))
            if len(value) != sizes[index]:
                raise InvalidInputError(
                    f"{what}: step {record.time}: expected {sizes[index]} numbers for reading "
                    f"{index}, got {len(value)}"
                )


def _check_offer(state: RobotState, what: str, offer: Offer) -> None:
    """Where a teammate is, and its ways before the next meeting of this team."""
    _check_places(state, what, np.array([offer.position]))
    teams = len(state.setup.schedule.graph.teams)
    if len({data.team for data in offer.legs}) != len(offer.legs) or any(
        data.team >= teams for data in offer.legs
    ):
        raise InvalidInputError(f"{what}: expected one way a team of {teams}")
    for data in offer.legs:
        _check_way(state, what, data)


def _check_agreed(state: RobotState, what: str, agreed: Agreed) -> None:
    """The ways to the next meeting."""
    members = state.setup.schedule.graph.teams[state.leg.team]
    if set(agreed.legs) != set(members):
        raise InvalidInputError(
            f"{what}: expected ways of {', '.join(members)}, got {', '.join(agreed.legs)}"
        )
    ways = [_check_way(state, what, data) for data in agreed.legs.values()]
    # Not the epoch: who has waited in vain may be ahead of who leads. Old ways are over by now.
    for leg in ways:
        if leg.team != state.leg.team or leg.epoch != ways[0].epoch or leg.ready < state.now:
            raise InvalidInputError(
                f"{what}: expected ways of team {state.leg.team} to one meeting that is to come, "
                f"got one of team {leg.team} in epoch {leg.epoch} at step {leg.ready}"
            )


def _check_way(state: RobotState, what: str, data: LegData) -> Leg:
    """A way that a robot can follow, soon."""
    leg = leg_of(data)
    latest = state.now + MOST_STEPS_AHEAD
    # A number beyond the latest would not fit into the arithmetic of what comes after.
    if max(leg.start, leg.due, leg.slack) > latest or leg.leaves > latest:
        raise InvalidInputError(f"{what}: expected a way that is over by step {latest}")
    if leg.epoch > state.leg.epoch + MOST_STEPS_AHEAD:
        raise InvalidInputError(f"{what}: expected an epoch near {state.leg.epoch}")
    _check_places(state, what, leg.places)
    steps = np.linalg.norm(np.diff(leg.places, axis=0), axis=1)
    if steps.max(initial=0.0) > state.setup.options.step_m + _TOLERANCE:
        raise InvalidInputError(
            f"{what}: expected steps of at most {state.setup.options.step_m:g} m, got "
            f"{steps.max():g}"
        )
    return leg


def _check_places(state: RobotState, what: str, places: FloatArray) -> None:
    """Places inside the workspace."""
    lower, upper = state.setup.workspace.lower, state.setup.workspace.upper
    inside = (places >= np.asarray(lower) - _TOLERANCE) & (places <= np.asarray(upper) + _TOLERANCE)
    if not inside.all():  # nor is what is not a number
        raise InvalidInputError(f"{what}: expected places inside the workspace")
