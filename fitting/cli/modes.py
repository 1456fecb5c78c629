"""`suas modes`: natural modes of a skin. JAX is imported inside the command."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fitting.cli.contract import NO_SOLUTION, Overwrite, bad_input
from fitting.cli.options import AsJson, Plot, check_figures, material_note
from fitting.cli.progress import spinner
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import new_console, say
from suas_jax.files.writing import check_outputs

if TYPE_CHECKING:
    from suas_jax.dynamics.modes import Modes


def modes(
    scene: Annotated[
        Path, typer.Argument(metavar="SKIN|SCENE", help="Skin or scene file (TOML).")
    ],
    count: Annotated[int, typer.Option(min=1, help="How many modes, the lowest first.")] = 6,
    as_json: AsJson = False,
    plot: Plot = None,
    overwrite: Overwrite = False,
) -> None:
    """Find natural modes about rest, or about the state that a scene's loads hold.

    Exit status: 0 done, 2 bad input, 3 no stable state found.
    """
    with bad_input():
        from suas_jax.config import load_scene

        spec = load_scene(scene)
        check_figures(plot)
        check_outputs([plot], overwrite=overwrite)
        with spinner("finding modes"):
            from suas_jax.runtime.settings import configure

            configure()
            from suas_jax.dynamics.modes import modes as find

            found = find(spec, count)
            if plot is not None and found.modes:
                from suas_jax.figures.modes import plot_modes

                plot_modes(found, plot)
    note = material_note(spec)
    if as_json:
        say(json_text(found.report() | note))
    else:
        _print_modes(found)
    if found.status != "converged":
        raise typer.Exit(NO_SOLUTION)


def _print_modes(found: "Modes") -> None:
    from rich.table import Table

    console = new_console(markup=False)  # which would swallow the units in brackets
    if found.bandwidth is None:
        console.print(f"{found.status}: {found.message}")
        return
    table = Table(
        "mode",
        "undamped [Hz]",
        "damping ratio",
        "swings at [Hz]",
        "fades in [s]",
        "film's share",
    )
    for number, mode in enumerate(found.modes, 1):
        swings = mode["frequency_Hz"]
        table.add_row(
            str(number),
            f"{mode['undamped_Hz']:.4g}",
            f"{mode['damping_ratio']:.3g}",
            "overdamped" if swings is None else f"{swings:.4g}",
            "never" if mode["time_s"] is None else f"{mode['time_s']:.3g}",
            f"{mode['film_share']:.1%}",
        )
    console.print(table)
    console.print(
        f"Statics is right to 1 % below {found.bandwidth:.3g} Hz, whatever the load: a cycle "
        f"takes {1 / found.bandwidth:.3g} s there."
    )
