"""Readings that a data sheet is made of, and where they were taken."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.figures import Accuracy, Cases

_RATED = 0.3  # of the smallest first contact


class Measured(NamedTuple):
    """Readings of a skin and its neighbours, and where they were taken."""

    cases: Cases  # the readings [taxel, skin, place]
    coordinates: dict[str, Floats]  # of the places by key, as a person states them [place]
    arc: Floats  # along the outer face [place] [m]
    region: np.ndarray  # whether a place counts for the figures of the whole skin [place]
    far: np.ndarray  # taxels that count as crosstalk [taxel, place]
    rated: float  # the rated force [N]
    accuracy: Accuracy  # of a reading
    grid: tuple[int, int]  # places along the arc and along the axis
    # why figures have no value on such a skin, by key
    missing: Mapping[str, str] = MappingProxyType({})


def rated_force(first_contact: Floats) -> float:
    """30 % of the smallest first contact, to one significant digit [N]; 1 N where none is."""
    known = first_contact[np.isfinite(first_contact)]
    return float(f"{_RATED * known.min():.0e}") if known.size else 1.0
