"""Settings of entry points that may never compute: JAX takes a second and 200 MB to start."""

from collections.abc import Callable

from suas_jax.runtime.blas import limit_blas

_WAITING: list[Callable[[], None]] = []


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
