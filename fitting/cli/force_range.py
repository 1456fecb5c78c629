"""`suas range`: where a skin's range of forces ends."""

from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np

from fitting.cli.contract import Overwrite, answer, bad_input
from fitting.cli.options import (
    AsJson,
    Noise,
    Plot,
    SkinFile,
    TrustNetwork,
    Workers,
    check_files,
    computing,
    material_note,
    option,
    pad_settings,
)
from suas_jax.acquisition.terminal import print_table

if TYPE_CHECKING:
    from fitting.force_range.bound import ForceRange
    from fitting.force_range.pad import PadForceRange


_Table: TypeAlias = tuple[list[str], list[list[str]], str | None]
_NO_CONTACT = (
    "no first contact (–): no load there brings the membrane to the wall, or the way there has "
    "no equilibrium (suas solve names it)"
)


def find_range(
    skin: SkinFile,
    as_json: AsJson = False,
    angles: Annotated[int, option("How many angles, from clamp to clamp.", min=1)] = 17,
    axials: Annotated[int, option("On a pad: how many places along the axis.", min=1)] = 11,
    diameter: Annotated[
        str | None, option("On a pad: diameter of the contact; default 6 mm.", metavar="LENGTH")
    ] = None,
    workers: Workers = None,
    trust_network: TrustNetwork = False,
    noise: Noise = None,
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
        check_files(plot, overwrite=overwrite)
        settings: dict[str, Any] = pad_settings(diameter, None)
        with computing("finding the range", workers, trust_network) as (show, processes):
            found: ForceRange | PadForceRange
            if spec.geometry.dimension == 3:
                from fitting.force_range.pad import pad_force_range

                if diameter == "free":
                    raise ValueError("--diameter free: a length is needed")
                settings |= {"progress": show, "workers": processes}
                found = on_pad = pad_force_range(spec, (angles, axials), noise, **settings)
                table = _pad_rows(on_pad)
                if plot is not None:
                    from fitting.force_range.figure import plot_pad_range

                    plot_pad_range(on_pad, plot)
            else:
                from fitting.force_range.bound import force_range

                if settings or workers is not None:
                    raise ValueError("--diameter and --workers are for pads")
                found = section = force_range(spec, angles, noise, show)
                table = _section_rows(section)
                if plot is not None:
                    from fitting.force_range.figure import plot_range

                    plot_range(section, plot)
    answer(as_json, found.report() | material_note(spec), lambda: print_table(*table))


def _section_rows(found: "ForceRange") -> _Table:
    """What a person wants to see of a section: names of the columns, then a row an angle."""
    places, what = found.along.shown(found.angle)
    names = [
        what,
        "first contact [N]",
        "95 % by the skin file [N]",
        "oil [kPa]",
        "measurable from [N]",
        "measurable to [N]",
        "a taxel saturates at [N]",
    ]
    rows = []
    for i, place in enumerate(places):
        low, high = found.contact_interval(i)
        interval = f"{low:.4g} to {high:.4g}" if np.isfinite(low) else "–"
        further = (1e-3 * found.oil_pressure, found.smallest, found.largest, found.saturation)
        first = _shown(found.first_contact[i])
        rows.append([f"{place:.1f}", first, interval, *(_shown(x[i]) for x in further)])
    return names, rows, None if np.isfinite(found.first_contact).all() else _NO_CONTACT


def _pad_rows(found: "PadForceRange") -> _Table:
    """The same of a pad, halfway between its ends."""
    force, middle = found.reference, int(np.abs(found.axial).argmin())
    places, what = found.along.shown(found.angle)
    columns = {
        "first contact [N]": found.first_contact,
        "oil [kPa]": 1e-3 * found.oil_pressure,
        "measurable from [N]": found.smallest,
        f"place at {force:g} N [mm]": 1e3 * found.position_error[..., -1],
        f"force at {force:g} N [%]": 100 * found.error[2, ..., -1] / force,
    }
    rows = [
        [f"{place:.1f}", *(_shown(x[i, middle]) for x in columns.values())]
        for i, place in enumerate(places)
    ]
    where = "in the middle of the pad; --plot and --json show all of it"
    return [what, *columns], rows, where


def _shown(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "–"
