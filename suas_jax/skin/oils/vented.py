"""Oil that is free to flow in and out."""

import jax.numpy as jnp

from suas_jax.config.oils.vented import VentedOilSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.oil import AbstractOil


class VentedOil(AbstractOil):
    """The film is open: p = 0 and no constraint on its volume."""

    spec = VentedOilSpec

    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Zero; never asked."""
        return jnp.zeros_like(pressure * film_volume)
