"""What all figures share: colours, resolution, and how they are written."""

import io
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from suas_jax.files.writing import write_bytes

WALL = "0.55"
"""Colour of the rigid wall."""
FILM = "#f7dfa0"
"""Colour of the oil."""
BODY = "0.85"
"""Colour of what is pressed on the skin."""
CONTACT = "C3"
"""Colour of where something is touched."""
_DOTS_PER_INCH = 150


def check_figure_file(file: Path) -> None:
    """Make sure that a figure can be written, before any work is done for it.

    Args:
        file: where the figure is to go; its ending chooses the format.

    Raises:
        ValueError: the ending is no figure format, or the folder does not exist.
    """
    formats = Figure().canvas.get_supported_filetypes()
    ending = file.suffix.removeprefix(".").lower()
    if ending not in formats:
        raise ValueError(
            f'{file}: "{ending}" is no figure format; use one of {", ".join(sorted(formats))}'
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
