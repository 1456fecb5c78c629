"""`suas datasheet`: what a skin will measure, and how well, before it is made."""

from pathlib import Path
from typing import Annotated

from fitting.cli.contract import Overwrite, answer, bad_input, print_report
from fitting.cli.options import (
    AsJson,
    Noise,
    SkinFile,
    TrustNetwork,
    Workers,
    check_files,
    computing,
    option,
    output_option,
    quantity_option,
)
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import write_text


def datasheet(
    skin: SkinFile,
    as_json: AsJson = False,
    output: Annotated[Path | None, output_option("Page to write (HTML).")] = None,
    places: Annotated[
        int, option("How many places along the arc, from clamp to clamp.", min=4)
    ] = 17,
    axials: Annotated[int, option("On a pad: how many places along the axis.", min=4)] = 7,
    force: Annotated[
        str | None,
        option(
            'Rated force, such as "10 N"; else 30 % of the smallest first contact.',
            metavar="FORCE",
        ),
    ] = None,
    workers: Workers = None,
    trust_network: TrustNetwork = False,
    noise: Noise = None,
    overwrite: Overwrite = False,
) -> None:
    """Write the data sheet of a skin: range, resolution, creep, bandwidth, tolerances.

    Exit status: 0 done, 2 bad input.
    """
    with bad_input():
        from suas_jax.config import load_skin

        spec = load_skin(skin)
        check_files(others=[output], overwrite=overwrite)
        rated = None if force is None else quantity_option("--force", force, "force")
        with computing("making the data sheet", workers, trust_network) as (show, processes):
            from fitting.datasheet.page import described, html_page
            from fitting.datasheet.sheet import data_sheet

            sheet = data_sheet(spec, (places, axials), noise, rated, show, processes)
            if output is not None:
                write_text(output, html_page(sheet, skin.name))
    report = {"skin": str(skin), **sheet.report()}
    answer(as_json, report, lambda: print_report(described(sheet, meanings=False)))
    if output is not None and not as_json:
        say(f"{output}: the page", err=True)
