"""`suas fit material`. JAX is imported inside the command."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fitting.cli.contract import NO_SOLUTION, Overwrite, bad_input
from fitting.cli.options import (
    Plot,
    check_figures,
    named_bounds,
    named_file,
    named_values,
    quantity_option,
)
from fitting.cli.progress import fitting_spinner
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import say
from suas_jax.files.command import own_output
from suas_jax.files.writing import check_outputs
from suas_jax.runtime.registry import model_names

if TYPE_CHECKING:
    from fitting.material.calibration import Calibration
    from fitting.material.cards.settings import CardSettings
    from fitting.material.experiments.measurements import Dataset


def material(
    data: Annotated[
        list[str],
        typer.Option(
            metavar="MODE=FILE",
            help="Test data (CSV, text, .xlsx): uniaxial, equibiaxial, pure_shear, biaxial, "
            "biaxial_difference, simple_shear, balloon, bulge, volumetric, skin (forces in) or "
            "indentation (a body's travel in). May be repeated.",
        ),
    ],
    law: Annotated[
        str,
        typer.Option(
            help=f"{', '.join(model_names('suas_jax.config.laws'))}; auto compares them."
        ),
    ] = "ogden",
    terms: Annotated[
        int | None, typer.Option(help="Number of terms; of the law polynomial its degree.")
    ] = None,
    residual: Annotated[
        str,
        typer.Option(
            help="relative (with a floor), absolute (all points alike), noise (as stated), "
            "or estimated (from the data)."
        ),
    ] = "relative",
    noise: Annotated[
        str | None,
        typer.Option(help='Standard deviation where files state none: "5 kPa" or "2 %".'),
    ] = None,
    specimen: Annotated[
        str | None,
        typer.Option(help='Sizes where files state none: "width=6 mm,thickness=2 mm".'),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            help="What columns measure where names don't say, by number or name, with a unit "
            'where the file states none: "force=3,extension=5 mm".'
        ),
    ] = None,
    branch: Annotated[
        str, typer.Option(help="Branch of the curve to use: all, or loading.")
    ] = "all",
    cycle: Annotated[
        str,
        typer.Option(help="Loading of one cycle of a cyclic test: first, last, or a number."),
    ] = "all",
    cut_break: Annotated[
        bool, typer.Option("--cut-break", help="Leave out what follows a specimen's failure.")
    ] = False,
    zero: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND",
            help="Find a test's zero with the law: slack (of the specimen), force (of the load "
            "cell) or machine (its stiffness). May be repeated.",
        ),
    ] = None,
    machine_stiffness: Annotated[
        str | None,
        typer.Option(
            help='Stiffness of machine and grips, "2 kN/mm": the travel that they take '
            "themselves is taken off."
        ),
    ] = None,
    thin: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Most readings of a curve; of more, half as many means. 0 keeps all.",
            show_default="500; 10000 with --prony or --mullins",
        ),
    ] = None,
    prony: Annotated[
        str,
        typer.Option(
            help="Relaxation of the stress from tests with times: number of Prony terms, or "
            "auto for as many as the data determine."
        ),
    ] = "0",
    mullins: Annotated[
        bool,
        typer.Option("--mullins", help="Fit softening (Mullins effect) from loading cycles."),
    ] = False,
    bound: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LOW:HIGH", help="Hard bound, SI units: alpha.0=1:3."),
    ] = None,
    starts: Annotated[int, typer.Option(min=1, help="Number of starting points.")] = 64,
    seed: Annotated[int, typer.Option(help="Seed of the starting points.")] = 0,
    sample: Annotated[
        bool, typer.Option("--sample", help="Sample the posterior of the constants (emcee).")
    ] = False,
    walkers: Annotated[int, typer.Option(help="Number of walkers of the sampler, even.")] = 32,
    steps: Annotated[
        int, typer.Option(min=1, help="Largest number of steps; sampling stops when converged.")
    ] = 20_000,
    moves: Annotated[
        str, typer.Option(help="Moves of the sampler: stretch, walk, de or de-snooker.")
    ] = "stretch",
    chain: Annotated[
        Path | None,
        typer.Option(help="HDF5 file that keeps the chain; one that exists is resumed."),
    ] = None,
    arviz: Annotated[
        Path | None, typer.Option(help="Write the samples for ArviZ (netCDF).")
    ] = None,
    corner: Annotated[
        Path | None, typer.Option(help="Write a corner plot (PNG, PDF, SVG).")
    ] = None,
    predictive: Annotated[
        Path | None, typer.Option(help="Write a posterior-predictive plot (PNG, PDF, SVG).")
    ] = None,
    export: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FORMAT=FILE",
            help="Write a material card: abaqus, calculix, ansys, febio, comsol, lsdyna, "
            "felupe or toml. May be repeated.",
        ),
    ] = None,
    card_units: Annotated[
        str, typer.Option(help="Units of the cards: SI or mm-N-MPa (mm, t, s, MPa).")
    ] = "SI",
    card_name: Annotated[
        str, typer.Option(help="Name of the material in the cards.")
    ] = "membrane",
    density: Annotated[
        float | None, typer.Option(help="Density in the cards, kg/m3; lsdyna needs it.")
    ] = None,
    bulk_modulus: Annotated[
        str | None,
        typer.Option(
            help='Bulk modulus in the cards, "1.5 GPa"; volumetric data give it themselves.'
        ),
    ] = None,
    scene: Annotated[
        Path | None,
        typer.Option(
            help="The skin of --data skin or indentation; without such data: compare the "
            "stability window with the stretches of this scene."
        ),
    ] = None,
    up_to: Annotated[
        float | None,
        typer.Option(
            help="Largest stretch of the prediction (and inverse of the "
            "smallest), such as 1.2; without it, those of --scene, or of the data."
        ),
    ] = None,
    plot: Plot = None,
    report_file: Annotated[
        Path | None,
        typer.Option("--report", help="Write a one-page report (HTML, self-contained)."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, SI units.")] = False,
) -> None:
    """Fit a material law to test data, and say what the data leave open.

    Exit status: 0 constants were found, 2 bad input, 3 no constants could be found.
    """
    with bad_input():
        files = (arviz, corner, predictive)
        if any((chain, *files)) and not sample:
            raise ValueError("--chain, --arviz, --corner and --predictive need --sample")
        cards = [named_file(text, "--export", "abaqus=card.inp") for text in export or []]
        settings = _card_settings(cards, card_units, card_name, density, bulk_modulus)
        bounds = dict(named_bounds(text) for text in bound or [])
        outputs = [*files, plot, report_file, *(Path(file) for _, file in cards)]
        check_outputs(outputs, overwrite=overwrite)
        own_output(chain)  # not only when the fit has ended
        check_figures(plot, corner, predictive)
        sets = _data(data, specimen, columns, noise, scene, machine_stiffness)
        modes = {test.mode for test in sets}
        if modes == {"volumetric"} and (cards or sample or scene is not None):
            raise ValueError(
                "--export, --sample and --scene need data of a law beside volumetric ones"
            )
        if "volumetric" in modes and bulk_modulus is not None:
            raise ValueError(
                "--bulk-modulus: the volumetric data give it; leave one of them out"
            )
        if sample and "indentation" in modes:
            raise ValueError(
                "--sample: an indentation curve takes too long to solve for as many samples; "
                "its intervals are those of the fit"
            )
        # Where a skin is the test, the scene is its specimen.
        scene = None if modes & {"skin", "indentation"} else scene
        with fitting_spinner() as show:
            from suas_jax.runtime.settings import configure

            configure()
            from fitting.material.calibration import Calibration, calibrate
            from fitting.material.fit.search import NoFit

            try:
                found = calibrate(
                    sets,
                    law,
                    terms,
                    progress=show,
                    residual=residual,
                    starts=starts,
                    seed=seed,
                    branch=branch,
                    cycle=cycle,
                    cut_break=cut_break,
                    thin=thin,
                    zero=tuple(zero or ()),
                    bounds=bounds,
                    prony=int(prony) if prony.isdigit() else prony,
                    mullins=mullins,
                    scene=scene,
                    up_to=up_to,
                )
            except NoFit as error:
                message = {"law": law, "status": "no_fit", "message": str(error)}
                found = Calibration(None, None, message)
            fit, report = found.fit, found.report
            if fit is not None and sample:
                from fitting.material.report.posterior_files import sample_and_write
                from fitting.statistics.posterior import Settings

                sampler = Settings(walkers, steps, moves, seed, chain=chain)
                report["posterior"] = sample_and_write(fit, sampler, bounds, show, *files)
            if report["status"] != "no_fit":
                _write(found, cards, settings, plot, report_file)
    if as_json:
        say(json_text(report))
    elif report["status"] != "no_fit":
        from fitting.material.report.description import print_report

        print_report(report, fit)
    if report["status"] == "no_fit":
        say(f"suas: {report['message']}", err=True)
        raise typer.Exit(NO_SOLUTION)


def _card_settings(
    cards: list[tuple[str, str]],
    units: str,
    name: str,
    density: float | None,
    bulk_modulus: str | None,
) -> "CardSettings":
    """What the options say of the cards, each a program and a file."""
    from fitting.material.cards.card import require_program
    from fitting.material.cards.settings import CardSettings

    modulus = None
    if bulk_modulus is not None:
        modulus = quantity_option("--bulk-modulus", bulk_modulus, "stress")
    for program, _ in cards:
        require_program(program)
    return CardSettings(units, name, density, modulus)


def _data(
    data: list[str],
    specimen: str | None,
    columns: str | None,
    noise: str | None,
    scene: Path | None,
    machine_stiffness: str | None,
) -> list["Dataset"]:
    """The tests that the options name."""
    from fitting.material.experiments.datasets import load_dataset
    from fitting.material.experiments.measurements import mode_named

    pairs = [named_file(text) for text in data]
    sizes = named_values(specimen, "--specimen", "width=6 mm,thickness=2 mm")
    named = named_values(columns, "--columns", "force=3,extension=5")
    return [
        load_dataset(mode_named(mode), path, sizes, noise, scene, named, machine_stiffness)
        for mode, path in pairs
    ]


def _write(
    found: "Calibration",
    cards: list[tuple[str, str]],
    settings: "CardSettings",
    plot: Path | None,
    page: Path | None,
) -> None:
    """Write cards, which the report then names, figure and page."""
    fit, bulk, report = found
    if fit is not None and cards:
        from fitting.material.cards.card import write_cards

        if bulk is not None:
            settings = replace(settings, bulk_modulus=bulk.value)
        report["cards"] = write_cards(fit.material(), cards, settings)
        report["warnings"] += [e["message"] for e in report["cards"] if e["message"]]
    if plot is not None:
        from fitting.material.report.plots import plot_material

        plot_material(fit, plot, bulk)
    if page is not None:
        from fitting.material.report.html import write_html

        write_html(fit, report, page, bulk)
