"""The options of commands that give work to other processes."""

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from suas_jax.acquisition.terminal import say

if TYPE_CHECKING:
    from concurrent.futures import Executor

_MOST = 1024
_WHAT = "N processes, or the Dask scheduler at tls://host:port"
Workers = Annotated[
    str | None,
    typer.Option(metavar="N|ADDRESS", help=f"On a pad: solve a new skin's table on {_WHAT}."),
]
ManyWorkers = Annotated[
    str, typer.Option("--workers", metavar="N|ADDRESS", help=f"Calibrate on {_WHAT}.")
]
TrustNetwork = Annotated[
    bool,
    typer.Option(
        "--trust-network",
        help="Also allow a scheduler at tcp://: anyone who can reach its port can run code as "
        "this user.",
    ),
]


@contextlib.contextmanager
def executor(workers: str | None, trust_network: bool) -> "Iterator[Executor | None]":
    """What `--workers` names, until the block is left; None where it isn't given.

    Raises:
        ValueError: it is neither a number of processes nor an address that is allowed.
        OSError: no scheduler answers at the address.
    """
    if workers is None:
        yield None
        return
    from fitting.workers import LocalWorkers, scheduler_workers

    found: contextlib.AbstractContextManager[Executor]
    if "://" in workers:
        found = scheduler_workers(workers, trust_network=trust_network)
    elif workers.isascii() and workers.isdigit() and 0 < int(workers) <= _MOST:
        found = LocalWorkers(int(workers), lambda lost: say(f"suas: {lost}", err=True))
    else:
        raise ValueError(
            f"--workers {workers}: a number of processes, 1 to {_MOST}, is needed, or the "
            "address of a Dask scheduler, tls://host:port"
        )
    with found as executor:
        yield executor
