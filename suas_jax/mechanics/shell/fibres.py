"""Fibres through the shell's thickness: from the strains of the mid-line to energy and stress.

With A = |r'|^2 - 1 the stretch and b = c/a - 1/R the bending of the mid-line, the fibre at
reference offset Z has ::

    lambda^2 - 1 = (A + m b) / (1 + Z/R)^2,     m = 2 Z + Z^2 / R

In a material with a past (`suas_jax.constitutive.relaxation`) the stress of a step is a share
of the instantaneous one and a rest H that is known, whose energy is H : C / 2. In plane strain
C is the square of the fibre's stretch along it and its inverse across; C is that which the law
sees.

A membrane that has grown by G against its seat keeps J = det G times its volume, and its law
sees x = lambda / (g_hoop sqrt(g_axial)) beside the stretch 1 / g_axial along the axis::

    x^2 - 1 = (A + J m b + (J - h) m / R + 1 - h) / (h (1 + Z/R)^2),    h = g_hoop^2 g_axial
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import (
    AbstractDeformation,
    FibreStretch,
    HeldFibre,
    InPlaneStrain,
)
from suas_jax.constitutive.relaxation import Response
from suas_jax.mechanics.shell.points import Moments
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.prestress import Growth


class Fibres(eqx.Module):
    """A membrane's material, integrated over its thickness."""

    law: AbstractLaw  # the material
    # of the undeformed mid-line, which broadcasts against the strains [1/m]
    mid_curvature: Array
    thickness: Array  # likewise [m]
    layers: int = eqx.field(static=True)  # quadrature points through the thickness
    # of a material with a past, its rest [2, layer, ...] along and
    # across fibres; None of an elastic one
    response: Response | None = None
    growth: Growth | None = None  # of the membrane against its seat; None where it fits

    def _state(self, green: Array) -> AbstractDeformation:
        if self.growth is None:
            return FibreStretch(green)
        return HeldFibre(green, -self.growth.axial)

    def energy(self, stretch: Array, curvature: Array) -> Array:
        """Strain energy per area of the mid-surface [J/m^2].

        `stretch`: A = |r'|^2 - 1. `curvature`: b = c / |r'|^2 - 1/R [1/m].
        """
        weight, lever, square, free = self._layers()
        green = (stretch + lever * curvature + free) / square
        return jnp.sum(weight * self._density(green), 0)

    def _density(self, green: Array) -> Array:
        """Energy per volume of the fibres [J/m^3]."""
        energy = self.law.energy(self._state(green))
        if self.response is None:
            return energy
        share, (along, across) = self.response
        if self.growth is None:
            return share * energy + (along * green - across * green / (1 + green)) / 2
        length = jnp.exp(
            self.growth.axial
        )  # those of C along and across are x^2 and 1/x^2 times it
        return share * energy + length * (along * green - across * green / (1 + green)) / 2

    def deviator(self, stretch: Array, curvature: Array) -> Float[Array, "2 layer *shape"]:
        """Deviator of the law's stress, pulled back: along and across the fibres [Pa].

        `stretch`: A = |r'|^2 - 1. `curvature`: b = c / |r'|^2 - 1/R [1/m].
        """
        _, lever, square, free = self._layers()
        green = (stretch + lever * curvature + free) / square
        axial = jnp.zeros(1) if self.growth is None else -self.growth.axial
        held, size = jnp.expm1(2 * axial), jnp.exp(-axial)
        green = size * green + jnp.expm1(-axial)  # of C along the fibre

        def kirchhoff(axis: str) -> Array:
            """Of a membrane: stress along a direction, none across the thickness."""

            def energy(e: Array) -> Array:
                along, aside = (green + e, held) if axis == "along" else (green, held + e)
                return self.law.energy(InPlaneStrain(along + aside, along * aside))

            none = jnp.zeros_like(green)
            return 2 * jax.jvp(energy, (none,), (jnp.ones_like(green),))[1]

        length = 1 + green
        along, aside = length * kirchhoff("along"), (1 + held) * kirchhoff("aside")
        mean = (along + aside) / 3
        return jnp.stack([(along - mean) / length, -mean * length * (1 + held)])

    def moments(self, stretch: Array, curvature: Array) -> Moments:
        """Derivatives of the energy per area by A and b.

        A fibre depends on one number, linear in both strains: two derivatives of the law
        are all it takes. The sum over the layers is a reduction on purpose: the compiler
        keeps its result instead of computing the law again for each of its uses.
        """
        weight, lever, square, free = self._layers()

        def slope(green: Array) -> Array:
            return jax.jvp(self._density, (green,), (jnp.ones_like(green),))[1]

        green = (stretch + lever * curvature + free) / square
        first, second = jax.jvp(slope, (green,), (jnp.ones_like(green),))
        first, second = first / square, second / square**2

        def moment(power: Array, derivative: Array) -> Array:
            return jnp.sum(power * derivative, 0)

        ones, squares = weight * lever, weight * lever**2
        return Moments(
            (moment(weight, first), moment(ones, first)),
            (moment(weight, second), moment(ones, second), moment(squares, second)),
        )

    def _layers(self) -> tuple[Array, Array, Array, Array | float]:
        """Weight [m], lever m [m], (1 + Z/R)^2, and the strain at no displacement times it.

        Of the fibres [layer, ...], and as the module says where the membrane has grown.
        """
        rule = gauss_legendre(self.layers, -0.5, 0.5)
        points, weights = (jnp.asarray(x)[:, None, None, None] for x in rule)
        offset = points * self.thickness
        shell = 1 + offset * self.mid_curvature
        weight = weights * self.thickness * shell
        lever = 2 * offset + offset**2 * self.mid_curvature
        if self.growth is None:
            return weight, lever, shell**2, 0.0
        g = self.growth
        own, volume = 2 * g.hoop + g.axial, g.volume
        size = jnp.exp(own)
        curved = size * jnp.expm1(g.radial - g.hoop) * lever * self.mid_curvature
        return volume * weight, volume * lever, size * shell**2, curved - jnp.expm1(own)
