"""A table of solved states of one round contact on a pad: where every estimate begins.

Readings are tabulated as reciprocals u = 1 / (SO - stray), which are nearly the gaps and
change smoothly with the load. Places are even over the pad, forces are shares of the force
that leaves little of the gap there.
"""

import functools
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.spline import TensorSpline

LEVELS = np.array([-0.3, -0.12, 0.0, 0.12, 0.28, 0.46, 0.64, 0.82, 1.0])
"""Forces as shares of the largest, rest among them; pulls are told as far as the first.

Two are pulls: soft pads harden so much under them that one alone leaves other pulls and light
pushes several per cent off.
"""
# Shares of the largest force, of nodes beside the table's own: a contact much lighter than all
# nodes at its place looks like a hard one far away.
_LIGHTLY = np.array([0.015, 0.03, 0.06])


def grid(*axes: Floats) -> Floats:
    """Places of a grid of coordinates [place, axis]."""
    return np.stack([x.reshape(-1) for x in np.meshgrid(*axes, indexing="ij")], 1)


def reciprocal(force: Floats) -> Floats:
    """Reciprocals of forces, infinite for those that aren't above zero, and back."""
    finite = np.isfinite(force) & (force > 1e-9)
    return np.where(
        np.isinf(force), 0.0, np.where(finite, 1 / np.where(finite, force, 1.0), np.inf)
    )


@dataclass(frozen=True)
class PadResolution:
    """How finely a table is made."""

    # of the meshes, along the arc and along the axis; None for as many as pads have
    elements: tuple[int, int] | None = None
    spacing: float = 5.3e-3  # of the table's places [m]
    # places along arc and axis at which the largest force is sought
    probes: tuple[int, int] = (4, 3)
    # elements of a mesh whose readings the table's forces are corrected for, which is solved at
    # the probes alone; None for none
    finer: tuple[int, int] | None = None


FINE = PadResolution(finer=(36, 30))
"""Right for the paper's membrane of 1.5 mm; a thicker one needs less."""


@dataclass(frozen=True)
class PadTable:
    """States under one radial contact of a given diameter."""

    angle: Floats  # of the contact [angle, rad]
    axial: Floats  # of the contact [axial, m]
    cap: Floats  # largest force of the table [angle, axial] [N]
    # force at which the membrane reaches the wall [angle, axial] [N]; infinite where that is
    # far beyond the table
    first_contact: Floats
    u: Floats  # reciprocal readings [angle, axial, level, taxel] [1/counts]
    pressure: Floats  # of the oil [angle, axial, level] [Pa]
    # share of the force by which the table's mesh was loaded more, to read what a finer mesh
    # reads [angle, axial, level]
    surplus: Floats
    rest: Floats  # readings at rest [taxel] [counts]
    stray: Floats  # part of the readings that no gap changes [taxel] [counts]
    # derivatives of u and, last, of the pressure by a further force along growing angles and by
    # one along the axis, at some of the places [across_angle, across_axial, level, 2, channel]
    across: Floats
    across_angle: Floats  # angles of these places [rad]
    across_axial: Floats  # their axial positions [m]
    diameter: float  # of the contact [m]
    # standard deviations of a contact that is found by the table, beside those of every pad's,
    # in even parts of the way from the middle to the edges [part of the arc, of the axis]:
    # place along arc and axis [m], relative force; none where they are zero
    place_error: Floats = field(default_factory=lambda: np.zeros((1, 1)))
    force_error: Floats = field(default_factory=lambda: np.zeros((1, 1)))
    # the same of readings' changes from rest, relative, all over the pad []
    reading_error: Floats | float = 0.0

    @property
    def rest_pressure(self) -> float:
        """Of the oil, without contacts [Pa]."""
        return float(self.pressure[0, 0, LEVELS == 0][0])

    @functools.cached_property
    def spline(self) -> TensorSpline:
        """Of the changes of u from rest and, as the last channel, the oil's pressure."""
        change = self.u - 1 / (self.rest - self.stray)
        both = np.concatenate([change, self.pressure[..., None]], -1)
        return TensorSpline.through((self.angle, self.axial, LEVELS), both)

    @functools.cached_property
    def tangential(self) -> TensorSpline:
        """Of the derivatives by tangential forces, those along the arc first."""
        nodes = self.across_angle, self.across_axial, LEVELS
        spline = TensorSpline.through(nodes, self.across.reshape(*self.across.shape[:3], -1))
        return replace(spline, coefficients=spline.coefficients.astype(np.float32))

    @functools.cached_property
    def largest(self) -> TensorSpline:
        """Of the logarithm of the largest force."""
        return TensorSpline.through((self.angle, self.axial), np.log(self.cap)[..., None])

    def first_contact_at(self, angle: Floats, axial: Floats) -> Floats:
        """Force of one contact at which the membrane reaches the wall [place] [N].

        The contact is at an angle [rad] and an axial position [m], each [place].
        """
        inverse = reciprocal(self.first_contact)
        i, j = (
            np.clip(np.searchsorted(x, v, side="right") - 1, 0, len(x) - 2)
            for x, v in ((self.angle, angle), (self.axial, axial))
        )
        a = (angle - self.angle[i]) / (self.angle[i + 1] - self.angle[i])
        b = (axial - self.axial[j]) / (self.axial[j + 1] - self.axial[j])
        value = (1 - a) * ((1 - b) * inverse[i, j] + b * inverse[i, j + 1])
        value = value + a * ((1 - b) * inverse[i + 1, j] + b * inverse[i + 1, j + 1])
        return np.asarray(1 / np.maximum(value, 1e-9))

    def force_on_mesh(self, angle: Floats, axial: Floats, force: Floats) -> Floats:
        """Force under which the table's mesh reads what a finer mesh reads [contact] [N].

        Contacts have an angle [rad], an axial position [m] and a force [N], each [contact].
        """
        cap = np.exp(self.largest(angle, axial)[0][:, 0])
        level = np.clip(force / cap, LEVELS[0], LEVELS[-1])
        return np.asarray(force * (1 + self._surplus(angle, axial, level)[0][:, 0]))

    def errors_at(self, angle: Floats, axial: Floats) -> tuple[Floats, Floats]:
        """`place_error` and `force_error` of contacts, each [contact].

        Their logarithms are linear in between, as errors grow towards clamps many times over.
        Contacts have an angle [rad] and an axial position [m], each [contact].
        """
        values = np.stack([self.place_error, self.force_error])
        if not values.all():
            return np.zeros_like(angle), np.zeros_like(angle)
        shares = []
        for x, edge, n in (
            (angle, self.angle[-1], values.shape[1]),
            (axial, self.axial[-1], values.shape[2]),
        ):
            at = np.abs(x) / edge * n - 0.5  # in terms of the parts' middles
            low = np.clip(at.astype(int), 0, max(n - 2, 0))
            high, own = np.minimum(low + 1, n - 1), np.eye(n)
            shares.append(own[low] + (at - low)[:, None] * (own[high] - own[low]))
        found: Floats = np.exp(np.einsum("ca,cz,kaz->kc", *shares, np.log(values)))
        return found[0], found[1]

    @functools.cached_property
    def _surplus(self) -> TensorSpline:
        nodes = self.angle, self.axial, LEVELS
        return TensorSpline.through(nodes, self.surplus[..., None])

    @functools.cached_property
    def places(self) -> Floats:
        """Angle and axial position of every place [place, 2]."""
        return grid(self.angle, self.axial)

    @functools.cached_property
    def signatures(self) -> Floats:
        """Change of channels per newton of a light contact [place, channel]."""
        rest = 1 / (self.rest - self.stray)
        level = int(np.flatnonzero(LEVELS > 0)[0])
        so = -(self.u[:, :, level] - rest) / rest**2
        both = np.concatenate([so, self.pressure[:, :, level, None]], -1)
        slope = both / (LEVELS[level] * self.cap)[..., None]
        return np.asarray(slope.reshape(-1, slope.shape[-1]))

    def thinned(self, every: int) -> "PadTable":
        """The table at some of its places only, the outermost among them."""
        i, j = (
            np.unique(np.append(np.arange(0, len(x), every), len(x) - 1))
            for x in (self.angle, self.axial)
        )
        at = np.ix_(i, j)
        return replace(
            self,
            angle=self.angle[i],
            axial=self.axial[j],
            cap=self.cap[at],
            first_contact=self.first_contact[at],
            u=self.u[at],
            pressure=self.pressure[at],
            surplus=self.surplus[at],
        )

    @functools.cached_property
    def nodes(self) -> tuple[Floats, Floats]:
        """Loads and channels of states that press, lightly ones too.

        Loads are (angle, axial, force) [node, 3], channels the readings and, last, the oil's
        pressure [node, channel].
        """
        used = LEVELS > 0
        lightly = self.spline(*grid(self.angle, self.axial, _LIGHTLY).T)[0]
        change = lightly.reshape(*self.cap.shape, len(_LIGHTLY), -1)
        u = np.concatenate(
            [1 / (self.rest - self.stray) + change[..., :-1], self.u[:, :, used]], 2
        )
        pressure = np.concatenate([change[..., -1], self.pressure[:, :, used]], 2)
        so = np.minimum(self.stray + 1 / np.maximum(u, 1e-12), 1e6)
        both = np.concatenate([so, pressure[..., None]], -1)
        force = self.cap[..., None] * np.append(_LIGHTLY, LEVELS[used])
        place = np.repeat(self.places, force.shape[-1], 0)
        loads = np.concatenate([place, force.reshape(-1, 1)], 1)
        return loads, both.reshape(-1, both.shape[-1])
