"""Options that commands have for pads in three dimensions."""

from typing import Annotated

import typer

from fitting.cli.quantity_option import quantity_of

Workers = Annotated[
    str | None,
    typer.Option(
        metavar="N|ADDRESS",
        help="On a pad: solve a new skin's table on N local processes, or on those of a Dask "
        "scheduler such as tcp://host:8786.",
    ),
]


def pad_settings(
    diameter: str | None, pressure_noise: str | None, workers: str | None
) -> dict[str, float | int | str | None]:
    """What options say of contacts, pressure and tables, in SI units; those given alone.

    Args:
        diameter: a length, or "free", which is None in the result.
        pressure_noise: a pressure.
        workers: see `parse_workers`.

    Raises:
        ValueError: an option can't be understood.
    """
    from fitting.dask_client import parse_workers

    settings: dict[str, float | int | str | None] = {}
    if workers is not None:
        settings["workers"] = parse_workers(workers)
    if diameter is not None:
        free = diameter == "free"
        settings["diameter"] = None if free else quantity_of("--diameter", diameter, "length")
    if pressure_noise is not None:
        noise = quantity_of("--pressure-noise", pressure_noise, "pressure")
        settings["pressure_noise"] = noise
    return settings
