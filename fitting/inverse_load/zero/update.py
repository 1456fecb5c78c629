"""What known presses say of a skin's inputs: a Gaussian update through the model's derivatives.

The inputs are known to within independent errors e of one standard deviation
(`suas_jax.config.input_errors`), filling, mounting and warmth among them. Presses at places and
with forces x that are known to within deviations of their own give readings::

    y = h(x, e) + noise,    e ~ N(0, 1),    x ~ N(x_known, s^2)

counted from the readings at rest. All of (e, x) is updated together (`conditioned`), about its
own mean until that stays where it is; what is left of e is the zero.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import chdtrc

from fitting.arrays import Floats
from fitting.inverse_load.estimate.assessment import POOR
from fitting.inverse_load.fit.section_errors import (
    SLOPE_PROGRAMS,
    changed_skin,
    skin_tangent,
)
from fitting.inverse_load.model.evaluation import at_rest, evaluate
from fitting.inverse_load.zero.gaussian import Gaussian, conditioned
from fitting.inverse_load.zero.zero import KnownPress, Zero, inputs_at, zeroed_inputs
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.skin import Skin, skin_of

_ROUNDS = 12
_SHORTER = 5  # halvings of a step beyond which the model has no state
_ENDED = 1e-2  # step in standard deviations
_BEYOND = 9.0  # chi2 per degree of freedom beyond which nothing is concluded


class PressReadings(NamedTuple):
    """Readings under known presses, less those at rest.

    Attributes:
        change: [press, taxel] [counts]; NaN where missing.
        variance: of it, without the model's error [press, taxel] [counts^2].
        share: elastic load of the long-term constants over the press's force [press]: below one
            while a membrane that relaxes still creeps.
        share_deviation: of the share, relative [press].
    """

    change: Floats
    variance: Floats
    share: Floats
    share_deviation: Floats | float = 0.0


class _Model(NamedTuple):
    """Change of readings from rest under all presses, with derivatives.

    Attributes:
        change: [press, taxel].
        by_press: by angle and force of the press [press, 2, taxel].
        by_error: [press, error, taxel].
    """

    change: Floats
    by_press: Floats
    by_error: Floats


class SectionPresses:
    """The model of a skin in plane strain under known presses, as its inputs change.

    Args:
        errors: of its inputs.
        presses: their number stays.
        share: see `PressReadings`.
    """

    def __init__(
        self, errors: InputErrors, presses: tuple[KnownPress, ...], share: Floats
    ) -> None:
        self._errors, self._share = errors, share
        self.known = np.array([(press.angle, press.force) for press in presses])
        self._skin = skin_of(errors.spec, contact=False)

    def at(self, e: Floats, x: Floats) -> _Model:
        """Change of readings at some errors [error] and presses [press, 2].

        Raises:
            ValueError: the model has no state there.
        """
        paths = self._errors.paths
        values = dict(zip(paths, inputs_at(self._errors, e).tolist(), strict=True))
        spec = zeroed_inputs(self._errors.spec, values)
        skin = changed_skin(spec, self._skin, {})
        loads = x * np.stack([np.ones(len(x)), self._share], 1)
        parameters = np.concatenate([loads, np.zeros((1, 2))]).T  # rest is the last lane
        found = COMPILED.run(_EVALUATE, skin, parameters, at_rest(skin, len(x) + 1))
        so, jacobian = np.asarray(found.so).T, np.asarray(found.jacobian)
        if np.asarray(found.result).any() or not np.isfinite(so).all():
            raise ValueError(
                "the model finds no state under the known presses with inputs "
                + ", ".join(f"{path} = {value:.6g}" for path, value in values.items())
                + ": is the force right, and the skin file this skin's?"
            )
        none = np.zeros(2)
        slopes = []
        for column in self._errors.directions:
            tangent = skin_tangent(spec, skin, paths, column)
            moved = COMPILED.run(
                SLOPE_PROGRAMS[1], skin, tangent, none, parameters, found.state
            )
            slopes.append(np.asarray(moved).T)
        by_error = np.stack(slopes, 1)
        by_press = jacobian.transpose(2, 0, 1)[:-1].copy()
        by_press[:, 1] *= self._share[:, None]
        return _Model(so[:-1] - so[-1], by_press, by_error[:-1] - by_error[-1])


def expected_changes(spec: SkinSpec, presses: tuple[KnownPress, ...]) -> Floats:
    """Change of readings that a skin as its file has it shows under presses [press, taxel]."""
    skin: Skin = skin_of(spec, contact=False)
    parameters = np.array([*((p.angle, p.force) for p in presses), (0.0, 0.0)]).T
    found = COMPILED.run(_EVALUATE, skin, parameters, at_rest(skin, len(presses) + 1))
    so = np.asarray(found.so).T
    return np.asarray(np.nan_to_num(so[:-1] - so[-1]))


def zero_of(
    errors: InputErrors,
    presses: tuple[KnownPress, ...],
    readings: PressReadings,
    model_error: float,
) -> Zero:
    """Update the errors of a skin's inputs by known presses.

    Args:
        errors: of the inputs.
        presses: what was known of them.
        readings: under them.
        model_error: of the model's change of readings, relative.

    Raises:
        ValueError: no inputs within what the file allows explain the readings.
    """
    model = SectionPresses(errors, presses, readings.share)
    count, size = len(errors), len(errors) + 2 * len(presses)
    deviations = np.array([(p.angle_deviation, p.force_deviation) for p in presses])
    creep = model.known[:, 1] * readings.share_deviation  # a share that is off reads as a force
    deviations[:, 1] = np.hypot(deviations[:, 1], creep)
    prior = Gaussian(
        np.concatenate([np.zeros(count), model.known.ravel()]),
        np.diag(np.concatenate([np.ones(count), deviations.ravel() ** 2])),
    )
    used = np.isfinite(readings.change)
    variance = readings.variance + (model_error * np.nan_to_num(readings.change)) ** 2
    weight = np.where(used, 1 / variance, 0.0)
    at, size_of = prior.mean.copy(), np.sqrt(np.diag(prior.covariance))
    now = model.at(at[:count], at[count:].reshape(-1, 2))
    for _ in range(_ROUNDS):
        residual = np.where(used, readings.change - now.change, 0.0)
        jacobian = _jacobian(now, size)
        found = conditioned(prior, at, jacobian, residual.ravel(), weight.ravel())
        if np.abs((found.mean - at) / size_of).max() < _ENDED:
            break
        at, now = _moved(model, at, found.mean, count)
    else:
        raise ValueError(
            "the update by the known presses does not settle: more than the tolerances allow "
            "would be needed to explain them; check forces, places and the skin file"
        )
    chi2 = float((weight * residual**2).sum())
    dof = max(int(used.sum()) - 2 * len(presses), 1)
    ratio, poor = chi2 / dof, bool(chdtrc(dof, chi2) < POOR)
    if poor and ratio > _BEYOND:
        raise ValueError(
            f"no inputs within the tolerances of the skin file explain the known presses (chi2 "
            f"per degree of freedom {ratio:.3g}): check forces, places, the order of the "
            "presses, and the skin file"
        )
    own = found.covariance[:count, :count] * (ratio if poor else 1.0)
    before, after = (
        force_deviations(now, weight, c) / model.known[:, 1] for c in (np.eye(count), own)
    )
    posterior = Gaussian(found.mean[:count], own)
    status = "poor_fit" if poor else "ok"
    return Zero(errors, posterior, presses, before, after, ratio, status)


def _moved(
    model: SectionPresses, at: Floats, wanted: Floats, count: int
) -> tuple[Floats, _Model]:
    """The model at wanted errors and presses, or on the way there where it has no state."""
    for _ in range(_SHORTER):
        try:
            return wanted, model.at(wanted[:count], wanted[count:].reshape(-1, 2))
        except ValueError:
            wanted = (at + wanted) / 2
    return wanted, model.at(wanted[:count], wanted[count:].reshape(-1, 2))


def _jacobian(model: _Model, size: int) -> Floats:
    """Derivatives of all readings by errors and presses [press * taxel, parameter]."""
    presses, errors, taxels = model.by_error.shape
    whole = np.zeros((presses, taxels, size))
    whole[:, :, :errors] = np.swapaxes(model.by_error, 1, 2)
    for k in range(presses):
        own = slice(errors + 2 * k, errors + 2 * k + 2)
        whole[k, :, own] = model.by_press[k].T
    return whole.reshape(-1, size)


def force_deviations(model: _Model, weight: Floats, covariance: Floats) -> Floats:
    """Standard deviations of forces found from readings alone, at each press [press] [N].

    Args:
        model: the readings' derivatives there.
        weight: inverse variances [press, taxel].
        covariance: of the errors [error, error].
    """
    found = []
    for k in range(len(weight)):
        jacobian = np.concatenate([model.by_error[k], model.by_press[k]])
        information = (jacobian * weight[k]) @ jacobian.T
        count = len(covariance)
        information[:count, :count] += np.linalg.inv(covariance)
        found.append(np.sqrt(np.linalg.inv(information)[-1, -1]))
    return np.array(found)


def _evaluate(skin: Skin, parameters: jax.Array, start: object) -> object:
    return evaluate(skin, jnp.asarray(parameters), start, 1)  # type: ignore[arg-type]


_EVALUATE = eqx.filter_jit(_evaluate)
