"""Reading a scenario file: TOML or YAML text to a checked ``Scenario``.

Three passes, each of which names file and field: syntax (tomllib, PyYAML), finite numbers (TOML
has ``nan`` and ``inf``, which no field means), and the schema (msgspec). msgspec says what was
expected and where; what came is looked up in the raw tables and added.
"""

import difflib
import math
import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from fgplan.errors import MissingExtraError, ScenarioError
from fgplan.io.place import Place
from fgplan.io.scenario import Scenario
from fgplan.io.table_fields import STEP, field_values, table_fields

TableT = TypeVar("TableT")

_PLACE = re.compile(r"^(?P<what>.*?)(?: - at `(?P<place>\$[^`]*)`)?$", re.DOTALL)
_FIELD = re.compile(r"^Object (missing required|contains unknown) field `([^`]*)`$")


def read_scenario(path: str | Path) -> Scenario:
    """Read and check a scenario file.

    Args:
        path: A ``.toml``, ``.yaml`` or ``.yml`` file.

    Returns:
        The scenario; names and references between its tables are checked too.

    Raises:
        ScenarioError: If the file is unreadable or malformed; names file, field, what was
            expected and what came.
        MissingExtraError: If the file is YAML and PyYAML is not installed.

    Example:
        >>> scenario = read_scenario("examples/scenarios/two_robots.toml")
        >>> [robot.name for robot in scenario.robots]
        ['ann', 'bob']
    """
    path = Path(path)
    raw = _parse(path)
    place = Place(path)
    scenario = convert_table(raw, Scenario, place)
    _check_planner(scenario, place)
    _check_names(scenario, place)
    return scenario


def convert_table(raw: Any, kind: type[TableT], place: Place) -> TableT:  # noqa: ANN401
    """Turn a raw table into a checked one.

    Args:
        raw: What the parser returned: dictionaries, lists, numbers and text.
        kind: The table's type.
        place: Where the table is, for messages.

    Returns:
        The table.

    Raises:
        ScenarioError: If a field is unknown, missing, of another type or not finite.
    """
    _check_finite(raw, raw, place)
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        raise ScenarioError(f"{place.file}: {_explain(str(error), raw, kind, place)}") from error


def _parse(path: Path) -> Any:  # noqa: ANN401 - checked by the caller
    """Read the file's syntax."""
    if path.suffix.lower() not in (".toml", ".yaml", ".yml"):
        raise ScenarioError(
            f"{path}: expected a scenario file named .toml, .yaml or .yml, got {path.suffix!r}"
        )
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: expected a readable scenario file: {error}") from error
    if path.suffix.lower() == ".toml":
        try:
            return tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ScenarioError(f"{path}: expected TOML: {error}{_line(text, error)}") from error
    try:
        import yaml
    except ImportError as error:
        raise MissingExtraError(
            f"{path}: reading YAML needs PyYAML: pip install 'fgplan[yaml]', or write TOML"
        ) from error
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ScenarioError(f"{path}: expected YAML: {' '.join(str(error).split())}") from error


def _line(text: str, error: tomllib.TOMLDecodeError) -> str:
    """The line that a syntax error names, as it stands in the file."""
    number = re.search(r"at line (\d+)", str(error))
    return f", got {_shown(text.splitlines()[int(number[1]) - 1])}" if number else ""


def _check_finite(value: Any, raw: Any, place: Place, inner: str = "$") -> None:  # noqa: ANN401
    """Refuse nan and inf anywhere."""
    if isinstance(value, float) and not math.isfinite(value):
        remedy = "write a number" if math.isnan(value) else "leave it out where there is no limit"
        raise Place(
            place.file, f"{place.field}{inner[1:]}", place.owner or _owner(raw, inner)
        ).error(f"expected a finite number, got {value}; {remedy}")
    if isinstance(value, dict):
        for name, item in value.items():
            _check_finite(item, raw, place, f"{inner}.{name}")
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _check_finite(item, raw, place, f"{inner}[{index}]")


def _explain(message: str, raw: Any, kind: type, within: Place) -> str:  # noqa: ANN401
    """Say what came, the remedy and, for a robot, which; YAML's traps get their own words."""
    parts = _PLACE.match(message)
    what, place = (parts["what"], parts["place"] or "$") if parts else (message, "$")
    what = what.replace(" | null", "")  # optional fields; TOML has no null
    value, found = _look_up(raw, place)
    came = ""
    field = _FIELD.match(what)
    if field is not None and field[1] == "missing required":
        given = ", ".join(map(str, value)) if isinstance(value, dict) and value else "nothing"
        came = f"; it has {given}{_remedy(field[2], kind, raw, within, place)}"
    elif field is not None:
        came = f"; expected one of {', '.join(table_fields(kind, raw, place))}"
    elif found and what.startswith(("Invalid enum value", "Invalid value")):
        what = _expected(kind, raw, place, value)
    elif found and ", got" not in what:
        came = f", got {_shown(value)}"
        if "> 0.0" in what and "sigma" in place and value == 0:
            came += "; what is known exactly needs a small positive sigma, such as 1e-6"
    elif found and "got `str`" in what and isinstance(value, str):
        came = f" {value!r}"
        if re.fullmatch(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+", value):
            came += " (YAML reads 1e-3 as text: write 1.0e-3)"
    owner = within.owner or _owner(raw, place)
    of = f" ({owner})" if owner else ""
    return f"{what}{came} - at `{within.field}{place[1:]}`{of}"


def _remedy(field: str, kind: type, raw: Any, within: Place, place: str) -> str:  # noqa: ANN401
    """What to write for a field that is missing, where only a few values will do."""
    values, _ = field_values(kind, raw, f"{place}.{field}")
    if len(values) == 1:
        sign = " =" if within.file.suffix.lower() == ".toml" else ":"
        return f"; write {field}{sign} {values[0]!r}"
    return f"; {field} is one of {', '.join(map(repr, values))}" if values else ""


def _expected(kind: type, raw: Any, place: str, value: Any) -> str:  # noqa: ANN401
    """Which values a field takes, and what came; the nearest one, where there is a near one."""
    values, lists = field_values(kind, raw, place)
    names = [one for one in values if isinstance(one, str)]
    near = difflib.get_close_matches(value, names, n=1) if isinstance(value, str) else []
    return (
        f"expected {'one of ' if len(values) > 1 else ''}{', '.join(map(repr, values))}"
        f"{' or a list' if lists else ''}, got {_shown(value)}"
        f"{f'; did you mean {near[0]!r}?' if near else ''}"
    )


def _look_up(raw: Any, place: str) -> tuple[Any, bool]:  # noqa: ANN401
    """Value at a place such as ``$.robots[3].goal``."""
    value = raw
    for name, index in STEP.findall(place):
        try:
            value = value[name] if name else value[int(index)]
        except (LookupError, TypeError):
            return None, False
    return value, True


def _owner(raw: Any, place: str) -> str:  # noqa: ANN401
    """Name of the robot or target that a place is in."""
    inside = re.match(r"\$\.(robots|targets)\[\d+\]", place)
    if inside is None:
        return ""
    owner, found = _look_up(raw, inside.group(0))
    named = found and isinstance(owner, dict) and isinstance(owner.get("name"), str)
    return f"{inside.group(1)[:-1]} {owner['name']!r}" if named else ""


def _shown(value: Any) -> str:  # noqa: ANN401
    """A value for a message, cut where it is long."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _check_planner(scenario: Scenario, place: Place) -> None:
    """Check ``[planner]``: a name, and tables of options by planner."""
    name = scenario.planner.get("name")
    if not isinstance(name, str) or not name:
        came = "nothing" if name is None else repr(name)
        raise place.at("planner.name").error(f"expected the name of a planner, got {came}")
    for key, value in scenario.planner.items():
        if key != "name" and not isinstance(value, dict):
            raise place.at(f"planner.{key}").error(
                f"expected a table of options [planner.{key}], got {_shown(value)}; options of "
                f"{name} belong under [planner.{name}]"
            )


def _check_names(scenario: Scenario, place: Place) -> None:
    """Check that names are unique and that robots name sensors that exist."""
    for table, names in (
        ("robots", [robot.name for robot in scenario.robots]),
        ("targets", [target.name for target in scenario.targets]),
        ("landmarks", [landmark_name(scenario, i) for i in range(len(scenario.landmarks))]),
    ):
        for index, name in enumerate(names):
            if name in names[:index]:
                raise place.at(f"{table}[{index}].name").error(
                    f"expected unique names, got {name!r}, which {table}[{names.index(name)}] has; "
                    "rename one of them"
                )
    for index, robot in enumerate(scenario.robots):
        for sensor in robot.sensors:
            if sensor not in scenario.sensors:
                known = ", ".join(scenario.sensors) or "none"
                raise place.at(f"robots[{index}].sensors", f"robot {robot.name!r}").error(
                    f"expected the name of a sensor under [sensors] ({known}), got {sensor!r}"
                )


def landmark_name(scenario: Scenario, index: int) -> str:
    """Name of a landmark: its own, or ``l`` and its place in the file."""
    return scenario.landmarks[index].name or f"l{index}"
