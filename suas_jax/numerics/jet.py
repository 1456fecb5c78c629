"""Second-order expansions of elementwise functions of two inputs.

In plane strain the energy at a quadrature point depends on two numbers. Differentiating
a function of two inputs costs next to nothing, whatever the number of unknowns behind
them; stress and tangent of every law and mechanics come from here.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def staged(rows: Sequence[Float[Array, "*shape"]]) -> list[Float[Array, "*shape"]]:
    """The same arrays, computed once and before anything that uses them.

    XLA merges elementwise operations into the loops that use them and computes shared ones anew
    in each: with dozens of users, time to compile and to run grow manifold. Optimisation
    barriers are removed before that happens. A matrix product it neither looks through nor
    repeats.

    `rows`: a few dozen arrays of the same shape, which are multiplied by the unit matrix; none
    may hold infinities.
    """
    stacked = jnp.stack(jnp.broadcast_arrays(*rows))
    flat = stacked.reshape(len(rows), -1)
    # A matrix that is a constant of the program would be multiplied out, row by row.
    product = jnp.eye(len(rows), dtype=flat.dtype) @ flat
    return list(product.reshape(stacked.shape))


class Jet(NamedTuple):
    """Value, gradient and Hessian of f(x, y), elementwise."""

    value: Float[Array, "*shape"]
    x: Float[Array, "*shape"]
    y: Float[Array, "*shape"]
    xx: Float[Array, "*shape"]
    xy: Float[Array, "*shape"]
    yy: Float[Array, "*shape"]


def second_order(
    fn: Callable[[Array, Array], Array],
    x: Float[Array, "*shape"],
    y: Float[Array, "*shape"],  # second input, of the same shape
    *,
    once: bool = False,
) -> Jet:
    """Expand an elementwise function of two inputs to second order.

    `fn`: function whose output at a point depends on the inputs at that point alone. `once`:
    whether the function takes so many operations that what uses its derivatives must not
    compute them anew, see `staged`.
    Returns the expansion, each entry of the shape of the inputs.
    """
    one = jnp.ones_like(x)

    # What is held is closed over: a tangent of zeros would be multiplied out.
    def along_x(x: Array, y: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda x: fn(x, y), (x,), (one,))

    def along_y(y: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda y: fn(x, y), (y,), (one,))

    (value, f_x), (f_y, f_xy) = jax.jvp(lambda y: along_x(x, y), (y,), (one,))
    _, (_, f_xx) = jax.jvp(lambda x: along_x(x, y), (x,), (one,))
    _, (_, f_yy) = jax.jvp(along_y, (y,), (one,))
    derivatives = [f_x, f_y, f_xx, f_xy, f_yy]
    return Jet(value, *(staged(derivatives) if once else derivatives))
