"""What tables of a scenario file are made of: structs without unknown fields, checked values."""

from typing import Annotated

from msgspec import Meta, Struct

Name = Annotated[str, Meta(min_length=1)]
Count = Annotated[int, Meta(ge=1)]
Seed = Annotated[int, Meta(ge=0)]
Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Probability = Annotated[float, Meta(ge=0, lt=1)]
Numbers = tuple[float, ...]
Sigmas = Annotated[tuple[Positive, ...], Meta(min_length=1)]
Matrix = Annotated[tuple[Numbers, ...], Meta(min_length=1)]
Point = Annotated[Numbers, Meta(min_length=2, max_length=3)]
PlanePoint = tuple[float, float]
Polygon = Annotated[tuple[PlanePoint, ...], Meta(min_length=3)]
PoseNumbers = Annotated[Numbers, Meta(min_length=3, max_length=7)]
KeyName = Annotated[str, Meta(min_length=1)] | Annotated[int, Meta(ge=0)]


class Table(Struct, forbid_unknown_fields=True, frozen=True):
    """One table of a scenario; unknown fields are refused by name."""
