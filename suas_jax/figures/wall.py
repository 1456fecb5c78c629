"""The wall of a solution's figure, and the zone where the inner face lies on it."""

import numpy as np
from matplotlib.axes import Axes

from suas_jax.figures.outline import Outline
from suas_jax.figures.style import CONTACT, WALL
from suas_jax.scene.solve import Solution


def draw_wall(axes: Axes, solution: Solution, drawn: Outline) -> None:
    """Draw the wall, on axes in millimetres, and on it the zone where the inner face lies."""
    wall = solution.report["wall"]
    # Beneath all else: a membrane beyond it stays visible.
    axes.fill(*(1e3 * drawn.wall), color=WALL, lw=0, zorder=0)
    if wall is not None:
        key, places = ("arc_m", drawn.arc) if "arc_m" in wall else ("angle_deg", drawn.given)
        first, last = np.interp(np.asarray(wall[key]), places, drawn.angle)
        inside = np.linspace(first, last, 99)
        zone = [1e3 * np.interp(inside, drawn.angle, x) for x in drawn.wall]
        label = f"wall carries {wall['force_N']:.4g} N"
        # Zones are short: the ends of the line show those that are a point on this scale.
        axes.plot(*zone, color=CONTACT, lw=4, solid_capstyle="round", zorder=3, label=label)
        axes.legend(loc="lower center")
