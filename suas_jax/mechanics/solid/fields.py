"""Fields of a deformed solid at the nodes of its elements, for figures and files."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.solid.element import NODES, modes
from suas_jax.mechanics.solid.shape import Material, displacement_gradient
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.numerics.array_types import StationVector


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


def nodal_fields(solid: Solid, q: StationVector) -> Fields:
    """Evaluate the first lane of a state at the nodes of every element.

    `solid`: the membrane.
    """
    layout = solid.layout
    u, p = layout.gather(q)
    x = layout.corners(solid.stations, solid.middles)
    local = np.array(NODES, float) - 1
    xi, eta = (jnp.asarray(local)[:, i, None, None] for i in range(2))
    gradient, _ = displacement_gradient(xi, eta, u, x)
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
