"""The frame formats, by the name they have on the command line."""

from collections.abc import Callable

from suas_jax.acquisition.frames.reading import Decoder, FrameFormat, Reading
from suas_jax.acquisition.ports.serial_port import Source
from suas_jax.runtime.registry import model_module, model_names

FORMAT_FILES = "suas_jax.acquisition.frames.formats"
FORMATS: dict[str, FrameFormat] = {
    name: model_module(FORMAT_FILES, name).FORMAT for name in model_names(FORMAT_FILES)
}
"""The formats by name, one for each file of `suas_jax.acquisition.frames.formats`."""

ENCODERS: dict[str, Callable[[Reading], bytes]] = {
    variant: encode for known in FORMATS.values() for variant, encode in known.encoders.items()
}
"""What a device sends for a reading, by the name of the format's variant."""


def encoder(variant: str) -> Callable[[Reading], bytes]:
    """What a device of a format's variant sends. Raises ValueError: no such variant."""
    if variant not in ENCODERS:
        raise ValueError(f'--format "{variant}": allowed are {", ".join(sorted(ENCODERS))}')
    return ENCODERS[variant]


def frame_format(name: str) -> FrameFormat:
    """The format of a name. Raises ValueError: no such format."""
    if name not in FORMATS:
        raise ValueError(f'--format "{name}": allowed are {", ".join(FORMATS)}')
    return FORMATS[name]


def decoder(name: str) -> Decoder:
    """A new decoder of a format. Raises ValueError: no such format."""
    return frame_format(name).decoder()


def open_source(port: str, name: str, baud: int) -> Source:
    """Open the port that carries a format.

    Raises ValueError: no such format; PortError: it can't be opened.
    """
    return frame_format(name).open_source(port, baud)
