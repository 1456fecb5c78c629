"""Solved states of several contacts, and of a wide one: what corrects the interpolant."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.interpolant import ASKEW, PLAIN, Correction, PadInterpolant
from suas_jax.equilibrium.state import State

if TYPE_CHECKING:
    from suas_jax.scene.skin import Skin

# Live, a correction is kept while contacts move by less than this and forces, extents and turns
# change by that share; in a log by a fifth of that.
_NEAR, _SHARE = 2.5e-3, 0.15
_STRICT = 0.2
_STRIP = 2.5  # length over width from which on a contact is a rectangle
_POINTS = 12  # along each side of a rectangle; as many over an ellipse


def near(
    kept: Correction, parameters: Floats, contacts: int, radius: float, *, live: bool
) -> bool:
    """Whether a correction holds well enough for other contacts.

    Parameters are those of the other contacts [parameter]; the radius is that of the outer face
    [m]. Live, time counts more than accuracy.
    """
    share = 1.0 if live else _STRICT
    if len(kept.parameters) != len(parameters):
        return False
    old, new = (x.reshape(-1, contacts).T for x in (kept.parameters, parameters))
    moved = np.hypot(radius * (old[:, 0] - new[:, 0]), old[:, 1] - new[:, 1])
    change = np.abs(old[:, 2] - new[:, 2])
    still = (moved < share * _NEAR) & (change < share * _SHARE * np.abs(new[:, 2]))
    if len(old[0]) == PLAIN:
        return bool(still.all())
    rows = [4, ASKEW - 1] if len(old[0]) == ASKEW else [4]
    shape = np.append(np.log(new[:, 3] / old[:, 3]), new[:, rows] - old[:, rows])
    return bool(still.all()) and bool((np.abs(shape) < share * _SHARE).all())


class SolvedContacts:
    """Solves contacts on a pad; one compiled program for any number of discs.

    A contact that is much longer than wide presses a rectangle evenly, another wide one an
    ellipse, of the second moments that the fit found. Either is many forces at points, on the
    even mesh of load fields: a pressure so wide needs none that is graded around it.
    """

    def __init__(
        self,
        skin: "Callable[[], Skin]",  # made when contacts are first solved
        interpolant: PadInterpolant,  # what is corrected
        most_contacts: int,  # at a time
        radius: float,  # of the outer face [m]
    ) -> None:
        self._skin, self._interpolant, self._radius = skin, interpolant, radius
        self._most = max(most_contacts, 2)
        self._start: State | None = None

    def correction(self, parameters: Floats, contacts: int) -> Correction | None:
        """Solve some contacts of the table's diameter; None where no state was found.

        The parameters are angles, axial positions and inward forces [parameter].
        """
        from suas_jax.scene.forward import forward
        from suas_jax.scene.loads import Loads

        rows, table = parameters.reshape(-1, contacts), self._interpolant.table
        # What is not used lies where the first one is, without a force.
        columns = np.array([np.append(x, np.full(self._most - contacts, x[0])) for x in rows])
        columns[2, contacts:] = 0.0
        columns[2, :contacts] = table.force_on_mesh(*columns[:, :contacts])
        angle, axial, force = columns[..., None]
        found = forward(self._skin(), Loads.patch(angle, axial, force, table.diameter))
        if not bool(found.solved[0]):
            return None
        numbers = float(found.oil_pressure[0]), float(found.min_gap[0])
        so = np.asarray(found.so)[:, 0]
        return self._interpolant.left_out(parameters, contacts, so, *numbers)

    def correction_of_wide(self, parameters: Floats) -> Correction | None:
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
