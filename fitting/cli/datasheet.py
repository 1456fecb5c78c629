"""`suas datasheet`: what a skin will measure, and how well, before it is made."""

from pathlib import Path
from typing import Annotated

import typer

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.options import AsJson, TrustNetwork, Workers, executor
from fitting.cli.progress import spinner
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import new_console, say
from suas_jax.files.writing import check_outputs, write_text


def datasheet(
    skin: Annotated[Path, typer.Argument(metavar="SKIN", help="Skin file (TOML).")],
    as_json: AsJson = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Page to write (HTML)."),
    ] = None,
    places: Annotated[
        int, typer.Option(min=4, help="How many places along the arc, from clamp to clamp.")
    ] = 17,
    axials: Annotated[
        int, typer.Option(min=4, help="On a pad: how many places along the axis.")
    ] = 7,
    force: Annotated[
        str | None,
        typer.Option(
            metavar="FORCE",
            help='Rated force, such as "10 N"; else 30 % of the smallest first contact.',
        ),
    ] = None,
    workers: Workers = None,
    trust_network: TrustNetwork = False,
    noise: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of a reading, in counts; default: the skin file's."
        ),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write the data sheet of a skin: range, resolution, creep, bandwidth, tolerances.

    Exit status: 0 done, 2 bad input.
    """
    with bad_input():
        from suas_jax.config import load_skin, parse_quantity

        spec = load_skin(skin)
        check_outputs([output], overwrite=overwrite)
        rated = None if force is None else parse_quantity(force, "force")
        with (
            executor(workers, trust_network) as processes,
            spinner("making the data sheet") as show,
        ):
            from suas_jax.runtime.settings import configure

            configure()
            from fitting.datasheet.page import described, html_page
            from fitting.datasheet.sheet import data_sheet

            sheet = data_sheet(spec, (places, axials), noise, rated, show, processes)
            if output is not None:
                write_text(output, html_page(sheet, skin.name))
    if as_json:
        say(json_text({"skin": str(skin), **sheet.report()}))
        return
    from fitting.report.description import print_parts

    print_parts(new_console(), described(sheet, meanings=False))
    if output is not None:
        say(f"{output}: the page", err=True)
