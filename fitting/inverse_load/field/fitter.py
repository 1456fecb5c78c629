"""Fits of a load field to a frame: Gauss-Newton over forces of zero or more at nodes."""

from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.load_field import Interval, LoadField
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.field.forward import FieldForward, FieldState, even_nodes
from fitting.inverse_load.field.posterior import FieldPosterior, LinearReadings, Scales
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from suas_jax.equilibrium.state import State
from suas_jax.scene.skin import Skin

_STEPS, _HALVES = 10, 6  # of a fit, of a step that leads nowhere
_WORSE = 4.0  # by which a step may raise chi2, where it lessens what is odd of the forces
_MOVED = 0.01  # share of the total force below which a step is the last
_FIRST = 1e-3  # where fits begin [N]
_SAMPLES = 80


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
