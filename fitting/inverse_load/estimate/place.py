"""Where a contact is: from the model's angle to the place that a scene states."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from fitting.arrays import Floats
from suas_jax.config.geometry import GeometrySpec
from suas_jax.config.schema_calibration import PlaceShiftSpec

if TYPE_CHECKING:
    from suas_jax.skin.geometry import SkinGeometry


class PlaceShift:
    """How much further along the arc than they are contacts on a unit are felt.

    As presses show; none of a skin without a record. Angles are the model's [rad].
    """

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


_NONE = PlaceShift()


class ArcTable(NamedTuple):
    """Places along the arc of one skin, as numbers."""

    outer_size: float  # [m]
    thickness: float  # [m]
    half_angle: float  # [rad]
    # the model's angle at places [place] [rad]; none on a circle, where nothing needs a table
    angle: Floats
    # there: the angle that scenes tell [rad], arc lengths of the inner and the outer face [m]
    rows: Floats  # [place, 3]

    @classmethod
    def of(cls, spec: GeometrySpec, geometry: "SkinGeometry") -> "ArcTable":
        """That of a skin's model."""
        thickness, edge = float(geometry.thickness[0]), float(geometry.half_angle[0])
        if spec.is_circle:
            none = np.zeros(0), np.zeros((0, 3))
            return cls(float(geometry.outer_size[0]), thickness, edge, *none)
        from fitting.inverse_load.estimate.arc_table import arc_table

        outer, *places = arc_table(geometry)
        return cls(outer, thickness, edge, *places)


class ContactPlaces:
    """Places along the arc of one skin, as its scenes state them.

    They are made from the [geometry] table and places along its arc. `shift` is how far from
    where they are contacts are felt, which the model's angle tells.
    """

    def __init__(self, spec: GeometrySpec, arc: ArcTable, shift: PlaceShift = _NONE) -> None:
        # name of the coordinate that is estimated: "arc", the arc length of the inner face from
        # its middle [m], where the section knows no angle; else "angle" [rad]
        self.name = "angle" if spec.has_angle else "arc"
        self._circle = spec.is_circle
        self._outer_size = arc.outer_size
        self._inner_size = arc.outer_size - arc.thickness
        if not spec.is_circle:
            self._rows = arc.angle, arc.rows
            self._table = CubicSpline(*self._rows)
        self.shift = shift
        # the estimated coordinate of the right clamped edge, which no press tells
        self.edge = float(self.estimated(shift.felt(np.asarray(arc.half_angle))))

    @classmethod
    def of(
        cls, spec: GeometrySpec, geometry: "SkinGeometry", shift: PlaceShift = _NONE
    ) -> "ContactPlaces":
        """Those of a skin's model."""
        return cls(spec, ArcTable.of(spec, geometry), shift)

    def angle(self, angle: Floats) -> Floats:
        """The angle that a scene calls so; of a path or spline that of the normal [rad]."""
        angle = self.shift.taken_off(angle)
        return angle if self._circle else self._table(angle)[..., 0]

    def arc(self, angle: Floats) -> Floats | None:
        """Arc length of the inner face from its middle [m]; None on a circle."""
        return None if self._circle else self._table(self.shift.taken_off(angle))[..., 1]

    def outer_arc(self, angle: Floats) -> Floats:
        """The same of the outer face [m]."""
        angle = self.shift.taken_off(angle)
        return angle * self._outer_size if self._circle else self._table(angle)[..., 2]

    def estimated(self, angle: Floats) -> Floats:
        """The coordinate that is estimated, see `name`."""
        found = self.arc(angle) if self.name == "arc" else self.angle(angle)
        assert found is not None
        return found

    def shown(self, angle: Floats) -> tuple[Floats, str]:
        """That coordinate for a person, and what it is with its unit."""
        if self.name == "arc":
            return 1e3 * self.estimated(angle), "arc [mm]"
        return np.rad2deg(self.estimated(angle)), "angle [deg]"

    def inner_arc(self, angle: Floats) -> Floats:
        """Arc length of the inner face from its middle [m], of a circle too."""
        angle = self.shift.taken_off(angle)
        return angle * self._inner_size if self._circle else self._table(angle)[..., 1]

    def outer_rate(self, angle: Floats) -> Floats:
        """Length of the outer face per angle of the model [m]."""
        if self._circle:
            return np.full(np.shape(angle), self._outer_size)
        return np.asarray(self._table(angle, 1)[..., 2])

    def from_place(self, name: str, place: Floats) -> Floats:
        """The model's angle of places that are told by "angle" [rad] or "arc" [m]."""
        if self._circle:
            return self.shift.felt(place if name == "angle" else place / self._inner_size)
        angle, rows = self._rows
        return self.shift.felt(np.interp(place, rows[:, int(name == "arc")], angle))

    def coordinates(self, angle: Floats) -> dict[str, Floats]:
        """Places by key, as reports tell them."""
        told, arc = {"angle_deg": np.rad2deg(self.angle(angle))}, self.arc(angle)
        return told if arc is None else {**told, "arc_m": arc}

    def keys(self, angle: Floats) -> dict[str, float]:
        """A place as reports tell it."""
        return {key: float(value) for key, value in self.coordinates(angle).items()}

    def error_keys(self, angle: Floats, error: float) -> dict[str, float]:
        """An error of the model's angle at a place, as one of what is estimated there."""
        own = float(error * np.abs(self.slope(angle)))
        known = self.name == "arc"
        return {"arc_error_m": own} if known else {"angle_error_deg": float(np.rad2deg(own))}

    def slope(self, angle: Floats) -> Floats:
        """Its derivative by the model's angle."""
        if self._circle:
            return np.ones_like(angle)
        return np.asarray(self._table(angle, 1)[..., int(self.name == "arc")])
