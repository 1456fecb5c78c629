"""The commands of `suas`, put together."""

from importlib.metadata import version
from typing import Annotated

import typer

from fitting.cli import (
    calibrate,
    data,
    datasheet,
    design,
    export,
    fit_material,
    fit_materials,
    fit_sensor,
    force_range,
    health,
    invert,
    log,
    modes,
    new,
    simulate,
    solve,
    sweep,
    tour,
    view,
    zero,
)
from fitting.cli.examples import add_examples
from suas_jax.acquisition.terminal import say

app = typer.Typer(
    help="Model of a soft underwater artificial skin: loads, oil pressure, sensor output.",
    epilog="Start with: suas tour",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
new_files = typer.Typer(help="Write a commented file to start from.", no_args_is_help=True)
new_files.command("skin")(new.skin)
new_files.command("scene")(new.scene)
app.add_typer(new_files, name="new")
app.command("tour")(tour.tour)
app.command("examples")(new.examples)
app.command("solve")(solve.solve)
app.command("sweep")(sweep.sweep)
app.command("modes")(modes.modes)
app.command("simulate")(simulate.simulate)
app.command("convert")(simulate.convert)
app.command("log")(log.log)
app.command("baseline")(log.baseline)
app.command("data")(data.data)
app.command("health")(health.health)
app.command("calibrate")(calibrate.calibrate)
# `suas fit` holds every command that fits the model to measurements.
fit = typer.Typer(help="Fit the model to measurements.", no_args_is_help=True)
fit.command("material")(fit_material.material)
fit.command("sensor")(fit_sensor.sensor)
fit.command("materials")(fit_materials.materials)
app.add_typer(fit, name="fit")
app.command("zero")(zero.zero)
app.command("invert")(invert.invert)
exports = typer.Typer(help="Convert logs for other programs.", no_args_is_help=True)
exports.command("mcap")(export.mcap)
app.add_typer(exports, name="export")
app.command("range")(force_range.find_range)
app.command("datasheet")(datasheet.datasheet)
app.command("design")(design.design)
app.command("view")(view.view)
add_examples(app)


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"suas_jax {version('suas-jax')}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    show_version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    from suas_jax.files.command import command_files

    context.with_resource(command_files())
