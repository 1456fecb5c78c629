"""The format `roboskin`: the CAN messages of the iCub's skin boards.

A board sends two messages of 8 bytes a triangle, with the identifier
0x300 + 16 board + triangle: first 0x40 and channels 0 to 6, then 0xC0, channels 7 to 11, and
two bytes that are not read. Each channel has 8 bits and falls with pressure. Channels 6 and
10 are temperature pads, the others the triangle's ten taxels; `module` is
16 board + triangle.

There is no counter and no clock in them: `seq` counts the rounds over all triangles, as the
host sees them, and `t_device` is the adapter's time stamp. So a lost round can't be noticed;
a first message without its second can.
"""

import re

from suas_jax.acquisition.frames.reading import FrameFormat, Reading, Tally
from suas_jax.acquisition.ports.can_bus import RECORD, CanSource

_SKIN = 0x300
_FIRST, _SECOND = 0x40, 0xC0
_THERMAL = (6, 10)
_TAXELS = tuple(k for k in range(12) if k not in _THERMAL)


class RoboskinDecoder:
    """Decoder of the skin's CAN messages; see the module's description."""

    clock_modulus: float | None = None
    checked = True  # by the bus itself
    extra_columns: tuple[str, ...] = ("thermal_1", "thermal_2")

    def __init__(self) -> None:
        self.tally = Tally()
        self._buffer = b""
        self._begun: dict[int, bytes] = {}  # module: its first message's channels
        self._round = 0
        self._heard: set[int] = set()  # modules of this round
        self._epoch: float | None = None

    def feed(self, data: bytes, t_host: float) -> list[Reading]:
        """Take whole or partial records; return the readings they complete."""
        self.tally.bytes += len(data)
        data = self._buffer + data
        whole = len(data) - len(data) % RECORD.size
        self._buffer = data[whole:]
        readings = []
        for identifier, stamp, length, content in RECORD.iter_unpack(data[:whole]):
            if identifier & ~0xFF != _SKIN:
                continue  # other traffic on the bus
            reading = self._message(identifier & 0xFF, stamp, content[:length], t_host)
            if reading is not None:
                readings.append(reading)
        self.tally.readings += len(readings)
        return readings

    def finish(self) -> list[Reading]:
        """End the stream: forget first messages without a second."""
        self.tally.malformed += len(self._begun)
        self._begun.clear()
        self._buffer = b""
        return []

    def _message(
        self, module: int, stamp: float, content: bytes, t_host: float
    ) -> Reading | None:
        if len(content) != 8 or content[0] not in (_FIRST, _SECOND):
            self.tally.malformed += 1
            self.tally.discarded += len(content)
            return None
        begun = self._begun.pop(module, None)
        if content[0] == _FIRST:
            if begun is not None:
                self.tally.malformed += 1
            self._begun[module] = content[1:]
            return None
        if begun is None:
            self.tally.malformed += 1
            return None
        if module in self._heard:
            self._round += 1
            self._heard.clear()
        self._heard.add(module)
        if self._epoch is None:
            self._epoch = stamp
        channels = begun + content[1:6]
        return Reading(
            self._round,
            round(stamp - self._epoch, 6),
            module,
            tuple(channels[k] for k in _TAXELS),
            t_host,
            tuple(channels[k] for k in _THERMAL),
        )


def encode_slcan(reading: Reading) -> bytes:
    """The two CAN messages of a triangle as a serial CAN adapter (slcan) sends them.

    16-bit counts are taken down to their high byte, turned round: they fall with pressure.
    """
    counts = [255 - (c or 0) // 256 for c in reading.counts][:10]
    counts += [255] * (10 - len(counts))
    channels = bytes([*counts[:6], 128, *counts[6:9], 128, counts[9]])
    first = b"\x40" + channels[:7]
    second = b"\xc0" + channels[7:] + b"\0\0"
    head = b"t%03X8" % (0x300 + reading.module % 256)
    return b"".join(head + part.hex().upper().encode() + b"\r" for part in (first, second))


# What such an adapter sends where a serial port is listened to.
_SLCAN = re.compile(rb"t[0-7][0-9A-F]{2}8[0-9A-F]{16}\r")


def _looks_like_slcan(recent: bytes) -> bool:
    return _SLCAN.search(recent) is not None


FORMAT = FrameFormat(RoboskinDecoder, {"roboskin": encode_slcan}, CanSource, _looks_like_slcan)
