"""The skin as it was built: what of a unit differs from its drawing, and by how much.

Thickness and gap are tables (`geometry.thickness.value.K`) through a few nodes along the arc,
on pads also along the axis. Before any press they are, relative to the drawing, ::

    u ~ N(0, C),   C_ij = s^2 (1 + exp(-|x_i - x_j|^2 / (2 l^2)))

a common part and a smooth one, each with the standard deviation s that the skin file states,
else 3 %, and l = 1 / 4 of the arc and of the length. Filling, mounting, permittivity and the
membrane's stiffness have the file's deviations. Every press is where, and as strong as, it was
told to be up to errors of its own, which are constants like the others. Channels have gains
1 + N(0, t^2), presses relative errors of force N(0, t^2), each with a t of their own that the
gains and the presses tell themselves (`shared_deviation`).

On a section presses may be off together, by a ruler's zero or a bar that stands askew
(`PlaceErrors`).
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.sensor.model.constants import (
    AXIAL,
    FILL,
    MOUNTING,
    PERMITTIVITY,
    PLACE,
    PUSH,
    STIFFNESS,
    SensorConstant,
    is_press_error,
    naming,
)
from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.config.geometry import AlongSpec, GeometrySpec, SheetSpec
from suas_jax.config.input_errors import stresses_of
from suas_jax.config.inputs import given_inputs
from suas_jax.config.schema_skin import MODULE_TAXELS
from suas_jax.config.tolerance import deviation_of
from suas_jax.skin.plain import plain_geometry

# t: a bar that stands a degree askew is felt 0.005 rad to a side at the paper's skin's crown,
# and hardly at 45 degrees; l is how soon that changes (`benchmarks/as_built.py`) [rad].
_ASKEW, _SOON = 0.0085, 0.35
_STEP = 0.27  # between places of a table, at most: good to 0.0005 rad [rad]
AS_BUILT = "as-built"
NODES, PAD_NODES = 5, 3
"""Of a table along the arc of a section, and each way on a pad."""
MODEL_ERROR = {2: 2.5e-3, 3: 1e-2}
"""Of a reading's change from rest, relative, by the skin's dimension: that of the estimates of
loads (`fitting.inverse_load.estimator`)."""
PLACE_ERROR = 1e-3
"""Standard deviation of a known place where none is stated [m]."""
FORCE_ERROR = 0.01
"""The same of a known force, relative, before the presses themselves tell it. Rubber gives way
by some per cent a decade of time, so that presses held for 5 to 50 s differ by about as much; a
kitchen scale errs by less."""
GAIN_ERROR = 0.01
"""The same of a channel's gain, before the gains themselves tell it."""
_TOLERANCE, _REACH = 0.03, 0.25
_STIFFNESS, _PERMITTIVITY = 0.10, 0.022  # relative; the scale's is in the second
_USUAL_GAINS, _USUAL_PRESSES = 8, 4
_EXACT = 1e-6
_TABLES = ("thickness", "oil_gap")


class PlaceErrors(NamedTuple):
    """Errors of presses' places on a section, before any reading: their own, and shared ones.

    A press at the angle a is felt m(a) + u_k further along the arc than it was told. A ruler's
    zero is the same for all presses, and a bar that stands askew, or presses one side harder,
    is felt beside where it presses, by a length that changes along the arc::

        u_k ~ N(0, s^2),    cov(m(a), m(a')) = s^2 + t^2 (1 + exp(-(a - a')^2 / 2 l^2))

    s is what is stated of places, t what a bar that a hand holds does.
    """

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
        near = np.exp(-((one[:, None] - other) ** 2) / (2 * _SOON**2))
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


def as_built(spec: SkinSpec) -> SkinSpec:
    """A skin that names all that may differ from its drawing, with the drawing's values."""
    spec = naming(spec, (FILL, MOUNTING) if spec.oil.trapped else (MOUNTING,))
    geometry = {key: _tabled(spec, key) for key in _TABLES}
    electrodes = spec.sensing
    own: dict[str, Any]
    if electrodes.layout == "list":
        own = {
            "taxels": tuple(t.model_copy(update={"gain": t.gain}) for t in electrodes.taxels)
        }
    else:
        ones = (1.0,) * MODULE_TAXELS
        own = {
            "modules": tuple(
                m.model_copy(update={"gains": m.gains or ones}) for m in electrodes.modules
            )
        }
    return spec.model_copy(
        update={
            "geometry": spec.geometry.model_copy(update=geometry),
            "electrodes": electrodes.model_copy(update=own),
        }
    )


def _tabled(spec: SkinSpec, key: str) -> AlongSpec | SheetSpec:
    """A length as a table; one that is a table stays."""
    value = getattr(spec.geometry, key)
    if not isinstance(value, float):
        return value
    if spec.geometry.dimension == 2:
        arc = tuple(np.linspace(0, 1, NODES).tolist())
        return AlongSpec(arc=arc, value=(float(value),) * NODES)
    places = tuple(np.linspace(0, 1, PAD_NODES).tolist())
    rows = ((float(value),) * PAD_NODES,) * PAD_NODES
    return SheetSpec(arc=places, axial=places, value=rows)


def as_built_names(spec: SkinSpec) -> tuple[str, ...]:
    """Names of all constants of such a skin but the errors of presses."""
    known = continuous_inputs(spec)
    common = (PERMITTIVITY, STIFFNESS, *((FILL,) if spec.oil.trapped else ()), MOUNTING)
    return (*common, *(path for path in known if _is_node(path) or is_gain(path)))


def is_gain(name: str) -> bool:
    """Whether a constant is the gain of a taxel's channel."""
    return name.startswith("electrodes.") and "gain" in name


def _is_node(name: str) -> bool:
    return name.startswith(tuple(f"geometry.{key}.value." for key in _TABLES))


def press_errors(spec: SkinSpec, presses: int, place: float) -> list[SensorConstant]:
    """Errors of presses: angles [rad], on pads then axial positions [m], relative forces.

    `place` is the standard deviation of a place, along the arc and along the axis [m].
    Raises ValueError: a deviation is not above zero.
    """
    if not place > 0:
        raise ValueError("--place-error: a length above zero is needed")
    size = float(plain_geometry(spec.geometry).section.size[0])
    kinds = [(PLACE, "rad", place / size), (PUSH, "1", FORCE_ERROR)]
    if spec.geometry.dimension == 3:
        kinds.insert(1, (AXIAL, "m", place))
    return [
        SensorConstant(f"{name}.{k}", unit, own, positive=False)
        for name, unit, own in kinds
        for k in range(presses)
    ]


def as_built_deviations(
    drawing: SkinSpec, parts: Sequence[SensorConstant], angle: Floats | None = None
) -> tuple[dict[str, float], Floats]:
    """Standard deviations of the constants before any press, and their correlations [p, p].

    The drawing is the skin file, which may state deviations; among the constants are those of
    presses, whose sizes are their deviations, and which have angles [press] [rad].
    """
    given = given_inputs(drawing)
    shares = {key: _share(given.get(f"geometry.{key}"), _TOLERANCE) for key in _TABLES}
    stresses = [_share(given[path], _STIFFNESS) for path in stresses_of(drawing)]
    permittivity = _share(given.get("oil.relative_permittivity"), _PERMITTIVITY)
    common = {PERMITTIVITY: permittivity, STIFFNESS: max(stresses)}
    found: dict[str, float] = {}
    correlation = np.eye(len(parts))
    for part in parts:
        if _is_node(part.name):
            found[part.name] = np.sqrt(2) * shares[part.name.split(".")[1]] * part.size
        elif is_gain(part.name):
            found[part.name] = GAIN_ERROR
        elif part.name in common:
            found[part.name] = common[part.name] * part.size
        elif is_press_error(part.name):
            found[part.name] = part.size
    places = [i for i, part in enumerate(parts) if part.name.startswith(f"{PLACE}.")]
    if drawing.geometry.dimension == 2 and places:
        assert angle is not None
        own = PlaceErrors(angle, parts[places[0]].size).covariance
        deviation = np.sqrt(np.diag(own))
        found |= {parts[i].name: float(d) for i, d in zip(places, deviation, strict=True)}
        correlation[np.ix_(places, places)] = own / np.outer(deviation, deviation)
    for key in _TABLES:
        table = _tabled(drawing, key)
        index = [
            i for i, part in enumerate(parts) if part.name.startswith(f"geometry.{key}.value.")
        ]
        at = np.array(table.arc)[:, None]
        if isinstance(table, SheetSpec):
            at = np.stack(np.meshgrid(table.arc, table.axial, indexing="ij"), -1).reshape(-1, 2)
        square = ((at[:, None] - at) ** 2).sum(-1)
        correlation[np.ix_(index, index)] = (1 + np.exp(-square / (2 * _REACH**2))) / 2
    return found, correlation


def _share(value: Any, usual: float) -> float:
    """Relative standard deviation that a file states, or the usual one."""
    deviation = deviation_of(value)
    return usual if deviation is None or not value else max(deviation / abs(value), _EXACT)


class Alike(NamedTuple):
    """Constants whose errors have one deviation that they tell themselves."""

    rows: Rows  # which of all constants
    usual: float  # t_0, relative
    weight: int  # m

    @classmethod
    def of(cls, names: Sequence[str]) -> "tuple[Alike, ...]":
        """Gains of channels, and forces of presses, where there are any."""
        gains = np.flatnonzero([is_gain(name) for name in names])
        forces = np.flatnonzero([name.startswith(f"{PUSH}.") for name in names])
        kinds = (cls(gains, GAIN_ERROR, _USUAL_GAINS), cls(forces, FORCE_ERROR, _USUAL_PRESSES))
        return tuple(own for own in kinds if own.rows.size)

    def shared_deviation(self, errors: Floats, variances: Floats) -> float:
        """The deviation t of errors x ~ N(0, t^2) that are known to within variances.

        One step of expectation and maximisation,
        t^2 = (sum(x^2 + variance) + m t_0^2) / (n + m)
        for n errors, the usual t_0 counting as m further ones. Repeated with the posteriors
        under N(0, t^2) it ends at the most probable t.
        """
        total = np.sum(errors**2 + variances) + self.weight * self.usual**2
        return float(np.sqrt(total / (len(errors) + self.weight)))
