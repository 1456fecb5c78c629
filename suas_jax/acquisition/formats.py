"""The frame formats, by the name they have on the command line."""

from suas_jax.acquisition.reading import Decoder

FORMATS = ("text", "cobs", "roboskin")


def decoder(name: str) -> Decoder:
    """A new decoder of a format.

    Raises:
        ValueError: no such format.
    """
    if name == "text":
        from suas_jax.acquisition.decode_text import TextDecoder

        return TextDecoder()
    raise ValueError(f'--format "{name}": allowed are {", ".join(FORMATS)}')
