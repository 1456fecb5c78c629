"""How far off the places of a section's presses are, each by itself and all together.

A press at the angle a is felt m(a) + u_k further along the arc than it was told. A ruler's zero
is the same for all presses, and a bar that stands askew, or presses one side harder, is felt
beside where it presses, by a length that changes along the arc::

    u_k ~ N(0, s^2),    cov(m(a), m(a')) = s^2 + t^2 (1 + exp(-(a - a')^2 / 2 l^2))

s is what is stated of places, t what a bar that a hand holds does.
"""

import math
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from suas_jax.config.geometry import GeometrySpec
from suas_jax.skin.plain import plain_geometry

# t: a bar that stands a degree askew is felt 0.005 rad to a side at the paper's skin's crown,
# and hardly at 45 degrees; l is how soon that changes (`benchmarks/as_built.py`) [rad].
_ASKEW, _REACH = 0.0085, 0.35
_STEP = 0.27  # between places of a table, at most: good to 0.0005 rad [rad]


class PlaceErrors(NamedTuple):
    """Errors of presses' places on a section, before any reading."""

    angle: Floats  # of the presses [press] [rad]
    own: float  # s [rad]

    @property
    def covariance(self) -> Floats:
        """Of the errors [press, press] [rad^2]."""
        return self._shared(self.angle, self.angle) + self.own**2 * np.eye(len(self.angle))

    def shared(self, found: Floats, covariance: Floats, at: Floats) -> tuple[Floats, Floats]:
        """What is shared at some places, with its covariance, from the errors' posterior.

        `found`: the errors [press]. `covariance`: theirs [press, press]. `at`: angles [place].
        """
        across = self._shared(at, self.angle)
        gain = np.linalg.solve(self.covariance, across.T).T
        left = self._shared(at, at) - gain @ across.T
        return gain @ found, left + gain @ covariance @ gain.T

    def _shared(self, one: Floats, other: Floats) -> Floats:
        near = np.exp(-((one[:, None] - other) ** 2) / (2 * _REACH**2))
        return np.asarray(self.own**2 + _ASKEW**2 * (1 + near))


def places_of_shifts(spec: GeometrySpec) -> Floats:
    """Angles between which what presses share is interpolated [place] [rad]."""
    edge = float(plain_geometry(spec).half_angle[0])
    return np.linspace(-edge, edge, 1 + 2 * math.ceil(edge / _STEP))


def shift_of_loads(shared: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """What places of loads to come are off by, and its covariance [place, place].

    Where a bar stood askew, a finger that presses straight is not off as the presses were;
    where the ruler's zero was, it is. Presses do not tell which, so half of what they share is
    taken off, and intervals hold either way.
    """
    return shared / 2, covariance + np.outer(shared, shared) / 4
