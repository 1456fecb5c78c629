"""Line loads drawn as arrows on the outer face."""

import numpy as np
from matplotlib.axes import Axes

from suas_jax.figures.outline import Outline


def draw_loads(axes: Axes, drawn: Outline, outer: np.ndarray, angle: np.ndarray) -> None:
    """Draw every line load as an arrow that ends at the outer face.

    Args:
        axes: in millimetres.
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
            arrowprops={"arrowstyle": "-|>", "color": "C3", "lw": 1.5},
        )
        axes.update_datalim([at - length * push])
