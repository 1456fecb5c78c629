"""Places along the arc of a skin, from its model."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from suas_jax.runtime.compiled import COMPILED
from suas_jax.skin.geometry import SkinGeometry

_POINTS = 4001  # of the table: good to 1e-9 of the arc


def arc_table(geometry: SkinGeometry) -> tuple[float, Floats, Floats]:
    """Outer size [m], places [place] and what is told there [place, 3]; see `ArcTable`."""
    edge = float(geometry.half_angle[0])
    angle = np.linspace(-edge, edge, _POINTS)
    size, *rows = COMPILED.run(_told, geometry, angle[:, None], once=True)
    return float(size[0]), angle, np.concatenate([np.asarray(x) for x in rows], 1)


@eqx.filter_jit
def _told(geometry: SkinGeometry, angle: jax.Array) -> tuple[jax.Array, ...]:
    section = geometry.section
    rows = section.given_angle(angle), section.arc(angle), geometry.outer_arc(angle)
    return geometry.outer_size, *(jnp.broadcast_to(x, angle.shape) for x in rows)
