"""A load field: what presses a skin where no small number of contacts explains the readings."""

from dataclasses import dataclass
from typing import NamedTuple


class Interval(NamedTuple):
    """A quantity with the interval that holds it in 95 of 100 cases."""

    value: float  # of the likeliest forces
    low: float
    high: float


@dataclass(frozen=True)
class LoadField:
    """A pressure on the outer face, told by its sums; forces are along the inward normal."""

    force: Interval  # total [N]
    # sum of the forces as vectors: to the right and towards the crown [N]
    resultant: tuple[Interval, Interval]
    angle: Interval  # of the forces' centre, as scenes state it [rad]
    # diameter along the arc of the even ellipse with the forces' second moments [m]
    arc_extent: Interval
    # by how much -2 log(evidence) is less than that of the contacts
    preferred_by: float
    arc: Interval | None = None  # of the centre: arc length of the inner face; None on a circle
    axial: Interval | None = None  # of the centre, from the middle of a pad [m]
    axial_extent: Interval | None = None  # likewise along the axis [m]
