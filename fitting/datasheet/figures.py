"""What a data sheet states of a place, as functions of readings there, differentiable.

With the readings y(x, F) of a contact of force F at a place x, their change from rest c, their
variances s^2 (noise, rounding 1/12, and a share of c that the model may be wrong by) and ' for
slopes by x and F, each over s::

    sensitivity          |y_F| at rest, a root of a sum of squares over the taxels
    detection limit      3.29 / |y_F / s| at rest (Currie 1968: false alarms and misses 5 %
                         each, place known)
    resolution           1 / |part of the slope that the other slopes can't imitate|, at the
                         rated force: the bound of Cramer and Rao of one frame
    nonlinearity         |L(F/2) - 1/2|, L the share of c along its value at the rated force F
    crosstalk            largest |c| of a taxel far from the contact over the largest of those
                         near it, or of all where none is
    first contact        F - gap / (dgap/dF): one step of Newton's method from a force at which
                         the gap is closed already, which makes its derivatives exact
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.interpolate import CubicSpline

from fitting.arrays import Floats
from fitting.datasheet.readings import Readings
from fitting.inverse_load.fit.covariance import inverse
from suas_jax.numerics.length import length
from suas_jax.sensing.converter import Converter

FINE = 128
"""Places from clamp to clamp for what two contacts do."""
CURRIE = 3.29
"""Standard deviations at which false alarms and misses are 5 % each, one-sided."""
_DISTANCES = 60  # of two contacts that are tried
_UNKNOWNS = 4  # of two contacts, a place and a force each
_ROUNDING = 1e-12  # share of a column below which what is left of it is rounding


class Cases(NamedTuple):
    """Readings of contacts at places, [taxel, *skin, place] where they have taxels."""

    rest: Readings  # without force
    half: Readings  # at half of the rated force
    rated: Readings  # at the rated force
    touch: Readings  # close to first contact with the wall
    force: Any  # of those [*skin, place] [N]

    @property
    def first_contact(self) -> Array:
        """Force at which the membrane reaches the wall [N]: a step of Newton's method."""
        return self.force - self.touch.gap / self.touch.gap_slope


class Figures(NamedTuple):
    """Figures at places, [*skin, place] each."""

    first_contact: Array  # force at which the membrane reaches the wall [N]
    min_gap: Array  # smallest to the wall under the rated force [m]
    sensitivity: Array  # of all taxels together, at rest [counts/N]
    detection_limit: Array  # force [N]
    force_resolution: Array  # least standard deviation of the force in one frame [N]
    place_resolution: Array  # of the place on the outer face [m]
    nonlinearity: Array  # at half of the rated force, over the reading at the rated force
    crosstalk: Array  # of far taxels, over the near ones; NaN where none is far


class Accuracy(NamedTuple):
    """How readings are weighed."""

    noise: float  # standard deviation of a reading [counts]
    model_error: float  # of the model, a share of the reading's change from rest

    @property
    def variance(self) -> float:
        """Of a reading at rest."""
        return self.noise**2 + 1 / 12


def figures_at(
    cases: Cases, accuracy: Accuracy, far: Bool[np.ndarray, "taxel place"]
) -> Figures:
    """The figures of places, `far` being the taxels that a contact there should leave alone."""
    rest, light = cases.rest.so, cases.rest.slope[-1]
    sensitivity = length(light)
    change, half = cases.rated.so - rest, cases.half.so - rest
    linear = jnp.sum(half * change, 0) * _over(jnp.sum(change**2, 0))
    own = unlike(weighted(cases, accuracy))
    resolution = _over(length(jnp.moveaxis(own, 1, 0)))
    mask = far.reshape(far.shape[0], *(1,) * (change.ndim - 2), far.shape[1])
    # Over the near ones, for a share of all has no slope where a far one changes most.
    near = ~mask | jnp.all(mask, 0)
    most = [jnp.max(jnp.where(x, jnp.abs(change), 0.0), 0) for x in (mask, near)]
    crosstalk = most[0] * _over(most[1])
    return Figures(
        cases.first_contact,
        cases.rated.gap,
        sensitivity,
        CURRIE * jnp.sqrt(accuracy.variance) * _over(sensitivity),
        resolution[-1],
        length(resolution[:-1]),
        jnp.abs(linear - 0.5),
        jnp.where(jnp.any(mask, 0), crosstalk, jnp.nan),
    )


def weighted(cases: Cases, accuracy: Accuracy) -> Array:
    """Slopes at the rated force over the readings' deviations; zero where saturated."""
    so = cases.rated.so
    known = (so > 0) & (so < Converter().full_scale)
    variance = accuracy.variance + (accuracy.model_error * (so - cases.rest.so)) ** 2
    return jnp.where(known, cases.rated.slope / jnp.sqrt(variance), 0.0)


def unlike(columns: Float[Array, "coordinate taxel *place"]) -> Array:
    """The part of each column that no sum of the others imitates (Gram and Schmidt).

    Zero where nothing but rounding is left: fewer taxels than coordinates tell none of them.
    """
    found = []
    for i, own in enumerate(columns):
        axes: list[Array] = []
        for j in (*range(i), *range(i + 1, len(columns)), i):
            rest = own if j == i else columns[j]
            for axis in axes:
                rest = rest - axis * jnp.sum(axis * rest, 0)
            if j != i:
                square = jnp.sum(rest**2, 0)
                axes.append(rest / jnp.sqrt(jnp.where(square > 0, square, 1.0)))
        own_square, square = jnp.sum(own**2, 0), jnp.sum(rest**2, 0)
        found.append(jnp.where(square > _ROUNDING**2 * own_square, rest, 0.0))
    return jnp.stack(found)


def told(cases: Cases, accuracy: Accuracy, change: Any) -> Float[Array, "coordinate *place"]:
    """What a change of readings [taxel, *place] [counts] is taken for, by the best fit.

    Returns changes of the place's coordinates [m] and of the force [N].
    """
    columns = weighted(cases, accuracy)
    own = unlike(columns)
    variance = (
        accuracy.variance + (accuracy.model_error * (cases.rated.so - cases.rest.so)) ** 2
    )
    scaled = change / jnp.sqrt(variance)
    return jnp.sum(own * scaled, 1) / jnp.sum(own**2, 1)


def two_point(
    arc: Floats,
    light: Float[np.ndarray, "taxel place"],
    force: float,
    variance: float,
    middle: Floats | None = None,
) -> Floats:
    """Distance from which on two contacts are told apart [middle] [m]; NaN where none is.

    From the bound of two light contacts of a force each [N], whose readings add: that of their
    distance is 1/3.29 of it. Places along the arc rise [m]; `light` are derivatives of the
    readings by the force there [counts/N]. `middle`: between the contacts; None: the places.
    """
    middle = arc if middle is None else middle
    if len(light) < _UNKNOWNS:  # of symmetric contacts alone the distance would be told
        return np.full(len(middle), np.nan)
    spline = CubicSpline(arc, light.T)
    distance = np.geomspace(1e-3, 1.0, _DISTANCES) * (arc[-1] - arc[0])
    sides = middle[:, None, None] + distance[:, None] * np.array([-0.5, 0.5])
    inside = ((sides >= arc[0]) & (sides <= arc[-1])).all(-1)
    sides = np.clip(sides, arc[0], arc[-1])
    columns = np.stack([force * spline(sides, 1), spline(sides)], -2) / np.sqrt(variance)
    rows = columns.reshape(len(middle) * _DISTANCES, 4, -1)  # place, force of one, of the other
    covariance = inverse(rows @ np.swapaxes(rows, 1, 2)).reshape(len(middle), _DISTANCES, 4, 4)
    of = covariance[..., 0, 0] + covariance[..., 2, 2] - 2 * covariance[..., 0, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        sure = np.where(inside & (of > 0), np.log(distance / np.sqrt(of) / CURRIE), np.nan)
    found = np.full(len(middle), np.nan)
    for i, row in enumerate(sure):
        apart = np.flatnonzero(row >= 0)
        if apart.size and apart[0] > 0 and np.isfinite(row[apart[0] - 1]):
            near = [apart[0] - 1, apart[0]]
            found[i] = np.exp(np.interp(0.0, row[near], np.log(distance[near])))
    return found


def _over(sizes: Array) -> Array:
    """One over sizes; NaN where one is zero, for then nothing is told."""
    return jnp.where(sizes > 0, 1 / jnp.where(sizes > 0, sizes, 1.0), jnp.nan)


class Measured(NamedTuple):
    """Readings of a skin and its neighbours, and where they were taken."""

    cases: Cases  # the readings [taxel, skin, place]
    coordinates: dict[str, Floats]  # of the places by key, as a person states them [place]
    arc: Floats  # along the outer face [place] [m]
    region: np.ndarray  # whether a place counts for the figures of the whole skin [place]
    far: np.ndarray  # taxels that count as crosstalk [taxel, place]
    rated: float  # the rated force [N]
    accuracy: Accuracy  # of a reading
    grid: tuple[int, int]  # places along the arc and along the axis
    # why figures have no value on such a skin, by key
    missing: Mapping[str, str] = MappingProxyType({})
    # arc of many places from clamp to clamp [m] and derivatives of the readings by the force
    # there at rest, in every row of places along the arc [taxel, row, place] [counts/N]
    light: tuple[Floats, Floats] | None = None
