"""`suas design`: the skin for a data sheet."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from fitting.cli.contract import Overwrite, answer, bad_input, print_report
from fitting.cli.options import (
    AsJson,
    Plot,
    TrustNetwork,
    Workers,
    argument,
    check_files,
    computing,
    option,
    output_option,
)
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import write_text

if TYPE_CHECKING:
    from fitting.design.choice import Choice
    from fitting.design.design import Design


def design(
    want: Annotated[
        Path, argument("Goals and limits (TOML), see docs/design_skin.md.", metavar="WANT")
    ],
    as_json: AsJson = False,
    output: Annotated[Path | None, output_option("Skin file to write.")] = None,
    plot: Plot = None,
    starts: Annotated[
        int | None, option("Number of starts of the search; default: the file's.", min=1)
    ] = None,
    resume: Annotated[
        Path | None,
        option("File that keeps the searches that have ended; one that exists is resumed."),
    ] = None,
    workers: Workers = None,
    trust_network: TrustNetwork = False,
    overwrite: Overwrite = False,
) -> None:
    """Find dimensions, materials or taxels that make a figure of the data sheet best.

    WANT names a section or a pad. With a table `variables` limits on other figures hold at
    every place; a section takes minutes, a pad half a minute and more for each design that is
    tried. With a table `taxels` the best taxels are kept.

    Exit status: 0 done, 2 bad input, or no design keeps the limits.
    """
    with bad_input():
        import dataclasses

        from fitting.design.want import load_want

        wanted = load_want(want)
        if starts is not None:
            wanted = dataclasses.replace(wanted, starts=starts)
        check_files(plot, others=[output], overwrite=overwrite)
        if resume is not None and wanted.keep is not None:
            raise ValueError(
                "--resume: a table of taxels has no searches to resume; leave it out"
            )
        with computing("designing", workers, trust_network) as (show, processes):
            designed: Choice | Design
            if wanted.keep is not None:
                from fitting.design.choice import choose_taxels
                from fitting.design.design import skin_with_taxels

                designed = choose_taxels(wanted, show, processes)
                text = partial(skin_with_taxels, wanted, designed.kept)
            else:
                from fitting.design.design import design_skin, designed_skin
                from fitting.design.resume import KeptSearches

                kept = None if resume is None else KeptSearches(resume)
                designed = design_skin(wanted, show, processes, kept)
                if kept is not None and kept.note:
                    say(f"suas: {kept.note}", err=True)
                text = partial(designed_skin, wanted, designed.found.x)
            if output is not None:
                write_text(output, text(output))
            if plot is not None:
                from suas_jax.figures.style import written

                written(designed.drawn(), plot)
    answer(as_json, designed.report(), lambda: print_report(designed.described()))
    if output is not None and not as_json:
        say(f"{output}: suas datasheet {output} -o sheet.html", err=True)
