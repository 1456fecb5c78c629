"""`suas design`: the skin for a data sheet."""

from pathlib import Path
from typing import Annotated

import typer

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.options import AsJson
from fitting.cli.progress import spinner
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import new_console, say
from suas_jax.files.writing import check_outputs, write_text


def design(
    want: Annotated[
        Path,
        typer.Argument(metavar="WANT", help="Goals and limits (TOML), see docs/datasheet.md."),
    ],
    as_json: AsJson = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Skin file to write.")
    ] = None,
    starts: Annotated[
        int | None,
        typer.Option(min=1, help="Number of starts of the search; default: the file's."),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Find dimensions and materials that make a figure of the data sheet as good as it can be.

    Limits on other figures hold at every place. Sections only; derivatives are exact.

    Exit status: 0 done, 2 bad input, or no design keeps the limits.
    """
    with bad_input():
        import dataclasses

        from fitting.design.want import load_want

        wanted = load_want(want)
        if starts is not None:
            wanted = dataclasses.replace(wanted, starts=starts)
        check_outputs([output], overwrite=overwrite)
        with spinner("designing") as show:
            from suas_jax.runtime.settings import configure

            configure()
            from fitting.design.design import design_skin
            from fitting.design.skin_file import designed_skin

            designed = design_skin(wanted, show)
            if output is not None:
                write_text(output, designed_skin(wanted, designed.found.x, output))
    if as_json:
        say(json_text(designed.report()))
        return
    from fitting.report.description import print_parts

    print_parts(new_console(), designed.described())
    if output is not None:
        say(f"{output}: suas datasheet {output} -o sheet.html", err=True)
