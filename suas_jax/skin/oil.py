"""How the trapped oil answers a change of the volume enclosed by the membrane.

Each model states one equation between that change, dV, and the oil's pressure p above
ambient; the equilibrium enforces it as the border of its linear system.
"""

import abc

import equinox as eqx
import jax.numpy as jnp

from suas_jax.numerics.array_types import Lanes


class AbstractOil(eqx.Module):
    """An oil film."""

    @property
    def trapped(self) -> bool:
        """Whether the oil's pressure is unknown (else it is zero)."""
        return True

    @abc.abstractmethod
    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Change of the film's volume that a pressure demands [m^2 per width].

        Args:
            pressure: oil pressure above ambient [Pa].
            film_volume: volume of the undeformed film per width [m^2].
        """

    @abc.abstractmethod
    def compliance(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Derivative of `expansion` by the pressure, negative or zero [m^2/Pa]."""


class IncompressibleOil(AbstractOil):
    """The film keeps its volume: dV = 0."""

    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Zero."""
        return jnp.zeros_like(pressure * film_volume)

    def compliance(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Zero."""
        return jnp.zeros_like(pressure * film_volume)


class CompressibleOil(AbstractOil):
    """p = -K ln(V / V0) with the bulk modulus K and the film's volume V0 at rest.

    Attributes:
        bulk_modulus: K [Pa].
    """

    bulk_modulus: Lanes

    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """V0 (exp(-p / K) - 1)."""
        return film_volume * jnp.expm1(-pressure / self.bulk_modulus)

    def compliance(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """-V0 / K exp(-p / K)."""
        return -film_volume / self.bulk_modulus * jnp.exp(-pressure / self.bulk_modulus)


class VentedOil(AbstractOil):
    """The film is open: p = 0 and no constraint on its volume."""

    @property
    def trapped(self) -> bool:
        """False: there is no pressure to find."""
        return False

    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Zero; never asked."""
        return jnp.zeros_like(pressure * film_volume)

    def compliance(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Zero; never asked."""
        return jnp.zeros_like(pressure * film_volume)
