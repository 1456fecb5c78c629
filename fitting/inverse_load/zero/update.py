"""What known presses say of a skin's inputs: a Gaussian update through the model's derivatives.

The inputs are known to within independent errors e of one standard deviation
(`suas_jax.config.input_errors`), filling, mounting and warmth among them. Presses at places and
with forces x that are known to within deviations of their own give readings::

    y = h(x, e) + noise,    e ~ N(0, 1),    x ~ N(x_known, s^2)

counted from the readings at rest. Those themselves tell gap, permittivity and scale, which
changes hardly do: they count to within what they wander by, where the errors can explain them.
All of (e, x) is updated together (`conditioned`), about its own mean until that stays where it
is; what is left of e is the zero.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float
from numpy.typing import NDArray
from scipy.special import chdtrc

from fitting.arrays import Floats
from fitting.inverse_load.drift import DriftDensities
from fitting.inverse_load.estimate.assessment import POOR
from fitting.inverse_load.fit.section_errors import changed_skin, skin_tangents
from fitting.inverse_load.zero.zero import (
    Gaussian,
    KnownPress,
    Zero,
    conditioned,
    inputs_at,
    zeroed_inputs,
)
from suas_jax.config import InputErrors
from suas_jax.equilibrium.state import State
from suas_jax.mesh.pad_plan import PadPlan
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin, skin_of

_ROUNDS = 12
_SHORTER = 5  # halvings of a step beyond which the model has no state
_ENDED = 1e-2  # step in standard deviations
_FEW, _ALIKE = 3, 0.02  # taxels, and how far apart readings may be that are alike
_BEYOND = 9.0  # chi2 per degree of freedom beyond which nothing is concluded
_UNSETTLED = (
    "the update by the known presses does not settle: more than the tolerances allow would be "
    "needed to explain them; check forces, places and the skin file"
)
_WALK = DriftDensities()  # of readings at rest, until the zero is used
_SHARES = {"half": 0.5, "twice": 2.0}  # of a press's force, told beside its own
_QUANTITIES = ("angle", "axial", "force")  # of a press; a line load has no axial position


class PressReadings(NamedTuple):
    """Readings under known presses, less those at rest."""

    change: Floats  # [press, taxel] [counts]; NaN where missing
    variance: Floats  # of it, without the model's error [press, taxel] [counts^2]
    # elastic load of the long-term constants over the press's force [press]: below one while a
    # membrane that relaxes still creeps
    share: Floats
    share_deviation: Floats | float = 0.0  # of the share, relative [press]
    # means at rest, less a calibration's offsets, and their variances [taxel] [counts],
    # [counts^2]; the former NaN where missing, None where only changes are known
    rest: Floats | None = None
    rest_variance: Floats | float = 0.0


class _Model(NamedTuple):
    """Readings at rest and their change under all presses, with derivatives."""

    change: Floats  # [press, taxel]
    by_press: Floats  # by place and force of the press [press, quantity, taxel]
    by_error: Floats  # [press, error, taxel]
    rest: Floats  # [taxel]
    rest_by_error: Floats  # [error, taxel]


class PressModel:
    """The model of a section or a pad under known presses, as its inputs change.

    The errors are those of the model's inputs, the number of presses stays the same, and
    `share` is that of `PressReadings`.
    """

    def __init__(
        self, errors: InputErrors, presses: Sequence[KnownPress], share: Floats | float = 1.0
    ) -> None:
        self._errors = errors
        self._pad = errors.spec.geometry.dimension == 3
        self.known = np.array([press.quantities for press in presses])
        self._scale = np.ones_like(self.known)
        self._scale[:, -1] = share
        self._diameter = np.array([press.diameter for press in presses])
        self._skin = skin_of(errors.spec, contact=False)
        # A pad's mesh stays graded around where the presses are known to be.
        groups = self._groups(self.known)
        self._meshes = [self._skin.around(loads).mesh for loads in groups]

    def _groups(self, x: Floats) -> list[Loads]:
        """The presses and, last, rest: in lanes of one program, on a pad one after another."""
        rows = np.concatenate([x * self._scale, np.zeros((1, x.shape[1]))])
        if not self._pad:
            return [Loads.line(*rows.T[:, None])]
        sizes = np.append(self._diameter, self._diameter[-1])
        return [
            Loads.patch(angle, axial, force, size)
            for (angle, axial, force), size in zip(rows, sizes, strict=True)
        ]

    def change(self) -> tuple[Floats, NDArray[np.bool_]]:
        """Change of readings under the presses as known, by the skin's file [press, taxel].

        And whether the membrane reaches the wall there [press].
        """
        groups = zip(self._meshes, self._groups(self.known), strict=True)
        found = [forward(_on(self._skin, mesh), loads) for mesh, loads in groups]
        so = np.concatenate([np.asarray(x.so).T for x in found])
        gap = np.concatenate([np.asarray(x.min_gap) for x in found])
        return np.asarray(np.nan_to_num(so[:-1] - so[-1])), gap[:-1] <= 0

    def at(self, e: Floats, x: Floats) -> _Model:
        """Change of readings at some errors [error] and presses [press, quantity].

        Raises ValueError: the model has no state there.
        """
        paths = self._errors.paths
        values = dict(zip(paths, inputs_at(self._errors, e).tolist(), strict=True))
        spec = zeroed_inputs(self._errors.spec, values)
        plain = changed_skin(spec, self._skin, {})
        tangents = skin_tangents(spec, plain, paths, self._errors.directions)
        errors = len(self._errors)
        so, slopes = [], []
        for mesh, loads in zip(self._meshes, self._groups(x), strict=True):
            skin = _on(plain, mesh)
            found = forward(skin, loads)
            if not (np.asarray(found.solved).all() and np.isfinite(found.so).all()):
                raise ValueError(
                    "the model finds no state under the known presses with inputs "
                    + ", ".join(f"{path} = {value:.6g}" for path, value in values.items())
                    + ": is the force right, the skin file this skin's, and the membrane off "
                    "the wall?"
                )
            names = [k for k in _QUANTITIES if getattr(loads, k) is not None]
            by_skin, by_loads = (_zeros(x, errors + len(names)) for x in (skin, loads))
            own = eqx.combine(_on(tangents, None), _zeros(skin, errors))
            by_skin = jax.tree.map(lambda x, y: x.at[:errors].set(y), by_skin, own)
            for row, k in enumerate(names, errors):
                unit = getattr(by_loads, k).at[row].set(1.0)
                by_loads = dataclasses.replace(by_loads, **{k: unit})
            so.append(np.asarray(found.so).T)
            columns = COMPILED.run(_along, skin, loads, found.state, by_skin, by_loads)
            slopes.append(np.moveaxis(np.asarray(columns), -1, 0))
        readings, moved = np.concatenate(so), np.concatenate(slopes)
        by_error, by_press = moved[:, :errors], moved[:-1, errors:]
        return _Model(
            readings[:-1] - readings[-1],
            by_press * self._scale[..., None],
            by_error[:-1] - by_error[-1],
            readings[-1],
            by_error[-1],
        )


def _on(skin: Skin, mesh: PadPlan | None) -> Skin:
    return dataclasses.replace(skin, mesh=mesh)


def _zeros(tree: Any, directions: int) -> Any:
    """No change of any array along some directions, an axis of which comes first."""
    arrays = eqx.filter(tree, eqx.is_inexact_array)
    return jax.tree.map(lambda x: jnp.zeros((directions, *x.shape)), arrays)


@eqx.filter_jit
def _along(
    skin: Skin, loads: Loads, start: State, by_skin: Skin, by_loads: Loads
) -> Float[Array, "tangent taxel lane"]:
    """Derivatives of readings at a state as skin and loads change along some tangents."""

    def so(skin: Skin, loads: Loads) -> Array:
        return forward(skin, loads, start).so

    def along(by_skin: Skin, by_loads: Loads) -> Array:
        moved: Array = eqx.filter_jvp(so, (skin, loads), (by_skin, by_loads))[1]
        return moved

    # The state is solved once, its tangent factorised once.
    return jax.vmap(along)(by_skin, by_loads)


def zero_of(
    errors: InputErrors,  # of the inputs
    presses: tuple[KnownPress, ...],  # what was known of them
    readings: PressReadings,  # under them
    model_error: float,  # of the model's change of readings, relative
) -> Zero:
    """Update the errors of a skin's inputs by known presses.

    Raises ValueError: no inputs within what the file allows explain the readings.
    """
    model = PressModel(errors, presses, readings.share)
    count = len(errors)
    deviations = np.array([press.deviations for press in presses])
    creep = model.known[:, -1] * readings.share_deviation  # it reads as a force
    deviations[:, -1] = np.hypot(deviations[:, -1], creep)
    prior = Gaussian(
        np.concatenate([np.zeros(count), model.known.ravel()]),
        np.diag(np.concatenate([np.ones(count), deviations.ravel() ** 2])),
    )
    used = np.isfinite(readings.change)
    variance = readings.variance + (model_error * np.nan_to_num(readings.change)) ** 2
    weight = np.where(used, 1 / variance, 0.0)
    at, size_of = prior.mean.copy(), np.sqrt(np.diag(prior.covariance))
    now = model.at(at[:count], at[count:].reshape(model.known.shape))
    rest, factor = _Rest.of(readings, now, model_error), rest_factor(readings.rest, now.rest)
    all_weights = np.append(weight, np.ones(len(rest.so)))
    for _ in range(_ROUNDS):
        residual = np.where(used, readings.change - now.change, 0.0)
        jacobian = np.concatenate([_jacobian(now), rest.jacobian(now, len(at))])
        both = np.append(residual, rest.residual(now))
        try:
            found = conditioned(prior, at, jacobian, both, all_weights)
        except np.linalg.LinAlgError as error:  # taxels that all but touch the membrane
            raise ValueError(_UNSETTLED) from error
        if np.abs((found.mean - at) / size_of).max() < _ENDED:
            break
        at, now = _moved(model, at, found.mean, count)
    else:
        raise ValueError(_UNSETTLED)
    chi2 = float((weight * residual**2).sum())
    dof = max(int(used.sum()) - model.known.size, 1)
    ratio, poor = chi2 / dof, bool(chdtrc(dof, chi2) < POOR)
    if poor and ratio > _BEYOND:
        raise ValueError(
            f"no inputs within the tolerances of the skin file explain the known presses (chi2 "
            f"per degree of freedom {ratio:.3g}): check forces, places, the order of the "
            "presses, and the skin file"
        )
    own = found.covariance[:count, :count] * (ratio if poor else 1.0)
    information = np.asarray(np.linalg.inv(own), float)
    before, after = (
        force_deviations(now.by_error, now.by_press, weight, known) / model.known[:, -1]
        for known in (np.eye(count), information)
    )
    return Zero(
        errors,
        Gaussian(found.mean[:count], own),
        presses,
        before,
        after,
        ratio,
        "poor_fit" if poor else "ok",
        at_rest=bool(len(rest.so)),
        rest_factor=factor,
        after_at={
            name: _deviations_at(share, model, at, readings, model_error, information)
            for name, share in _SHARES.items()
        },
    )


def _deviations_at(
    share: float,  # of each press's force
    model: PressModel,
    at: Floats,  # errors and presses [parameter]
    readings: PressReadings,  # whose variances other presses would have
    model_error: float,  # see `zero_of`
    information: Floats,  # on the errors [error, error]
) -> Floats:
    """Relative deviations of forces at the presses' places; NaN where there is no state."""
    errors = at.size - model.known.size
    x = at[errors:].reshape(model.known.shape).copy()
    x[:, -1] *= share
    try:
        there = model.at(at[:errors], x)
    except ValueError:
        return np.full(len(x), np.nan)
    variance = readings.variance + (model_error * there.change) ** 2
    weight = np.where(np.isfinite(readings.change), 1 / variance, 0.0)
    return force_deviations(there.by_error, there.by_press, weight, information) / x[:, -1]


def rest_factor(read: Floats | None, model: Floats) -> float | None:
    """How many times a model's readings at rest all taxels read [taxel], None if not alike.

    Of electrodes as they are: offsets and exchanged wires differ from taxel to taxel, an oil,
    a gap or a scale of another kind does not.
    """
    ratio = np.zeros(0) if read is None else (read / model)[np.isfinite(read)]
    if len(ratio) < _FEW or np.ptp(ratio) > _ALIKE * ratio.mean():
        return None
    return float(ratio.mean())


class _Rest(NamedTuple):
    """Readings at rest that count, with what makes their errors independent and of size one."""

    so: Floats  # [row]
    taxels: NDArray[np.intp]  # whose they are [row]
    whiten: Floats  # [row, row]

    @classmethod
    def of(cls, readings: PressReadings, model: _Model, model_error: float) -> "_Rest":
        """Those of readings, none where the errors of the inputs can't explain them.

        An offset or another wiring is in them alone: changes say what the skin is without them.
        """
        so = np.full_like(model.rest, np.nan) if readings.rest is None else readings.rest
        taxels = np.flatnonzero(np.isfinite(so))
        own = (
            np.broadcast_to(readings.rest_variance, so.shape) + (model_error * model.rest) ** 2
        )
        gain = _WALK.walk(model.rest, _WALK.before).shared[taxels, 1:]
        covariance = np.diag(own[taxels]) + gain @ gain.T
        slopes = model.rest_by_error[:, taxels]
        away = (so - model.rest)[taxels]
        chi2 = float(away @ np.linalg.solve(covariance + slopes.T @ slopes, away))
        if chdtrc(max(len(taxels), 1), chi2) < POOR:
            taxels = taxels[:0]
        rows = covariance[: len(taxels), : len(taxels)]
        return cls(so[taxels], taxels, np.linalg.inv(np.linalg.cholesky(rows)))

    def residual(self, model: _Model) -> Floats:
        """What a model leaves of them [row]."""
        return np.asarray(self.whiten @ (self.so - model.rest[self.taxels]))

    def jacobian(self, model: _Model, parameters: int) -> Floats:
        """Their derivatives, by errors, which come first, and presses [row, parameter]."""
        by_error = self.whiten @ model.rest_by_error[:, self.taxels].T
        return np.pad(by_error, ((0, 0), (0, parameters - by_error.shape[1])))


def _moved(model: PressModel, at: Floats, wanted: Floats, count: int) -> tuple[Floats, _Model]:
    """The model at wanted errors and presses, or on the way there where it has no state."""
    for k in range(_SHORTER + 1):
        try:
            return wanted, model.at(wanted[:count], wanted[count:].reshape(model.known.shape))
        except ValueError:
            if k == _SHORTER:
                raise
            wanted = (at + wanted) / 2
    raise AssertionError


def _jacobian(model: _Model) -> Floats:
    """Derivatives of all readings by errors and presses [press * taxel, parameter]."""
    by_press = np.swapaxes(model.by_press, 1, 2)  # [press, taxel, quantity]
    own = scipy.linalg.block_diag(*by_press)
    by_error = np.swapaxes(model.by_error, 1, 2)
    return np.concatenate([by_error.reshape(len(own), -1), own], 1)


def force_deviations(
    by_input: Floats, by_contact: Floats, weight: Floats, information: Floats
) -> Floats:
    """Standard deviations of contacts' last quantity, found from readings alone [contact].

    Readings have derivatives by what is known of the skin [contact, input, taxel] and by the
    contact's own quantities [contact, quantity, taxel], with inverse variances [contact,
    taxel]; the information is the inverse covariance of the inputs [input, input].
    """
    found = []
    for by_own, by_skin, w in zip(by_contact, by_input, weight, strict=True):
        weighted = by_skin * w
        both = weighted @ by_own.T
        rest = np.linalg.solve(information + weighted @ by_skin.T, both)
        covariance = np.linalg.inv((by_own * w) @ by_own.T - both.T @ rest)
        found.append(np.sqrt(covariance[-1, -1]))
    return np.array(found)
