"""Fits of a load field to a frame: Gauss-Newton over forces of zero or more at nodes.

With readings scaled by their noise, b = A f + e. Forces at nodes are a Gaussian field of one
size s and one length l along the face::

    f ~ N(0, s^2 K),  K_ij = exp(-|x_i - x_j| / l),    b ~ N(0, 1 + s^2 A K A^T)

The second is the evidence of s and l, which weighs them. Samples of the forces are the ends
of fits to disturbed data (randomise, then optimise), over f >= 0::

    |A f - b - e|^2 + |f - z|^2 / (s^2 K) + 2 r 1.f / s,    e ~ N(0, 1)

Oil that can't be compressed hides a pressure that is even all over the skin, so that readings
hardly tell what presses where little moves. Half of the samples expect as little as readings
ask for (z = 0, r = 2), half a field that goes on everywhere (z ~ N(0, s^2 K), r = 0).
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.distance import cdist

from fitting.arrays import Floats
from fitting.inverse_load.estimate.load_field import Interval, LoadField
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.field.forward import FieldForward, FieldState, even_nodes
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from suas_jax.equilibrium.state import State
from suas_jax.scene.skin import Skin

_LENGTHS = (8e-3, 16e-3, 32e-3, 64e-3, 128e-3)  # l [m]
_PRESSURES = np.geomspace(6.0, 6e5, 24)  # s over a node's part of the face [Pa]
_SPARSE = 2.0  # r of samples that expect little
_JITTER = 1e-9
_STEPS, _HALVES = 10, 6  # of a fit, of a step that leads nowhere
_WORSE = 4.0  # by which a step may raise chi2, where it lessens what is odd of the forces
_MOVED = 0.01  # share of the total force below which a step is the last
_FIRST = 1e-3  # where fits begin [N]
_SAMPLES = 80


class LinearReadings(NamedTuple):
    """Readings as a linear model of the nodes' forces, scaled by their noise."""

    design: Floats  # A [channel, node]
    target: Floats  # b [channel]


class Scale(NamedTuple):
    """One size and length of a field."""

    length: int  # its index
    size: float  # of a node's force [N]


class Scales(NamedTuple):
    """Sizes and lengths of a field, and how well each explains some readings."""

    each: list[Scale]
    log_evidence: Floats  # of each, but for a constant of the readings

    @property
    def best(self) -> Scale:
        """The one that explains them best."""
        return self.each[int(self.log_evidence.argmax())]

    @property
    def weights(self) -> Floats:
        """Probabilities of each, all being as likely before."""
        own = np.exp(self.log_evidence - self.log_evidence.max())
        return np.asarray(own / own.sum())


class FieldPosterior:
    """The posterior of forces at nodes of one skin.

    Nodes have places on the unrolled face [node, coordinate] [m], each a part of it [m^2].
    """

    def __init__(self, metres: Floats, area: float) -> None:
        self._distance = cdist(metres, metres)
        self._sizes = (_PRESSURES * area).tolist()

    @cached_property
    def _kernels(self) -> list[Floats]:
        eye = _JITTER * np.eye(len(self._distance))
        return [np.exp(-self._distance / length) + eye for length in _LENGTHS]

    @cached_property
    def _inverses(self) -> list[Floats]:
        return [np.asarray(np.linalg.inv(kernel), float) for kernel in self._kernels]

    @cached_property
    def _roots(self) -> list[Floats]:
        return [np.asarray(np.linalg.cholesky(x), float) for x in self._kernels]

    def scales(self, linear: LinearReadings) -> Scales:
        """Evidence of all sizes and lengths, forces of either sign."""
        each, found = [], []
        for length, kernel in enumerate(self._kernels):
            value, way = np.linalg.eigh(linear.design @ kernel @ linear.design.T)
            along = (way.T @ linear.target) ** 2
            for size in self._sizes:
                variance = 1 + size**2 * np.maximum(value, 0.0)
                found.append(-(along / variance + np.log(variance)).sum() / 2)
                each.append(Scale(length, size))
        return Scales(each, np.array(found))

    def likeliest(self, linear: LinearReadings, scale: Scale, rate: float = 1.0) -> Floats:
        """The likeliest forces of zero or more [node]; r is `rate`."""
        return self._least(linear.design, linear.target, scale, 0.0, rate)

    def samples(
        self,
        linear: LinearReadings,
        scales: Scales,
        errors: Floats,  # of the skin's inputs, what each does to b [error, channel]
        count: int,
        random: np.random.Generator,
    ) -> Floats:
        """Forces that the readings allow [sample, node]."""
        chosen = random.choice(len(scales.each), count, p=scales.weights)
        found = []
        for k, i in enumerate(chosen.tolist()):
            scale, sparse = scales.each[i], bool(k % 2)
            noise = random.normal(size=len(linear.target))
            target = linear.target + noise + random.normal(size=len(errors)) @ errors
            drawn = (
                scale.size * self._roots[scale.length] @ random.normal(size=len(self._distance))
            )
            how = (0.0, _SPARSE) if sparse else (drawn, 0.0)
            found.append(self._least(linear.design, target, scale, *how))
        return np.array(found)

    def _least(
        self, design: Floats, target: Floats, scale: Scale, expected: Any, rate: float
    ) -> Floats:
        """Forces of zero or more at the least of the objective; z is `expected` [node]."""
        precision = self._inverses[scale.length] / scale.size**2
        normal = design.T @ design + precision
        right = design.T @ target - rate / scale.size
        right = right + precision @ np.broadcast_to(expected, right.shape)
        root = np.linalg.cholesky(normal)
        return np.asarray(nnls(root.T, np.linalg.solve(root, right))[0])


class FieldFit(NamedTuple):
    """A load field that was fitted to a frame."""

    force: Floats  # [node] [N]
    found: FieldState  # the model there
    linear: LinearReadings  # the readings about it
    scales: Scales
    chi2: float  # weighted squares of the residuals

    @property
    def cost(self) -> float:
        """-2 log(evidence), less what it is of readings that are met exactly."""
        return -2 * float(self.scales.log_evidence.max())


class FieldFitter:
    """Fits load fields on one skin; channels are its taxels [counts] and its oil [Pa]."""

    def __init__(
        self,
        skin: Skin,
        edge: Floats,  # largest angle [rad] and axial position [m] of a load
        along: ContactPlaces,
        errors: AbstractSystematicErrors | None,  # of the skin's inputs
        scatter: float = 0.0,  # of forces from one press to another, relative
    ) -> None:
        self._along, self._errors, self._scatter = along, errors, scatter
        self.nodes = nodes = even_nodes(skin, edge, along)
        self._forward = FieldForward(skin, nodes)
        # where nodes are on the unrolled outer face [node, coordinate] [m]
        outer = along.outer_arc(nodes.places[:, 0])
        self._metres = metres = np.column_stack([outer, nodes.places[:, 1:]])
        width = np.ptp(metres[:, 1]) if skin.is_pad else skin.geometry.width[0]
        face = float(np.ptp(metres[:, 0]) * width)
        self._posterior = FieldPosterior(metres, face / len(metres))
        self._rest: State | None = None

    def fit(self, y: Floats, weight: Floats) -> FieldFit | None:
        """Fit a frame [channel], by inverse variances; None where nothing is found."""
        if self._rest is None:
            self._rest = self._forward.rest()
        force = np.full(len(self.nodes.places), _FIRST)
        here = self._forward(force, self._rest)
        if not _usable(here):
            return None
        for _ in range(_STEPS):
            linear = _linear(y, weight, force, here)
            scale = self._posterior.scales(linear).best
            move = self._posterior.likeliest(linear, scale) - force
            most = _chi2(y, weight, here) + _WORSE
            for share in 0.5 ** np.arange(_HALVES):
                there = self._forward(force + share * move, here.state)
                if _usable(there) and _chi2(y, weight, there) <= most:
                    break
            else:
                break
            force, here = force + share * move, there
            if share * np.abs(move).sum() < _MOVED * force.sum():
                break
        if not force.any():
            return None
        linear = _linear(y, weight, force, here)
        scales = self._posterior.scales(linear)
        return FieldFit(force, here, linear, scales, _chi2(y, weight, here))

    def told(self, fit: FieldFit, weight: Floats, preferred_by: float) -> LoadField:
        """What a fit says, with what noise, inputs, and a unit's presses leave open."""
        errors = np.zeros((0, len(weight)))
        if self._errors is not None:
            here = fit.found
            state = np.asarray(here.jacobian), np.asarray(here.channels)
            slopes = self._errors.under_field(self.nodes.places, fit.force, *state)
            if slopes is not None:
                errors = slopes * np.sqrt(weight)
        random = np.random.default_rng(0)  # the same frame, the same answer
        samples = self._posterior.samples(fit.linear, fit.scales, errors, _SAMPLES, random)
        kept = samples[samples.any(1)]
        # One rubber gives way under all of a field.
        kept = kept * (1 + self._scatter * random.normal(size=(len(kept), 1)))
        aside = np.append(0.0, random.normal(size=len(kept)))
        return self._summed(np.concatenate([fit.force[None], kept]), aside, preferred_by)

    def _summed(self, samples: Floats, aside: Floats, preferred_by: float) -> LoadField:
        """What forces at nodes [sample, node] amount to, the likeliest of which come first.

        Centres are off by what all places are off by, in standard deviations [sample].
        """
        nodes, total = self.nodes, samples.sum(1)
        inward = -np.stack([np.sin(nodes.direction), np.cos(nodes.direction)])
        share = samples / total[:, None]
        middle = share @ self._metres
        second = share @ self._metres**2 - middle**2
        extent = 4 * np.sqrt(np.maximum(second, 0.0))
        outer = self._metres[:, 0]
        order = np.argsort(outer, kind="stable")
        angle = np.interp(middle[:, 0], outer[order], nodes.places[order, 0])
        angle = angle + aside * np.sqrt(self._along.shift.covariance(angle[:1, None])[0, 0])
        arc, pad = self._along.arc(angle), middle.shape[1] == 2
        return LoadField(
            _interval(total),
            _interval(samples @ inward[0]),
            _interval(samples @ inward[1]),
            _interval(self._along.angle(angle)),
            _interval(extent[:, 0]),
            preferred_by,
            None if arc is None else _interval(arc),
            _interval(middle[:, 1]) if pad else None,
            _interval(extent[:, 1]) if pad else None,
        )


def _interval(values: Floats) -> Interval:
    value, (low, high) = float(values[0]), np.percentile(values[1:], [2.5, 97.5]).tolist()
    return Interval(value, min(value, low), max(value, high))


def _usable(here: FieldState) -> bool:
    known = np.isfinite(here.channels).all() and np.isfinite(here.jacobian).all()
    return bool(known and int(here.outcome) == 0)


def _chi2(y: Floats, weight: Floats, here: FieldState) -> float:
    """Weighted squares of the residuals."""
    residual = np.where(weight > 0, y - np.asarray(here.channels), 0.0)
    return float((weight * residual**2).sum())


def _linear(y: Floats, weight: Floats, force: Floats, here: FieldState) -> LinearReadings:
    """The model about a state: reciprocals of counts are nearly linear in the forces."""
    root, jacobian = np.sqrt(weight), np.asarray(here.jacobian)
    model = np.asarray(here.channels)
    change = np.where(weight > 0, y - model, 0.0)
    so, read = model[:-1], np.maximum(model + change, 1.0)[:-1]
    change[:-1] = so**2 * (1 / so - 1 / read)
    return LinearReadings(root[:, None] * jacobian, root * (change + jacobian @ force))
