"""Readings that a data sheet is made of, and where they were taken."""

from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.figures import Accuracy, Cases


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
    """

    cases: Cases
    coordinates: dict[str, Floats]
    arc: Floats
    region: np.ndarray
    far: np.ndarray
    rated: float
    accuracy: Accuracy
