"""`suas range`: where a skin's range of forces ends."""

from pathlib import Path
from typing import Annotated

import typer

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.progress import spinner
from fitting.cli.solve import AsJson, Plot
from fitting.json_text import json_text
from suas_jax.files.writing import check_outputs


def register(app: typer.Typer) -> None:
    """Add this module's command to the program."""
    app.command("range")(find_range)


def find_range(
    skin: Annotated[Path, typer.Argument(metavar="SKIN", help="Skin file (TOML).")],
    as_json: AsJson = False,
    angles: Annotated[
        int, typer.Option(min=1, help="How many angles, from clamp to clamp.")
    ] = 17,
    noise: Annotated[
        float | None,
        typer.Option(help="Standard deviation of a reading, in counts; else the skin file's."),
    ] = None,
    plot: Plot = None,
    overwrite: Overwrite = False,
) -> None:
    """Find where loads reach the wall, and where a force can no longer be told.

    Exit status: 0 done, 2 bad input.
    """
    with bad_input():
        from suas_jax.config import load_skin

        spec = load_skin(skin)
        if plot is not None:
            from suas_jax.figures.style import check_figure_file

            check_figure_file(plot)
        check_outputs([plot], overwrite=overwrite)
        with spinner("finding the range") as show:
            from suas_jax.runtime.settings import configure

            configure()
            from fitting.force_range.bound import force_range

            found = force_range(spec, angles, noise, show)
            if plot is not None:
                from fitting.force_range.figure import plot_range

                plot_range(found, plot)
    if as_json:
        typer.echo(json_text(found.report()))
        return
    from rich.console import Console
    from rich.table import Table

    console = Console(markup=False)  # which would swallow the units in brackets
    table = Table(
        "angle [deg]",
        "first contact [N]",
        "oil [kPa]",
        "told from [N]",
        "told to [N]",
        "a taxel saturates at [N]",
    )
    for row in found.report()["angles"]:
        contact = row["first_contact"] or {"force_N": None, "oil_pressure_Pa": None}
        pressure = contact["oil_pressure_Pa"]
        table.add_row(
            f"{row['angle_deg']:.1f}",
            _shown(contact["force_N"]),
            _shown(None if pressure is None else 1e-3 * pressure),
            _shown(row["smallest_force_told_N"]),
            _shown(row["largest_force_told_N"]),
            _shown(row["saturation_force_N"]),
        )
    console.print(table)


def _shown(value: float | None) -> str:
    return "–" if value is None or value != value else f"{value:.4g}"
