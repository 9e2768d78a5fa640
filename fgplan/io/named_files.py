"""Files beside a scenario that it names: modules of a user's own, maps, pose graphs.

With copies of these a run folder runs again, ``fgplan run runs/run-NAME/scenario.toml``. What lies
elsewhere (an absolute name, ``..``, an installed package) stays where it is; so does what a user's
module imports itself, unless it is in the same package folder.
"""

from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Any

import msgspec

from fgplan.io.mrclam_past import mrclam_files
from fgplan.io.scenario import G2oPrior, Scenario, TumPrior
from fgplan.io.tum_past import tum_files
from fgplan.io.user_object import is_object_name
from roadmaps.map_yaml import parse_map_yaml


def named_files(scenario: Scenario, path: Path) -> tuple[Path, ...]:
    """Find the files that a scenario names and that lie in its folder or below.

    Args:
        scenario: The scenario.
        path: The file it was read from.

    Returns:
        Relative to the scenario's folder, each once, sorted.
    """
    folder = path.parent
    found: set[Path] = set()
    for text in _texts(msgspec.to_builtins(scenario)):
        if is_object_name(text):
            found |= _module_files(folder, text.partition(":")[0])
        elif _is_file_below(folder, text):
            found.add(Path(text))
    if isinstance(scenario.prior, G2oPrior):
        found |= _log_files(folder, scenario.prior.files)
    named_folder = getattr(scenario.prior, "folder", "")
    if _is_below(named_folder) and (folder / named_folder).is_dir():
        files_of = tum_files if isinstance(scenario.prior, TumPrior) else mrclam_files
        found |= {file.relative_to(folder) for file in files_of(folder / named_folder)}
    named = scenario.world.map
    if named is not None and named.endswith((".yaml", ".yml")) and Path(named) in found:
        fields = parse_map_yaml((folder / named).read_text(encoding="utf-8"), folder / named)
        image = str(Path(named).parent / str(fields.get("image", "")))
        if _is_file_below(folder, image):
            found.add(Path(image))
    return tuple(sorted(found))


def _texts(value: Any) -> Iterator[str]:  # noqa: ANN401 - plain data
    """Every text in plain data."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from _texts(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _texts(item)


def _module_files(folder: Path, module: str) -> set[Path]:
    """Source of a module beside the scenario: a file, or its whole package."""
    top = module.split(".")[0]
    if top in ("fgplan", "roadmaps"):  # a scenario at the top of a checkout
        return set()
    if (folder / f"{top}.py").is_file():
        return {Path(f"{top}.py")}
    return {source.relative_to(folder) for source in (folder / top).rglob("*.py")}


def _log_files(folder: Path, names: tuple[str, ...]) -> set[Path]:
    """g2o files of the folders that a prior names."""
    inside = [name for name in names if _is_below(name) and (folder / name).is_dir()]
    return {file.relative_to(folder) for name in inside for file in (folder / name).glob("*.g2o")}


def _is_below(text: str) -> bool:
    """Whether a text names something in the folder or below."""
    name = PurePath(text)
    return bool(text) and not name.is_absolute() and ".." not in name.parts and "\0" not in text


def _is_file_below(folder: Path, text: str) -> bool:
    """Whether a text is the name of a file in the folder or below."""
    if not _is_below(text):
        return False
    try:
        return (folder / text).is_file()
    except OSError:  # longer than any name may be
        return False
