"""Threads of BLAS, which NumPy and SciPy compute with."""

import os


def limit_blas() -> None:
    """Give BLAS one thread, unless ``OPENBLAS_NUM_THREADS`` says otherwise."""
    if "OPENBLAS_NUM_THREADS" not in os.environ:
        # NumPy and SciPy have a pool of threads each, which wait for one another longer than
        # matrices as small as ours take: up to thirty times as long, on two busy cores.
        import scipy.linalg  # noqa: F401, loads the one that JAX takes LAPACK from
        from threadpoolctl import threadpool_limits

        threadpool_limits(1, user_api="blas")
