"""The frame formats, by the name they have on the command line."""

from suas_jax.acquisition.frames.reading import Decoder
from suas_jax.acquisition.ports.serial_port import Source

FORMATS = ("text", "cobs", "roboskin")


def decoder(name: str) -> Decoder:
    """A new decoder of a format.

    Raises:
        ValueError: no such format.
    """
    if name == "text":
        from suas_jax.acquisition.frames.text import TextDecoder

        return TextDecoder()
    if name == "cobs":
        from suas_jax.acquisition.frames.cobs import CobsDecoder

        return CobsDecoder()
    if name == "roboskin":
        from suas_jax.acquisition.frames.roboskin import RoboskinDecoder

        return RoboskinDecoder()
    raise ValueError(f'--format "{name}": allowed are {", ".join(FORMATS)}')


def open_source(port: str, format_name: str, baud: int) -> Source:
    """Open the port that carries a format.

    Raises:
        PortError: it can't be opened.
    """
    if format_name == "roboskin":
        from suas_jax.acquisition.ports.can_bus import CanSource

        return CanSource(port, baud)
    from suas_jax.acquisition.ports.serial_port import SerialSource

    return SerialSource(port, baud)
