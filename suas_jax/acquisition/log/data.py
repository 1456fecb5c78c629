"""The SO log: what writer and reader share of its format, its rows and frames in memory."""

import dataclasses
import functools
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FORMAT = "suas-so-log"
FORMAT_VERSION = 1
MAX_COUNT = 65535
UNITS = f"t_host_s and t_device_s in seconds, so_k in raw counts (0 to {MAX_COUNT})"
# The paper's Eq. 2: one count is 3.05e-16 F.
DEFAULT_SCALE = "0.305 fF"
KEY_COLUMNS = ("t_host_s", "t_device_s", "seq", "module")
RAW_CLOCK = "t_device_raw_s"
"""Column of the device's clock as it came, before wraps and jumps were undone [s]."""
MEASURED = ("oil_pressure_Pa", RAW_CLOCK)
"""Columns of numbers beside the counts; other further columns are flags."""
# Header key, and comment at the end, that name the next part of a rotated log.
CONTINUED = "continued_in"
# Comment where a recording went on in the same file.
APPENDED = "appended"
# Rows of one frame may be interleaved with those of its neighbours (several buses), but
# an equal seq further away is another frame: the counter wrapped or the device restarted.
FRAME_WINDOW = 256
MOST_MODULES = 1024
_COUNTERS = (2**8, 2**16, 2**24, 2**32)


class LogFileError(ValueError):
    """A log that can't be read: names the file, the line and the column."""


def log_header(
    *,
    skin: str = "not given",
    scale: str = DEFAULT_SCALE,
    start_time: datetime | None = None,
    **more: str,
) -> dict[str, str]:
    """The header that every log carries, in its order; `more` adds keys after it."""
    start = datetime.now(UTC) if start_time is None else start_time
    if start.tzinfo is None:
        raise ValueError(f"start_time = {start}: a time zone is needed, such as UTC")
    return {
        "format": FORMAT,
        "format_version": str(FORMAT_VERSION),
        "start_time": start.isoformat(timespec="microseconds"),
        "skin": skin,
        "scale": scale,
        "units": UNITS,
    } | more


@dataclass(frozen=True)
class SoLog:
    """A log in memory."""

    path: Path  # where it was read
    header: dict[str, str]  # the `# key: value` lines
    t_host: NDArray[np.float64]  # host time since `start_time` [row, s]; NaN where missing
    t_device: NDArray[np.float64]  # device time, unwrapped [row, s]; NaN where missing
    seq: NDArray[np.int64]  # frame number [row]
    module: NDArray[np.int64]  # module (triangle) number [row]
    so: NDArray[np.float64]  # raw counts [row, taxel]; NaN where missing
    # columns after the counts, by name [row]; integers where they all are, numbers where
    # something was measured (`oil_pressure_Pa`)
    flags: dict[str, NDArray[np.generic]]
    notes: tuple[str, ...] = ()  # what the reader left out, in words
    # header lines of logs joined in one file that say something else than the first, by key
    restated: dict[str, str] = dataclasses.field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.seq)


@dataclass(frozen=True)
class Frames:
    """A log by frames: the rows of equal seq side by side.

    Counts are kept by rows: a module may be in few of the frames.
    """

    t_host: NDArray[np.float64]  # host time of the frame's first row [frame, s]
    t_device: NDArray[np.float64]  # device time of the frame's first row [frame, s]
    seq: NDArray[np.int64]  # frame number [frame]
    modules: NDArray[np.int64]  # module numbers, ascending [module]
    counts: NDArray[np.float64]  # raw counts [row, taxel]; NaN where missing
    frame: NDArray[np.int64]  # which frame a row is of [row]
    slot: NDArray[np.int64]  # index of a row's module in `modules` [row]
    row: NDArray[np.int64]  # number of a row in the log, from zero [row]

    def __len__(self) -> int:
        return len(self.seq)

    def of_module(self, index: int) -> NDArray[np.float64]:
        """Raw counts of `modules[index]` [frame, taxel]; NaN where missing."""
        so = np.full((len(self), self.counts.shape[1]), np.nan)
        rows = self._rows[index]
        so[self.frame[rows]] = self.counts[rows]
        return so

    def mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean over a frame's rows of a column of the log [frame]; NaN where all is missing."""
        own = np.asarray(values, float)[self.row]
        known = np.isfinite(own)
        total = np.bincount(self.frame[known], own[known], len(self))
        count = np.bincount(self.frame[known], minlength=len(self))
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    @functools.cached_property
    def _rows(self) -> list[NDArray[np.int64]]:
        """Rows of each module."""
        order = np.argsort(self.slot, kind="stable")
        ends = np.searchsorted(self.slot[order], np.arange(1, len(self.modules)))
        return np.split(order, ends)


def group_frames(log: SoLog) -> Frames:
    """Group the rows of equal seq to frames.

    Rows flagged `duplicate` (the device sent them twice) are left out, and so are those flagged
    `other_taxels` (which taxels their counts are of is unknown). An equal seq counts as the
    same frame only while it is near and its module is new: a counter that wrapped or a device
    that restarted begins new frames. Raises ValueError: the log has more modules than any skin.
    """
    modules = np.unique(log.module)
    if len(modules) > MOST_MODULES:
        raise ValueError(
            f"{log.path}: {len(modules)} different module numbers; at most {MOST_MODULES} are "
            "read, so the column module holds something else"
        )
    slot = np.searchsorted(modules, log.module)
    frame_of = np.full(len(log), -1, np.int64)
    first: list[int] = []
    members: dict[int, tuple[int, int, set[int]]] = {}  # seq: frame, last row, its modules
    unusable = flagged(log, "duplicate") | flagged(log, "other_taxels")
    sequence, slots = log.seq.tolist(), slot.tolist()
    for row in range(len(log)):
        if unusable[row]:
            continue
        number, module = sequence[row], slots[row]
        known = members.get(number)
        if known and row - known[1] <= FRAME_WINDOW and module not in known[2]:
            frame, _, present = known
            present.add(module)
        else:
            frame, present = len(first), {module}
            first.append(row)
        members[number] = (frame, row, present)
        frame_of[row] = frame
    kept = frame_of >= 0
    start = np.asarray(first, np.int64)
    return Frames(
        log.t_host[start],
        log.t_device[start],
        log.seq[start],
        modules,
        log.so[kept],
        frame_of[kept],
        slot[kept].astype(np.int64),
        np.flatnonzero(kept),
    )


def flagged(log: SoLog, name: str) -> NDArray[np.bool_]:
    """Which rows carry a flag of the recorder [row]; none where the log has no such column."""
    flag = log.flags.get(name)
    if flag is None or flag.dtype.kind not in "iub":
        return np.zeros(len(log), bool)
    return flag.astype(bool)


def fluid_of(log: SoLog) -> str:
    """What filled the gap, as the header or a column names it; empty where neither does.

    Raises ValueError: several fluids are named.
    """
    told = [value for key, value in log.header.items() if key.strip().lower() == "fluid"]
    for name, column in log.flags.items():
        if name.strip().lower() == "fluid":
            told += [str(value) for value in np.unique(column)]
    named = sorted({value.strip().lower() for value in told} - {""})
    if len(named) > 1:
        raise ValueError(f"{log.path}: fluids {', '.join(named)}; give each a log of its own")
    return named[0] if named else ""


def without_other_taxels(log: SoLog) -> SoLog:
    """The log without the rows that are flagged `other_taxels`."""
    kept = ~flagged(log, "other_taxels")
    if kept.all():
        return log
    names = ("t_host", "t_device", "seq", "module", "so")
    return dataclasses.replace(
        log,
        **{name: getattr(log, name)[kept] for name in names},
        flags={name: values[kept] for name, values in log.flags.items()},
    )


def sequence_notes(log: SoLog) -> tuple[str, ...]:
    """What is odd about the rows of each module and their frame numbers, in words.

    Rows that the recorder flagged (`duplicate`, `restart`) are known already, and a counter
    that begins again at one of the usual widths is none.
    """
    known = flagged(log, "duplicate") | flagged(log, "restart")
    again: list[int] = []
    back: list[int] = []
    clocks = {"t_host_s": log.t_host, "t_device_s": log.t_device}
    earlier: dict[str, list[int]] = {name: [] for name in clocks}
    for module in np.unique(log.module)[:MOST_MODULES]:
        rows = np.flatnonzero((log.module == module) & ~known)
        step = np.diff(log.seq[rows])
        wrapped = np.isin(step, [near - m for m in _COUNTERS for near in range(1, 17)])
        again += rows[1:][step == 0].tolist()
        back += rows[1:][(step < 0) & ~wrapped].tolist()
        for name, clock in clocks.items():
            earlier[name] += rows[1:][np.diff(clock[rows]) < 0].tolist()
    notes = []
    for module in np.unique(log.module[flagged(log, "other_taxels")]):
        rows = np.flatnonzero(flagged(log, "other_taxels") & (log.module == module))
        notes.append(
            f"{len(rows)} rows of module {module} are left out, first seq {log.seq[rows[0]]} "
            f"(row {rows[0] + 1}): they came with {log.flags['other_taxels'][rows[0]]} counts, "
            "another number than this module's"
        )
    for name, rows_found in earlier.items():
        if rows_found:
            row = min(rows_found)
            notes.append(
                f"{name} goes back, {len(rows_found)} times, first to {clocks[name][row]:g} s "
                f"(row {row + 1}): a clock that was set, or several recordings; drift and "
                "--inputs go by it"
            )
    for rows_found, what in (
        (again, "repeat the frame number of the row before"),
        (back, "go back in frame numbers"),
    ):
        if rows_found:
            row = min(rows_found)
            notes.append(
                f"{len(rows_found)} rows {what} of their module, first seq {log.seq[row]} of "
                f"module {log.module[row]} (row {row + 1}): sent twice, out of order, or of "
                "several recordings"
            )
    return tuple(notes)
