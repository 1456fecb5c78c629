"""The capacitance-to-digital converter: counts from farads, and farads from counts.

A converter subtracts what its offset DAC supplies, divides by the capacitance of one count
and rounds to a whole number of n bits (Eqs. 1 and 2 of the paper)::

    s = (C - C_offset) / C_lsb,     SO = clip(round(s + noise + drift t), 0, 2^n - 1)

Rounding, clipping, noise and drift belong to simulated readings (`Converter.sample`).
Likelihoods use the continuous s, whose noise is Gaussian, and leave saturated readings out.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

PAPER_LSB = 20e-12 / 2**16
"""Capacitance of one count, Eq. 2: 20 pF over 16 bits [F]."""

EIGHT_BIT_LSB = 2.88e-15
"""Capacitance of one count of the paper's 8-bit units [F]; no power of two of the above."""


class Sample(NamedTuple):
    """Simulated readings [frame, taxel]."""

    counts: NDArray[np.int64]  # whole counts
    saturated: NDArray[np.bool_]  # where the input lies outside the converter's range
    # frames polled before the converter had refreshed [frame]:
    # their counts are those of the frame before
    repeated: NDArray[np.bool_]


@dataclass(frozen=True)
class Converter:
    """Settings of a converter."""

    lsb: float = PAPER_LSB  # capacitance of one count [F]
    bits: int = 16  # of its result; 16 or 8 in the paper
    offset: float = 0.0  # capacitance that the offset DAC takes off [F]
    noise: float = 0.0  # standard deviation of a reading [counts]
    # standard deviation, over the taxels, of a baseline's steady drift [counts/s]
    drift: float = 0.0
    # time between new results [s]; polled faster, the last result comes again. None: a new
    # result at every poll.
    refresh: float | None = None

    def __post_init__(self) -> None:
        if not self.lsb > 0:
            raise ValueError(f"lsb = {self.lsb} F: a positive capacitance is needed")
        if not 1 <= self.bits <= 16:
            raise ValueError(f"bits = {self.bits}: 1 to 16 are possible, usual are 8 and 16")
        for name in ("noise", "drift"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} = {getattr(self, name)}: zero or more is needed")
        if self.refresh is not None and not self.refresh > 0:
            raise ValueError(f"refresh = {self.refresh} s: a positive time is needed")

    @property
    def full_scale(self) -> int:
        """Largest count."""
        return 2**self.bits - 1

    def counts(self, capacitance: ArrayLike) -> NDArray[np.float64]:
        """Continuous counts of capacitances [F]: no noise, rounding or saturation."""
        return (np.asarray(capacitance, float) - self.offset) / self.lsb

    def capacitance(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Capacitances that counts stand for [F]."""
        return np.asarray(counts, float) * self.lsb + self.offset

    def sample(
        self,
        # [frame, taxel] [F]; NaN where membrane and electrode touch, a short circuit that reads
        # full scale
        capacitance: NDArray[np.float64],
        time: NDArray[np.float64],  # of the frames, ascending [s]
        random: np.random.Generator,  # source of noise and drift
    ) -> Sample:
        """Simulate readings."""
        frames, taxels = capacitance.shape
        continuous = self.counts(capacitance)
        rates = self.drift * random.standard_normal(taxels)
        noise = self.noise * random.standard_normal((frames, taxels))
        continuous = continuous + noise + rates * (time - time[0])[:, None]
        continuous = np.where(np.isnan(capacitance), np.inf, continuous)
        limited = np.clip(continuous, 0, self.full_scale)
        counts = np.rint(limited).astype(np.int64)
        saturated = np.rint(continuous) != counts
        repeated = np.zeros(frames, bool)
        if self.refresh is not None:
            result = np.floor((time - time[0]) / self.refresh * (1 + 1e-12))
            repeated[1:] = result[1:] == result[:-1]
            last_new = np.maximum.accumulate(np.where(repeated, 0, np.arange(frames)))
            counts, saturated = counts[last_new], saturated[last_new]
        return Sample(counts, saturated, repeated)
