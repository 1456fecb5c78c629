"""The oil's measured pressure against that of the contacts that explain a frame's readings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import LoadEstimate

_FAR = 3.5  # standard deviations


def contradicted(estimate: LoadEstimate, channels: Floats, weight: Floats) -> bool:
    """Whether the pressure, last of a frame's channels, speaks against contacts with errors.

    At the same readings pressure and force are in proportion to the membrane's stiffness: what
    is not known of all forces alike is as little known of the pressure.
    """
    force = sum(abs(contact.force) for contact in estimate.contacts)
    if not force or weight[-1] <= 0:
        return False
    share = sum(contact.deviation("force") for contact in estimate.contacts) / force
    off = abs(channels[-1] - estimate.oil_pressure)
    return bool(off > _FAR * np.hypot(weight[-1] ** -0.5, share * estimate.oil_pressure))


def with_doubts(
    estimates: Sequence[LoadEstimate], channels: Floats, weight: Floats
) -> list[LoadEstimate]:
    """Estimates of frames [frame, channel]; none holds that its pressure contradicts."""
    return [
        replace(estimate, status="ambiguous")
        if estimate.status in ("ok", "imprecise") and contradicted(estimate, y, w)
        else estimate
        for estimate, y, w in zip(estimates, channels, weight, strict=True)
    ]
