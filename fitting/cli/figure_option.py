"""The option of commands that draw a figure, and its check before anything takes long."""

from pathlib import Path
from typing import Annotated

import typer

Plot = Annotated[Path | None, typer.Option(help="Write a figure (PNG, PDF, SVG).")]


def check_figures(*files: Path | None) -> None:
    """Refuse endings that no figure can have.

    Args:
        files: of figures; those that are None are not wanted.

    Raises:
        ValueError: names the file.
    """
    for file in files:
        if file is not None:
            from suas_jax.figures.style import check_figure_file

            check_figure_file(file)
