"""Known loads that took no part in the fit, estimated with the calibrated skin."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.calibration.plan import Press
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.readings import readings_of
from suas_jax.acquisition.baseline import Baseline
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.acquisition.missing import mean
from suas_jax.config import SkinSpec

_ANGLE, _AXIAL, _FORCE = math.radians(2.0), 2e-3, 0.1  # tolerated: angle, place, share of force
_ERRORS = 3.0  # standard errors that are tolerated, too


@dataclass(frozen=True)
class Verification:
    """One known load and what was estimated.

    Attributes:
        press: the known load.
        status: of the estimate.
        angle: estimated [rad]; NaN where nothing was found.
        force: likewise [N].
        axial: likewise on a pad [m].
        passed: whether it is within 2 degrees, 2 mm and 10 % of the force, or three standard
            errors.
    """

    press: Press
    status: str
    angle: float
    force: float
    axial: float | None
    passed: bool


def verify(
    spec: SkinSpec, baseline: Baseline, logs: Sequence[tuple[Press, Path]]
) -> list[Verification]:
    """Estimate known loads.

    Args:
        spec: the calibrated skin.
        baseline: at rest, from which the readings count.
        logs: the known loads, and their logs.
    """
    from fitting.inverse_load.readings import Layout

    rest, variance = Layout(spec).baseline(baseline, "rest")
    # A pad's estimator carries no calibration's errors; readings count from rest anyway.
    bare = spec.model_copy(update={"calibration": None})
    estimator = LoadEstimator(bare, rest=rest, rest_variance=variance, most_contacts=1)
    found = []
    for press, path in logs:
        readings = readings_of(read_log(path), spec, estimator.reading_noise)
        so = np.where(readings.stuck, np.nan, readings.so)
        (estimate,) = estimator.estimate(mean(so)[None])
        if not estimate.contacts:
            found.append(Verification(press, estimate.status, math.nan, math.nan, None, False))
            continue
        contact = max(estimate.contacts, key=lambda c: c.force)
        errors = {
            "angle": abs(contact.angle - press.angle) / _allowed(contact, "angle", _ANGLE),
            "force": abs(contact.force - press.force)
            / _allowed(contact, "force", _FORCE * press.force),
        }
        if contact.axial is not None and press.axial is not None:
            allowed = _allowed(contact, "axial", _AXIAL)
            errors["axial"] = abs(contact.axial - press.axial) / allowed
        found.append(
            Verification(
                press,
                estimate.status,
                contact.angle,
                contact.force,
                contact.axial,
                max(errors.values()) <= 1.0,
            )
        )
    return found


def _allowed(contact: object, name: str, tolerance: float) -> float:
    deviation = contact.deviation(name)  # type: ignore[attr-defined]
    return max(tolerance, _ERRORS * deviation if math.isfinite(deviation) else 0.0)
