"""A data sheet as one page of HTML that needs nothing else, and for a terminal."""

import math
from datetime import UTC, datetime
from importlib.metadata import version

from fitting.datasheet.pictures import plot_places, plot_skin, plot_tolerances
from fitting.datasheet.sheet import DataSheet
from fitting.datasheet.sheet import Figure as SheetFigure
from fitting.datasheet.words import WORDS, place_text
from fitting.report.description import Part, Remark, ReportTable
from fitting.report.page import embedded, page

_COLUMNS = ("figure", "value", "95 %", "at", "meaning")


def described(sheet: DataSheet, *, meanings: bool = True) -> list[Part]:
    """The sheet's tables and remarks; reasons follow them unless meanings stand in them."""
    rows = [_row(sheet, figure)[: 5 if meanings else 4] for figure in sheet.figures]
    reasons: dict[str, list[str]] = {}
    for figure in () if meanings else sheet.figures:
        if figure.reason:
            reasons.setdefault(figure.reason, []).append(WORDS[figure.key].title)
    names = sheet.variants.changes
    tolerances = [
        (
            ", ".join((names[i], *_size(sheet.variants.size(i)))),
            "taken" if sheet.assumed(i) else "stated",
            *(_or_dash(f"{100 * sheet.effects[i, k]:+.2f} %") for k in (0, 2)),
            _or_dash(f"{1e3 * sheet.effects[i, 1]:.3f} mm"),
        )
        for i in sheet.order
    ]
    columns = ("one standard deviation of", "", "estimated force", "range", "estimated place")
    return [
        ReportTable("Figures", _COLUMNS[: 5 if meanings else 4], rows),
        *(Remark(f"{', '.join(keys)}: {why.rstrip('.')}.") for why, keys in reasons.items()),
        ReportTable("What to measure first", columns, tolerances),
        *(Remark(_sentence(text)) for text in sheet.remarks),
    ]


def html_page(sheet: DataSheet, name: str) -> str:
    """The page of a skin, named such as its file."""
    measured = sheet.measured
    return page(
        "fitting.datasheet",
        "sheet.html.j2",
        name=name,
        made=datetime.now(UTC).strftime("%Y-%m-%d"),
        version=version("suas-jax"),
        drawing=embedded(plot_skin(sheet.spec), "svg"),
        places=embedded(plot_places(sheet), "svg"),
        tolerances=embedded(plot_tolerances(sheet), "svg"),
        parts=described(sheet),
        rated=_text(measured.rated),
        noise=_text(measured.accuracy.noise),
        places_count=len(measured.arc),
    )


def figure_text(figure: SheetFigure) -> str:
    """The value with its unit; a dash where there is none."""
    if math.isnan(figure.value):
        return "–"
    return f"{_shown(figure, figure.value)} {WORDS[figure.key].unit}".strip()


def _shown(figure: SheetFigure, value: float) -> str:
    return "no limit" if math.isinf(value) else _text(value / WORDS[figure.key].size)


def _row(sheet: DataSheet, figure: SheetFigure) -> tuple[str, ...]:
    word = WORDS[figure.key]
    interval = "–"
    if math.isfinite(figure.deviation):
        interval = " to ".join(_shown(figure, value) for value in figure.interval)
    own = {}
    if figure.place is not None:
        own = {k: float(v[figure.place]) for k, v in sheet.measured.coordinates.items()}
    at = place_text(own) or "–"
    meaning = " ".join(part for part in (word.meaning, _sentence(figure.reason)) if part)
    return word.title, figure_text(figure), interval, at, meaning


def _size(size: tuple[float, str] | None) -> tuple[str, ...]:
    return () if size is None else (f"{size[0]:.3g} {size[1]}",)


def _or_dash(text: str) -> str:
    return "–" if "nan" in text else text


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def _text(value: float) -> str:
    return f"{value:.3g}"
