"""Solved states of one wide contact: what the interpolant's discs over a box leave out.

A contact that is much longer than wide presses a rectangle evenly, another one an ellipse,
of the second moments that the fit found. Either is many forces at points, on the even mesh of
load fields: a pressure so wide needs none that is graded around it.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.interpolant import ASKEW, PLAIN, Correction, PadInterpolant
from suas_jax.equilibrium.state import State

if TYPE_CHECKING:
    from suas_jax.scene.skin import Skin

_STRIP = 2.5  # length over width from which on a contact is a rectangle
_POINTS = 12  # along each side of a rectangle; as many over an ellipse


class SolvedPatch:
    """Solves one wide contact on a pad; the interpolant is what is corrected.

    The radius is that of the outer face [m]; for the skin see `SolvedContacts`.
    """

    def __init__(
        self, skin: "Callable[[], Skin]", interpolant: PadInterpolant, radius: float
    ) -> None:
        self._skin, self._interpolant, self._radius = skin, interpolant, radius
        self._start: State | None = None

    def correction(self, parameters: Floats) -> Correction | None:
        """Solve a contact with WHOLE or ASKEW parameters; None where no state was found.

        What tangential forces add is the interpolant's.
        """
        from fitting.inverse_load.field.forward import FieldForward, FieldNodes

        radial = parameters.copy()
        radial[PLAIN + 2 : ASKEW - 1] = 0.0
        places, share = patch_points(radial, self._radius)
        skin = self._skin()
        model = FieldForward(skin, FieldNodes.at(skin, places))
        if self._start is None:
            self._start = model.rest()
        found = model.state(radial[2] * share, self._start)
        if int(found.outcome) != 0:
            return None
        solved = np.asarray(found.so), float(found.pressure), float(found.min_gap)
        missing = self._interpolant.left_out(radial, 1, *solved)
        return missing._replace(parameters=parameters.copy())


def patch_points(parameters: Floats, radius: float) -> tuple[Floats, Floats]:
    """Points of a contact's face [point, (angle, axial)], and the share of the force at each.

    The radius is that of the outer face [m].
    """
    diameter, slender = parameters[3:5]
    turn = parameters[ASKEW - 1] if len(parameters) == ASKEW else 0.0
    half = diameter / 2 * np.exp(slender * np.array([1.0, -1.0]))
    node, weight = np.polynomial.legendre.leggauss(_POINTS)
    if np.exp(2 * abs(slender)) >= _STRIP:  # sides of a rectangle with the second moments
        x, y = np.meshgrid(node, node, indexing="ij")
        unit, share = np.sqrt(3) / 2 * np.stack([x, y], -1), np.outer(weight, weight) / 4
    else:
        way = 2 * np.pi * np.arange(_POINTS) / _POINTS
        ring = np.sqrt((1 + node) / 2)[:, None]
        unit = np.stack([ring * np.cos(way), ring * np.sin(way)], -1)
        share = np.repeat(weight[:, None] / (2 * _POINTS), _POINTS, 1)
    along: Any = unit.reshape(-1, 2) * half
    cos, sin = np.cos(turn), np.sin(turn)
    metres = along @ np.array([[cos, sin], [-sin, cos]])
    return parameters[:2] + metres / [radius, 1.0], share.reshape(-1)
