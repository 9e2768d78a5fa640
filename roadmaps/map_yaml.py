"""The YAML of a ROS map_server file: one level of `field: value`.

Values are kept as text and converted by the reader, so none of YAML's implicit types (`no` is
False, `1e-3` is text, `010` is 8) can bite. PyYAML reads the file where it is installed (the
`yaml` extra); where not, the strict parser below reads what map_server files hold: scalars,
quotes, comments, `[a, b, c]`, and a list of `- item` lines. Both give the same on such files.
"""

from pathlib import Path

from roadmaps.errors import MapFileError

MapFields = dict[str, str | list[str]]


def parse_map_yaml(text: str, path: Path) -> MapFields:
    """Read the fields of a map_server YAML file as text.

    Args:
        text: The file's content.
        path: The file, for messages.

    Returns:
        Text or list of texts by field.

    Raises:
        MapFileError: If it is not one level of `field: value`.
    """
    try:
        import yaml
    except ImportError:
        return parse_map_yaml_strictly(text, path)
    try:
        content = yaml.load(text, Loader=yaml.BaseLoader)  # text, lists and mappings only
    except yaml.YAMLError as error:
        raise MapFileError(f"{path}: expected YAML: {error}") from error
    if not isinstance(content, dict):
        raise MapFileError(f"{path}: expected lines `field: value`, got {type(content).__name__}")
    fields: MapFields = {}
    for name, value in content.items():
        is_list = isinstance(value, list) and all(isinstance(item, str) for item in value)
        if not (isinstance(value, str) or is_list):
            raise MapFileError(f"{path}: field {name!r}: expected text or a flat list")
        fields[str(name)] = value
    return fields


def parse_map_yaml_strictly(text: str, path: Path) -> MapFields:
    """Read the fields without PyYAML.

    Args:
        text: The file's content.
        path: The file, for messages.

    Returns:
        Text or list of texts by field.

    Raises:
        MapFileError: If a line is not `field: value`, `- item`, a comment or blank; the message
            names the line.
    """
    fields: MapFields = {}
    open_list: list[str] | None = None
    for number, raw in enumerate(text.splitlines(), start=1):
        line = _without_comment(raw)
        stripped = line.strip()
        if not stripped or stripped in ("---", "..."):
            continue
        if stripped.startswith("- "):
            if open_list is None:
                raise MapFileError(
                    f"{path}, line {number}: expected `field: value`, got the list item "
                    f"{stripped!r} that belongs to no field"
                )
            open_list.append(_unquoted(stripped[2:].strip()))
            continue
        name, colon, value = stripped.partition(":")
        if not colon or line[0].isspace() or not name.isidentifier():
            raise MapFileError(
                f"{path}, line {number}: expected `field: value`, got {stripped!r}; other YAML "
                "than scalars and lists needs PyYAML (pip install 'fgplan[yaml]')"
            )
        if name in fields:
            raise MapFileError(f"{path}, line {number}: field {name!r} is given twice")
        value = value.strip()
        if value.startswith("["):
            if not value.endswith("]"):
                raise MapFileError(f"{path}, line {number}: expected `]` at the end of {value!r}")
            items = value[1:-1].strip().removesuffix(",")
            fields[name] = [_unquoted(item.strip()) for item in items.split(",")] if items else []
            open_list = None
        elif value:
            fields[name] = _unquoted(value)
            open_list = None
        else:
            open_list = []
            fields[name] = open_list
    return {name: value if value != [] else "" for name, value in fields.items()}


def _without_comment(line: str) -> str:
    """Drop a comment: `#` at the start or after a blank, outside quotes."""
    quote = ""
    for place, letter in enumerate(line):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        elif letter == "#" and (place == 0 or line[place - 1].isspace()):
            return line[:place]
    return line


def _unquoted(value: str) -> str:
    """Drop a pair of quotes around a value."""
    if len(value) >= 2 and value[0] == value[-1] and value[0] in "'\"":
        return value[1:-1]
    return value
