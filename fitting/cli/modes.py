"""`suas modes`: natural modes of a skin. JAX is imported inside the command."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fitting.cli.contract import NO_SOLUTION, Overwrite, answer, bad_input, print_report
from fitting.cli.options import (
    AsJson,
    Plot,
    argument,
    check_files,
    computing,
    material_note,
    option,
)

if TYPE_CHECKING:
    from suas_jax.dynamics.modes import Modes


def modes(
    scene: Annotated[Path, argument("Skin or scene file (TOML).", metavar="SKIN|SCENE")],
    count: Annotated[int, option("How many modes, the lowest first.", min=1)] = 6,
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
        check_files(plot, overwrite=overwrite)
        with computing("finding modes"):
            from suas_jax.dynamics.modes import modes as find

            found = find(spec, count)
            if plot is not None and found.modes:
                from suas_jax.figures.modes import plot_modes

                plot_modes(found, plot)
    answer(as_json, found.report() | material_note(spec), lambda: _print_modes(found))
    if found.status != "converged":
        raise typer.Exit(NO_SOLUTION)


def _print_modes(found: "Modes") -> None:
    from fitting.report.description import Part, Remark, ReportTable

    parts: list[Part] = [Remark(f"{found.status}: {found.message}")]
    if found.bandwidth is not None:
        names = (
            *("mode", "undamped [Hz]", "damping ratio", "swings at [Hz]", "fades in [s]"),
            "film's share",
        )
        rows = [
            [
                str(number),
                f"{mode['undamped_Hz']:.4g}",
                f"{mode['damping_ratio']:.3g}",
                "overdamped" if mode["frequency_Hz"] is None else f"{mode['frequency_Hz']:.4g}",
                "never" if mode["time_s"] is None else f"{mode['time_s']:.3g}",
                f"{mode['film_share']:.1%}",
            ]
            for number, mode in enumerate(found.modes, 1)
        ]
        bound = (
            f"Statics is right to 1 % below {found.bandwidth:.3g} Hz, whatever the load: a "
            f"cycle takes {1 / found.bandwidth:.3g} s there."
        )
        said = (bound, found.message) if found.message else (bound,)
        parts = [ReportTable("", names, rows), *map(Remark, said)]
    print_report(parts)
