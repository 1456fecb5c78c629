"""Readings that a data sheet is made of, and where they were taken."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.figures import Accuracy, Cases

_RATED = 0.3  # of the smallest first contact


class Measured(NamedTuple):
    """Readings of a skin and its neighbours, and where they were taken.

    Attributes:
        cases: the readings [taxel, skin, place].
        coordinates: of the places by key, as a person states them [place].
        arc: along the outer face [place] [m].
        region: whether a place counts for the figures of the whole skin [place].
        far: taxels that count as crosstalk [taxel, place].
        rated: the rated force [N].
        accuracy: of a reading.
        grid: places along the arc and along the axis.
        missing: why figures have no value on such a skin, by key.
    """

    cases: Cases
    coordinates: dict[str, Floats]
    arc: Floats
    region: np.ndarray
    far: np.ndarray
    rated: float
    accuracy: Accuracy
    grid: tuple[int, int]
    missing: Mapping[str, str] = MappingProxyType({})


def rated_force(first_contact: Floats) -> float:
    """30 % of the smallest first contact, to one significant digit [N]; 1 N where none is."""
    known = first_contact[np.isfinite(first_contact)]
    return float(f"{_RATED * known.min():.0e}") if known.size else 1.0
