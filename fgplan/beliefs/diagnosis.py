"""Why a belief is ill-posed, in words: which variable, which factor is missing, what to add.

Structure first. A belief has no finite covariance for certain when

    a variable is in no factor;
    a variable's factors measure fewer numbers than it has dimensions (a landmark seen once by
    range, or once by bearing);
    a connected component has only relative factors (between, bearing, range): its variables can
    all move together (gauge freedom).

Numbers second, for what structure cannot see (two ranges from one place, a prior on position but
not on heading): the deficient columns of R give the directions n with R n = 0, and the variables
that take part in them are those that could move without any factor noticing.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.beliefs.square_root import SquareRootFactor
from fgplan.errors import IllPosedBeliefError
from fgplan.factors.keys import describe_key, describe_keys
from fgplan.typing import FloatArray, Key

_RELATIVE = re.compile(r"^(BetweenFactor|BearingRangeFactor|BearingFactor|RangeFactor)")
_POINTS = ("Point2", "Point3")
_MOVES = 1e-6
"""A variable takes part in a direction if it moves by more than this, relative to the largest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FactorView:
    """What diagnosis needs to know of one factor.

    Attributes:
        index: Its place in the graph.
        type_name: GTSAM's class name.
        keys: Its variables.
        rows: How many numbers it measures.
    """

    index: int
    type_name: str
    keys: tuple[Key, ...]
    rows: int

    @property
    def is_relative(self) -> bool:
        """Whether its type is known to say nothing about the world frame."""
        return len(self.keys) > 1 and _RELATIVE.match(self.type_name) is not None

    def __str__(self) -> str:
        """Name it: ``factor 3 (BetweenFactorPose2 on x0, x1)``."""
        return f"factor {self.index} ({self.type_name} on {describe_keys(self.keys)})"


def connected_components(keys: Sequence[Key], views: Sequence[FactorView]) -> list[list[Key]]:
    """Group variables that factors connect: components and keys in ascending order."""
    parent = {key: key for key in keys}

    def root(key: Key) -> Key:
        while parent[key] != key:
            parent[key] = parent[parent[key]]
            key = parent[key]
        return key

    for view in views:
        for other in view.keys[1:]:
            low, high = sorted((root(view.keys[0]), root(other)))
            parent[high] = low
    groups: dict[Key, list[Key]] = {}
    for key in sorted(keys):
        groups.setdefault(root(key), []).append(key)
    return list(groups.values())


def check_structure(
    kinds: Mapping[Key, str], dims: Mapping[Key, int], views: Sequence[FactorView]
) -> None:
    """Raise if structure alone shows that some variable cannot be determined.

    Args:
        kinds: Type of each variable: Pose2, Pose3, Point2, Point3 or another GTSAM type.
        dims: Tangent dimension of each variable.
        views: Every factor.

    Raises:
        IllPosedBeliefError: Naming the variable, the likely missing factor and the remedy.
    """
    touching = factors_of(kinds, views)
    for key in kinds:
        if not touching[key]:
            raise IllPosedBeliefError(
                f"variable {describe_key(key)} ({kinds[key]}) is in the values but in no factor: "
                f"nothing says where it is; add a {prior_name(kinds[key])} on "
                f"{describe_key(key)}, or a factor that measures it, or leave it out of the values"
            )
    for key, seen in touching.items():
        rows = sum(view.rows for view in seen)
        if rows < dims[key]:
            raise IllPosedBeliefError(
                f"{_noun(kinds[key])} {describe_key(key)} ({kinds[key]}) has {dims[key]} "
                f"dimensions but {_seen_by(key, seen)}: {rows} "
                f"number{'s' if rows > 1 else ''} in all. {_remedy(key, kinds[key], seen)}"
            )
    components = connected_components(list(kinds), views)
    absolute = {key for view in views if not view.is_relative for key in view.keys}
    loose = [group for group in components if absolute.isdisjoint(group)]
    if not loose:
        return
    group = loose[0]
    anchor = _anchor(group, kinds)
    prior = f"graph.add(gtsam.{prior_name(kinds[anchor])}({describe_key(anchor)}, value, noise))"
    if len(loose) == len(components) == 1:
        raise IllPosedBeliefError(
            f"no factor fixes the world frame: all {len(group)} variables "
            f"({describe_keys(group)}) could move together without changing any factor (gauge "
            f"freedom). Add a {prior_name(kinds[anchor])} on {describe_key(anchor)}: {prior}"
        )
    poses = [key for key in group if kinds[key] not in _POINTS]
    what = "variables" if poses else "landmarks, tied to no robot,"
    rest = next((other for other in components if other is not group), group)
    raise IllPosedBeliefError(
        f"{len(loose)} of {len(components)} connected components of the graph "
        f"{'has' if len(loose) == 1 else 'have'} no absolute factor. In the first, the "
        f"{len(group)} {what} {describe_keys(group)} could move together, and nothing connects "
        f"them to {describe_keys(rest, limit=3)}. Add a {prior_name(kinds[anchor])} on "
        f"{describe_key(anchor)}, or a factor between the components (an encounter, a landmark "
        "that both saw, the odometry that was left out)"
    )


def check_rank(
    factor: SquareRootFactor,
    kinds: Mapping[Key, str],
    views: Sequence[FactorView],
) -> None:
    """Raise if elimination found a direction that no factor measures.

    Args:
        factor: The eliminated graph.
        kinds: Type of each variable.
        views: Every factor.

    Raises:
        IllPosedBeliefError: Naming the variables that could move, what touches them, the remedy.
    """
    if not factor.deficient:
        return
    moving, direction = moving_variables(factor)
    touching = factors_of(kinds, views)
    count = f"{factor.deficiency} direction{'s' if factor.deficiency > 1 else ''}"
    if len(moving) == 1:
        key = moving[0]
        along = np.array2string(direction[key], precision=2, suppress_small=True)
        raise IllPosedBeliefError(
            f"{_noun(kinds[key])} {describe_key(key)} ({kinds[key]}) could move along {along} "
            f"(its tangent) without changing any factor; {_seen_by(key, touching[key])}. "
            f"{_remedy(key, kinds[key], touching[key])}"
        )
    group = set(moving)
    anchor = _anchor(moving, kinds)
    borders = [view for view in views if not group.issuperset(view.keys) and group & set(view.keys)]
    absolute = [view for view in views if group & set(view.keys) and not view.is_relative]
    if borders:
        why = f"they hang on the rest by {_listed(borders)} only"
    elif absolute:
        why = f"the absolute factors among them, {_listed(absolute)}, leave that open"
    else:
        why = "no factor among them is absolute (gauge freedom)"
    raise IllPosedBeliefError(
        f"{count} not determined: the {len(moving)} variables {describe_keys(moving)} could move "
        f"together without changing any factor; {why}. Add a {prior_name(kinds[anchor])} on "
        f"{describe_key(anchor)}, or another factor that ties {describe_key(anchor)} to what is "
        "known"
    )


def moving_variables(factor: SquareRootFactor) -> tuple[list[Key], dict[Key, FloatArray]]:
    """Variables that take part in the first undetermined direction, R n = 0, and their parts.

    Args:
        factor: An eliminated graph with at least one deficient key.

    Returns:
        Keys in ascending order; and for each its part of n, unit length over all, tangent units.
    """
    first = factor.deficient[0]
    parts: dict[Key, FloatArray] = {}
    free = True
    for key in reversed(factor.keys):
        row, others = factor.block_row(key)
        dim = row.shape[0]
        known = np.concatenate([np.zeros(dim), *(parts[other] for other in others)])
        for scalar in range(dim - 1, -1, -1):
            if row[scalar, scalar] > 0.0:
                known[scalar] = (
                    -(row[scalar, scalar + 1 :] @ known[scalar + 1 :]) / row[scalar, scalar]
                )
            elif key == first and free:
                known[scalar], free = 1.0, False
        parts[key] = known[:dim]
    length = np.sqrt(sum(float(part @ part) for part in parts.values()))
    parts = {key: part / length for key, part in parts.items()}
    largest = max(float(np.abs(part).max()) for part in parts.values())
    moving = sorted(key for key, part in parts.items() if np.abs(part).max() > _MOVES * largest)
    return moving, {key: parts[key] for key in moving}


def factors_of(
    keys: Mapping[Key, str] | Sequence[Key], views: Sequence[FactorView]
) -> dict[Key, list[FactorView]]:
    """Factors that touch each key, in graph order."""
    touching: dict[Key, list[FactorView]] = {key: [] for key in keys}
    for view in views:
        for key in view.keys:
            touching[key].append(view)
    return touching


def prior_name(kind: str) -> str:
    """Name of GTSAM's prior factor for a type of variable."""
    return f"PriorFactor{kind}"


def _noun(kind: str) -> str:
    """What the field calls a variable of this type."""
    if kind in _POINTS:
        return "landmark"
    return "pose" if kind.startswith("Pose") else "variable"


def _anchor(keys: Sequence[Key], kinds: Mapping[Key, str]) -> Key:
    """The variable to put a prior on: the first pose, else the first of all."""
    return next((key for key in keys if kinds[key].startswith("Pose")), keys[0])


def _listed(views: Sequence[FactorView], limit: int = 3) -> str:
    """Name some factors."""
    shown = ", ".join(str(view) for view in views[:limit])
    return shown if len(views) <= limit else f"{shown} and {len(views) - limit} more"


def _seen_by(key: Key, seen: Sequence[FactorView]) -> str:
    """Say what touches a variable: ``is seen only once, by factor 3 (RangeFactor2D on x0, l1)``."""
    if len(seen) == 1:
        return f"is touched only once, by {seen[0]}"
    names = Counter(view.type_name for view in seen)
    others = sorted({other for view in seen for other in view.keys if other != key})
    kinds = " and ".join(f"{count} {name}" for name, count in names.items())
    where = f", all with {describe_keys(others)}" if others else ""
    return f"is touched only by {kinds}{where}"


def _remedy(key: Key, kind: str, seen: Sequence[FactorView]) -> str:
    """What to add so that a variable is determined."""
    name = describe_key(key)
    names = " ".join(view.type_name for view in seen)
    prior = f"a {prior_name(kind)} on {name}"
    if kind in _POINTS and "BearingRange" not in names and "Range" in names:
        where = (
            "a second range from another place" if kind == "Point2" else "ranges from three places"
        )
        return f"A range leaves the bearing open: add {where}, a bearing, or {prior}"
    if kind in _POINTS and "BearingRange" not in names and "Bearing" in names:
        return (
            f"A bearing leaves the distance open: add a second bearing from another place, a range "
            f"(BearingRangeFactor), or {prior}"
        )
    return f"Add {prior}, or another factor that measures {name}"
