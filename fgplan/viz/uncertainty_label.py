"""What an axis of an uncertainty says: the function and its unit, planar targets in metres."""

_UNITS = {
    "determinant": "m⁴",
    "trace": "m²",
    "largest_eigenvalue": "m²",
    "entropy": "nats",
    "mutual_information": "nats",
}


def uncertainty_label(function: str, of: str = "") -> str:
    """The label of an axis.

    Args:
        function: Name of the uncertainty function.
        of: What it is of, with a space before it.

    Returns:
        Such as ``determinant of the worst target (m⁴)``; no unit where none is known.
    """
    unit = f" ({_UNITS[function]})" if function in _UNITS else ""
    return f"{function.replace('_', ' ')}{of}{unit}"
