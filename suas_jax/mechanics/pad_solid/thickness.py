"""Polynomials through the thickness: displacement of one degree, pressure of one less.

The displacement is interpolated between values at Gauss-Lobatto points, of which the first lies
on the inner face and the last on the outer one; the pressure is a sum of Legendre polynomials.
"""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Legendre, Polynomial

from suas_jax.numerics.polynomials import gauss_legendre


class Thickness(NamedTuple):
    """Tables at the quadrature points through the thickness, eta from -1 to 1."""

    eta: Float[np.ndarray, " point"]  # the points
    weights: Float[np.ndarray, " point"]  # of the points
    shapes: Float[np.ndarray, "value point"]  # of the displacement [value, point]
    slopes: Float[np.ndarray, "value point"]  # their derivatives by eta
    modes: Float[np.ndarray, "mode point"]  # of the pressure [mode, point]


def levels(degree: int) -> Float[np.ndarray, " value"]:
    """Where the displacement's values are: eta of the Gauss-Lobatto points."""
    inside = Legendre.basis(degree).deriv().roots()
    return np.concatenate([[-1.0], np.sort(np.real(inside)), [1.0]])


def _polynomials(degree: int) -> list[Polynomial]:
    at = levels(degree)
    others = [np.delete(at, k) for k in range(degree + 1)]
    return [
        Polynomial.fromroots(rest) / np.prod(own - rest)
        for own, rest in zip(at, others, strict=True)
    ]


def shapes_at(
    degree: int, eta: Float[np.ndarray, " point"], derivative: int = 0
) -> Float[np.ndarray, "value point"]:
    """The displacement's polynomials, or their derivatives, at places.

    `eta`: places. `derivative`: order of differentiation.
    """
    return np.stack([p.deriv(derivative)(eta) for p in _polynomials(degree)])


@functools.cache
def thickness(degree: int, points: int) -> Thickness:
    """Tables for a degree of the displacement.

    `degree`: of the displacement. `points`: of the quadrature.
    """
    eta, weights = gauss_legendre(points, -1.0, 1.0)
    modes = np.stack([Legendre.basis(k)(eta) for k in range(degree)])
    return Thickness(eta, weights, shapes_at(degree, eta), shapes_at(degree, eta, 1), modes)
