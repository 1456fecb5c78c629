"""A column of an SO log as its file writes it: text, read as numbers.

Every value is checked, and one that is not allowed is named with its file, line and column.
`columns` does the same for logs in files of other kinds, which hold numbers already.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.log.columns import LARGEST_INTEGER
from suas_jax.acquisition.log.format import LogFileError


class TextColumn(NamedTuple):
    """A column of a log's text.

    Attributes:
        path: the file, for messages.
        name: of the column.
        lines: numbers of the lines that the fields are in, for messages.
        texts: its fields.
    """

    path: Path
    name: str
    lines: Sequence[int]
    texts: Sequence[str]

    def floats(self, low: float = -np.inf, high: float = np.inf) -> NDArray[np.float64]:
        """Numbers within limits; NaN where missing.

        Raises:
            LogFileError: a field is no number, or outside the limits.
        """
        try:
            if "_" in "".join(self.texts):
                raise ValueError
            values = np.array(list(map(float, self.texts)))
        except ValueError:  # missing values, or worse
            values = np.array([number_in(text) for text in self.texts], float)
        outside = np.isinf(values) | (values < low) | (values > high)
        for i in np.flatnonzero(outside | np.isnan(values)).tolist():
            if outside[i] or not _is_missing(self.texts[i]):
                what = "a number" if high == np.inf else f"a count from {low:.0f} to {high:.0f}"
                raise self._refused(i, f"{what}, or nothing where the value is missing")
        return values

    def integers(self) -> NDArray[np.int64]:
        """Whole numbers, none of them missing.

        Raises:
            LogFileError: a field is none, or too large to be exact.
        """
        texts = self.texts
        if all(map(str.isdecimal, texts)) and max(map(len, texts), default=0) < 16:
            return np.array(list(map(int, texts)), np.int64)
        values = []
        for i, text in enumerate(texts):
            value = number_in(text)
            if not (value.is_integer() and 0 <= value <= LARGEST_INTEGER):
                raise self._refused(i, "a whole number, zero or more")
            values.append(int(value))
        return np.array(values, np.int64)

    def flag(self) -> NDArray[np.generic]:
        """Whole numbers, zero where missing; the words as they are where some are none."""
        try:
            return np.array([int(text) if text.strip() else 0 for text in self.texts], np.int64)
        except (ValueError, OverflowError):
            return np.array([text.strip() for text in self.texts], np.str_)

    def _refused(self, i: int, expected: str) -> LogFileError:
        return LogFileError(
            f'{self.path}, line {self.lines[i]}, column {self.name}: "{self.texts[i][:80]}": '
            f"expected {expected}"
        )


def number_in(text: str) -> float:
    """NaN where the text is no number; Python's own `1_000` is none in a CSV."""
    try:
        return float(text) if "_" not in text else float("nan")
    except ValueError:
        return float("nan")


def _is_missing(text: str) -> bool:
    return text.strip().lower() in ("", "nan", "na")
