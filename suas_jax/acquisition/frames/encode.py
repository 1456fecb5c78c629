"""What a device sends: readings to bytes, by format.

Shares no code with the decoders, so that each can prove the other.
"""

from collections.abc import Callable

from suas_jax.acquisition.frames.reading import Reading


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


def encode_cobs(reading: Reading) -> bytes:
    """One `cobs` frame with the zero bytes before and after it."""
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


ENCODERS: dict[str, Callable[[Reading], bytes]] = {
    "text": encode_text,
    "text-checked": encode_checked_text,
    "cobs": encode_cobs,
    "roboskin": encode_slcan,
}


def _crc_of_byte(byte: int) -> int:
    remainder = byte << 8
    for _ in range(8):
        remainder = (remainder << 1) ^ (0x1021 if remainder & 0x8000 else 0)
    return remainder & 0xFFFF


_TABLE = tuple(_crc_of_byte(byte) for byte in range(256))


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, no reflection, no final xor."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ _TABLE[crc >> 8 ^ byte]
    return crc


def stuffed(data: bytes) -> bytes:
    """Consistent overhead byte stuffing: no zero byte is left (Cheshire and Baker, 1999)."""
    out = bytearray()
    for block in data.split(b"\0"):
        while len(block) >= 254:
            out += b"\xff" + block[:254]
            block = block[254:]
        out += bytes((len(block) + 1,)) + block
    return bytes(out)
