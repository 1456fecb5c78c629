"""Oil with air in it."""

import dataclasses
from typing import Self

import jax.numpy as jnp

from suas_jax.config.oils.aerated import AeratedOilSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.oil import AbstractOil


class AeratedOil(AbstractOil):
    """V/V0 = (1 - f) exp(-p / K) + f p0 / (p0 + p): oil, and air that keeps its temperature.

    The air obeys Boyle's law. One per cent of it at the sea's surface makes the film as soft
    as a bulk modulus of 10 MPa would. There is no volume at p <= -p0, where it boils off.
    """

    spec = AeratedOilSpec

    air_fraction: Lanes  # f, share of the film's volume at rest that is air
    ambient_pressure: Lanes  # p0, absolute pressure of the air at rest [Pa]
    bulk_modulus: Lanes  # K of the oil [Pa]

    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """V0 ((1 - f) (exp(-p / K) - 1) - f p / (p0 + p))."""
        oil = (1.0 - self.air_fraction) * jnp.expm1(-pressure / self.bulk_modulus)
        air = -self.air_fraction * pressure / (self.ambient_pressure + pressure)
        return film_volume * (oil + air)

    def warmed(self, growth: Lanes, warmth: Lanes) -> tuple[Self, Lanes]:
        """Air grows with the absolute temperature; see the base class."""
        air = self.air_fraction * warmth
        volume = air + (1.0 - self.air_fraction) * jnp.exp(growth)
        oil = dataclasses.replace(self, air_fraction=air / volume)
        return oil, jnp.log(volume)
