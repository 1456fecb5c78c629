"""Line loads drawn as arrows on the outer face, bodies where they have come to."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from suas_jax.figures.outline import Outline
from suas_jax.figures.style import BODY, CONTACT
from suas_jax.scene.solve import Solution

_ZONE = ("contact_from_m", "contact_to_m")


def draw_loads(axes: Axes, drawn: Outline, outer: np.ndarray, angle: np.ndarray) -> None:
    """Draw every line load as an arrow that ends at the outer face, on axes in millimetres.

    Args:
        axes: to draw in.
        drawn: the section and its loads.
        outer: points of the deformed outer face [2, point] [mm].
        angle: of those points [rad].
    """
    length = 0.18 * np.ptp(outer[0])
    for place, push in zip(drawn.load_angle, drawn.load_push, strict=True):
        if not push.any():  # no load, or none that pushes
            continue
        at = outer[:, int(np.argmin(np.abs(angle - place)))]
        axes.annotate(
            "",
            xy=tuple(at),
            xytext=tuple(at - length * push),
            arrowprops={"arrowstyle": "-|>", "color": CONTACT, "lw": 1.5},
        )
        axes.update_datalim([at - length * push])


def draw_bodies(
    axes: Axes, solution: Solution, drawn: Outline, outer: np.ndarray, angle: np.ndarray
) -> None:
    """Draw the bodies of a solved section, and the zones where the skin touches them.

    The other arguments are those of `draw_loads`.
    """
    found = [load for load in solution.report["loads"] if load["kind"] == "body"]
    reports = zip(found, drawn.bodies, drawn.body_way, strict=False)
    for load, surface, way in reports:
        moved = 1e3 * (surface + load["depth_m"] * way[:, None])
        axes.fill(*moved, color=BODY, lw=0, zorder=0)
        axes.plot(*moved, color="0.3", lw=1)
        if load["zones"] == 0:
            continue
        along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(drawn.outer), axis=0))])
        along += load["arc_position_m"] - np.interp(_angle(load, drawn), drawn.angle, along)
        places = [load["arc_position_m"] + load[key] for key in _ZONE]
        first, last = np.interp(places, along, drawn.angle)
        inside = np.linspace(first, last, 99)
        zone = [np.interp(inside, angle, x) for x in outer]
        label = f"body presses with {load['force_N']:.4g} N"
        axes.plot(*zone, color=CONTACT, lw=4, solid_capstyle="round", zorder=3, label=label)
        axes.legend(loc="lower center")


def _angle(load: dict[str, Any], drawn: Outline) -> float:
    """Where a load of a report is, as sections define angles [rad]."""
    if "arc_m" in load:
        return float(np.interp(load["arc_m"], drawn.arc, drawn.angle))
    return float(np.interp(load["angle_deg"], drawn.given, drawn.angle))
