"""Where the pad's elements go, and the points that its loads act at.

Elements gather at clamped edges and around loads. A plan is made once from plain numbers;
breakpoints are fractions of the pad's extent and stay where they are when loads move.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.quadrature import gauss_legendre
from suas_jax.skin.pad_loads import PadLoad, PadLoadPoints


def graded(knots, sizes, elements=None, scale=1.0):
    """Breakpoints between knots with element sizes given at them."""
    out = [knots[0]]
    for a, b, sa, sb in zip(knots[:-1], knots[1:], sizes[:-1], sizes[1:], strict=True):
        s = np.linspace(0, 1, 401)
        density = (b - a) * scale / (sa ** (1 - s) * sb**s)
        total = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 / 400)])
        n = max(1, int(round(total[-1])))
        out += list(a + (b - a) * np.interp(np.arange(1, n + 1) / n, total / total[-1], s))
    return np.array(out)


def clipped(breaks, low, high, windows, gauss=2):
    """Points and weights of an interval, element by element."""
    first = jnp.searchsorted(jax.lax.stop_gradient(breaks), jax.lax.stop_gradient(low), side="right") - 1
    first = jnp.clip(first, 0, len(breaks) - 1 - windows)
    index = first + np.arange(windows)
    a, b = jnp.clip(breaks[index], low, high), jnp.clip(breaks[index + 1], low, high)
    x, w = gauss_legendre(gauss)
    return (a[:, None] + (b - a)[:, None] * x).reshape(-1), ((b - a)[:, None] * w).reshape(-1)
