"""Checks of single options of planners: a choice, a switch, a count."""

from fgplan.errors import InvalidInputError


def check_choice(option: str, value: object, allowed: tuple[str, ...]) -> None:
    """Refuse what is not among an option's values.

    Args:
        option: Its name.
        value: What was given.
        allowed: Its values.

    Raises:
        InvalidInputError: If it is none of them.
    """
    if value not in allowed:
        raise InvalidInputError(
            f"planner option {option}: expected one of {', '.join(allowed)}, got {value!r}"
        )


def check_switch(option: str, value: object) -> None:
    """Refuse what is neither true nor false.

    Args:
        option: Its name.
        value: What was given.

    Raises:
        InvalidInputError: If it is neither.
    """
    if not isinstance(value, bool):
        raise InvalidInputError(f"planner option {option}: expected true or false, got {value!r}")


def check_count(option: str, value: object, least: int = 1, most: int | None = None) -> None:
    """Refuse what is not a whole number of at least so many.

    Args:
        option: Its name.
        value: What was given.
        least: The smallest number that is usable.
        most: The greatest one; None has no limit.

    Raises:
        InvalidInputError: If it is no such number.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise InvalidInputError(
            f"planner option {option}: expected a whole number of at least {least}, got {value!r}"
        )
    if most is not None and value > most:
        raise InvalidInputError(f"planner option {option}: expected at most {most}, got {value}")
