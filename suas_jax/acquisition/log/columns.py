"""The columns of an SO log: checked alike, whatever kind of file they come from."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.integrity import Flags
from suas_jax.acquisition.log.data import KEY_COLUMNS, MAX_COUNT, MEASURED, LogFileError, SoLog

_LARGEST_INTEGER = 2**53  # whole numbers up to here are exact in float64


def columns(log: SoLog) -> dict[str, np.ndarray]:
    """The columns of a log as the CSV file names them."""
    keys = dict(zip(KEY_COLUMNS, (log.t_host, log.t_device, log.seq, log.module), strict=True))
    so = {f"so_{k + 1}": log.so[:, k] for k in range(log.so.shape[1])}
    return keys | so | dict(log.flags)


def from_columns(path: Path, header: Any, table: Mapping[str, Any]) -> SoLog:
    """A log from its header and its columns by name, by the rules that its CSV files follow.

    Raises LogFileError: a column that every log has is missing, or a value is not allowed.
    """
    if not isinstance(header, dict) or not all(
        isinstance(key, str) and isinstance(value, str) for key, value in header.items()
    ):
        raise LogFileError(f"{path}: the header is not a table of words: not an SO log")
    names = [f"so_{k}" for k in range(1, sum(n.startswith("so_") for n in table) + 1)]
    for name in (*KEY_COLUMNS, *(names or ["so_1"])):
        if name not in table:
            raise LogFileError(f"{path}: no column {name}: the file is not an SO log")
    arrays = {name: np.asarray(values) for name, values in table.items()}
    rows = len(arrays["seq"])
    for name, values in arrays.items():
        if values.shape != (rows,):
            raise LogFileError(f"{path}, column {name}: one value a row is expected")
    found = {name: Column(path, name, values) for name, values in arrays.items()}
    return log_of(path, dict(header), found, names)


def log_of(
    path: Path,
    header: dict[str, str],
    found: "Mapping[str, Column]",
    so: Sequence[str],
    notes: Sequence[str] = (),
) -> SoLog:
    """A log from its checked columns, of which those named in `so` are counts."""
    return SoLog(
        path,
        header,
        found["t_host_s"].floats(),
        found["t_device_s"].floats(),
        found["seq"].integers(),
        found["module"].integers(),
        np.stack([found[name].floats(0.0, MAX_COUNT) for name in so], axis=1),
        {
            name: column.floats() if name in MEASURED else column.flag()
            for name, column in found.items()
            if name not in KEY_COLUMNS and name not in so
        },
        tuple(notes),
    )


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a file; its methods raise `LogFileError` at a value that is not allowed."""

    path: Path  # the file, for messages
    name: str  # of the column
    values: Any  # its fields: texts, as a CSV file has them, or an array
    # numbers of the lines that texts are in; None for an array
    lines: Sequence[int] | None = None

    def floats(self, low: float = -np.inf, high: float = np.inf) -> NDArray[np.float64]:
        """Numbers within limits; NaN where missing."""
        try:
            if self.lines is None:
                numbers = np.asarray(self.values, np.float64)
            elif "_" in "".join(self.values):
                raise ValueError
            else:
                numbers = np.array(list(map(float, self.values)))
        except (TypeError, ValueError):  # missing values, or worse
            if self.lines is None:
                raise self._no("numbers are expected") from None
            numbers = np.array([number_in(text) for text in self.values], float)
        outside = np.isinf(numbers) | (numbers < low) | (numbers > high)
        no_number = np.isnan(numbers) if self.lines is not None else outside
        for i in np.flatnonzero(outside | no_number).tolist():
            if outside[i] or self.values[i].strip().lower() not in ("", "nan", "na"):
                what = "a number" if high == np.inf else f"a count from {low:.0f} to {high:.0f}"
                raise self._refused(i, f"{what}, or nothing where the value is missing")
        return numbers

    def integers(self) -> NDArray[np.int64]:
        """Whole numbers, none of them missing or too large to be exact."""
        if self.lines is None:
            numbers = self.floats()
        elif (
            all(map(str.isdecimal, self.values)) and max(map(len, self.values), default=0) < 16
        ):
            return np.array(list(map(int, self.values)), np.int64)
        else:
            numbers = np.array([number_in(text) for text in self.values], float)
        whole = (numbers >= 0) & (numbers <= _LARGEST_INTEGER) & (numbers == np.floor(numbers))
        if not whole.all():
            raise self._refused(int(whole.argmin()), "a whole number, zero or more")
        return numbers.astype(np.int64)

    def flag(self) -> NDArray[np.generic]:
        """Whole numbers; the words where some are none.

        In text the recorder's own flags are zero where missing: nothing was amiss there.
        """
        values = self.values
        missing = "0" if self.name in Flags._fields else ""
        if self.lines is not None:
            try:
                return np.array([int(text.strip() or missing) for text in values], np.int64)
            except (ValueError, OverflowError):
                return np.array([text.strip() for text in values], np.str_)
        kind = values.dtype.kind
        if kind in "iub" or (
            kind == "f" and np.isfinite(values).all() and (values % 1 == 0).all()
        ):
            return values.astype(np.int64)
        odd = kind == "O" and not all(
            x is None or isinstance(x, str | int | float) for x in values
        )
        if odd or kind not in "fOUST":
            raise self._no("numbers or words are expected")
        words = (
            "" if x is None else x if isinstance(x, str) else f"{x}" for x in values.tolist()
        )
        return np.array(list(words), np.str_)

    def _no(self, what: str) -> LogFileError:
        return LogFileError(f"{self.path}, column {self.name}: {what}")

    def _refused(self, i: int, expected: str) -> LogFileError:
        if self.lines is None:
            place, shown = f"row {i + 1}", f"{float(self.values[i]):g}"
        else:
            place, shown = f"line {self.lines[i]}", f'"{self.values[i][:80]}"'
        return LogFileError(
            f"{self.path}, {place}, column {self.name}: {shown}: expected {expected}"
        )


def number_in(text: str) -> float:
    """NaN where the text is not a number; Python's own `1_000` is none in a CSV."""
    try:
        return float(text) if "_" not in text else float("nan")
    except ValueError:
        return float("nan")
