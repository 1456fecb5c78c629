"""Numbers as files spell them: decimal points or commas, separated thousands, gaps."""

import math
import re
from collections.abc import Iterable

_MISSING = frozenset(
    (
        *("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "."),
        *("inf", "+inf", "-inf", "#div/0!", "#value!", "#num!", "1.#qnan", "1.#inf"),
    )
)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
_PLAIN = re.compile(r"[+-]?\d{1,15}(?:\.\d{0,20})?")
_SHAPE = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eEdD][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:[.,]\d{3})+")


def is_missing(text: str) -> bool:
    """Whether a cell is one of the usual ways to write that there is no value."""
    return text.strip().casefold() in _MISSING


def looks_numeric(text: str) -> bool:
    """Whether a cell is a number in one spelling or another."""
    return not math.isnan(number(text))


def decimal_mark(cells: Iterable[str]) -> str:
    """The decimal mark of a table, from the cells that leave no choice.

    "1,5" can only have a decimal comma, "1,234.5" only a decimal point; "1,234" alone is
    read with a decimal comma unless other cells have points.
    """
    comma = point = open_comma = 0
    for text in cells:
        bare = _bare(text)
        if not _SHAPE.fullmatch(bare):
            continue
        commas, points = bare.count(","), bare.count(".")
        if commas and points:
            comma += bare.rfind(",") > bare.rfind(".")
            point += bare.rfind(".") > bare.rfind(",")
        elif _THOUSANDS.fullmatch(bare):
            open_comma += commas == 1
            comma += points > 1
            point += commas > 1
        elif commas == 1:
            comma += 1
        elif points == 1:
            point += 1
    if comma != point:
        return "," if comma > point else "."
    return "," if open_comma and not point else "."


def number(text: str, decimal: str | None = None) -> float:
    """The number in a cell; NaN if there is none.

    `decimal`: decimal mark of its table; None takes the last mark of the cell, unless it comes
    twice.
    """
    if decimal != "," and _PLAIN.fullmatch(text):  # most cells of most files
        return float(text)
    bare = _bare(text)
    if decimal is None:
        decimal = "," if bare.rfind(",") > bare.rfind(".") else "."
        if bare.count(decimal) > 1:  # it parts thousands
            decimal = "." if decimal == "," else ","
    other = "." if decimal == "," else ","
    if other in bare:
        grouped = bare.split(decimal)[0].lstrip("+-").split(other)
        if other in bare.rpartition(decimal)[2] and decimal in bare:
            return math.nan
        thousands = all(len(part) == 3 for part in grouped[1:])
        if thousands and 1 <= len(grouped[0]) <= 3 and not grouped[0].startswith("0"):
            bare = bare.replace(other, "")
        elif decimal in bare or bare.count(other) > 1:
            return math.nan
        else:  # a column of another spelling than the rest of the table
            bare = bare.replace(other, decimal)
    bare = bare.replace(decimal, ".")
    if not _NUMBER.fullmatch(bare):
        return math.nan
    value = float(bare.replace("d", "e").replace("D", "e"))
    return value if math.isfinite(value) else math.nan


def _bare(text: str) -> str:
    return re.sub(r"[\s\u00a0\u202f']", "", text).replace("\N{MINUS SIGN}", "-")
