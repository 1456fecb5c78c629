"""What all figures share: colours, resolution, how places are named, how they are written."""

import io
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
from cycler import cycler
from matplotlib.figure import Figure

from suas_jax.files.writing import write_bytes

WALL = "0.55"
"""Colour of the rigid wall."""
FILM = "#f7dfa0"
"""Colour of the oil."""
BODY = "0.85"
"""Colour of what is pressed on the skin."""
CONTACT = "#d55e00"
"""Colour of where something is touched."""
FIRST = "#0072b2"
"""Colour of the first series."""
SECOND = "#e69f00"
"""Colour of what is drawn over the first series."""
# Okabe and Ito (2008): told apart by people who see two colours of three.
_COLOURS = (FIRST, CONTACT, "#009e73", "#cc79a7", "#56b4e9", SECOND, "#000000")
_DOTS_PER_INCH = 150
_STYLE: Any = {
    # An eighth line is dashed: it has the first one's colour.
    "axes.prop_cycle": cycler(linestyle=["-", "--"]) * cycler(color=_COLOURS),
    "font.size": 9.0,
}
_P = ParamSpec("_P")
_R = TypeVar("_R")


def styled(draw: Callable[_P, _R]) -> Callable[_P, _R]:
    """Give the figure that a function draws this project's style."""

    @wraps(draw)
    def with_style(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with mpl.rc_context(_STYLE):
            return draw(*args, **kwargs)

    return with_style


def place_label(load: Mapping[str, Any], *, by_arc: bool) -> str:
    """Where a reported load is, by what the section's places are told by."""
    if not by_arc:
        return f"{load['angle_deg']:.4g}°"
    # In the middle it is known to rounding errors.
    return f"{round(1e3 * load['arc_m'], 6) + 0.0:.4g} mm"


def check_figure_file(file: Path) -> None:
    """Make sure that a figure can be written, before any work is done for it.

    Raises ValueError: the ending is not a figure format, or the folder does not exist.
    """
    formats = Figure().canvas.get_supported_filetypes()
    ending = file.suffix.removeprefix(".").lower()
    if ending not in formats:
        raise ValueError(
            f'{file}: "{ending}" is not a figure format; use {", ".join(sorted(formats))}'
        )
    if not file.absolute().parent.is_dir():
        raise ValueError(f"{file}: the folder {file.parent} does not exist")


def written(figure: Figure, file: Path | None) -> Figure:
    """Write a figure where a file is given, and return it."""
    if file is not None:
        check_figure_file(file)
        with mpl.rc_context({"savefig.dpi": _DOTS_PER_INCH}):
            content = io.BytesIO()
            figure.savefig(content, format=file.suffix.removeprefix("."))
        write_bytes(file, content.getvalue())
    return figure
