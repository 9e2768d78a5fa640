"""Everything that `roadmaps` raises on purpose: one tree, each class also a builtin.

A message says what was expected, what came, for which vertex, position, file or field, and
what to do about it.
"""


class RoadmapError(Exception):
    """Base of all errors of this package: catch it to catch them all."""


class ParameterError(RoadmapError, ValueError):
    """An argument has the wrong shape, sign, count or value."""


class WorkspaceError(RoadmapError, ValueError):
    """Bounds, a polygon or an occupancy grid does not describe a workspace."""


class MapFileError(RoadmapError, ValueError):
    """A map file is malformed; the message names the file and the line or field."""


class InvalidPositionError(RoadmapError, ValueError):
    """A position that must be free is outside the bounds or touches an obstacle."""


class UnknownVertexError(RoadmapError, LookupError):
    """A vertex id is not in the roadmap or tree."""


class UnreachableError(RoadmapError, RuntimeError):
    """No collision-free path joins two vertices, or a position cannot be connected."""


class NoCandidatePathError(RoadmapError, RuntimeError):
    """No candidate path satisfies what was asked."""


class SamplingError(RoadmapError, RuntimeError):
    """Too few valid positions were found: the free space is too small a part of the bounds."""


class MissingDependencyError(RoadmapError, ImportError):
    """An optional package was asked for by name and is not installed."""
