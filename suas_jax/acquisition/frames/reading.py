"""A reading of one module, and what every frame format offers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from suas_jax.acquisition.ports.serial_port import Source


class Reading(NamedTuple):
    """One module in one frame.

    Attributes:
        seq: frame number of the device.
        t_device: the device's clock [s]; NaN if it has none.
        module: module (triangle) number.
        counts: raw counts by taxel; None where the device sent no value.
        t_host: when its last byte was read, on the host's clock [s].
        extra: what else the format carries, as the decoder's `extra_columns` name it.
    """

    seq: int
    t_device: float
    module: int
    counts: tuple[int | None, ...]
    t_host: float = float("nan")
    extra: tuple[int, ...] = ()


@dataclass
class Tally:
    """What a decoder has seen since it was made.

    Attributes:
        bytes: bytes fed.
        readings: frames accepted.
        bad_crc: frames whose checksum is wrong.
        malformed: frames without a checksum, or with a right one, that make no sense.
        partial: frames of which only the end was there when the port was opened.
        discarded: bytes that belong to no accepted frame.
    """

    bytes: int = 0
    readings: int = 0
    bad_crc: int = 0
    malformed: int = 0
    partial: int = 0
    discarded: int = 0


class Decoder(Protocol):
    """Turns a stream of bytes, cut anywhere, into readings; its memory is bounded.

    Attributes:
        tally: counts since the decoder was made.
        clock_modulus: the device clock starts again after this time [s]; None if unknown.
        checked: a checksum vouches for each reading.
        extra_columns: names of what each reading has in `extra`.
    """

    tally: Tally
    clock_modulus: float | None
    checked: bool
    extra_columns: tuple[str, ...]

    def feed(self, data: bytes, t_host: float) -> list[Reading]:
        """Take the bytes read at `t_host` [s]; return the readings they complete."""

    def finish(self) -> list[Reading]:
        """End the stream (closed, lost): return what was held back, forget the rest."""


class FrameFormat(NamedTuple):
    """A frame format; each file of `suas_jax.acquisition.frames.formats` has one as `FORMAT`.

    Attributes:
        decoder: makes a decoder of the format.
        encoders: what a device sends for a reading, by the name of the format's variant.
        open_source: opens the port that carries the format, from its name and bits per
            second.
        looks_like: whether bytes from a serial port are the format's, although its decoder
            makes nothing of them; None where the decoder itself tells.
    """

    decoder: Callable[[], Decoder]
    encoders: Mapping[str, Callable[[Reading], bytes]]
    open_source: Callable[[str, int], Source]
    looks_like: Callable[[bytes], bool] | None = None
