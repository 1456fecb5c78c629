"""Settings of entry points that may never compute: JAX takes a second and 200 MB to start."""

import os
from collections.abc import Callable

_WAITING: list[Callable[[], None]] = []


def limit_blas() -> None:
    """Give BLAS one thread, unless ``OPENBLAS_NUM_THREADS`` says otherwise."""
    if "OPENBLAS_NUM_THREADS" not in os.environ:
        # NumPy and SciPy have a pool of threads each, which wait for one another longer than
        # matrices as small as ours take: up to thirty times as long, on two busy cores.
        import scipy.linalg  # noqa: F401, loads the one that JAX takes LAPACK from
        from threadpoolctl import threadpool_limits

        threadpool_limits(1, user_api="blas")


def configure_when_computing() -> None:
    """Limit BLAS now, and configure JAX when something first computes (`before_computing`)."""
    limit_blas()
    _WAITING.append(_configure)


def before_computing() -> None:
    """Configure JAX now, where an entry point left that for later.

    What starts JAX in the middle of something that goes without calls this first. Raises
    ValueError as `suas_jax.configure` does.
    """
    while _WAITING:
        _WAITING.pop()()


def _configure() -> None:
    from suas_jax.runtime.settings import configure

    configure()
