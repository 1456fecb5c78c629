"""Compilation of functions that users make of the model."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import equinox as eqx
import jax

from suas_jax.runtime.compiled import OPTIONS
from suas_jax.runtime.precision import require_float64

P = ParamSpec("P")
R = TypeVar("R")


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of the model, such as `forward`, in half of JAX's usual time.

    As `equinox.filter_jit`: arrays are traced, everything else is static, and one program
    serves all arguments of the same shapes. Apply it last, so to the gradient itself
    (``jit(jax.grad(loss))``): inside another transformation the options that save the time
    have no effect. The function must be pure.

    Raises:
        Float64Error: when called, if float64 is off.
    """
    outermost = eqx.filter_jit(function, compiler_options=OPTIONS)  # type: ignore[call-overload]
    # JAX takes compiler options for the outermost program alone.
    inner = eqx.filter_jit(function)

    @functools.wraps(function)
    def compiled(*args: P.args, **kwargs: P.kwargs) -> R:
        require_float64()
        leaves = jax.tree.leaves((args, kwargs))
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
        found: R = (inner if traced else outermost)(*args, **kwargs)
        return found

    return compiled
