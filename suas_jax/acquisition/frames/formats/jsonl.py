"""The format `jsonl`: one JSON object a line, module and frame.

::

    {"seq":258,"t":1.5,"module":3,"so":[13675,null,65535]}

`t` is the device's clock [s] and may be missing; null in `so` is a missing value. Further keys
are ignored. A line that was cut is not JSON, but a changed digit goes unnoticed.
"""

import json
import math
import sys
from typing import TypeGuard

from suas_jax.acquisition.frames.reading import FrameFormat, Reading, SplitDecoder
from suas_jax.acquisition.ports.serial_port import SerialSource

MAX_LINE = 8192
_MAX_COUNT, _MAX_MODULE, _MAX_SEQ = 65535, 99_999, 10**18


class JsonLinesDecoder(SplitDecoder):
    """Decoder of `jsonl`; see the module's description."""

    longest = MAX_LINE

    def _frame(self, frame: bytes, t_host: float) -> list[Reading]:
        reading = _parsed(frame, t_host)
        if reading is None:
            self.tally.discarded += len(frame) + 1
            self._too_long()
        self._opening = False
        return [] if reading is None else [reading]

    def _too_long(self) -> None:
        self.tally.partial += self._opening
        self.tally.malformed += not self._opening
        self._opening = False


def _parsed(line: bytes, t_host: float) -> Reading | None:
    """The reading of a line; None if it is none."""
    if len(line) > MAX_LINE:
        return None
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(found, dict):
        return None
    seq, module, counts = found.get("seq"), found.get("module"), found.get("so")
    clock = found.get("t", math.nan)
    if not (_whole(seq, _MAX_SEQ) and _whole(module, _MAX_MODULE)):
        return None
    if not isinstance(counts, list) or not counts:
        return None
    if type(clock) not in (int, float) or clock < 0.0 or clock > sys.float_info.max:
        return None
    if not all(count is None or _whole(count, _MAX_COUNT) for count in counts):
        return None
    return Reading(seq, float(clock), module, tuple(counts), t_host)


def _whole(value: object, most: int) -> TypeGuard[int]:
    return type(value) is int and 0 <= value <= most


def encode_jsonl(reading: Reading) -> bytes:
    """One line of `jsonl`, written without a JSON library, as firmware does."""
    known = reading.t_device == reading.t_device
    clock = f'"t":{reading.t_device:.6f},' if known else ""
    counts = ",".join("null" if count is None else str(count) for count in reading.counts)
    head = f'{{"seq":{reading.seq},{clock}"module":{reading.module}'
    return f'{head},"so":[{counts}]}}\n'.encode()


FORMAT = FrameFormat(JsonLinesDecoder, {"jsonl": encode_jsonl}, SerialSource)
