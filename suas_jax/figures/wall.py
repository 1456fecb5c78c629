"""The wall of a solution's figure, and the zone where the inner face lies on it."""

import numpy as np
from matplotlib.axes import Axes

from suas_jax.figures.style import CONTACT, WALL
from suas_jax.scene.solve import Solution


def draw_wall(axes: Axes, solution: Solution) -> None:
    """Draw the wall, and on it the zone where the inner face lies.

    Args:
        axes: in millimetres.
        solution: says where the wall is, and whether something touches it.
    """
    geometry, wall = solution.scene.geometry, solution.report["wall"]
    radius = 1e3 * (geometry.inner_radius - geometry.oil_gap)

    def arc(first: float, last: float) -> tuple[np.ndarray, np.ndarray]:
        angle = np.linspace(first, last, 361)
        return radius * np.sin(angle), radius * np.cos(angle)

    # Beneath all else: a membrane beyond it stays visible.
    axes.fill(*arc(-geometry.half_angle, geometry.half_angle), color=WALL, lw=0, zorder=0)
    if wall is not None:
        zone = arc(*np.deg2rad(wall["angle_deg"]))
        label = f"wall carries {wall['force_N']:.4g} N"
        # Zones are short: the ends of the line show those that are a point on this scale.
        axes.plot(*zone, color=CONTACT, lw=4, solid_capstyle="round", zorder=3, label=label)
        axes.legend(loc="lower center")
