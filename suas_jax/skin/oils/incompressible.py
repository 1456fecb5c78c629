"""Oil that keeps its volume."""

import jax.numpy as jnp

from suas_jax.config.oils.incompressible import IncompressibleOilSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.oil import AbstractOil


class IncompressibleOil(AbstractOil):
    """The film keeps its volume: dV = 0."""

    spec = IncompressibleOilSpec

    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Zero."""
        return jnp.zeros_like(pressure * film_volume)
