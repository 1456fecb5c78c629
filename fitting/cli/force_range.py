"""`suas range`: where a skin's range of forces ends."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.options import (
    AsJson,
    Plot,
    TrustNetwork,
    Workers,
    check_figures,
    executor,
    material_note,
    pad_settings,
)
from fitting.cli.progress import spinner
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import new_console, say
from suas_jax.files.writing import check_outputs

if TYPE_CHECKING:
    from fitting.force_range.bound import ForceRange
    from fitting.force_range.pad import PadForceRange


def find_range(
    skin: Annotated[Path, typer.Argument(metavar="SKIN", help="Skin file (TOML).")],
    as_json: AsJson = False,
    angles: Annotated[
        int, typer.Option(min=1, help="How many angles, from clamp to clamp.")
    ] = 17,
    axials: Annotated[
        int, typer.Option(min=1, help="On a pad: how many places along the axis.")
    ] = 11,
    diameter: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="On a pad: diameter of the contact; default 6 mm."),
    ] = None,
    workers: Workers = None,
    trust_network: TrustNetwork = False,
    noise: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of a reading, in counts; default: the skin file's."
        ),
    ] = None,
    plot: Plot = None,
    overwrite: Overwrite = False,
) -> None:
    """Find where loads reach the wall, and where a force is too small to be measured.

    On a pad: for a round contact anywhere, with the least errors of its place and force.

    Exit status: 0 done, 2 bad input.
    """
    with bad_input():
        from suas_jax.config import load_skin

        spec = load_skin(skin)
        check_figures(plot)
        check_outputs([plot], overwrite=overwrite)
        settings = pad_settings(diameter, None)
        with (
            executor(workers, trust_network) as processes,
            spinner("finding the range") as show,
        ):
            from suas_jax.runtime.settings import configure

            configure()
            if spec.geometry.dimension == 3:
                from fitting.force_range.figure import plot_pad_range
                from fitting.force_range.pad import pad_force_range

                if diameter == "free":
                    raise ValueError("--diameter free: a length is needed")
                on_pad = pad_force_range(
                    spec,
                    (angles, axials),
                    noise,
                    progress=show,
                    workers=processes,
                    **settings,  # type: ignore[arg-type]
                )
                if plot is not None:
                    plot_pad_range(on_pad, plot)
                report, table = on_pad.report(), _pad_rows(on_pad)
                where = "in the middle of the pad; --plot and --json show all of it"
            else:
                from fitting.force_range.bound import force_range
                from fitting.force_range.figure import plot_range

                if settings or workers is not None:
                    raise ValueError("--diameter and --workers are for pads")
                found = force_range(spec, angles, noise, show)
                if plot is not None:
                    plot_range(found, plot)
                report, table, where = found.report(), _section_rows(found), None
    note = material_note(spec)
    if as_json:
        say(json_text(report | note))
        return
    from rich.table import Table

    # Markup would swallow the units in brackets.
    shown = Table(*table[0], caption=where)
    for row in table[1:]:
        shown.add_row(*row)
    new_console(markup=False).print(shown)


def _section_rows(found: "ForceRange") -> list[list[str]]:
    """What a person wants to see of a section: names of the columns, then a row an angle."""
    places, what = found.along.shown(found.angle)
    rows = [
        [
            what,
            "first contact [N]",
            "95 % by the skin file [N]",
            "oil [kPa]",
            "measurable from [N]",
            "measurable to [N]",
            "a taxel saturates at [N]",
        ]
    ]
    for i, place in enumerate(places):
        values = (
            1e-3 * found.oil_pressure[i],
            found.smallest[i],
            found.largest[i],
            found.saturation[i],
        )
        low, high = found.contact_interval(i)
        interval = f"{low:.4g} to {high:.4g}" if np.isfinite(low) else "–"
        first = _shown(found.first_contact[i])
        rows.append([f"{place:.1f}", first, interval, *(_shown(x) for x in values)])
    return rows


def _pad_rows(found: "PadForceRange") -> list[list[str]]:
    """The same of a pad, halfway between its ends."""
    force, middle = found.reference, int(np.abs(found.axial).argmin())
    places, what = found.along.shown(found.angle)
    rows = [
        [
            what,
            "first contact [N]",
            "oil [kPa]",
            "measurable from [N]",
            f"place at {force:g} N [mm]",
            f"force at {force:g} N [%]",
        ]
    ]
    for i, place in enumerate(places):
        values = (
            found.first_contact[i, middle],
            1e-3 * found.oil_pressure[i, middle],
            found.smallest[i, middle],
            1e3 * found.position_error[i, middle, -1],
            100 * found.error[2, i, middle, -1] / force,
        )
        rows.append([f"{place:.1f}", *(_shown(x) for x in values)])
    return rows


def _shown(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "–"
