"""Relaxation times and shares from the course of a skin's readings under held presses.

The counts of taxel k follow the viscoelastic model m_k(t) of `suas sweep --history` up to what
has nothing to do with the rubber, an offset, a drift and a gain::

    y_k(t) = a_k + sum_p b_kp t^p + c_k m_k(t; gamma, tau, s)

The drift is steady, and bends where the readings ask for it, as of a skin that warms. Here
gamma_i = g_i / (1 - sum g), the relaxation times tau_i and a factor s on the long-term
constants. a, b and c are taken out by a projection (Golub and Pereyra 1973, variable
projection), so the covariance of the others counts them as unknown. The model is run anew for
every trial; its derivatives are differences.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.sensor.logs.data import NoCalibration, SensorData
from fitting.sensor.relaxation.held_press import HeldPress, held_presses
from fitting.statistics.least_squares import solved_by_scipy
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.input_errors import DEFAULTS, STIFFNESS
from suas_jax.constitutive.relaxation import PronySeries
from suas_jax.runtime.compiled import require_float64

_MOST_TERMS = 2
_MOST_DEGREE = 6  # in time, of a drift
_FIRST = 0.2  # gamma to start from
_SMALL, _AWAY = 0.01, 5.0  # a further term to try: gamma, and how far its time is
_STEP = 5e-3  # of a parameter, for differences
_UNKNOWN = 0.5  # relative deviation of a share or a time from which it is not known
_HIDDEN = 2.0  # by how much the drift may widen a deviation without being named
_BEYOND, _APART = 10.0, 2.0  # of the times measured; of two times
_LIMITS = (1e-4, 4.0)  # of gamma
_TRIALS = 40
# Least correlation of the taxels' changes under the presses with the model's, and how many
# times as large as those, or as small, they may be.
_ALIKE, _LARGER = 0.9, 2.0


class Trial(NamedTuple):
    """The model near some parameters."""

    theta: Floats  # log gamma, log tau in rising order, log s [p]
    readings: tuple[
        Floats, ...
    ]  # of each press, there and a step along each [1 + p, taxel, mean]


@dataclasses.dataclass(frozen=True)
class RelaxationFit:
    """Prony terms with what is known of them."""

    data: SensorData
    presses: tuple[HeldPress, ...]
    trial: Trial  # at the minimum
    chi2: float  # sum of the squared residuals over the noise
    readings: int  # how many means they are of
    inflation: float  # factor on the deviations for a misfit that is not noise
    root: Floats  # R with R R^T the covariance of theta [p, p]
    steady: Floats  # deviations of theta if no taxel drifted [p]

    @property
    def terms(self) -> int:
        """How many."""
        return len(self.trial.theta) // 2

    @property
    def names(self) -> tuple[str, ...]:
        """Of the constants."""
        own = (f"material.relaxation.{k}.{i}" for k in ("g", "tau") for i in range(self.terms))
        return (*own, "stiffness")

    @property
    def series(self) -> RelaxationSpec:
        """The terms."""
        return _series(self.trial.theta)

    @property
    def constants(self) -> Floats:
        """Shares g, times tau [s], and the factor s [p]."""
        return np.array([*self.series.g, *self.series.tau, np.exp(self.trial.theta[-1])])

    @property
    def covariance(self) -> Floats:
        """Of the constants [p, p]."""
        n, own = self.terms, self.constants
        slope = np.diag(own)  # d constants / d theta
        slope[:n, :n] -= np.outer(own[:n], own[:n])
        return np.asarray(slope @ self.root @ self.root.T @ slope.T)

    def relaxed(self, time: float, since: float) -> tuple[float, float]:
        """Share of the stress at `since` that is gone at `time` [s], and its deviation."""
        here, theta = relaxed(self.series, time, since), self.trial.theta
        steps = 1e-4 * np.eye(len(theta))
        slope = [relaxed(_series(theta + by), time, since) - here for by in steps]
        return here, float(np.linalg.norm(np.array(slope) / 1e-4 @ self.root))

    @property
    def window(self) -> tuple[float, float]:
        """Times that the presses tell of [s]."""
        return _window(self.presses)

    @property
    def unknown(self) -> str:
        """Which term is not known, and why; empty if all are."""
        (shortest, longest), n, own = self.window, self.terms, self.constants
        deviation = np.linalg.norm(self.root, axis=1)
        if n > 1 and np.min(np.diff(self.trial.theta[n : 2 * n])) < np.log(_APART):
            return "two of the times are one"
        for g, tau, *off in zip(own[:n], own[n:], deviation[:n], deviation[n:], strict=False):
            if max(off) < _UNKNOWN and tau > shortest:
                continue
            a, b = (f"(+- {100 * min(x, 10.0):.0f} %)" for x in off)
            told = f"g = {g:.2g} {a}, tau = {tau:.3g} s {b}"
            if tau > longest / _APART:
                return f"a hold of {longest:.3g} s can't tell {told}; hold the press for longer"
            return f"{told}: no more than noise and drift may be"
        return ""

    @property
    def hidden(self) -> list[str]:
        """What a drift of the baseline could be as well, in words."""
        wider = np.linalg.norm(self.root, axis=1) / np.maximum(self.steady, 1e-300)
        names = [name for name, by in zip(self.names, wider, strict=True) if by > _HIDDEN]
        if not names:
            return []
        return [
            f"slow creep and drift of the baseline are alike: the drift widens the errors of "
            f"{', '.join(names)} {wider.max():.2g} times; record rest before and after for as "
            "long as the hold"
        ]


def relaxed(series: RelaxationSpec, time: float, since: float) -> float:
    """Share of a held stress at one time that is gone at another [s], 1 - G(time)/G(since)."""
    early, late = PronySeries(jnp.array(series.g), jnp.array(series.tau)).modulus(
        jnp.array([since, time])
    )
    return float(1 - late / early)


def fit_relaxation(
    data: SensorData, progress: Callable[[str], None] = lambda text: None
) -> tuple[RelaxationFit, list[dict[str, Any]]]:
    """Find the Prony terms of a skin's rubber.

    `data` are logs of held presses; `progress` is called with what is being done.
    Returns the fit with as many terms as bring something, and what is known of one more.
    Raises ValueError: a log has no held press; NoCalibration: no term can be known.
    """
    require_float64()
    presses = held_presses(data)
    best, tried = _with_terms(data, presses, progress)
    # What a baseline that warms leaves is no noise: the times would be off by it, unnamed.
    while presses[0].drift_degree < _MOST_DEGREE and _bends(best):
        presses = _bent(presses)
        progress(f"a drift of degree {presses[0].drift_degree}")
        best, tried = _with_terms(data, presses, progress)
    return best, tried


def _with_terms(
    data: SensorData, presses: tuple[HeldPress, ...], progress: Callable[[str], None]
) -> tuple[RelaxationFit, list[dict[str, Any]]]:
    """As `fit_relaxation`, with drifts of the degree that the presses state."""
    progress("one Prony term")
    best = _fitted(data, presses, np.log([_FIRST, np.sqrt(np.prod(_window(presses))), 1.0]))
    if another := _another_skin(best):
        raise NoCalibration(f"{data.paths}: {another}")
    if best.unknown:
        said = "; ".join([best.unknown, *best.hidden])
        raise NoCalibration(f"{data.paths}: no relaxation is told: {said}")
    tried: list[dict[str, Any]] = []
    while best.terms < _MOST_TERMS:
        progress(f"{best.terms + 1} Prony terms")
        hoped, start = _further(best)
        tried.append({"terms": best.terms + 1, "gain_of_bic": hoped, "unknown": ""})
        if hoped <= 0:
            break
        more = _fitted(data, presses, start)
        lower = (best.chi2 - more.chi2) / more.inflation**2 - _price(best)
        tried[-1] |= {"gain_of_bic": lower, "unknown": more.unknown}
        if lower <= 0 or more.unknown:
            break
        best = more
    return best, tried


def _another_skin(fit: RelaxationFit) -> str:
    """Why the taxels' changes are not this skin's, which gains hide; empty if they are."""
    pairs = [
        _changes(press, readings[0])
        for press, readings in zip(fit.presses, fit.trial.readings, strict=True)
    ]
    read, model = (np.concatenate(x, None) for x in zip(*pairs, strict=True))
    turned = np.concatenate([own[::-1] for own, _ in pairs])

    def alike(changes: Floats) -> float:
        return float(changes @ model / np.linalg.norm(changes) / np.linalg.norm(model))

    if alike(read) < _ALIKE:
        order = ", and in reverse order they would" if alike(turned) > _ALIKE else ""
        return (
            "the presses do not change the taxels as on this skin (correlation "
            f"{alike(read):.2f}){order}: check the order of the taxels, the load's place and "
            "unit, and that the log belongs to this skin"
        )
    larger = float(read @ model / (model @ model))
    if not 1 / _LARGER < larger < _LARGER:
        return (
            f"the presses change the counts {larger:.3g} times as much as this skin's model: "
            "check the load's unit, the stiffness of [material], and [electrodes] lsb"
        )
    return ""


def _changes(press: HeldPress, model: Floats) -> tuple[Floats, Floats]:
    """Changes of the taxels' counts under a press, less offset and drift, and the model's.

    `model`: its counts [taxel, mean].
    Returns changes [taxel] each, zero where a taxel tells nothing.
    """
    away, own = model - model[:, :1], np.zeros(len(model))
    moves = np.take_along_axis(away, np.abs(away).argmax(1)[:, None], 1)[:, 0]
    for i, (so, row) in enumerate(zip(press.so, model, strict=True)):
        used = np.isfinite(so) & np.isfinite(row)
        if used.any():
            columns = np.stack([np.ones_like(row), press.time, row], 1)[used]
            own[i] = np.linalg.lstsq(columns, so[used], rcond=None)[0][-1] * moves[i]
    return own, np.where(own == 0, 0.0, moves)


def _price(fit: RelaxationFit) -> float:
    """What Schwarz's criterion, BIC, asks of a further term: a share and a time."""
    return 2 * float(np.log(fit.readings))


def _bends(fit: RelaxationFit) -> bool:
    """Whether the taxels' drifts follow a further power of time, by Schwarz's criterion."""
    bent = _bent(fit.presses)
    r, J = _residuals(bent, fit.trial.readings, fit.trial.theta)
    left = float(np.sum((r - J @ np.linalg.lstsq(J, r, rcond=None)[0]) ** 2))
    more = sum(int(np.isfinite(press.so).any(1).sum()) for press in bent)
    noise = max(1.0, left / max(fit.readings - (bent[0].drift_degree + 2) * more, 1))
    return fit.chi2 - left > more * float(np.log(fit.readings)) * noise


def _bent(presses: tuple[HeldPress, ...]) -> tuple[HeldPress, ...]:
    return tuple(press._replace(drift_degree=press.drift_degree + 1) for press in presses)


def _further(fit: RelaxationFit) -> tuple[float, Floats]:
    """By how much a small further term promises to lower BIC, and where to begin with it."""
    n, theta = fit.terms, fit.trial.theta
    r, J = _residuals(fit.presses, fit.trial.readings, theta)
    best = (-np.inf, theta)
    for i, tau in ((0, theta[n] - np.log(_AWAY)), (n, theta[2 * n - 1] + np.log(_AWAY))):
        start = np.insert(theta, [i, n + i], [np.log(_SMALL), tau])
        pairs = [
            np.stack([own[0], p.readings(_series(start), float(np.exp(theta[-1])))])
            for p, own in zip(fit.presses, fit.trial.readings, strict=True)
        ]
        change = _residuals(fit.presses, pairs, theta[:1])[1][:, 0]
        change[-1] = 0.0  # the factor s stays
        change -= J @ np.linalg.lstsq(J, change, rcond=None)[0]
        along = max(-float(change @ r), 0.0)  # a share below zero is none
        lower = along**2 / max(float(change @ change), 1e-300) / fit.inflation**2
        best = max(best, (lower - _price(fit), start), key=lambda pair: pair[0])
    return best


def _window(presses: tuple[HeldPress, ...]) -> tuple[float, float]:
    return min(p.first for p in presses), max(p.hold for p in presses)


def _series(theta: Floats) -> RelaxationSpec:
    n = len(theta) // 2
    gamma, tau = np.exp(theta[:n]), np.exp(theta[n : 2 * n])
    return RelaxationSpec(g=tuple(gamma / (1 + gamma.sum())), tau=tuple(tau))


def _fitted(data: SensorData, presses: tuple[HeldPress, ...], start: Floats) -> RelaxationFit:
    """The terms, as many as to start from, that follow the presses best."""
    (first, longest), count = _window(presses), len(start) // 2
    room = np.log([_LIMITS] * count + [(first / 3, _BEYOND * longest)] * count + [(0.5, 2.0)])
    trials: dict[bytes, Trial] = {}

    def at(theta: Floats) -> tuple[Floats, Floats]:
        own = Trial(theta, tuple(_near(press, theta) for press in presses))
        trials[theta.tobytes()] = own
        return _residuals(presses, own.readings, theta)

    found = solved_by_scipy(at, start, bounds=room.T, xtol=1e-6, ftol=1e-8, max_nfev=_TRIALS)
    end = trials[found.x.tobytes()]
    steady = _residuals(presses, end.readings, end.theta, drifts=False)[1]
    chi2, known = float(2 * found.cost), [np.isfinite(press.so) for press in presses]
    readings = int(sum(own.sum() for own in known))
    each = 2 + presses[0].drift_degree  # offset, drift and gain of a taxel
    free = readings - each * int(sum(own.any(1).sum() for own in known)) - 2 * count
    inflation = float(np.sqrt(max(1.0, chi2 / max(free, 1))))
    root, alone = (inflation * np.linalg.pinv(J, rcond=1e-9) for J in (found.jac, steady))
    spread = np.linalg.norm(alone, axis=1)
    return RelaxationFit(data, presses, end, chi2, readings, inflation, root, spread)


def _near(press: HeldPress, theta: Floats) -> Floats:
    """Counts of the model at some parameters, and a step along each [1 + p, taxel, mean]."""
    points = [theta, *(theta + _STEP * np.eye(len(theta)))]
    return np.stack([press.readings(_series(x), float(np.exp(x[-1]))) for x in points])


def _residuals(
    presses: tuple[HeldPress, ...],
    readings: Sequence[Floats],  # the model's of each press, there and a step along each
    theta: Floats,
    *,
    drifts: bool = True,  # whether taxels drift
) -> tuple[Floats, Floats]:
    """Residuals over the noise [n], and their derivatives by the parameters [n, p]."""
    rows = [
        unexplained(press, own, drifts=drifts).reshape(len(own), -1)
        for press, own in zip(presses, readings, strict=True)
    ]
    at = np.concatenate(rows, 1)
    # The last residual is that of the factor on the constants, which the skin file states.
    J = np.zeros((at.shape[1] + 1, len(at) - 1))
    J[:-1] = (at[1:] - at[0]).T / _STEP
    J[-1, -1] = 1 / DEFAULTS[STIFFNESS]
    return np.append(at[0], theta[-1] / DEFAULTS[STIFFNESS]), J


def unexplained(press: HeldPress, readings: Floats, *, drifts: bool = True) -> Floats:
    """What offset, drift and gain of each taxel leave of its counts, over their noise.

    `readings` are the model's of some trials [trial, taxel, mean]; so is what is left.
    """
    used = np.isfinite(press.so) & np.isfinite(readings).all(0)
    weight = np.where(used, 1 / press.deviation, 0.0)
    model = np.nan_to_num(readings - readings[..., :1])
    degree = press.drift_degree if drifts else 0
    powers = (press.time / press.time[-1])[:, None] ** np.arange(1 + degree)
    fixed = [np.broadcast_to(own, model.shape) for own in powers.T]
    stack = np.stack([*fixed, model], -1) * weight[..., None]
    basis = np.linalg.qr(stack)[0]
    y = np.where(used, press.so, 0.0) * weight
    return np.asarray(y - np.einsum("ktmc,ktnc,tn->ktm", basis, basis, y, optimize=True))
