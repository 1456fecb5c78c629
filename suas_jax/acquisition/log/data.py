"""An SO log in memory: its rows, and its frames."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# Rows of one frame may be interleaved with those of its neighbours (several buses), but
# an equal seq further away is another frame: the counter wrapped or the device restarted.
FRAME_WINDOW = 256


@dataclass(frozen=True)
class SoLog:
    """A log in memory.

    Attributes:
        path: where it was read.
        header: the `# key: value` lines.
        t_host: host time since `start_time` [row, s]; NaN where missing.
        t_device: device time, unwrapped [row, s]; NaN where missing.
        seq: frame number [row].
        module: module (triangle) number [row].
        so: raw counts [row, taxel]; NaN where missing.
        flags: columns after the counts, by name [row]; integers where they all are.
        notes: what the reader left out, in words.
    """

    path: Path
    header: dict[str, str]
    t_host: NDArray[np.float64]
    t_device: NDArray[np.float64]
    seq: NDArray[np.int64]
    module: NDArray[np.int64]
    so: NDArray[np.float64]
    flags: dict[str, NDArray[np.generic]]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.seq)


@dataclass(frozen=True)
class Frames:
    """A log by frames: the rows of equal seq side by side.

    Attributes:
        t_host: host time of the frame's first row [frame, s].
        t_device: device time of the frame's first row [frame, s].
        seq: frame number [frame].
        modules: module numbers, ascending [module].
        so: raw counts [frame, module, taxel]; NaN where missing.
    """

    t_host: NDArray[np.float64]
    t_device: NDArray[np.float64]
    seq: NDArray[np.int64]
    modules: NDArray[np.int64]
    so: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.seq)


def group_frames(log: SoLog) -> Frames:
    """Group the rows of equal seq to frames.

    Rows flagged `duplicate` (the device sent them twice) are left out. An equal seq counts
    as the same frame only while it is near and its module is new: a counter that wrapped or
    a device that restarted begins new frames.
    """
    modules = np.unique(log.module)
    slot = np.searchsorted(modules, log.module).tolist()
    frame_of = np.full(len(log), -1, np.int64)
    first: list[int] = []
    members: dict[int, tuple[int, int, set[int]]] = {}  # seq: frame, last row, its modules
    duplicate = log.flags.get("duplicate")
    sequence = log.seq.tolist()
    for row in range(len(log)):
        if duplicate is not None and duplicate[row]:
            continue
        number, module = sequence[row], slot[row]
        known = members.get(number)
        if known and row - known[1] <= FRAME_WINDOW and module not in known[2]:
            frame, _, present = known
            present.add(module)
        else:
            frame, present = len(first), {module}
            first.append(row)
        members[number] = (frame, row, present)
        frame_of[row] = frame
    so = np.full((len(first), len(modules), log.so.shape[1]), np.nan)
    kept = frame_of >= 0
    so[frame_of[kept], np.asarray(slot, np.int64)[kept]] = log.so[kept]
    start = np.asarray(first, np.int64)
    return Frames(log.t_host[start], log.t_device[start], log.seq[start], modules, so)
