"""`suas health`. Without --skin and --plot it needs neither JAX nor matplotlib."""

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from fitting.cli.contract import Overwrite, answer, bad_input
from fitting.cli.options import Baud, Format, JsonOnly, Plot, argument, check_files, option
from suas_jax.acquisition.terminal import new_console, say

if TYPE_CHECKING:
    from suas_jax.acquisition.health import Health
    from suas_jax.acquisition.log.log_file import SoLog


def health(
    source: Annotated[
        str, argument("Log of taxels, or a port as for `suas log`.", metavar="LOG|PORT")
    ],
    skin: Annotated[
        Path | None,
        option("Skin file: neighbours are the nearest taxels; else those next in number."),
    ] = None,
    format_name: Format = "text",
    baud: Baud = 115200,
    duration: Annotated[
        float, option("Port: how long to listen.", min=0.5, max=3600.0, metavar="S")
    ] = 10.0,
    plot: Plot = None,
    overwrite: Overwrite = False,
    as_json: JsonOnly = False,
) -> None:
    """Judge every taxel: noise, stuck, saturation, drift, loss, correlation with neighbours.

    Record some seconds at rest, then press here and there.
    Exit status: 0 judged, whatever was found; 2 bad input, or nothing came.
    """
    with bad_input():
        check_files(plot, overwrite=overwrite)
        from suas_jax.acquisition.health import health_json, log_health
        from suas_jax.acquisition.log.log_file import read_log

        path = Path(source)
        if path.is_file() or path.suffix.lower() == ".csv":
            log = read_log(path)
        else:
            log = _listened(source, format_name, baud, duration)
        found = log_health(log, None if skin is None else _places(skin))
        if plot is not None:
            from suas_jax.figures.health import plot_health

            plot_health(found, plot)
    answer(as_json, health_json(found), lambda: _print(found))


def _listened(port: str, format_name: str, baud: int, duration: float) -> "SoLog":
    """What a port says meanwhile, as a log."""
    from suas_jax.acquisition.frames.registry import decoder, open_source
    from suas_jax.acquisition.log.log_file import read_log
    from suas_jax.acquisition.log.record import record_port

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "health.csv"
        result = record_port(
            open_source(port, format_name, baud),
            decoder(format_name),
            format_name,
            path,
            duration=duration,
            report=lambda text: say(f"suas: {text}", err=True),
        )
        if not result["rows"]:
            raise ValueError(f"{port}: no frame came in {duration:g} s")
        return read_log(path)


def _places(skin: Path) -> dict[tuple[int, int], tuple[float, float]]:
    """Places of a skin's taxels on the unrolled wall [m], by module and number."""
    from suas_jax.config import load_skin
    from suas_jax.sensing.taxels import taxel_places

    spec = load_skin(skin)
    return taxel_places(spec.sensing, spec.geometry)


def _print(found: "Health") -> None:
    from rich.table import Table

    from suas_jax.acquisition.health import FAULTS

    console = new_console(highlight=False)
    table = Table(
        "taxel", "mean", "noise", "drift/min", "lost", "stuck", "sat.", "follows", "faults"
    )
    for taxel in found.taxels:
        colour = "[yellow]" if taxel.faults else ""
        shares = (f"{100 * x:.0f} %" for x in (taxel.lost, taxel.stuck, taxel.saturated))
        numbers = (f"{taxel.mean:.0f}", f"{taxel.noise:.1f}", f"{taxel.drift:+.1f}")
        table.add_row(
            f"{colour}{taxel.module}.{taxel.taxel}",
            *(text if "nan" not in text else "–" for text in numbers),
            *shares,
            "–" if taxel.follows != taxel.follows else f"{taxel.follows:.2f}",
            f"{colour}{', '.join(taxel.faults)}",
        )
    console.print(table)
    for note in found.notes:
        console.print(f"note: {note}", markup=False)
    for name in dict.fromkeys(name for taxel in found.faulty for name in taxel.faults):
        own = [f"{t.module}.{t.taxel}" for t in found.faulty if name in t.faults]
        console.print(f"{name}: {', '.join(own)}: {FAULTS[name]}", markup=False)
    console.print(
        f"{found.frames} frames in {found.duration:.1f} s, {len(found.taxels)} taxels, "
        f"{len(found.faulty) or 'none'} faulty"
    )
