"""`suas fit materials`: many membranes, on this machine or on a cluster."""

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from fitting.cli.contract import bad_input
from fitting.cli.progress import bar


def register(app: typer.Typer) -> None:
    """Add this module's command to the group `suas fit`."""
    app.command("materials")(materials)


def materials(
    jobs: Annotated[Path, typer.Argument(help="TOML file with a table `membrane` for each.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="JSON lines; membranes in it are skipped.")
    ],
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786."),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Local worker processes.")] = 2,
) -> None:
    """Calibrate many membranes on Dask; run it again to go on after an interruption.

    Exit status: 0 every membrane has a line of results (its status says how it went),
    2 bad input.
    """
    with bad_input():
        from fitting.dask_client import dask_client
        from fitting.material.many import calibrate_all, load_jobs

        wanted = load_jobs(jobs)
        stack = contextlib.ExitStack()
        client = stack.enter_context(dask_client(scheduler or workers))
    with stack, bar("calibrating membranes", len(wanted)) as advance:
        added = calibrate_all(wanted, output, client, lambda done, *_: advance(done))
    typer.echo(f"{added} results added to {output}", err=True)
