"""Colours that mean the same in every figure.

Eight robot colours that stay apart for protan and deutan eyes too (smallest CIELAB difference 14
under simulated deficiency), and apart from the factor colours; robots nine to sixteen repeat them
with dashed lines. Colour is never the only sign: starts carry the robot's name. A team whose robots
are all called by a colour of ``NAMED_COLORS``, as those of Regev and Indelman 2017, section 7.2
("red, green, blue and purple"), is drawn in the colours that it is called by; those four stay 19
apart, from one another and from the factors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from fgplan.errors import InvalidInputError

ROBOT_COLORS = (
    "#0072B2",
    "#D55E00",
    "#117733",
    "#332288",
    "#661100",
    "#999933",
    "#EE6677",
    "#000000",
)

NAMED_COLORS = {
    "red": "#D62728",
    "green": "#1B8A3A",
    "blue": "#1F5FD0",
    "purple": "#7B2D8B",
}
"""Colours of robots that are called by a colour."""

UNCHANGED = "#00B8D9"
"""Cyan: multi-robot factors; in comparisons those of both announcements."""

REMOVED = "#E8B400"
"""Golden: factors of the previous announcement alone; yellow would not show on white."""

ADDED = "#E6007E"
"""Magenta: factors of the new announcement alone."""

OBSTACLE = "#8A8A8A"
UNKNOWN = "#E4E4E4"
ROADMAP = "#E2E2E2"
UNTOUCHED = "#A6A6A6"
LANDMARK = "#404040"
UNMAPPED = "#969696"
"""Where landmarks truly are: tiny dots."""

LIMIT = 2 * len(ROBOT_COLORS)
"""Number of robots that can be told apart."""


@dataclass(frozen=True, slots=True)
class RobotStyle:
    """How one robot is drawn.

    Attributes:
        color: Hexadecimal colour.
        dash: Matplotlib line style: solid for the first eight, dashed for the next.
    """

    color: str
    dash: str | tuple[int, tuple[float, float]]


def robot_styles(robots: Sequence[str]) -> dict[str, RobotStyle]:
    """Styles by the order of the team, so that a robot looks the same in all its figures.

    Args:
        robots: Unique names in the order of the team.

    Returns:
        Style of each robot; beyond sixteen robots they repeat.

    Raises:
        InvalidInputError: If a name is given twice.
    """
    names = tuple(robots)
    if len(set(names)) != len(names):
        raise InvalidInputError(f"figure: expected unique robot names, got {names}")
    if all(name in NAMED_COLORS for name in names):
        return {name: RobotStyle(NAMED_COLORS[name], "-") for name in names}
    styles = {}
    for place, name in enumerate(names):
        dashed = place % LIMIT >= len(ROBOT_COLORS)
        dash: str | tuple[int, tuple[float, float]] = (0, (4.0, 1.5)) if dashed else "-"
        styles[name] = RobotStyle(ROBOT_COLORS[place % len(ROBOT_COLORS)], dash)
    return styles
