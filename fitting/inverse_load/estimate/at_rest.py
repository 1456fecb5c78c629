"""Estimates of frames that nothing touches, and what drift at rest adds to any status."""

from dataclasses import replace
from typing import Any

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.fit.detection import without_errors
from suas_jax.acquisition.taxel_faults import saturated

_DRIFTING = 3.0  # counts of drift beyond which a status says so


def chi2_at_rest(change: Any, weight: Any, errors: Floats | None) -> Floats:
    """Weighted squares of the change from rest that no error of the inputs explains."""
    left = change
    if errors is not None and errors.any():
        left, _ = without_errors(change, weight, errors)
    return np.asarray((weight * left * change).sum(1))


def drifting(estimate: LoadEstimate, mean: float, largest: float) -> LoadEstimate:
    """An estimate with the drift that was taken off its readings."""
    names = {"no_contact": "drifting", "ok": "ok_drifted"}
    far = abs(largest) > _DRIFTING
    status = names.get(estimate.status, estimate.status) if far else estimate.status
    return replace(estimate, status=status, drift=(mean, largest))


def untouched(so: Any, used: Any, enough: bool, ratio: float, pressure: float) -> LoadEstimate:
    """The estimate of a frame that shows no contact, or has too few readings to show one.

    Readings are [taxel] [counts]; the ratio is chi2 per degree of freedom, the
    pressure that of the oil at rest [Pa].
    """
    missing = tuple(np.flatnonzero(~used).tolist())
    if not enough:
        present = so[np.isfinite(so)]
        at_limits = present.size and saturated(present).all()
        status = "saturated" if at_limits else "too_few_taxels"
        return LoadEstimate(None, status=status, left_out=missing)
    return LoadEstimate(False, (), pressure, False, ratio, "no_contact", missing)
