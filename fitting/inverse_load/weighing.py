"""Readings as the model has them, and how much each counts.

A reading's variance is the converter's noise, its rounding (1/12), a baseline's own error, that
of the drift taken off, and the model's error in terms of the change from rest.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.drift import Drift
from suas_jax.acquisition.taxel_faults import saturated
from suas_jax.config import SkinSpec

ROUNDING = 1 / 12  # variance of a converter's rounding [counts^2]


@dataclass(frozen=True)
class ReadingWeights:
    """What turns readings into the model's, with inverse variances.

    Attributes:
        zero: what is taken off readings [taxel] [counts]; NaN: the taxel is not used.
        variance: of a reading, without the model's error [taxel] [counts^2].
        model_rest: the model's readings at rest [taxel] [counts].
        model_error: relative error of the model's change of readings.
        pressure_noise: standard deviation of a measured oil pressure [Pa], infinite where
            there is none; None in plane strain, where there is no such column.
    """

    zero: NDArray[np.float64]
    variance: NDArray[np.float64]
    model_rest: NDArray[np.float64]
    model_error: float
    pressure_noise: float | None

    @property
    def taxels(self) -> int:
        """Number of taxels in the layout."""
        return len(self.model_rest)

    def change_from_rest(
        self, so: NDArray[np.float64], faulty: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Readings less those at rest [frame, taxel]; NaN where a taxel can't be used."""
        used = np.isfinite(so) & (so > 0) & ~saturated(so) & ~faulty
        return np.where(used, so - self.zero - self.model_rest, np.nan)

    def weigh(
        self,
        so: NDArray[np.float64],
        faulty: NDArray[np.bool_] | None = None,
        pressure: NDArray[np.float64] | None = None,
        drift: Drift | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Readings as the model has them, and their inverse variances.

        Args:
            so: readings [frame, taxel] [counts]; NaN where missing.
            faulty: taxels known to be faulty [frame, taxel].
            pressure: measured of the oil [frame] [Pa]; NaN where missing.
            drift: of the readings at rest.

        Returns:
            Readings [counts] and inverse variances [1/counts^2], both zero where a taxel is
            missing, saturated (0 or full scale) or faulty. On a pad the last column is the
            oil's pressure [Pa], [1/Pa^2].
        """
        y, variance = so - self.zero, self.variance
        if drift is not None:
            y, variance = y - drift.offset, variance + drift.variance
        used = np.isfinite(y) & ~saturated(so)
        if faulty is not None:
            used &= ~faulty
        y = np.where(used, y, 0.0)
        change = np.where(used, y - self.model_rest, 0.0)
        weight = used / (variance + (self.model_error * change) ** 2)
        if self.pressure_noise is None:
            return y, weight
        p = np.full(len(so), np.nan) if pressure is None else np.asarray(pressure, float)
        known = np.isfinite(p) & np.isfinite(self.pressure_noise)
        p = np.where(known, p, 0.0)
        sigma = self.pressure_noise if np.isfinite(self.pressure_noise) else 1.0
        own = known / (sigma**2 + (self.model_error * p) ** 2)
        return np.column_stack([y, p]), np.column_stack([weight, own])


def zero_of_readings(
    spec: SkinSpec,
    model_rest: NDArray[np.float64],
    rest: NDArray[np.float64] | None,
    rest_variance: NDArray[np.float64] | float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What is taken off readings to compare them with the model, and its variance.

    Args:
        spec: the skin; its calibration may have offsets.
        model_rest: the model's readings at rest [taxel] [counts].
        rest: those of a baseline; None: readings are absolute.
        rest_variance: of `rest` [counts^2].

    Raises:
        ValueError: a calibration has offsets for another number of taxels.
    """
    if rest is not None:
        return rest - model_rest, np.asarray(rest_variance, float)
    taxels, record = len(model_rest), spec.calibration
    if record is None or not record.offsets:
        return np.zeros(taxels), np.zeros(taxels)
    if len(record.offsets) != taxels:
        raise ValueError(
            f"[calibration] offsets: {len(record.offsets)} numbers for the skin's "
            f"{taxels} taxels"
        )
    errors = record.offset_errors or np.zeros(taxels)
    return np.array(record.offsets, float), np.nan_to_num(np.square(errors))
