"""The columns of an SO log: checked alike, whatever kind of file they come from."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.log.data import SoLog
from suas_jax.acquisition.log.format import KEY_COLUMNS, MAX_COUNT, MEASURED, LogFileError

LARGEST_INTEGER = 2**53
"""Whole numbers up to here are exact in float64."""


def columns(log: SoLog) -> dict[str, np.ndarray]:
    """The columns of a log as the CSV file names them."""
    keys = dict(zip(KEY_COLUMNS, (log.t_host, log.t_device, log.seq, log.module), strict=True))
    so = {f"so_{k + 1}": log.so[:, k] for k in range(log.so.shape[1])}
    return keys | so | dict(log.flags)


def from_columns(path: Path, header: Any, table: Mapping[str, Any]) -> SoLog:
    """A log from its columns, by the rules that its CSV files follow.

    Args:
        path: where they are from, for messages.
        header: the log's header, by key.
        table: columns of one length, by name.

    Raises:
        LogFileError: a column that every log has is missing, or a value is not allowed.
    """
    if not isinstance(header, dict) or not all(
        isinstance(key, str) and isinstance(value, str) for key, value in header.items()
    ):
        raise LogFileError(f"{path}: the header is no table of words: the file is no SO log")
    names = [f"so_{k}" for k in range(1, sum(n.startswith("so_") for n in table) + 1)]
    for name in (*KEY_COLUMNS, *(names or ["so_1"])):
        if name not in table:
            raise LogFileError(f"{path}: no column {name}: the file is no SO log")
    arrays = {name: np.asarray(values) for name, values in table.items()}
    rows = len(arrays["seq"])
    for name, values in arrays.items():
        if values.shape != (rows,):
            raise LogFileError(f"{path}, column {name}: one value a row is expected")
    known = {*KEY_COLUMNS, *names}
    counts = [_numbers(path, name, arrays[name], 0.0, MAX_COUNT) for name in names]
    return SoLog(
        path,
        dict(header),
        _numbers(path, "t_host_s", arrays["t_host_s"]),
        _numbers(path, "t_device_s", arrays["t_device_s"]),
        _integers(path, "seq", arrays["seq"]),
        _integers(path, "module", arrays["module"]),
        np.stack(counts, 1),
        {
            name: (_numbers if name in MEASURED else _flag)(path, name, x)
            for name, x in arrays.items()
            if name not in known
        },
    )


def _numbers(
    path: Path, name: str, values: np.ndarray, low: float = -np.inf, high: float = np.inf
) -> NDArray[np.float64]:
    """Numbers within limits; NaN where missing."""
    try:
        numbers = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise LogFileError(f"{path}, column {name}: numbers are expected") from None
    wrong = np.isinf(numbers) | (numbers < low) | (numbers > high)
    if wrong.any():
        row = int(wrong.argmax())
        allowed = "a number" if high == np.inf else f"a count from {low:.0f} to {high:.0f}"
        raise LogFileError(
            f"{path}, row {row + 1}, column {name}: {numbers[row]:g}: expected {allowed}, or "
            "nothing where the value is missing"
        )
    return numbers


def _integers(path: Path, name: str, values: np.ndarray) -> NDArray[np.int64]:
    numbers = _numbers(path, name, values)
    wrong = ~((numbers >= 0) & (numbers <= LARGEST_INTEGER) & (numbers == np.floor(numbers)))
    if wrong.any():
        row = int(wrong.argmax())
        raise LogFileError(
            f"{path}, row {row + 1}, column {name}: {numbers[row]:g}: expected a whole "
            "number, zero or more"
        )
    return numbers.astype(np.int64)


def _flag(path: Path, name: str, values: np.ndarray) -> NDArray[np.generic]:
    """Whole numbers or words, as in a CSV file."""
    if values.dtype.kind in "iub":
        return values.astype(np.int64)
    if values.dtype.kind == "f" and np.isfinite(values).all() and (values % 1 == 0).all():
        return values.astype(np.int64)
    if values.dtype.kind == "O" and not all(
        x is None or isinstance(x, str | int | float) for x in values
    ):
        raise LogFileError(f"{path}, column {name}: numbers or words are expected")
    if values.dtype.kind not in "fOUST":
        raise LogFileError(f"{path}, column {name}: numbers or words are expected")
    words = ("" if x is None else x if isinstance(x, str) else f"{x}" for x in values.tolist())
    return np.array(list(words), np.str_)
