"""The commands of `suas`, put together."""

from importlib.metadata import version
from typing import Annotated

import typer

from fitting.cli import (
    calibrate,
    data,
    example_files,
    export,
    fit_material,
    fit_materials,
    fit_sensor,
    force_range,
    health,
    invert,
    log,
    new,
    simulate,
    solve,
    sweep,
    view,
)
from fitting.cli.examples import add_examples
from suas_jax.acquisition.terminal import say

app = typer.Typer(
    help="Model of a soft underwater artificial skin: loads, oil pressure, sensor output.",
    epilog="Start with: suas examples, then: suas solve configs/scenes/case_b.toml",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
new.register(app)
example_files.register(app)
solve.register(app)
sweep.register(app)
simulate.register(app)
log.register(app)
data.register(app)
health.register(app)
calibrate.register(app)

# `suas fit` holds every command that fits the model to measurements.
fit = typer.Typer(help="Fit the model to measurements.", no_args_is_help=True)
fit_material.register(fit)
fit_sensor.register(fit)
fit_materials.register(fit)
app.add_typer(fit, name="fit")
invert.register(app)
exports = typer.Typer(help="Write logs for other programs.", no_args_is_help=True)
export.register(exports)
app.add_typer(exports, name="export")
force_range.register(app)
view.register(app)
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
