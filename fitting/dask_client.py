"""Worker processes, on this machine or on a cluster, by Dask."""

import contextlib
import logging
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def dask_client(workers: int | str) -> Iterator[Any]:
    """A client of local worker processes, which end with it, or of a scheduler.

    Workers are started fresh, never forked: a fork of a process that runs JAX hangs.

    Args:
        workers: number of local processes, or a scheduler's address (``tcp://host:8786``).

    Raises:
        ValueError: Dask is not installed.
        OSError: no scheduler answers at this address.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise ValueError('workers need Dask: pip install "suas-jax[cluster]"') from None
    if isinstance(workers, str):
        with Client(workers, timeout="10s") as client:
            yield client
        return
    spawned = {"distributed.worker.multiprocessing-method": "spawn"}
    with (
        dask.config.set(spawned),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=logging.ERROR,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def parse_workers(text: str) -> int | str:
    """What `--workers` means: a number of processes, or an address.

    Raises:
        ValueError: it is neither.
    """
    if text.isascii() and text.isdigit() and int(text) > 0:
        return int(text)
    if "://" in text:
        return text
    raise ValueError(
        f"--workers {text}: a number of processes above zero is needed, or the address of a "
        "Dask scheduler, such as tcp://host:8786"
    )
