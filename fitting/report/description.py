"""A report described once: headline, tables and remarks, for a terminal or a page."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table as TerminalTable

from suas_jax.config.quantities import format_quantity

_DIMENSIONS = {"m": "length", "F": "capacitance", "Pa": "stress"}


class Headline(NamedTuple):
    """How something ended."""

    status: str  # in a word
    text: str  # the rest of the line
    good: bool  # whether it ended well


class ReportTable(NamedTuple):
    """Rows of cells."""

    title: str  # of the table on a page
    names: tuple[str, ...]  # of its columns
    rows: Sequence[Sequence[str]]  # as many cells each
    chosen: int | None = None  # the row that stands out, if one does


class Remark(NamedTuple):
    """A sentence."""

    text: str  # what it says
    label: str = ""  # what kind of doubt it is, such as "warning"; empty for none


Part = Headline | ReportTable | Remark


def print_parts(console: Console, parts: Sequence[Part]) -> None:
    """Print a report."""
    for part in parts:
        if isinstance(part, Headline):
            colour = "green" if part.good else "yellow"
            console.print(f"[{colour}]{part.status}[/] {escape(part.text)}")
        elif isinstance(part, Remark):
            label = f"[yellow]{part.label}:[/] " if part.label else ""
            console.print(label + escape(part.text))
        else:
            table = TerminalTable()
            for i, name in enumerate(part.names):
                table.add_column(escape(name), no_wrap=i == 0, overflow="fold")
            for i, (first, *rest) in enumerate(part.rows):
                mark = "[bold]" if i == part.chosen else ""
                table.add_row(mark + escape(first), *map(escape, rest))
            console.print(table)


def percent_text(share: float) -> str:
    """A share to two digits, in percent: ``170 %``, never ``1.7e+02 %``."""
    return f"{float(f'{100 * share:.2g}'):g} %"


def quantity_text(value: float, unit: str, digits: int = 5) -> str:
    """A number in SI units with the unit that suits its size; an infinite one has no limit."""
    if np.isinf(value):
        return "no limit"
    if unit in _DIMENSIONS and value:
        return format_quantity(float(value), _DIMENSIONS[unit])  # type: ignore[arg-type]
    return f"{value:.{digits}g}"
