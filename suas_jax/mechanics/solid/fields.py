"""Fields of a deformed solid at the nodes of its elements, for figures and files."""

import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import PlaneStrain
from suas_jax.mechanics.solid.element import NODES, modes, quadratic
from suas_jax.mechanics.solid.points import free_strain
from suas_jax.mechanics.solid.shape import Nodes
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.numerics.array_types import StationVector
from suas_jax.skin.prestress import Growth


class Fields(NamedTuple):
    """Values at the nine nodes of every element, elements along the arc first.

    Neighbours don't share nodes here: strains and pressures jump between elements.
    """

    position: Float[Array, "element 9 2"]  # reference position [m]
    displacement: Float[Array, "element 9 2"]  # [m]
    # Lagrange multiplier of incompressibility; where the law's energy is that of the isochoric
    # deformation, the mean Cauchy stress [Pa]
    pressure: Float[Array, "element 9"]
    energy_density: Float[Array, "element 9"]  # strain energy per volume [J/m^3]
    hoop_stretch: Float[Array, "element 9"]  # of the fibre that lies along the arc at rest
    radial_stretch: Float[Array, "element 9"]  # of the fibre across the thickness
    # J over that free of stress, less 1; its moments over an element vanish
    dilatation: Float[Array, "element 9"]


class Material(NamedTuple):
    """The membrane's material at angles."""

    law: AbstractLaw  # its law
    growth: Growth | None  # against its seat; None where it fits
    tangent: Float[Array, "2 *point"]  # along the undeformed section at the angles

    def energy(self, gradient: Float[Array, "2 2 layer *point"]) -> Array:
        """Strain energy per undeformed volume [J/m^3]. `gradient`: of the displacement."""
        swelling = 1.0 if self.growth is None else self.growth.volume
        return swelling * self.law.energy(self.state(gradient))

    def state(self, gradient: Float[Array, "2 2 layer *point"]) -> PlaneStrain:
        """The deformation as the law sees it, see `points`. `gradient`: of the displacement."""
        if self.growth is not None:
            rows = free_strain(self.growth, self.tangent[:, None])
            a = jnp.stack([jnp.stack(jnp.broadcast_arrays(*row)) for row in rows])
            gradient = gradient + a + jnp.einsum("ij...,jk...->ik...", gradient, a)
        return PlaneStrain.from_displacement_gradient(gradient)


def displacement_gradient(
    xi: Array, eta: Array, u: Nodes, x: Nodes
) -> Float[Array, "2 2 layer ..."]:
    """Derivatives of the displacement by position.

    `xi`: local coordinates along the arc, [sample, #element, #lane]. `eta`: local coordinate
    through each layer. `u`: displacements of the nodes. `x`: reference positions of the nodes.
    """
    n, dn = quadratic(xi), quadratic(xi, 1)
    m, dm = quadratic(eta), quadratic(eta, 1)

    def local(values: Nodes) -> tuple[Array, Array]:
        v = values[:, :, :, None]
        along = [dn[a] * m[b] * v[i] for i, (a, b) in enumerate(NODES)]
        across = [n[a] * dm[b] * v[i] for i, (a, b) in enumerate(NODES)]
        return functools.reduce(jnp.add, along), functools.reduce(jnp.add, across)

    (x1, x2), (u1, u2) = local(x), local(u)
    area = x1[0] * x2[1] - x1[1] * x2[0]
    by_x = (u1 * x2[1] - u2 * x1[1]) / area
    by_y = (u2 * x1[0] - u1 * x2[0]) / area
    return jnp.stack([by_x, by_y], 1)


def nodal_fields(solid: Solid, q: StationVector) -> Fields:
    """Evaluate the first lane of a state at the nodes of every element.

    `solid`: the membrane.
    """
    layout = solid.layout
    u, p = layout.gather(q)
    x = layout.corners(solid.stations, solid.middles)
    local = np.array(NODES, float) - 1
    xi, eta = (jnp.asarray(local)[:, i, None, None] for i in range(2))
    gradient = displacement_gradient(xi, eta, u, x)
    start, end = solid.angles[:-1], solid.angles[1:]
    angle = start + (xi + 1) / 2 * (end - start)
    at = solid.section.frame(angle)
    normal, tangent = (v[:, None] for v in (at.normal, at.tangent))
    material, grown = Material(solid.law, solid.growth, at.tangent), solid.growth
    free = (0.0, 0.0, 0.0) if grown is None else (grown.hoop, grown.radial, 3 * grown.axial)

    def stretch(fibre: Array, own: Array | float) -> Array:
        size = jnp.sqrt(jnp.sum((fibre + jnp.sum(gradient * fibre[None], 1)) ** 2, 0))
        return size * jnp.exp(-own)

    table = modes(local[:, 0], local[:, 1])
    pressure = jnp.einsum("na,ajel->jnel", table, p)

    def scalar(values: Array) -> Array:
        return values[..., 0].transpose(2, 0, 1).reshape(-1, len(NODES))

    def vector(values: Array) -> Array:
        components = values[..., 0].transpose(3, 2, 0, 1)
        return components.reshape(-1, len(NODES), 2)

    return Fields(
        vector(x),
        vector(u),
        scalar(pressure),
        scalar(material.energy(gradient)),
        scalar(stretch(tangent, free[0])),
        scalar(stretch(normal, free[1])),
        scalar((1 + material.state(gradient).dilatation) * jnp.exp(-free[2]) - 1),
    )
