"""A user's own object, named in a scenario as ``module:object``.

The folder of the scenario is searched first, so that a file beside the scenario needs no
installation. Only the name travels in the file: a scenario itself never executes anything, but
naming a module runs that module, as an import does.
"""

import importlib
import sys
from typing import Any

from fgplan.io.place import Place


def is_object_name(name: str) -> bool:
    """Whether a name has the form ``module:object``."""
    module, colon, attribute = name.partition(":")
    return bool(colon) and all(
        part.isidentifier() for part in (*module.split("."), *attribute.split("."))
    )


def load_object(name: str, place: Place) -> Any:  # noqa: ANN401 - whatever it names
    """Import the object that ``module:object`` names.

    Args:
        name: The name, such as ``my_sensors:Sonar``.
        place: Where it is named; the scenario's folder is searched before installed packages.

    Returns:
        The object.

    Raises:
        ScenarioError: If the name has another form, the module cannot be imported, or it holds no
            such object.
    """
    if not is_object_name(name):
        raise place.error(f"expected the name of an object as 'module:object', got {name!r}")
    module_name, _, attribute = name.partition(":")
    search = str(place.file.parent.resolve())
    sys.path.insert(0, search)
    try:
        found: Any = importlib.import_module(module_name)
    except ImportError as error:
        raise place.error(
            f"expected an importable module, got {module_name!r}: {error}; put "
            f"{module_name.split('.')[0]}.py into {search} or install it"
        ) from error
    finally:
        sys.path.remove(search)
    for part in attribute.split("."):
        if not hasattr(found, part):
            raise place.error(
                f"expected an object {attribute!r} in module {module_name!r}, found none"
            )
        found = getattr(found, part)
    return found
