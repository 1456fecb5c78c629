"""How the trapped oil answers a change of the volume enclosed by the membrane.

Each model states one equation between that change, dV, and the oil's pressure p above
ambient; the equilibrium enforces it as the border of its linear system.
"""

import abc
from typing import ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp

from suas_jax.config.oil import OilSpec
from suas_jax.numerics.array_types import Lanes


class AbstractOil(eqx.Module):
    """An oil film; its constants are the keys of its [oil] table, with a lane axis."""

    spec: ClassVar[type[OilSpec]]  # the model's declaration

    @property
    def trapped(self) -> bool:
        """Whether the oil's pressure is unknown (else it is zero)."""
        return self.spec.trapped

    @property
    def yields(self) -> bool:
        """Whether its volume changes with the pressure."""
        return self.spec.yields

    @abc.abstractmethod
    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Change of the film's volume that a pressure demands [m^2 per width].

        `pressure`: oil pressure above ambient [Pa]. `film_volume`: volume of the undeformed
        film per width [m^2].
        """

    def warmed(self, growth: Lanes, warmth: Lanes) -> tuple[Self, Lanes]:
        """The oil at another temperature, and the logarithm of its volume over what it was.

        `growth`: that logarithm for oil alone. `warmth`: absolute temperature over what it was.
        """
        del warmth
        return self, growth

    def compliance(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """Derivative of `expansion` by the pressure, negative or zero [m^2/Pa]."""
        pressure = jnp.asarray(pressure)
        one = jnp.ones_like(pressure)
        return jax.jvp(lambda p: self.expansion(p, film_volume), (pressure,), (one,))[1]
