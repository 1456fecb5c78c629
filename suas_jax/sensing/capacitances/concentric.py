"""Capacitance of a curved wall under a film of even thickness."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.sensing.capacitance import AbstractFilmFormula


class Concentric(AbstractFilmFormula):
    """Coaxial cylinders: eps0 eps_r / (r_w ln(1 + d / r_w)) per area.

    Larger than the parallel plate's by about d / (2 r_w).
    """

    def thickness(
        self, gap: Float[Array, "*shape lane"], wall_curvature: Array
    ) -> Float[Array, "*shape lane"]:
        """r_w ln(1 + d / r_w)."""
        return gap * _relative(jnp.log1p, gap * wall_curvature)

    def gap(
        self, thickness: Float[Array, "*shape lane"], wall_curvature: Array
    ) -> Float[Array, "*shape lane"]:
        """r_w (exp(t / r_w) - 1)."""
        return thickness * _relative(jnp.expm1, thickness * wall_curvature)


def _relative(function: Callable[[Array], Array], x: Array) -> Array:
    """f(x) / x of a function with f(0) = 0 and f'(0) = 1, also where the wall is straight."""
    straight = jnp.abs(x) < 1e-9
    safe = jnp.where(straight, 1.0, x)
    return jnp.where(straight, 1.0, function(safe) / safe)
