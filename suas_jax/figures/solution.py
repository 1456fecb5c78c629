"""The figure of a solution, drawn by what its model resolves."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from suas_jax.figures.section import plot_section
from suas_jax.figures.solid import plot_solid
from suas_jax.figures.style import written
from suas_jax.scene.solve import Solution

FIGURES: dict[str, Callable[[Solution], Figure]] = {"shell": plot_section, "solid": plot_solid}
"""How solutions of each model are drawn, by its name."""


def plot_solution(solution: Solution, file: Path | None = None) -> Figure:
    """Draw the deformed membrane.

    Args:
        solution: what to draw.
        file: where to write the figure; its ending chooses the format.
    """
    return written(FIGURES[solution.plan.model](solution), file)
