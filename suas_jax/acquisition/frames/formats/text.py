r"""The format `text`: one line `seq,t_device_s,module,so_1,...,so_n` per module and frame.

A line may end with `*hhhh`, the CRC-16/CCITT-FALSE of what stands before the star in
hexadecimal; once a device has sent one, lines without are refused. Without it only form can
be checked: a digit that was changed to another digit goes unnoticed.

What form can tell: a line must be nothing but numbers; its number of counts must be the one
that its module always has (a line that lost its tail, or two lines that ran together, differ);
and the first line after the port was opened must not be the tail of a longer one.
"""

import math
import re
from collections import Counter

from suas_jax.acquisition.frames.reading import FrameFormat, Reading, SplitDecoder, crc16
from suas_jax.acquisition.ports.serial_port import SerialSource

MAX_LINE = 8192
MAX_COUNT = 65535

# Possessive quantifiers: linear time on any garbage.
_LINE = re.compile(
    rb"[ \t]*+([0-9]{1,18})[ \t]*+,"
    rb"[ \t]*+([0-9]++(?:\.[0-9]*+)?+(?:[eE][+-]?[0-9]{1,3}+)?+|[nN]a[nN]|)[ \t]*+,"
    rb"[ \t]*+([0-9]{1,5})[ \t]*+,"
    rb"((?:[ \t]*+(?:[0-9]{1,5}+|[nN]a[nN]|)[ \t]*+(?:,|\Z))++)"
)
_CHECKSUM = re.compile(rb"\*([0-9A-Fa-f]{4})[ \t]*\Z")
# A module's number of counts is believed once this many lines agree.
_AGREE = 2
# Lines held back while the modules that have just appeared aren't sure of theirs.
_MAX_HELD = 128
# Places tried for the begin of a whole line in a damaged one: counts look like one, too.
_SALVAGE_TRIES = 16
# A module that keeps sending another number of counts has really changed.
_CHANGED = 20


class TextDecoder(SplitDecoder):
    """Decoder of `text` lines; see the module's description."""

    longest = MAX_LINE

    def __init__(self) -> None:
        self._widths: dict[int, int] = {}
        self._unlike: dict[int, tuple[int, int]] = {}  # module: other width, lines in a row
        super().__init__()

    def _restart(self) -> None:
        super()._restart()
        self._any_line = False
        self._last_seq = -2
        self._last_heard = -math.inf  # when the last line that was released came [s]
        self._held: list[Reading] = []
        self._strangers: dict[int, Reading] = {}

    def finish(self) -> list[Reading]:
        """See `Decoder`; what was held back is released."""
        held = self._without_partial(self._held)
        self.tally.partial += len(self._held) - len(held)
        readings = self._released(held)
        self._refuse(len(self._strangers))
        self.tally.readings += len(readings)
        super().finish()
        return readings

    def _frame(self, line: bytes, t_host: float) -> list[Reading]:
        reading = self._parse(line, t_host) if len(line) <= MAX_LINE else None
        first, self._any_line = not self._any_line, True
        if reading is None:
            if line.lstrip().startswith((b"#", b"seq,")):
                return []  # remarks and a line of column names are welcome
            if first:
                self.tally.partial += 1
            else:
                self.tally.malformed += 1
            reading = self._salvaged(line, t_host)
            if reading is None:
                self.tally.discarded += len(line) + 1
                return []
        if self._opening:
            self._held.append(reading)
            return self._sure_of_opening()
        if reading.module not in self._widths:
            return self._introduced(reading)
        return self._released([reading])

    def _parse(self, line: bytes, t_host: float) -> Reading | None:
        if self.checked or b"*" in line:
            checksum = _CHECKSUM.search(line)
            if checksum is None:
                return None
            line = line[: checksum.start()]
            if crc16(line) != int(checksum[1], 16):
                return None
        else:
            checksum = None
        match = _LINE.fullmatch(line)
        if match is None:
            return None
        seq, time, module, tail = match.groups()
        fields = tail.split(b",")
        try:
            counts: tuple[int | None, ...] = tuple(map(int, fields))
        except ValueError:  # missing values
            counts = tuple(int(f) if f.strip().isdigit() else None for f in fields)
        if any(count is not None and count > MAX_COUNT for count in counts):
            return None
        self.checked = self.checked or checksum is not None
        return Reading(int(seq), float(time or b"nan"), int(module), counts, t_host)

    def _salvaged(self, line: bytes, t_host: float) -> Reading | None:
        """The whole line behind garbage or a line whose end was lost, if it is expected.

        It must begin with the frame number that comes next, and then be right in every way.
        """
        for seq in (self._last_seq, self._last_seq + 1):
            start = len(line)
            for _ in range(_SALVAGE_TRIES):
                start = line.rfind(b"%d," % seq, 1, start)
                if start < 0:
                    break
                reading = self._parse(line[start:], t_host)
                if (
                    reading is not None
                    and reading.seq == seq
                    and self._widths.get(reading.module) == len(reading.counts)
                ):
                    return reading
        return None

    def _sure_of_opening(self) -> list[Reading]:
        """Release the opening lines once each module has said twice how wide it is."""
        if len(self._held) < _AGREE:
            return []
        said = Counter((reading.module, len(reading.counts)) for reading in self._held)
        agreed = {module for (module, _), lines in said.items() if lines >= _AGREE}
        agreed |= self._widths.keys()
        full = len(self._held) >= _MAX_HELD
        held = self._without_partial(self._held)
        if not full and any(reading.module not in agreed for reading in held):
            return []
        self.tally.partial += len(self._held) - len(held)
        self._held = []
        self._opening = False
        released = self._released([r for r in held if r.module in agreed])
        for reading in held:
            if reading.module not in agreed:
                released += self._introduced(reading)
        return released

    def _introduced(self, reading: Reading) -> list[Reading]:
        """Believe in a module that appears late when it has said the same width twice.

        The first of the two lines is refused where later ones have been released since:
        readings come out in the order in which they arrived.
        """
        before = self._strangers.pop(reading.module, None)
        if before is not None and len(before.counts) == len(reading.counts):
            if before.t_host >= self._last_heard:
                return self._released([before, reading])
            self._refuse(1)
            return self._released([reading])
        if before is not None or len(self._strangers) >= _MAX_HELD:
            self._refuse(1)
        if before is not None or len(self._strangers) < _MAX_HELD:
            self._strangers[reading.module] = reading
        return []

    def _without_partial(self, held: list[Reading]) -> list[Reading]:
        """The opening lines less the first, if that can be the tail of a longer line.

        Then its frame number is the tail of a number that would fit, or its module is one
        that never spoke again while all others did.
        """
        if len(held) < _AGREE:
            return held
        lines = Counter(reading.module for reading in held[1:])
        alone = lines[held[0].module] == 0 and min(lines.values()) >= _AGREE
        return held[1:] if alone or _is_tail(held[0].seq, held[1].seq) else held

    def _released(self, readings: list[Reading]) -> list[Reading]:
        """Those of the readings that have their module's number of counts."""
        said = Counter((r.module, len(r.counts)) for r in readings)
        for (module, width), _ in said.most_common():
            self._widths.setdefault(module, width)
        kept = [reading for reading in readings if self._fits(reading)]
        if kept:
            self._last_seq, self._last_heard = kept[-1].seq, kept[-1].t_host
        return kept

    def _fits(self, reading: Reading) -> bool:
        width = len(reading.counts)
        if width == self._widths[reading.module]:
            self._unlike.pop(reading.module, None)
            return True
        other, lines = self._unlike.get(reading.module, (width, 0))
        self._unlike[reading.module] = (width, lines + 1 if width == other else 1)
        if self._unlike[reading.module][1] >= _CHANGED:
            del self._unlike[reading.module]
            self._widths[reading.module] = width
            return True
        self._refuse(1)
        return False

    def _refuse(self, lines: int) -> None:
        self.tally.malformed += lines


def _is_tail(seq: int, following: int) -> bool:
    """Whether `seq` can be the last digits of the number before `following`, or of it."""
    text = str(seq)
    return any(
        len(text) < len(whole) and whole.endswith(text)
        for whole in (str(following), str(max(following - 1, 0)))
    )


def encode_text(reading: Reading) -> bytes:
    """One line of `text`."""
    return _text_body(reading) + b"\n"


def encode_checked_text(reading: Reading) -> bytes:
    """One line of `text` with its checksum."""
    body = _text_body(reading)
    return body + b"*%04X\n" % crc16(body)


def _text_body(reading: Reading) -> bytes:
    clock = "" if reading.t_device != reading.t_device else f"{reading.t_device:.6f}"
    counts = ",".join("" if c is None else str(c) for c in reading.counts)
    return f"{reading.seq},{clock},{reading.module},{counts}".encode()


FORMAT = FrameFormat(
    TextDecoder, {"text": encode_text, "text-checked": encode_checked_text}, SerialSource
)
