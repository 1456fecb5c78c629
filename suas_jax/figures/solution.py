"""The figure of a solution, drawn by what its model resolves."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from suas_jax.figures.pad import plot_pad_surface
from suas_jax.figures.section import plot_section, plot_solid
from suas_jax.figures.style import written
from suas_jax.scene.solve import Solution

FIGURES: dict[int, dict[str, Callable[[Solution], Figure]]] = {
    2: {"shell": plot_section, "solid": plot_solid},
    3: {"shell": plot_pad_surface, "solid": plot_pad_surface},
}
"""How solutions of each model are drawn, by dimension and by its name."""


def plot_solution(solution: Solution, file: Path | None = None) -> Figure:
    """Draw the deformed membrane; a file's ending chooses the format."""
    return written(FIGURES[solution.plan.dimension][solution.plan.model](solution), file)
