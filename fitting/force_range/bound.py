"""Cramér-Rao bounds of a load from a skin's taxels, before and after it reaches the wall.

No unbiased estimate of a load's angle and force has a smaller covariance than (J^T W J)^-1,
with the exact derivatives J of all readings and their inverse variances W: the converter's
noise, its rounding, 1/12, and the model's error, a share of the reading's change from rest.
Saturated taxels say nothing. Once the membrane lies on the wall nearly all further load goes
there, and the bound on the force grows by orders of magnitude: there the range ends.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Flags, Floats
from fitting.force_range.inputs import contact_deviation
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.fit.covariance import inverse
from fitting.inverse_load.model.evaluation import NoRestError
from fitting.inverse_load.readings import noise_of_readings
from fitting.inverse_load.settings import MODEL_ERROR
from suas_jax.config import SkinSpec
from suas_jax.config.input_errors import as_assembled
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.forward import forward, load_jacobian
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin, skin_of
from suas_jax.sensing.converter import Converter

TOLD = 0.2
"""Standard deviation, relative to the force, up to which a force can be told."""
LADDER = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 0.95, 0.99)
BEYOND = (1.01, 1.05, 1.15, 1.3, 1.6, 2.0, 3.0, 5.0)
"""Forces at which the bound is evaluated, in terms of first contact: before it and after."""

_CLOSEST = 2.0  # thicknesses from a clamp within which no load is put
_SMALLEST = 1e-3  # force at which the search for first contact starts [N]
_LARGEST = 1e6  # and where it is given up [N]

_95 = 1.96  # standard deviations
_RATED = 0.3  # of the smallest first contact


@dataclass(frozen=True)
class ForceRange:
    """The range of one radial line load over the skin."""

    angle: Floats  # of the load [angle] [rad]
    # force at which the membrane reaches the wall [angle] [N]; NaN where it never does, or
    # where the way there has no equilibrium
    first_contact: Floats
    oil_pressure: Floats  # there [angle] [Pa]
    force: Floats  # at which the bound is evaluated [angle, force] [N]
    force_error: Floats  # least standard deviation of an estimated force [angle, force] [N]
    angle_error: Floats  # of an estimated angle [angle, force] [rad]
    wall_force: Floats  # that the wall carries [angle, force] [N]
    saturated: Flags  # taxels at the converter's limit [angle, force, taxel]
    noise: float  # standard deviation of a reading, rounding included [counts]
    # whether the wall holds the membrane, so that anything beyond first contact is known
    modelled: bool
    along: ContactPlaces  # what scenes call places
    # relative standard deviation of the forces of first contact by the skin file's own inputs,
    # as found in the middle; NaN where it is unknown
    deviation: float = float("nan")

    @property
    def told(self) -> Flags:
        """Whether a force can be told, to `TOLD` of itself [angle, force]."""
        return np.asarray(self.force_error <= TOLD * self.force)

    @property
    def smallest(self) -> Floats:
        """Smallest force that can be told [angle] [N]; NaN where none can."""
        return smallest_told(self.force, self.force_error)

    @property
    def largest(self) -> Floats:
        """Largest force evaluated that can be told, as all from `smallest` on [angle] [N].

        NaN where none can. On the wall a force may be told again that is many times as large.
        """
        begun = np.logical_or.accumulate(self.told, 1)
        ended = np.logical_or.accumulate(begun & ~self.told, 1)
        return _first(self.force[:, ::-1], (self.told & ~ended)[:, ::-1])

    @property
    def saturation(self) -> Floats:
        """Smallest force evaluated at which some taxel is saturated [angle] [N], or NaN."""
        return _first(self.force, np.any(self.saturated, -1))

    def report(self) -> dict[str, Any]:
        """What `suas range --json` prints."""
        return {
            "noise_counts": self.noise,
            "told_relative_error": TOLD,
            "contact_modelled": self.modelled,
            "first_contact_relative_deviation": self.deviation,
            "angles": [self._row(i) for i in range(len(self.angle))],
        }

    def contact_interval(self, i: int) -> tuple[float, float]:
        """95 % interval of the force of first contact at an angle [N]."""
        factor = float(np.exp(_95 * self.deviation))
        force = float(self.first_contact[i])
        return force / factor, force * factor

    def _row(self, i: int) -> dict[str, Any]:
        known = bool(np.isfinite(self.first_contact[i]))
        low, high = self.contact_interval(i)
        at = {
            "force_N": float(self.first_contact[i]),
            "low95_N": low,
            "high95_N": high,
            "oil_pressure_Pa": float(self.oil_pressure[i]),
        }
        points = [
            {
                "force_N": float(self.force[i, k]),
                "wall_contact": bool(self.force[i, k] > self.first_contact[i]),
                "wall_force_N": float(self.wall_force[i, k]),
                "force_error_N": float(self.force_error[i, k]),
                **self.along.error_keys(self.angle[i], self.angle_error[i, k]),
                "saturated_taxels": int(self.saturated[i, k].sum()),
            }
            for k in range(self.force.shape[1])
            if np.isfinite(self.force[i, k])
        ]
        return {
            **self.along.keys(self.angle[i]),
            "first_contact": at if known else None,
            "smallest_force_told_N": float(self.smallest[i]),
            "largest_force_told_N": float(self.largest[i]),
            "saturation_force_N": float(self.saturation[i]),
            "points": points,
        }


def angles_over(skin: Skin, places: int) -> Floats:
    """Angles evenly from clamp to clamp [rad], none closer to one than an element of the mesh.

    Half an element from a clamp first contact comes at 1.4 times the true force.
    """
    geometry = skin.geometry
    half = float(geometry.half_angle[0])
    assert isinstance(skin.elements, int)
    thin = float(_CLOSEST * geometry.thickness[0] / geometry.mid_size[0])
    edge = half - max(thin, 2 * half / skin.elements)
    return np.linspace(-edge, edge, places)


def force_range(
    spec: SkinSpec,  # the skin, with electrodes
    angles: int = 17,  # how many, evenly from clamp to clamp
    # standard deviation of a reading [counts]; the skin file's if None
    noise: float | None = None,
    progress: Callable[[str], None] = lambda text: None,  # called with what is being done
) -> ForceRange:
    """Find where the range of a radial line load ends, for loads over the skin.

    Raises ValueError: the skin has no electrodes or no stable state at rest, or an argument
    makes no sense.
    """
    if angles < 1:
        raise ValueError(f"angles = {angles}: at least one is needed")
    free = skin_of(spec, contact=False)
    deviation = noise_of_readings(spec, noise)
    angle = angles_over(free, angles) if angles > 1 else np.zeros(1)
    progress("first contact")
    rest = readings_at_rest(free, angle)[:, None, None]
    touch, pressure = first_contacts(free, angle)
    held = skin_of(spec)
    ladder = np.array(LADDER + (BEYOND if held.wall is not None else ()))
    force = touch[:, None] * ladder
    progress("what the taxels tell")
    reading = deviation**2 + 1 / 12
    so, jacobian, wall_force, failed = _sensitivities(held, angle, force)
    variance = reading + (MODEL_ERROR * (so - rest)) ** 2
    full = Converter().full_scale
    # No capacitance: membrane and electrode touch, which reads full scale.
    saturated = ~failed & (~np.isfinite(so) | (so >= full) | (so <= 0))
    weight = np.where(saturated | failed, 0.0, 1 / np.where(saturated, 1.0, variance))
    angle_error, force_error = least_errors(np.nan_to_num(jacobian), np.nan_to_num(weight))
    unknown = failed[0]
    return ForceRange(
        angle,
        touch,
        pressure,
        force,
        np.where(unknown, np.nan, force_error),
        np.where(unknown, np.nan, angle_error),
        np.where(unknown, np.nan, wall_force),
        np.moveaxis(saturated, 0, -1),
        float(np.sqrt(reading)),
        held.wall is not None,
        ContactPlaces.of(spec.geometry, free.geometry),
        _deviation(spec, angle, touch, progress),
    )


def _deviation(
    spec: SkinSpec, angle: Floats, touch: Floats, progress: Callable[[str], None]
) -> float:
    """Of the force of first contact nearest to the middle, relative, by the inputs' errors.

    Those of filling, mounting and warmth count where the file names none.
    """
    progress("what the skin file leaves open")
    spec = as_assembled(spec)
    middle = int(np.argmin(np.where(np.isfinite(touch), np.abs(angle), np.inf)))
    place = np.full(len(angle), angle[middle])  # as many as the program is made for

    def smallest_gap(inputs: Mapping[str, float], force: float) -> float:
        skin = skin_of(spec, inputs, contact=False)
        found = _solved(skin, place, np.full(len(angle), force))
        return float(found.min_gap[0]) if found.result[0] == 0 else float("nan")

    return contact_deviation(spec, float(touch[middle]), smallest_gap)


class _Solved(NamedTuple):
    """States under line loads, the wall left out: a lane each."""

    min_gap: Floats  # [m]
    oil_pressure: Floats  # [Pa]
    so: Floats  # readings [taxel, lane] [counts]
    result: NDArray[np.int64]  # index of the outcome


@eqx.filter_jit
def _forward(skin: Skin, loads: Loads) -> tuple[Any, ...]:
    found = forward(skin, loads)
    return found.min_gap, found.oil_pressure, found.so, found.result


def _solved(skin: Skin, angle: Floats, force: Floats) -> _Solved:
    found = COMPILED.run(_forward, skin, Loads.line(angle, force), once=True)
    return _Solved(*(np.asarray(x) for x in found))


@eqx.filter_jit
def _sensitivity(skin: Skin, loads: Loads) -> tuple[Any, ...]:
    found, jacobian = load_jacobian(skin, loads)
    return found.so, jacobian[:2, 0], found.wall_force, found.result


def readings_at_rest(skin: Skin, angle: Floats) -> Floats:
    """Readings of a section that nothing touches [taxel], by the program for loads at angles.

    Raises NoRestError: it has no stable state there, so that no force has a range.
    """
    found = _solved(skin, angle, np.zeros(len(angle)))
    if found.result[0] != 0:
        raise NoRestError
    return found.so[:, 0]


def first_contacts(skin: Skin, angle: Floats) -> tuple[Floats, Floats]:
    """Forces [angle] [N] at which the gap closes, and the pressures there [Pa].

    By bisection, and a secant in the last bracket: derivatives of the force are read there.

    Of radial line loads at angles [rad] on a section without its wall; NaN where the gap closes
    under no force.
    """
    low, high = np.full(len(angle), _SMALLEST), np.full(len(angle), np.inf)
    lost = np.zeros(len(angle), bool)
    pressure, open_gap, closed_gap = np.full((3, len(angle)), np.nan)
    force = low.copy()
    for _ in range(80):
        gap, p, _, result = _solved(skin, angle, force)
        closed = gap <= 0  # of a failure, too: the gap is that of the last equilibrium
        # A failure under the smallest force is one at rest: there is no state whose gap counts.
        lost |= (result != 0) & (~closed | (force <= _SMALLEST))
        low = np.where(closed, low, force)
        open_gap, closed_gap = np.where(closed, (open_gap, gap), (gap, closed_gap))
        high = np.where(closed, force, high)
        pressure = np.where(closed & (result == 0), p, pressure)
        open_ = np.isinf(high)
        lost |= open_ & (force > _LARGEST)
        bounded = np.where(open_, 4.0 * low, high)
        force = np.where(lost, _SMALLEST, np.sqrt(low * bounded))
        force = np.where(open_ & ~lost, 2 * low, force)
        if (lost | (high < 1.0001 * low)).all():
            break
    share = open_gap / (open_gap - closed_gap)
    touch = np.where(np.isnan(share), high, low + share * (high - low))
    return np.where(lost, np.nan, touch), np.where(lost, np.nan, pressure)


def rated_force(first_contact: Floats) -> float:
    """30 % of the smallest first contact, to one significant digit [N]; 1 N where none is."""
    known = first_contact[np.isfinite(first_contact)]
    return float(f"{_RATED * known.min():.0e}") if known.size else 1.0


def least_errors(jacobian: Floats, weight: Floats) -> Floats:
    """Least standard deviations [parameter, ...] by the bound of Cramer and Rao.

    `jacobian`: derivatives of the readings [parameter, taxel, ...]. `weight`: inverse variances
    of the readings [taxel, ...].
    """
    information = np.einsum("at...,bt...,t...->ab...", jacobian, jacobian, weight)
    rows = np.moveaxis(information, (0, 1), (-2, -1))
    size = len(jacobian)
    covariance = inverse(rows.reshape(-1, size, size)).reshape(rows.shape)
    variance = np.moveaxis(np.diagonal(covariance, axis1=-2, axis2=-1), -1, 0)
    return np.sqrt(np.where(variance > 0, variance, np.inf))


def _sensitivities(
    skin: Skin, angle: Floats, force: Floats
) -> tuple[Floats, Floats, Floats, Flags]:
    """Readings [taxel, angle, force], their derivatives by angle and force, the wall's force.

    Last comes what has no solution [1, angle, force].
    """
    known = np.isfinite(force)
    loads = Loads.line(
        np.repeat(angle, force.shape[1]), np.where(known, force, _SMALLEST).ravel()
    )
    so, jacobian, wall_force, result = (
        np.asarray(x) for x in COMPILED.run(_sensitivity, skin, loads, once=True)
    )
    failed = (result != 0).reshape(force.shape) | ~known
    return (
        so.reshape(-1, *force.shape),
        jacobian.reshape(2, -1, *force.shape),
        wall_force.reshape(force.shape),
        failed[None],
    )


def smallest_told(force: Floats, error: Floats) -> Floats:
    """Smallest forces that can be told, from errors at rising forces [..., force] [N]; or NaN.

    Between the forces evaluated, the relative error is taken as a power of the force; below
    them its error is that of the lightest, as readings are then linear.
    """
    found = np.full(force.shape[:-1], np.nan)
    relative = np.where(np.isnan(error), np.inf, error) / force
    for place in np.ndindex(found.shape):
        f, r = force[place], relative[place]
        told = np.flatnonzero(r <= TOLD)
        if told.size and told[0] == 0:
            found[place] = r[0] * f[0] / TOLD
        elif told.size:
            near = [told[0], told[0] - 1]
            found[place] = np.exp(np.interp(np.log(TOLD), np.log(r[near]), np.log(f[near])))
    return found


def _first(force: Floats, holds: Flags) -> Floats:
    """First force of every row for which something holds, or NaN."""
    found = force[np.arange(len(force)), holds.argmax(1)]
    return np.where(holds.any(1), found, np.nan)
