"""What the pad's thin shell leaves out, as energy: the source of its modelling error.

Normals that stay normal forbid transverse shear. With the moments M of the shell and the
transverse force Q = div M it stores, in a membrane of shear modulus G and thickness t::

    E = integral of A |Q|^2 / (G t) dA

with A = 0.525, fitted to the solid in plane strain. To first order the solution of the
potential less E is one more substitution with the tangent at hand. The field of a patch
itself, and how a clamp holds a face, are not part of it.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.pad.fibres import Layers, energy_density
from suas_jax.mechanics.pad.mid_surface import Surface, Vector

_SHEAR = 0.525

Moments = Float[Array, "3 point"]


def moments(law: AbstractLaw, s: Surface, fibres: Layers) -> Moments:
    """Derivatives of the energy density by h_11 h_22 h_12: M_11, M_22 and 2 M_12 [N].

    Args:
        law: the material.
        s: the mid-surface at points.
        fibres: through the thickness.
    """

    def energy(bending: Vector) -> Array:
        return jnp.sum(energy_density(law, s._replace(bending=bending), fibres))

    return jnp.stack(jax.grad(energy)(s.bending))


def shear_energy_density(
    by_arc: Float[Array, "3 *point"], by_axial: Float[Array, "3 *point"], stiffness: Array
) -> Float[Array, "*point"]:
    """Energy of transverse shear per area of the mid-surface [J/m^2].

    Args:
        by_arc: derivatives of the moments by arc length [N/m].
        by_axial: along the axis.
        stiffness: G t [N/m].
    """
    along = by_arc[0] + by_axial[2] / 2
    across = by_arc[2] / 2 + by_axial[1]
    return _SHEAR * (along**2 + across**2) / stiffness
