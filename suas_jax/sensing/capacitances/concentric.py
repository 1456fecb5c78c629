"""Capacitance of a curved wall under a film of even thickness."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.sensing.capacitance import AbstractFilmFormula


class Concentric(AbstractFilmFormula):
    """Coaxial cylinders: eps0 eps_r / (r_w ln(1 + d / r_w)) per area.

    Larger than the parallel plate's by about d / (2 r_w).
    """

    def thickness(
        self, gap: Float[Array, "*shape lane"], wall_radius: Lanes
    ) -> Float[Array, "*shape lane"]:
        """r_w ln(1 + d / r_w)."""
        return wall_radius * jnp.log1p(gap / wall_radius)

    def gap(
        self, thickness: Float[Array, "*shape lane"], wall_radius: Lanes
    ) -> Float[Array, "*shape lane"]:
        """r_w (exp(t / r_w) - 1)."""
        return wall_radius * jnp.expm1(thickness / wall_radius)
