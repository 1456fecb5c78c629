"""Isotropic functions of a symmetric 3 × 3 matrix, differentiable where eigenvalues meet.

The derivative of an eigenvector is singular at a repeated eigenvalue, that of an
isotropic function is not. The rules here differentiate the function, never the vectors:

    d tr f(A) = f′(A) : dA,        d f(A) = V (Γ ∘ (Vᵀ dA V)) Vᵀ,

with A = V diag(a) Vᵀ and Γ the Loewner matrix of divided differences f[a_i, a_j]
(Daleckii and Krein). A trace function therefore has exact first and second derivatives
everywhere. A third derivative goes through the eigenvectors: it is right where the
eigenvalues differ and not a number where they meet.

Functions must be analytic for arguments above −1, which is where 1 + a is positive.
"""

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

Symmetric: TypeAlias = Float[Array, "3 3 *batch"]
Eigenvalues: TypeAlias = Float[Array, "3 *batch"]
Parameters: TypeAlias = tuple[Array, ...]
ScalarFunction: TypeAlias = Callable[[Parameters, Array], Array]

# Below this ratio of 1 + a to 1 + b a divided difference is the mean of the derivative,
# by a quadrature that is exact to rounding there; above it the quotient itself is.
_NEAR = 1.5
_SWEEPS = 5  # of rotations: convergence is quadratic at least
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(8)
_NODES, _WEIGHTS = 0.5 * (1.0 + _GAUSS_NODES), 0.5 * _GAUSS_WEIGHTS


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def trace_function(
    fn: ScalarFunction, parameters: Parameters, matrix: Symmetric
) -> Float[Array, "*batch"]:
    """Return tr f(A) = Σ f(a_i) over the eigenvalues of A.

    `fn`: f(parameters, a), elementwise, analytic for a > −1. `parameters`: arrays of shape
    [*batch] on which f depends; differentiable. `matrix`: A, symmetric, shape [3, 3, *batch].
    Returns an array [*batch], with exact first and second derivatives in A and derivatives of
    every order in the parameters.
    """
    eigenvalues, _ = _decompose(matrix)
    return jnp.sum(fn(parameters, eigenvalues), axis=0)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def matrix_function(
    fn: ScalarFunction, parameters: Parameters, matrix: Symmetric
) -> Float[Array, "3 3 *batch"]:
    """Return f(A) = V diag(f(a)) Vᵀ.

    `fn`: f(parameters, a), elementwise, analytic for a > −1. `parameters`: arrays of shape
    [*batch] on which f depends; differentiable. `matrix`: A, symmetric, shape [3, 3, *batch].
    Returns an array [3, 3, *batch], with an exact first derivative in A.
    """
    eigenvalues, vectors = _decompose(matrix)
    return jnp.einsum("ik...,k...,jk...->ij...", vectors, fn(parameters, eigenvalues), vectors)


def _trace_rule(fn: ScalarFunction, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    parameters, matrix = primals
    d_parameters, d_matrix = tangents
    tangent = jnp.zeros(matrix.shape[2:], matrix.dtype)
    if not isinstance(d_matrix, SymbolicZero):
        slope = matrix_function(_derivative(fn), parameters, matrix)
        tangent = tangent + jnp.sum(slope * d_matrix, axis=(0, 1))
    for k, change in enumerate(d_parameters):
        if not isinstance(change, SymbolicZero):
            by_parameter = trace_function(_by_parameter(fn, k), parameters, matrix)
            tangent = tangent + by_parameter * change
    return trace_function(fn, parameters, matrix), tangent


def _matrix_rule(fn: ScalarFunction, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    parameters, matrix = primals
    d_parameters, d_matrix = tangents
    tangent = jnp.zeros_like(matrix)
    if not isinstance(d_matrix, SymbolicZero):
        eigenvalues, vectors = _decompose(matrix)
        in_axes = jnp.einsum("ki...,kl...,lj...->ij...", vectors, d_matrix, vectors)
        scaled = _loewner(fn, parameters, eigenvalues) * in_axes
        tangent = tangent + jnp.einsum("ik...,kl...,jl...->ij...", vectors, scaled, vectors)
    for k, change in enumerate(d_parameters):
        if not isinstance(change, SymbolicZero):
            by_parameter = matrix_function(_by_parameter(fn, k), parameters, matrix)
            tangent = tangent + by_parameter * change
    return matrix_function(fn, parameters, matrix), tangent


trace_function.defjvp(_trace_rule, symbolic_zeros=True)
matrix_function.defjvp(_matrix_rule, symbolic_zeros=True)


def _decompose(matrix: Symmetric) -> tuple[Eigenvalues, Float[Array, "3 3 *batch"]]:
    """Eigenvalues [3, *batch] and eigenvectors [component, 3, *batch], by Jacobi's rotations.

    Without LAPACK: compiled programs that call a library can't be kept between runs, and one
    3 x 3 matrix a call is slow.
    """
    unit = jnp.eye(3, dtype=matrix.dtype).reshape(3, 3, *(1,) * (matrix.ndim - 2))
    start = matrix, jnp.broadcast_to(unit, matrix.shape)

    def sweep(_: int, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        a, vectors = carry
        for p, q in ((0, 1), (0, 2), (1, 2)):
            apart, off = a[q, q] - a[p, p], 2 * a[p, q]
            size = jnp.abs(apart) + jnp.sqrt(apart**2 + off**2)
            safe = jnp.where(size > 0, size, 1.0)
            tangent = jnp.where(apart < 0, -off, off) / safe
            cosine = 1 / jnp.sqrt(1 + tangent**2)
            sine = tangent * cosine

            half = _rotated(a, p, q, cosine, sine)
            a = _rotated(jnp.swapaxes(half, 0, 1), p, q, cosine, sine)
            vectors = _rotated(vectors, p, q, cosine, sine)
        return a, vectors

    diagonal, vectors = jax.lax.fori_loop(0, _SWEEPS, sweep, start)
    return jnp.stack([diagonal[k, k] for k in range(3)]), vectors


def _rotated(x: Array, p: int, q: int, cosine: Array, sine: Array) -> Array:
    """Two columns turned into each other."""
    first, second = cosine * x[:, p] - sine * x[:, q], sine * x[:, p] + cosine * x[:, q]
    return x.at[:, p].set(first).at[:, q].set(second)


def _loewner(
    fn: ScalarFunction, parameters: Parameters, eigenvalues: Eigenvalues
) -> Float[Array, "3 3 *batch"]:
    """Divided differences f[a_i, a_j]; on the diagonal the derivative f′(a_i)."""
    first, second = np.array([0, 0, 1]), np.array([1, 2, 2])
    pairs = divided_difference(fn, parameters, eigenvalues[first], eigenvalues[second])
    slopes = _derivative(fn)(parameters, eigenvalues)
    d01, d02, d12 = pairs
    s0, s1, s2 = slopes
    return jnp.stack(
        [jnp.stack([s0, d01, d02]), jnp.stack([d01, s1, d12]), jnp.stack([d02, d12, s2])]
    )


def divided_difference(
    fn: ScalarFunction, parameters: Parameters, a: Float[Array, "..."], b: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return (f(a) − f(b)) / (a − b), and f′(a) where the two meet, to rounding error.

    `fn`: f(parameters, a), elementwise, analytic for a > −1. `a`: first argument, above −1.
    `b`: second argument, above −1.
    """
    near = jnp.maximum(1.0 + a, 1.0 + b) < _NEAR * jnp.minimum(1.0 + a, 1.0 + b)
    # The quotient's untaken branch must stay finite for its derivatives' sake.
    apart = jnp.where(near, 1.0, a - b)
    quotient = (fn(parameters, a) - fn(parameters, b)) / apart
    slope = _derivative(fn)
    # Where the arguments are far apart the mean is not wanted, and b = a keeps it finite.
    end = jnp.where(near, b, a)
    column = (-1, *(1,) * quotient.ndim)
    at = a + jnp.asarray(_NODES).reshape(column) * (end - a)
    mean = jnp.sum(jnp.asarray(_WEIGHTS).reshape(column) * slope(parameters, at), axis=0)
    return jnp.where(near, mean, quotient)


def _derivative(fn: ScalarFunction) -> ScalarFunction:
    """f′, by the argument."""

    def derivative(parameters: Parameters, a: Array) -> Array:
        return jax.jvp(lambda x: fn(parameters, x), (a,), (jnp.ones_like(a),))[1]

    return derivative


def _by_parameter(fn: ScalarFunction, k: int) -> ScalarFunction:
    """∂f/∂p_k."""

    def derivative(parameters: Parameters, a: Array) -> Array:
        def along(p: Array) -> Array:
            return fn((*parameters[:k], p, *parameters[k + 1 :]), a)

        return jax.jvp(along, (parameters[k],), (jnp.ones_like(parameters[k]),))[1]

    return derivative
