"""`suas fit material`. JAX is imported inside the command."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fitting.cli.contract import NO_SOLUTION, Overwrite, bad_input
from fitting.cli.options import (
    Chain,
    JsonInSI,
    Plot,
    Sample,
    Steps,
    Walkers,
    check_files,
    named_bounds,
    named_file,
    named_values,
    option,
    quantity_option,
)
from fitting.cli.progress import fitting_spinner
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import say
from suas_jax.files.command import own_output
from suas_jax.runtime.registry import model_names

if TYPE_CHECKING:
    from fitting.material.calibration import Calibration
    from fitting.material.cards.settings import CardSettings
    from fitting.material.experiments.measurements import Dataset


def material(
    data: Annotated[
        list[str],
        option(
            "Test data (CSV, text, .xlsx): uniaxial, equibiaxial, pure_shear, biaxial, "
            "biaxial_difference, simple_shear, balloon, bulge, volumetric, skin (forces in) or "
            "indentation (a body's travel in). May be repeated.",
            metavar="MODE=FILE",
        ),
    ],
    law: Annotated[
        str, option(f"{', '.join(model_names('suas_jax.config.laws'))}; auto compares them.")
    ] = "ogden",
    terms: Annotated[
        int | None, option("Number of terms; of the law polynomial its degree.")
    ] = None,
    residual: Annotated[
        str,
        option(
            "relative (with a floor), absolute (all points alike), noise (as stated), "
            "or estimated (from the data)."
        ),
    ] = "relative",
    noise: Annotated[
        str | None, option('Standard deviation where files state none: "5 kPa" or "2 %".')
    ] = None,
    specimen: Annotated[
        str | None, option('Sizes where files state none: "width=6 mm,thickness=2 mm".')
    ] = None,
    columns: Annotated[
        str | None,
        option(
            "What columns measure where names don't say, by number or name, with a unit "
            'where the file states none: "force=3,extension=5 mm".'
        ),
    ] = None,
    branch: Annotated[str, option("Branch of the curve to use: all, or loading.")] = "all",
    cycle: Annotated[
        str, option("Loading of one cycle of a cyclic test: first, last, or a number.")
    ] = "all",
    cut_break: Annotated[
        bool, option("Leave out what follows a specimen's failure.", "--cut-break")
    ] = False,
    cut_spikes: Annotated[
        bool, option("Leave out readings that stand out from their neighbours.", "--cut-spikes")
    ] = False,
    zero: Annotated[
        list[str] | None,
        option(
            "Find a test's zero with the law: slack (of the specimen), force (of the load "
            "cell) or machine (its stiffness). May be repeated.",
            metavar="KIND",
        ),
    ] = None,
    machine_stiffness: Annotated[
        str | None,
        option(
            'Stiffness of machine and grips, "2 kN/mm": the travel that they take '
            "themselves is taken off."
        ),
    ] = None,
    thin: Annotated[
        int | None,
        option(
            "Largest number of readings of a curve; a longer one becomes half as many means. "
            "0 keeps all.",
            min=0,
            show_default="500; 10000 with --prony or --mullins",
        ),
    ] = None,
    prony: Annotated[
        str,
        option(
            "Relaxation of the stress from tests with times: number of Prony terms, or "
            "auto for as many as the data determine."
        ),
    ] = "0",
    mullins: Annotated[
        bool, option("Fit softening (Mullins effect) from loading cycles.", "--mullins")
    ] = False,
    bound: Annotated[
        list[str] | None, option("Hard bound, SI units: alpha.0=1:3.", metavar="NAME=LOW:HIGH")
    ] = None,
    starts: Annotated[int, option("Number of starting points.", min=1)] = 64,
    seed: Annotated[int, option("Seed of the starting points.")] = 0,
    sample: Sample = False,
    walkers: Walkers = 32,
    steps: Steps = 20_000,
    moves: Annotated[
        str, option("Moves of the sampler: stretch, walk, de or de-snooker.")
    ] = "stretch",
    chain: Chain = None,
    arviz: Annotated[Path | None, option("Write the samples for ArviZ (netCDF).")] = None,
    corner: Annotated[Path | None, option("Write a corner plot (PNG, PDF, SVG).")] = None,
    export: Annotated[
        list[str] | None,
        option(
            "Write a material card: abaqus, calculix, ansys, febio, comsol, lsdyna, "
            "felupe or toml. May be repeated.",
            metavar="FORMAT=FILE",
        ),
    ] = None,
    card_units: Annotated[
        str, option("Units of the cards: SI or mm-N-MPa (mm, t, s, MPa).")
    ] = "SI",
    card_name: Annotated[str, option("Name of the material in the cards.")] = "membrane",
    density: Annotated[
        float | None, option("Density in the cards, kg/m3; lsdyna needs it.")
    ] = None,
    bulk_modulus: Annotated[
        str | None,
        option('Bulk modulus in the cards, "1.5 GPa"; volumetric data give it themselves.'),
    ] = None,
    scene: Annotated[
        Path | None,
        option(
            "The skin of --data skin or indentation; without such data: compare the "
            "stability window with the stretches of this scene."
        ),
    ] = None,
    up_to: Annotated[
        float | None,
        option(
            "Largest stretch of the prediction (and inverse of the "
            "smallest), such as 1.2; without it, those of --scene, or of the data."
        ),
    ] = None,
    plot: Plot = None,
    report_file: Annotated[
        Path | None, option("Write a one-page report (HTML, self-contained).", "--report")
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonInSI = False,
) -> None:
    """Fit a material law to test data, and say what the data leave open.

    Exit status: 0 constants were found, 2 bad input, 3 no constants could be found.
    """
    with bad_input():
        if (chain or arviz or corner) and not sample:
            raise ValueError("--chain, --arviz and --corner need --sample")
        cards = [named_file(text, "--export", "abaqus=card.inp") for text in export or []]
        settings = _card_settings(cards, card_units, card_name, density, bulk_modulus)
        bounds = dict(named_bounds(text) for text in bound or [])
        others = [arviz, report_file, *(Path(file) for _, file in cards)]
        check_files(plot, corner, others=others, overwrite=overwrite)
        own_output(chain)  # not only when the fit has ended
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
                    cut_spikes=cut_spikes,
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
                report["posterior"] = sample_and_write(
                    fit, sampler, bounds, show, arviz, corner
                )
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
