"""Names of a planner's options: one that the planner does not have is refused.

The message lists every option that the planner has, whatever part of it reads the option, near
names first: a slip of the pen is seen at once.
"""

import difflib
from collections.abc import Iterable, Sequence

from fgplan.errors import OptionError


def check_option_names(given: Iterable[str], known: Sequence[str], planner: str) -> None:
    """Refuse options that a planner does not have.

    Args:
        given: Names of options.
        known: Names of all options of the planner.
        planner: Its name.

    Raises:
        OptionError: If one is not known; lists those that are.
    """
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known)
            listed = ", ".join([*near, *(one for one in known if one not in near)])
            remedy = f"; did you mean {near[0]!r}?" if near else ""
            raise OptionError(
                f"option {name!r} of planner {planner!r}: expected one of {listed}{remedy}"
            )
