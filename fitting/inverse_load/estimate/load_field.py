"""A load field: what presses a skin where no small number of contacts explains the readings."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Interval(NamedTuple):
    """A quantity with the interval that holds it in 95 of 100 cases."""

    value: float  # of the likeliest forces
    low: float
    high: float


@dataclass(frozen=True)
class LoadField:
    """A pressure on the outer face, told by its sums; forces are along the inward normal."""

    force: Interval  # total [N]
    right: Interval  # sum of the forces as vectors, to the right [N]
    up: Interval  # the same towards the crown [N]
    angle: Interval  # of the forces' centre, as scenes state it [rad]
    # diameter along the arc of the even ellipse with the forces' second moments [m]
    arc_extent: Interval
    # by how much -2 log(evidence) is less than that of the contacts
    preferred_by: float
    arc: Interval | None = None  # of the centre: arc length of the inner face; None on a circle
    axial: Interval | None = None  # of the centre, from the middle of a pad [m]
    axial_extent: Interval | None = None  # likewise along the axis [m]


FIELD_QUANTITIES = {
    "force": ("force_N", 1.0),
    "angle": ("angle_deg", 180 / np.pi),
    "arc": ("arc_m", 1.0),
    "axial": ("axial_m", 1.0),
    "arc_extent": ("extent_arc_m", 1.0),
    "axial_extent": ("extent_axial_m", 1.0),
    "right": ("resultant_right_N", 1.0),
    "up": ("resultant_up_N", 1.0),
}
"""Keys of a field's quantities in JSON, and what SI units are multiplied by there."""


def interval_key(key: str) -> str:
    """The key of a quantity's interval."""
    name, _, unit = key.rpartition("_")
    return f"{name}_interval_{unit}"
