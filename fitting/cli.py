"""The console script `suas`."""

from importlib.metadata import version
from typing import Annotated

import typer

from fitting.inverse_load import cli as cli_invert
from fitting.material import cli as cli_material
from fitting.material import cli_many
from fitting.sensor import cli as cli_sensor
from suas_jax import cli as forward
from suas_jax import cli_acquisition as acquisition
from suas_jax import cli_sensing as sensing

app = typer.Typer(
    help="Model of a soft underwater artificial skin: loads, oil pressure, sensor output.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
forward.register(app)
sensing.register(app)
acquisition.register(app)

# `suas fit` holds every command that fits the model to measurements.
fit = typer.Typer(help="Fit the model to measurements.", no_args_is_help=True)
cli_material.register(fit)
cli_sensor.register(fit)
cli_many.register(fit)
app.add_typer(fit, name="fit")
cli_invert.register(app)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"suas_jax {version('suas-jax')}")
        raise typer.Exit


@app.callback()
def _options(
    show_version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line."""
    app()
