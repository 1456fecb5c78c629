"""What a law predicts for a test: the forward model of a material's calibration."""

import abc
from typing import ClassVar, Self

import equinox as eqx
from jaxtyping import Array, Float

from fitting.statistics.parameters import AbstractFamily
from fitting.statistics.residuals import linearised
from suas_jax.constitutive import AbstractLaw


class AbstractExperiment(eqx.Module):
    """Tests whose readings a law predicts.

    Attributes:
        costly: whether compiling the prediction takes longer than a whole fit's use of it.
    """

    costly: ClassVar[bool] = False

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of readings, padding included."""

    def settled(self, law: AbstractLaw) -> Self:
        """The same tests, at the states that fit a law."""
        return self

    def shifted(self, zeros: Float[Array, " k"]) -> Self:
        """The same tests with other zeros; by default a test has none that are free."""
        return self

    def linearised(
        self, family: AbstractFamily, constants: Float[Array, " p"]
    ) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        """Readings of a family's law and their derivatives by its constants, SI units."""
        return linearised(
            lambda c: self.shifted(family.zeros(c)).predict(family.law(c)), constants
        )

    @abc.abstractmethod
    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings of all points, padding included."""
