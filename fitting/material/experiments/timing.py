"""Times of a test's readings, and what is stated of its loading: rate, ramp, held strain."""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fitting.material.data.columns import SECONDS
from fitting.material.data.errors import said_of
from suas_jax.config.quantities import parse_quantity

KEYS = ("strain", "stretch", "strain_rate", "ramp")
"""What a file's comments, or --specimen, may state of a whole test."""
_SPELLED = {
    "strain": ("strain", "hold_strain", "held_strain", "strain_level"),
    "stretch": ("stretch", "hold_stretch", "held_stretch", "stretch_ratio"),
    "strain_rate": ("strain_rate", "rate"),
    "ramp": ("ramp", "ramp_time", "ramp_duration", "rise_time", "loading_time"),
}
_RATE = re.compile(r"([^\s%/]+)\s*(%|mm/mm|)\s*(?:1?\s*/\s*(s|sec|min|h)|(s|min)\^?-1)")


class Stated(NamedTuple):
    """What the command line, or a file's comments, state of a test."""

    file: str
    metadata: Mapping[str, str]  # of the file
    given: Mapping[str, str]  # on the command line

    def text(self, key: str) -> str | None:
        """As it is written; None for nothing."""
        if key in self.given:
            return self.given[key]
        names = (name for name in _SPELLED[key] if name in self.metadata)
        return next((self.metadata[name] for name in names), None)

    def held_stretch(self) -> float | None:
        """The stretch of a relaxation test whose table has no strains; None for none.

        Raises DataError: what is stated is not a stretch or strain.
        """
        for key, shift in (("stretch", 0.0), ("strain", 1.0)):
            if (text := self.text(key)) is not None:
                with said_of(f'{self.file}: {key} = "{text}"'):
                    value = parse_quantity(text, "number") + shift
                    if not value > 0.0:
                        raise ValueError("the stretch must be greater than zero")
                    return value
        return None

    def ramp(self) -> float:
        """Duration of the loading before the first reading [s]; NaN where none is stated.

        Raises DataError: what is stated is not a time.
        """
        if (text := self.text("ramp")) is None:
            return float("nan")
        with said_of(f'{self.file}: ramp = "{text}"'):
            seconds = parse_quantity(text, "time")
            if seconds < 0.0:
                raise ValueError("must not be less than zero")
        return seconds

    def times(self, strain: np.ndarray) -> np.ndarray:
        """Times of readings at a constant rate of strain [s], shape [n]; NaN without a rate.

        `strain`: nominal strain, or amount of shear, in the order of the test, shape [n].
        Raises DataError: what is stated is not a rate.
        """
        if (text := self.text("strain_rate")) is None:
            return np.full(len(strain), np.nan)
        found = _RATE.fullmatch(text.strip())
        with said_of(f'{self.file}: strain_rate = "{text}"'):
            if found is None:
                raise ValueError('a rate of strain is expected, such as "0.1 1/s" or "5 %/min"')
            rate = float(found.group(1)) * (0.01 if found.group(2) == "%" else 1.0)
            rate /= SECONDS[found.group(3) or found.group(4)]
            if not rate > 0.0:
                raise ValueError("it must be greater than zero")
        way = np.abs(np.diff(strain, prepend=0.0))
        known = np.isfinite(way)
        return np.where(known, np.cumsum(np.where(known, way, 0.0)), np.nan) / rate
