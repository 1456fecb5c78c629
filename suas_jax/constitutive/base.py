"""What every material law is: a strain energy, and the modulus it starts with.

A law declares its energy and nothing else. Stresses, tangents and parameter
sensitivities follow by differentiation, so there is one place where the physics of
a law can be right or wrong.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Self, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from suas_jax.config.law import LawSpec
from suas_jax.constitutive.deformation import AbstractDeformation

Constants: TypeAlias = ArrayLike | Sequence[ArrayLike]


class AbstractLaw(eqx.Module):
    """An isotropic, incompressible (or purely isochoric) hyperelastic law.

    A law is a pytree whose leaves are its constants. A constant may carry trailing
    batch axes ("lanes"); they broadcast against the trailing axes of the deformation,
    so that one call evaluates many materials.

    Attributes:
        spec: the law's declaration, by which its constants are checked; None for a law of
            one's own, which no file can name.
        has_limit: whether there are deformations that the law has no energy for, such as
            beyond a locking stretch: the energy is not a number there, load steps are kept
            from going there, and no state with a face there is called an equilibrium.
        in_stretches: whether the energy is written in principal stretches: with its
            derivatives thousands of operations, which programs then do once.
    """

    spec: ClassVar[type[LawSpec] | None] = None
    has_limit: ClassVar[bool] = False
    in_stretches: ClassVar[bool] = False

    @classmethod
    def of_material(cls, material: LawSpec, value: Callable[[str], Any]) -> Self:
        """Build the law of a [material] table, whose keys are the law's arguments.

        Args:
            material: the table.
            value: constants by their paths in it.
        """
        return cls(**{key: value(key) for key in material.declared()})

    def __check_init__(self) -> None:
        if self.spec is None:
            return
        name = self.spec.model_fields["law"].default
        for key, declared in self.spec.declared().items():
            value = getattr(self, key)
            _require(value, f'law "{name}": {key}', positive=declared.positive)
        if self.spec.half_modulus:
            halves = " + ".join(self.spec.half_modulus)
            what = f'law "{name}": the modulus 2 ({halves})'
            _require(self.shear_modulus, what, positive=True)

    @abc.abstractmethod
    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Strain energy per unit reference volume.

        Args:
            deformation: the state of deformation, arrays of any shape.

        Returns:
            Ψ [J/m³], in the broadcast shape of deformation and constants; zero at rest.
        """

    def has_energy(self, deformation: AbstractDeformation) -> Bool[Array, "..."]:
        """Whether states of deformation lie in the law's domain; see `has_limit`.

        Args:
            deformation: the states, arrays of any shape.
        """
        return jnp.isfinite(self.energy(deformation))

    @property
    @abc.abstractmethod
    def shear_modulus(self) -> Float[Array, "..."]:
        """Shear modulus at small strain, μ [Pa], in the shape of the constants' lanes."""


def constant(value: ArrayLike) -> Float[Array, "..."]:
    """Convert a law's constant to a floating-point array, keeping a narrower float type.

    `value`: a number, an array, or a traced value, in SI units.
    Returns the same value as a JAX array that is floating-point and strongly typed, so that a
    law built from Python numbers and one built from arrays share compiled programs.
    """
    return jnp.asarray(value, dtype=jnp.result_type(value, float))


def constants(values: Constants) -> Float[Array, " terms *lanes"]:
    """Convert a series of constants to an array whose leading axis counts the terms.

    `values`: a number (one term), a sequence of numbers or traced values, or an array.
    Returns an array [terms, *lanes].
    """
    if isinstance(values, Sequence):
        if not values:
            return jnp.zeros(0)
        return jnp.stack(jnp.broadcast_arrays(*[constant(value) for value in values]))
    return jnp.atleast_1d(constant(values))


def known(value: Array) -> np.ndarray | None:
    """Return the numbers behind a constant, or None while it is being traced."""
    return None if isinstance(value, jax.core.Tracer) else np.asarray(value)


def _require(value: Array, what: str, *, positive: bool) -> None:
    """Raise unless a constant is finite, and positive where it must be; tracers pass."""
    numbers = known(value)
    if numbers is None or np.all(np.isfinite(numbers) & ((numbers > 0) | (not positive))):
        return
    rule = "positive and finite" if positive else "finite"
    raise ValueError(f"{what} must be {rule}, got {numbers}")
