"""``[sensors.NAME]`` and the sensors and criteria of ``[[team.multi_robot]]``.

``kind`` names a built-in model, whose parameters are the fields of its class, or a user's own as
"module:object", which is called with the other fields of the table.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fgplan.checks import check_covariance
from fgplan.io.place import Place
from fgplan.io.scenario import (
    Matrix,
    MultiRobotTable,
    NotNegative,
    Positive,
    Scenario,
    Sigmas,
    Table,
)
from fgplan.io.scenario_file import convert_table
from fgplan.io.user_object import is_object_name, load_object
from fgplan.models.clamped_range import ClampedRangeSensor
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.multi_robot import Criterion, DistanceCriterion, MultiRobotModel
from fgplan.typing import Covariance


class _ViewTable(Table, frozen=True):
    """What every sensor of points has: how far and how wide it sees."""

    max_range_m: Positive = np.inf
    field_of_view_rad: Positive = 2.0 * np.pi


class RangeTable(_ViewTable, frozen=True, kw_only=True):
    """Parameters of ``kind = "range"``."""

    sigma_m: Positive
    sigma_per_metre: NotNegative = 0.0


class BearingTable(_ViewTable, frozen=True, kw_only=True):
    """Parameters of ``kind = "bearing"``."""

    sigma_rad: Positive


class BearingRangeTable(_ViewTable, frozen=True, kw_only=True):
    """Parameters of ``kind = "bearing_range"``."""

    bearing_sigma_rad: Positive
    range_sigma_m: Positive
    range_sigma_per_metre: NotNegative = 0.0


class ProportionalRangeTable(_ViewTable, frozen=True):
    """Parameters of ``kind = "proportional_range"``."""

    slope: NotNegative = 0.25
    sigma_m: NotNegative = 0.0
    floor_m: Positive = 0.01


class ClampedRangeTable(_ViewTable, frozen=True):
    """Parameters of ``kind = "clamped_range"``."""

    slope: NotNegative = 0.045
    sigma_m: float = -0.035
    floor_m: Positive = 0.01
    ceiling_m: Positive = 0.1
    max_range_m: Positive = 5.0


class PositionTable(_ViewTable, frozen=True, kw_only=True):
    """Parameters of ``kind = "position"``."""

    sigma_m: Positive
    sigma_per_metre: NotNegative = 0.0


class RelativePoseTable(Table, frozen=True):
    """Parameters of ``kind = "relative_pose"``, between robots only.

    Attributes:
        sigmas: Standard deviations, 3 (planar x, y, heading; metres and radians) or 6 (spatial,
            rotation first); or ``covariance``.
        covariance: Whole covariance, 3 x 3 or 6 x 6.
    """

    sigmas: Sigmas | None = None
    covariance: Matrix | None = None


SENSOR_KINDS: dict[str, tuple[type[Table], type[AbstractSensor]]] = {
    "range": (RangeTable, RangeSensor),
    "bearing": (BearingTable, BearingSensor),
    "bearing_range": (BearingRangeTable, BearingRangeSensor),
    "proportional_range": (ProportionalRangeTable, ProportionalRangeSensor),
    "clamped_range": (ClampedRangeTable, ClampedRangeSensor),
    "position": (PositionTable, PositionSensor),
}
"""Built-in sensors of points by kind: what checks the table, and the model that it makes."""
_BETWEEN_ROBOTS = ("range", "bearing_range")


def make_sensors(scenario: Scenario, place: Place) -> dict[str, AbstractSensor]:
    """Make the sensors of a scenario, by name.

    Args:
        scenario: The scenario.
        place: The whole file, for messages.

    Returns:
        Sensors in the order of the file.

    Raises:
        ScenarioError: If a kind is not known or a parameter is wrong.
    """
    return {
        name: make_sensor(table, place.at(f"sensors.{name}"))
        for name, table in scenario.sensors.items()
    }


def make_sensor(table: Mapping[str, Any], place: Place) -> AbstractSensor:
    """Make one sensor of points.

    Args:
        table: ``kind`` and its parameters.
        place: Where the table is.

    Returns:
        The sensor.

    Raises:
        ScenarioError: If the kind is not known or a parameter is wrong.
    """
    kind, parameters = _kind(table, place)
    if kind in SENSOR_KINDS:
        shape, model = SENSOR_KINDS[kind]
        checked = convert_table(parameters, shape, place)
        with place.checking():
            return model(**{name: getattr(checked, name) for name in checked.__struct_fields__})
    if not is_object_name(kind):
        raise place.at("kind").error(
            f"expected one of {', '.join(SENSOR_KINDS)} or 'module:object', got {kind!r}"
        )
    sensor = _call(kind, parameters, place)
    if not isinstance(sensor, AbstractSensor):
        raise place.at("kind").error(
            f"expected {kind} to make an fgplan.models.sensor.AbstractSensor, got "
            f"{type(sensor).__name__}"
        )
    return sensor


def make_multi_robot(scenario: Scenario, place: Place) -> tuple[MultiRobotModel, ...]:
    """Make the models of factors between robots.

    Args:
        scenario: The scenario.
        place: The whole file, for messages.

    Returns:
        One model a table of ``[[team.multi_robot]]``.

    Raises:
        ScenarioError: If criterion or sensor are missing or wrong.
    """
    return tuple(
        _make_model(scenario, table, place.at(f"team.multi_robot[{index}]"))
        for index, table in enumerate(scenario.team.multi_robot)
    )


def _make_model(scenario: Scenario, table: MultiRobotTable, place: Place) -> MultiRobotModel:
    """One model of factors between robots."""
    criterion = _make_criterion(table, place)
    sensor = _make_team_sensor(scenario, table.sensor, place.at("sensor"))
    past = scenario.team.include_past if table.include_past is None else table.include_past
    with place.checking():
        return MultiRobotModel(
            criterion=criterion,
            sensor=sensor,
            time_tolerance_s=table.time_tolerance_s,
            include_past=past,
        )


def _make_criterion(table: MultiRobotTable, place: Place) -> Criterion:
    """The distance, or the user's own."""
    if (table.distance_m is None) == (table.criterion is None):
        came = "neither" if table.distance_m is None else "both"
        raise place.error(f"expected distance_m or criterion, one of the two, got {came}")
    if table.distance_m is not None:
        return DistanceCriterion(table.distance_m)
    criterion: Any = load_object(str(table.criterion), place.at("criterion"))
    if isinstance(criterion, type):
        criterion = criterion()
    if not callable(criterion):
        raise place.at("criterion").error(
            f"expected something to call with two states, got {type(criterion).__name__}"
        )
    return criterion


def _make_team_sensor(
    scenario: Scenario, given: dict[str, Any] | str, place: Place
) -> RelativePoseSensor | AbstractSensor:
    """A sensor between robots: by name, or in place."""
    if isinstance(given, str):
        if given not in scenario.sensors:
            known = ", ".join(scenario.sensors) or "none"
            raise place.error(
                f"expected a table or a name under [sensors] ({known}), got {given!r}"
            )
        given = scenario.sensors[given]
    kind, parameters = _kind(given, place)
    if kind in SENSOR_KINDS and kind not in _BETWEEN_ROBOTS:
        raise place.at("kind").error(
            f"expected relative_pose, {' or '.join(_BETWEEN_ROBOTS)} between robots, got {kind!r}"
        )
    if kind != "relative_pose":
        return make_sensor(given, place)
    noise = convert_table(parameters, RelativePoseTable, place)
    covariance = make_covariance(
        (noise.sigmas, noise.covariance), ("sigmas", "covariance"), (3, 6), place
    )
    with place.checking():
        return RelativePoseSensor(covariance=covariance)


def make_covariance(
    given: tuple[tuple[float, ...] | None, tuple[tuple[float, ...], ...] | None],
    names: tuple[str, str],
    sizes: tuple[int, ...],
    place: Place,
) -> Covariance:
    """Covariance from standard deviations or from a whole matrix; exactly one of them is given.

    Args:
        given: Standard deviations, length n, and rows of the matrix, (n, n); one of them None.
        names: Names of the two fields, for messages.
        sizes: What n may be.
        place: The table that holds both.

    Returns:
        Shape (n, n), symmetric and positive definite.

    Raises:
        ScenarioError: If both or neither are given, a size is wrong, or it is no covariance.
    """
    sigmas, rows = given
    if (sigmas is None) == (rows is None):
        came = "neither" if sigmas is None else "both"
        raise place.error(f"expected {names[0]} or {names[1]}, one of the two, got {came}")
    wanted = " or ".join(str(size) for size in sizes)
    if sigmas is not None:
        where = place.at(names[0])
        if len(sigmas) not in sizes:
            raise where.error(f"expected {wanted} numbers, got {len(sigmas)}")
        matrix = np.diag(np.square(np.array(sigmas)))
    else:
        where = place.at(names[1])
        lengths = [len(row) for row in rows or ()]
        if len(lengths) not in sizes or any(length != len(lengths) for length in lengths):
            raise where.error(
                f"expected a square matrix of {wanted} rows, got rows of "
                f"{', '.join(str(length) for length in lengths)} numbers"
            )
        matrix = np.array(rows, dtype=np.float64)
    with where.checking():
        return check_covariance(matrix, "covariance")


def _kind(table: Mapping[str, Any], place: Place) -> tuple[str, dict[str, Any]]:
    """Kind and parameters of a sensor's table."""
    kind = table.get("kind")
    if not isinstance(kind, str):
        came = "nothing" if kind is None else repr(kind)
        raise place.at("kind").error(f"expected the kind of a sensor, got {came}")
    return kind, {name: value for name, value in table.items() if name != "kind"}


def _call(name: str, parameters: dict[str, Any], place: Place) -> object:
    """Call a user's own maker; wrong parameters are the scenario's fault."""
    maker = load_object(name, place.at("kind"))
    with place.checking():
        try:
            return maker(**parameters)
        except TypeError as error:
            raise place.error(f"expected parameters that {name} accepts: {error}") from error
