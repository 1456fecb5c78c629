"""`suas data`: what is understood of a test machine's file. Imports no JAX before it must."""

from pathlib import Path
from typing import Annotated, Any

from fitting.cli.contract import Overwrite, answer, bad_input
from fitting.cli.options import JsonOnly, Plot, argument, check_files, named_values, option
from suas_jax.acquisition.terminal import new_console


def data(
    file: Annotated[Path, argument("File of a test machine: CSV, text or .xlsx.")],
    mode: Annotated[
        str, option("Kind of test to read it as, see `suas fit material`.")
    ] = "uniaxial",
    columns: Annotated[
        str | None, option('What columns measure: "force=3,extension=5 mm".')
    ] = None,
    specimen: Annotated[
        str | None, option('Sizes that the file does not state: "width=6 mm,thickness=2 mm".')
    ] = None,
    plot: Plot = None,
    overwrite: Overwrite = False,
    as_json: JsonOnly = False,
) -> None:
    """Show how a file of a test machine is read, and what looks wrong with it.

    Exit status: 0 the file holds a table, even if something is missing for the test (status
    "incomplete"), 2 bad input.
    """
    with bad_input():
        named = named_values(columns, "--columns", "force=3,extension=5")
        sizes = named_values(specimen, "--specimen", "width=6 mm,thickness=2 mm")
        check_files(plot, overwrite=overwrite)
        from fitting.material.experiments.measurements import mode_named
        from fitting.material.experiments.preview import preview

        report, table, test = preview(file, mode_named(mode), named, sizes)
        if plot is not None:
            from fitting.material.report.plots import plot_data

            plot_data(table, test, plot)
    answer(as_json, report, lambda: _print(report, test))


def _print(report: dict[str, Any], test: Any) -> None:
    from rich.markup import escape
    from rich.table import Table

    console = new_console(highlight=False)
    reading = report["reading"]
    mark = {",": "decimal commas", ".": "decimal points"}[reading["decimal_mark"]]
    names = reading["names_line"]
    console.print(
        f"{escape(report['file'])}: {reading['format']}, {mark}; "
        f"{f'names in line {names}' if names else 'no column names'}, readings in lines "
        f"{reading['first_line']} to {reading['last_line']}"
    )
    table = Table("", "column", "measures", "unit", "numbers", "from", "to")
    for column in report["columns"]:
        ends = [f"{x:.5g}" if x is not None else "" for x in (column["min"], column["max"])]
        meaning = column["quantity"] or ("not usable" if "problem" in column else "not used")
        meaning += " (direction 2)" if column["direction"] == 2 else ""
        first = (str(column["number"]), escape(column["name"]), meaning, column["unit"])
        table.add_row(*first, str(column["numbers"]), *ends)
    console.print(table)
    units = {"area": ("mm2", 1e6), "thickness_ratio": ("", 1.0)}
    for name, size in report["sizes_m"].items():
        unit, factor = units.get(name, ("mm", 1e3))
        console.print(f"{name}: {size * factor:.5g} {unit}".rstrip())
    found = report["test"]
    if found is None:
        console.print(f"[yellow]incomplete:[/] {escape(report['message'])}")
    for part in found["specimens"] if found else ():
        label = f'specimen "{part["specimen"]}"' if part["specimen"] else "one specimen"
        console.print(
            f"{escape(label)}: {part['readings']} readings, {part['loadings']} "
            f"loading{'s' if part['loadings'] > 1 else ''}"
        )
    if found:
        console.print(
            f"read as {report['mode']}: {found['abscissa']} from {found['abscissa_min']:.4g} "
            f"to {found['abscissa_max']:.4g}, {_modulus(found)}"
        )
        console.print(_drawing(test), markup=False)
    for text in report["warnings"]:
        console.print(f"[yellow]warning:[/] {escape(text)}")


def _modulus(found: dict[str, Any]) -> str:
    """The modulus that the readings suggest, in words."""
    for kind in ("shear", "bulk"):
        value = found.get(f"{kind}_modulus_Pa")
        if value is not None:
            return f"{kind} modulus about {value / 1e6:.3g} MPa"
    return "modulus unknown"


def _drawing(test: Any, width: int = 60, height: int = 12) -> str:
    """The readings as a picture of letters, one letter a specimen."""
    import numpy as np

    channel = test.channels()[0]
    x, y = test.abscissa[channel.rows], test.value[channel.rows] / channel.unit
    labels = list(dict.fromkeys(test.specimen))
    marks = "o" if len(labels) == 1 else "abcdefghijklmnopqrstuvwxyz"
    spans = [np.ptp(values) or 1.0 for values in (x, y)]
    columns = np.round((x - x.min()) / spans[0] * (width - 1)).astype(int)
    rows = np.round((y - y.min()) / spans[1] * (height - 1)).astype(int)
    canvas = [[" "] * width for _ in range(height)]
    for column, row, label in zip(columns, rows, test.specimen[channel.rows], strict=True):
        canvas[height - 1 - row][column] = marks[labels.index(label) % len(marks)]
    top = f"{y.max():.4g}"
    lines = [f"{top} {channel.label}"]
    lines += ["| " + "".join(row).rstrip() for row in canvas]
    lines += ["+" + "-" * width, f"{x.min():.4g} to {x.max():.4g} {test.abscissa_label}"]
    return "\n".join(lines)
