"""A reading of one module, and what every frame format offers and shares."""

import binascii
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from suas_jax.acquisition.ports.serial_port import Source


class Reading(NamedTuple):
    """One module in one frame."""

    seq: int  # frame number of the device
    t_device: float  # the device's clock [s]; NaN if it has none
    module: int  # module (triangle) number
    counts: tuple[int | None, ...]  # raw counts by taxel; None where the device sent no value
    t_host: float = float("nan")  # when its last byte was read, on the host's clock [s]
    # what else the format carries, as the decoder's `extra_columns` name it
    extra: tuple[int, ...] = ()


@dataclass
class Tally:
    """What a decoder has seen since it was made."""

    bytes: int = 0  # bytes fed
    readings: int = 0  # frames accepted
    bad_crc: int = 0  # frames whose checksum is wrong
    malformed: int = 0  # frames without a checksum, or with a right one, that make no sense
    partial: int = 0  # frames of which only the end was there when the port was opened
    discarded: int = 0  # bytes that belong to no accepted frame


class Decoder(Protocol):
    """Turns a stream of bytes, cut anywhere, into readings; its memory is bounded."""

    tally: Tally  # counts since the decoder was made
    # the device clock starts again after this time [s]; None if unknown
    clock_modulus: float | None
    checked: bool  # a checksum vouches for each reading
    extra_columns: tuple[str, ...]  # names of what each reading has in `extra`

    def feed(self, data: bytes, t_host: float) -> list[Reading]:
        """Take the bytes read at `t_host` [s]; return the readings they complete."""

    def finish(self) -> list[Reading]:
        """End the stream (closed, lost): return what was held back, forget the rest."""


class SplitDecoder:
    """A decoder of frames that end with a mark which no frame contains.

    A kind says whether they are `lines` (else a zero byte ends them) and the `longest` of them,
    and reads one frame in `_frame`; `_too_long` counts one that goes on beyond that, which is
    given up until its end comes.
    """

    lines = True
    longest: int
    clock_modulus: float | None = None
    checked = False
    extra_columns: tuple[str, ...] = ()

    def __init__(self) -> None:
        self.tally = Tally()
        self._restart()

    def _restart(self) -> None:
        self._buffer, self._overlong = b"", False
        self._opening = True  # nothing was understood since the port was opened

    def feed(self, data: bytes, t_host: float) -> list[Reading]:
        """See `Decoder`."""
        self.tally.bytes += len(data)
        data = self._buffer + data
        split = data.replace(b"\r", b"\n").split(b"\n") if self.lines else data.split(b"\0")
        *frames, rest = split
        readings: list[Reading] = []
        for frame in frames:
            if self._overlong:  # the end of a frame already given up
                self._overlong = False
                self.tally.discarded += len(frame) + 1
            elif frame:
                readings += self._frame(frame, t_host)
        if len(rest) > self.longest:
            if not self._overlong:
                self._too_long()
            self.tally.discarded += len(rest)
            self._overlong, rest = True, b""
        self._buffer = rest
        self.tally.readings += len(readings)
        return readings

    def finish(self) -> list[Reading]:
        """See `Decoder`."""
        self.tally.discarded += len(self._buffer)
        self._restart()
        return []

    def _frame(self, frame: bytes, t_host: float) -> list[Reading]:
        raise NotImplementedError

    def _too_long(self) -> None:
        self.tally.malformed += 1


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, no reflection, no final xor."""
    return binascii.crc_hqx(data, 0xFFFF)


class FrameFormat(NamedTuple):
    """A frame format: `FORMAT` of each file of `suas_jax.acquisition.frames.formats`."""

    decoder: Callable[[], Decoder]  # makes a decoder of the format
    # what a device sends for a reading, by the name of the format's variant
    encoders: Mapping[str, Callable[[Reading], bytes]]
    # opens the port that carries the format, from its name and bits per second
    open_source: Callable[[str, int], Source]
    # whether bytes from a serial port are the format's, although its decoder makes nothing of
    # them; None where the decoder itself tells
    looks_like: Callable[[bytes], bool] | None = None
