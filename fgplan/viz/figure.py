"""Figures without pyplot: no global state, no window, safe on a server.

Matplotlib is the extra ``viz`` and is imported when the first figure is made. A figure is 1000
pixels wide unless told otherwise.
"""

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fgplan.errors import InvalidInputError, MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
WIDTH_PX = 1000
FORMATS = (".png", ".pdf", ".svg")


def matplotlib_module(name: str) -> Any:  # noqa: ANN401
    """Import a module of matplotlib when it is needed.

    Args:
        name: Name within matplotlib, such as "figure".

    Returns:
        The module.

    Raises:
        MissingExtraError: If matplotlib is not installed.
    """
    try:
        return importlib.import_module(f"matplotlib.{name}")
    except ImportError as error:
        raise MissingExtraError(
            f"figures need matplotlib, which could not be imported ({error}); install the extra: "
            "pip install 'fgplan[viz]'"
        ) from error


def new_figure(
    width_px: float = WIDTH_PX, height_px: float = 600, *, lays_itself_out: bool = True
) -> "Figure":
    """Make an empty figure.

    Args:
        width_px: Width at 100 dots an inch.
        height_px: Height.
        lays_itself_out: Whether matplotlib places the axes; False leaves that to the caller.

    Returns:
        A matplotlib Figure that pyplot does not know of.

    Raises:
        MissingExtraError: If matplotlib is not installed.
    """
    figure = matplotlib_module("figure").Figure(
        figsize=(width_px / DPI, height_px / DPI),
        dpi=DPI,
        layout="constrained" if lays_itself_out else None,
    )
    matplotlib_module("backends.backend_agg").FigureCanvasAgg(figure)
    return figure


def save(figure: "Figure", path: str | Path) -> Path:
    """Write a figure to a file; its folder is made if missing.

    Args:
        figure: The figure.
        path: Ends in .png, .pdf or .svg.

    Returns:
        The path.

    Raises:
        InvalidInputError: If the name ends otherwise.
    """
    path = Path(path)
    if path.suffix not in FORMATS:
        raise InvalidInputError(
            f"figure {path.name!r}: expected a name that ends in {', '.join(FORMATS)}"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI)
    return path
