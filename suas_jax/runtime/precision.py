"""Double precision, without which the model is not computed."""

import jax.numpy as jnp


class Float64Error(RuntimeError):
    """JAX computes in single precision, which is not enough to find an equilibrium."""


def require_float64() -> None:
    """Refuse to compute in single precision, JAX's own default.

    Raises Float64Error: float64 is off.
    """
    if jnp.result_type(float) != jnp.float64:
        raise Float64Error(
            "suas_jax computes in float64, which is off: call suas_jax.configure() first"
        )
