"""A place in a scenario file: what every message about it names."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fgplan.errors import FgplanError, MissingExtraError, ScenarioError
from roadmaps import MissingDependencyError, RoadmapError


@dataclass(frozen=True, slots=True)
class Place:
    """A field of a scenario file.

    Attributes:
        file: The scenario file; what it names is relative to its folder.
        field: Path of the field, ``$`` for the whole file, ``$.robots[3].goal`` for one field.
        owner: Name of the robot or target the field belongs to, or empty.
    """

    file: Path
    field: str = "$"
    owner: str = ""

    def at(self, inner: str, owner: str = "") -> "Place":
        """The place of a field inside this one: ``at("robots[3]")``."""
        return Place(self.file, f"{self.field}.{inner}", owner or self.owner)

    def error(self, message: str) -> ScenarioError:
        """The error to raise for this place."""
        of = f" ({self.owner})" if self.owner else ""
        return ScenarioError(f"{self.file}: {message} - at `{self.field}`{of}")

    def path_of(self, name: str) -> Path:
        """A file that the scenario names, relative to its own folder.

        Raises:
            ScenarioError: If there is no such file.
        """
        path = self.file.parent / name
        if not path.is_file():
            raise self.error(f"expected a file relative to the scenario, got {name!r}: no {path}")
        return path

    @contextmanager
    def checking(self) -> Iterator[None]:
        """Name this place in whatever the products made inside refuse.

        Raises:
            ScenarioError: In place of any other error of fgplan or roadmaps.
        """
        try:
            yield
        except (ScenarioError, MissingExtraError):
            raise
        except MissingDependencyError as error:
            raise MissingExtraError(f"{self.file}: {error} - at `{self.field}`") from error
        except (FgplanError, RoadmapError) as error:
            raise self.error(str(error)) from error
