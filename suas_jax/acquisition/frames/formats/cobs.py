"""The format `cobs`, this project's binary frame (docs/firmware_frames.md).

Before stuffing, little-endian::

    0  u8      version, 1
    1  u8      n, number of taxels, 1 to 64
    2  u8      module
    3  u8      status; bit 0: a map of missing taxels follows the counts
    4  u32     seq, frame number
    8  u32     device clock, microseconds, starts again after 2^32
    12 u16 x n counts
       u8 x ceil(n/8)  only with status bit 0: bit k of byte j set: taxel 8j + k + 1 missing
       u16     CRC-16/CCITT-FALSE of all bytes before

Stuffed by COBS, so that no byte is zero, and a zero byte before and after.
"""

import struct

from suas_jax.acquisition.frames.reading import FrameFormat, Reading, SplitDecoder, crc16
from suas_jax.acquisition.ports.serial_port import SerialSource

_HEAD = struct.Struct("<BBBBII")
_CRC = struct.Struct("<H")
_COUNTS = [struct.Struct(f"<{n}H") for n in range(65)]
_MAX_TAXELS = 64
_HAS_MAP = 1
# The longest frame, stuffed: head, 64 counts, map, CRC and one byte per 254.
MAX_FRAME = _HEAD.size + 2 * _MAX_TAXELS + 8 + _CRC.size + 1


class CobsDecoder(SplitDecoder):
    """Decoder of `cobs` frames; see the module's description."""

    lines, longest = False, MAX_FRAME
    clock_modulus: float | None = 2**32 * 1e-6
    checked = True

    def _frame(self, frame: bytes, t_host: float) -> list[Reading]:
        reading = self._parse(frame, t_host)
        self._opening = False
        return [] if reading is None else [reading]

    def _too_long(self) -> None:
        self._refuse(b"")

    def _refuse(self, frame: bytes, *, crc: bool = False) -> None:
        self.tally.discarded += len(frame)
        if self._opening:  # the port was opened in the middle of it
            self.tally.partial += 1
            self._opening = False
        elif crc:
            self.tally.bad_crc += 1
        else:
            self.tally.malformed += 1

    def _parse(self, frame: bytes, t_host: float) -> Reading | None:
        payload = _unstuffed(frame) if len(frame) <= MAX_FRAME else None
        if payload is None or len(payload) < _HEAD.size + _CRC.size:
            self._refuse(frame)
            return None
        end = len(payload) - _CRC.size
        if crc16(payload[:end]) != _CRC.unpack_from(payload, end)[0]:
            self._refuse(frame, crc=True)
            return None
        version, n, module, status, seq, clock = _HEAD.unpack_from(payload)
        map_at = _HEAD.size + 2 * n
        has_map = status & _HAS_MAP
        right_size = map_at + ((n + 7) // 8 if has_map else 0)
        if version != 1 or not 0 < n <= _MAX_TAXELS or right_size != end:
            self._refuse(frame)
            return None
        counts: tuple[int | None, ...] = _COUNTS[n].unpack_from(payload, _HEAD.size)
        if has_map:
            missing = int.from_bytes(payload[map_at:end], "little")
            counts = tuple(None if missing >> k & 1 else c for k, c in enumerate(counts))
        return Reading(seq, clock / 1e6, module, counts, t_host)


def _unstuffed(frame: bytes) -> bytes | None:
    """Undo COBS; None if the frame is cut or damaged."""
    out = bytearray()
    at, size = 0, len(frame)
    while at < size:
        code = frame[at]
        end = at + code
        if end > size:
            return None
        out += frame[at + 1 : end]
        at = end
        if code < 255 and at < size:
            out.append(0)
    return bytes(out)


def encode_cobs(reading: Reading) -> bytes:
    """One `cobs` frame with the zero bytes before and after it.

    Shares no code with the decoder but the checksum, so that each can prove the other.
    """
    clock = 0.0 if reading.t_device != reading.t_device else reading.t_device
    micros = round(clock * 1e6) % 2**32
    missing = [c is None for c in reading.counts]
    body = bytearray((1, len(missing), reading.module, int(any(missing))))
    body += (reading.seq % 2**32).to_bytes(4, "little") + micros.to_bytes(4, "little")
    for count in reading.counts:
        body += (count or 0).to_bytes(2, "little")
    if any(missing):
        bits = sum(1 << k for k, gone in enumerate(missing) if gone)
        body += bits.to_bytes((len(missing) + 7) // 8, "little")
    body += crc16(bytes(body)).to_bytes(2, "little")
    return b"\0" + stuffed(bytes(body)) + b"\0"


def stuffed(data: bytes) -> bytes:
    """Consistent overhead byte stuffing: no zero byte is left (Cheshire and Baker, 1999)."""
    out = bytearray()
    for block in data.split(b"\0"):
        while len(block) >= 254:
            out += b"\xff" + block[:254]
            block = block[254:]
        out += bytes((len(block) + 1,)) + block
    return bytes(out)


FORMAT = FrameFormat(CobsDecoder, {"cobs": encode_cobs}, SerialSource)
