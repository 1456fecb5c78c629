"""Settings of entry points that may never compute: JAX takes a second and 200 MB to start."""

from suas_jax.runtime.blas import limit_blas


class _Asked:
    """Whether JAX is still to be configured."""

    waiting = False


def configure_when_computing() -> None:
    """Limit BLAS now, and configure JAX when something first computes (`before_computing`)."""
    limit_blas()
    _Asked.waiting = True


def before_computing() -> None:
    """Configure JAX now, where an entry point left that for later.

    What starts JAX in the middle of something that goes without calls this first. Raises
    ValueError as `suas_jax.configure` does.
    """
    if _Asked.waiting:
        _Asked.waiting = False
        from suas_jax.runtime.settings import configure

        configure()
