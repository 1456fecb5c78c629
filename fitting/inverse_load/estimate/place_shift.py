"""How much further along the arc than they are contacts are felt, as presses show."""

import numpy as np

from fitting.arrays import Floats
from suas_jax.config.schema_calibration import PlaceShiftSpec


class PlaceShift:
    """That of one unit; none of a skin without a record. Angles are the model's [rad]."""

    def __init__(self, record: PlaceShiftSpec | None = None) -> None:
        self.known = record is not None
        record = record or PlaceShiftSpec(angles=(0.0,), shifts=(0.0,), covariance=((0.0,),))
        self._told, self._shifts = np.array(record.angles), np.array(record.shifts)
        self._covariance = np.array(record.covariance)

    def taken_off(self, felt: Floats) -> Floats:
        """Where contacts are that are felt somewhere."""
        return np.asarray(felt - np.interp(felt, self._told + self._shifts, self._shifts))

    def felt(self, told: Floats) -> Floats:
        """Where contacts are felt that are somewhere."""
        return np.asarray(told + np.interp(told, self._told, self._shifts))

    def covariance(self, felt: Floats) -> Floats:
        """Of the places of contacts of frames [frame, contact, contact] [rad^2]."""
        told, nodes = self.taken_off(felt), np.eye(len(self._told))
        share = np.stack([np.interp(told, self._told, own) for own in nodes], -1)
        return np.asarray(share @ self._covariance @ np.swapaxes(share, 1, 2))
