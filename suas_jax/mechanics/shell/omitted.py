"""What the lumped shell leaves out, as energy: the source of its modelling error.

Normals that stay normal forbid transverse shear, and a clamp holds a line where it should
hold a face. Both are corrections of the energy by the shell's own resultants: normal force
N, moment M and transverse force Q = dM/ds, per width, of a membrane of shear modulus G::

    E = integral of A Q^2 / (G t) ds
        + sum over clamps of (B M^2 / (G t^2) + C N M / (G t) + D N Q / G)

    relaxed potential = potential - E

To first order the solution of the relaxed problem is one more substitution with the
tangent at hand, K dq = dE/dq: how far the shell is from the continuum, for all quantities
of interest at once. A line load's own field comes on top of it: what it does to the
section beneath shifts the mid-surface by -e f / G per force per width f, whatever the rest.

A is near 3/5 (shear correction 5/6); all five constants are those of linear elasticity of
an incompressible strip, hence the same for every membrane. They were found by least
squares against the solid over 50 random scenes; ``python -m benchmarks.error_estimate``
checks what they are good for on others.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.quadrature import gauss_legendre

SHEAR = 0.525
"""Constant A of the energy of transverse shear."""
_CLAMP_MOMENT, _CLAMP_NORMAL_MOMENT, _CLAMP_NORMAL_SHEAR = -0.071, 0.081, 0.397
INDENTATION = 0.637
"""Constant e of a line load's own field."""


class Resultants(NamedTuple):
    """Normal force [N/m] and moment [N] per width, at points of every element."""

    normal: Float[Array, "point element lane"]
    moment: Float[Array, "point element lane"]


def sample_points() -> Float[np.ndarray, " 4"]:
    """Local coordinates where resultants are needed: both ends, and two Gauss points."""
    return np.array([0.0, *gauss_legendre(2)[0], 1.0])


def omitted_energy(
    at: Resultants, lengths: Float[Array, "element #lane"], thickness: Lanes, modulus: Lanes
) -> Lanes:
    """The energy E per width [J/m].

    Args:
        at: resultants at the `sample_points`.
        lengths: of the elements [m].
        thickness: of the membrane [m].
        modulus: small-strain shear modulus [Pa].
    """
    _, first, second, _ = sample_points()
    shear = (at.moment[2] - at.moment[1]) / ((second - first) * lengths)
    total = SHEAR * jnp.sum(lengths * shear**2, 0) / (modulus * thickness)
    # Outwards along the arc Q changes its sign with the side of the clamp.
    for point, element, side in ((0, 0, 1.0), (3, -1, -1.0)):
        n, m = at.normal[point, element], at.moment[point, element]
        total = (
            total
            + (
                _CLAMP_MOMENT * (m / thickness) ** 2
                + _CLAMP_NORMAL_MOMENT * n * m / thickness
                + _CLAMP_NORMAL_SHEAR * side * n * shear[element]
            )
            / modulus
        )
    return total
