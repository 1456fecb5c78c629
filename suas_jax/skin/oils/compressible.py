"""Oil with a bulk modulus."""

import jax.numpy as jnp

from suas_jax.config.oils.compressible import CompressibleOilSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.oil import AbstractOil


class CompressibleOil(AbstractOil):
    """p = -K ln(V / V0) with the bulk modulus K and the film's volume V0 at rest."""

    spec = CompressibleOilSpec

    bulk_modulus: Lanes  # K [Pa]

    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """V0 (exp(-p / K) - 1)."""
        return film_volume * jnp.expm1(-pressure / self.bulk_modulus)
