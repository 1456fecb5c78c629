"""Line loads drawn as arrows on the outer face."""

import numpy as np
from matplotlib.axes import Axes

from suas_jax.config import continuous_inputs
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.solve import Solution


def draw_loads(axes: Axes, solution: Solution, outer: np.ndarray, angle: np.ndarray) -> None:
    """Draw every line load as an arrow that ends at the outer face."""
    parts = scene_parts(solution.scene, continuous_inputs(solution.scene))
    length = 0.18 * np.ptp(outer[0])
    for load in parts.forces:
        at = outer[:, int(np.argmin(np.abs(angle - float(load.angle[0]))))]
        push = np.asarray(load.direction)[:, 0] * np.sign(float(load.force[0]))
        axes.annotate(
            "",
            xy=tuple(at),
            xytext=tuple(at - length * push),
            arrowprops={"arrowstyle": "-|>", "color": "C3", "lw": 1.5},
        )
        axes.update_datalim([at - length * push])
