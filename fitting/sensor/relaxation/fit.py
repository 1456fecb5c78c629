"""Relaxation times and shares from the course of a skin's readings under held presses.

The readings of a taxel k follow the viscoelastic model m_k(t) of `suas sweep --history` up to
what has nothing to do with the rubber, each taxel's offset, steady drift and gain::

    y_k(t) = a_k + b_k t + c_k m_k(t; gamma, tau, s)

with gamma_i = g_i / (1 - sum g), the relaxation times tau_i and a factor s on the long-term
constants. a, b and c are linear and taken out of each taxel by a projection (Golub and Pereyra
1973, variable projection), so the covariance of what is left counts them as unknown. The model
is run anew for every trial; its derivatives are differences of it.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.sensor.logs.data import NoCalibration, SensorData
from fitting.sensor.relaxation.held_press import HeldPress, held_presses
from fitting.statistics.least_squares import solved_by_scipy
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.input_errors import DEFAULTS, STIFFNESS
from suas_jax.runtime.precision import require_float64

_MOST_TERMS = 2
_SHARE = 0.15  # that relaxes, to start from
_STEP = 5e-3  # of a parameter, for differences
_MOVES = 5.0  # change of a taxel's mean, over its noise, that makes it tell something
_UNKNOWN = 0.5  # relative deviation of a share or a time from which it is not known
_HIDDEN = 2.0  # by how much the drift may widen a deviation without being named
_BEYOND, _APART = 10.0, 2.0  # of the times measured; of two times
_SMALL, _AWAY = 0.01, 5.0  # a further term to try: gamma, and how far its time is
_LIMITS = (1e-4, 4.0)  # of gamma
_TRIALS = 40


class Trial(NamedTuple):
    """The model near some parameters."""

    theta: Floats  # log gamma, log tau, log of the factor on the long-term constants [p]
    readings: tuple[
        Floats, ...
    ]  # of each press, there and a step along each [1 + p, taxel, mean]


@dataclasses.dataclass(frozen=True)
class RelaxationFit:
    """Prony terms with what is known of them."""

    data: SensorData
    presses: tuple[HeldPress, ...]
    told: tuple[np.ndarray, ...]  # which taxels of each move [taxel]
    trial: Trial  # at the minimum
    chi2: float  # sum of the squared residuals over the noise
    readings: int  # how many means they are of
    free: int  # degrees of freedom
    root: Floats  # R with R R^T the covariance of theta, misfit included [p, p]
    steady: Floats  # deviations of theta if no taxel drifted [p]

    @property
    def terms(self) -> int:
        """How many."""
        return len(self.trial.theta) // 2

    @property
    def inflation(self) -> float:
        """Factor on the deviations for a misfit that is no noise."""
        return float(np.sqrt(max(1.0, self.chi2 / self.free)))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the constants."""
        own = (f"material.relaxation.{k}.{i}" for k in ("g", "tau") for i in range(self.terms))
        return (*own, "stiffness")

    @property
    def constants(self) -> Floats:
        """Shares g, times tau [s], and the factor on the long-term constants [p]."""
        own = np.exp(self.trial.theta)
        own[: self.terms] /= 1 + own[: self.terms].sum()
        return own

    @property
    def covariance(self) -> Floats:
        """Of the constants [p, p]."""
        n, own = self.terms, self.constants
        slope = np.diag(own)  # d constants / d theta
        slope[:n, :n] -= np.outer(own[:n], own[:n])
        moved = slope @ self.root
        return np.asarray(moved @ moved.T)

    @property
    def series(self) -> RelaxationSpec:
        """The terms."""
        return _series(self.trial.theta)

    def relaxed(self, time: float, since: float) -> tuple[float, float]:
        """Share of the stress at one time that is gone at another, and its deviation."""
        steps = 1e-4 * np.eye(len(self.trial.theta))
        at = [
            relaxed(_series(self.trial.theta + h), time, since) for h in (0 * steps[0], *steps)
        ]
        slope = (np.array(at[1:]) - at[0]) / 1e-4
        return at[0], float(np.linalg.norm(slope @ self.root))

    @property
    def window(self) -> tuple[float, float]:
        """Times that the presses tell of [s]."""
        return min(p.first for p in self.presses), max(p.hold for p in self.presses)

    @property
    def unknown(self) -> str:
        """Which term is not known, and why; empty if all are."""
        (shortest, longest), n = self.window, self.terms
        deviation = np.linalg.norm(self.root, axis=1)
        own = self.constants
        if n > 1 and np.min(np.diff(np.sort(np.log(own[n : 2 * n])))) < np.log(_APART):
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

    @property
    def findings(self) -> list[str]:
        """What the presses leave open, in words."""
        shortest, longest = self.window
        window = (
            f"what relaxes within {shortest:.3g} s of a change counts as elastic, what takes "
            f"much longer than the hold of {longest:.3g} s as long-term"
        )
        return [window, *self.hidden]


def relaxed(series: RelaxationSpec, time: float, since: float) -> float:
    """Share of a held stress at one time that is gone at another [s], 1 - G(time)/G(since)."""
    g, tau = np.array(series.g), np.array(series.tau)
    late, early = (1 + g @ np.expm1(-t / tau) for t in (time, since))
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
    first, longest = min(p.first for p in presses), max(p.hold for p in presses)
    start = np.log([_SHARE / (1 - _SHARE), np.sqrt(first * longest), 1.0])
    progress("one Prony term")
    best = _fitted(data, presses, start)
    if best.unknown:
        raise NoCalibration(
            f"{data.paths}: no relaxation is told: {'; '.join([best.unknown, *best.hidden])}"
        )
    tried: list[dict[str, Any]] = []
    while best.terms < _MOST_TERMS:
        progress(f"{best.terms + 1} Prony terms")
        hoped, start = _further(best)
        row = {"terms": best.terms + 1, "gain_of_bic": hoped, "unknown": ""}
        tried.append(row)
        if hoped <= 0:
            break
        more = _fitted(data, presses, start)
        lower = (best.chi2 - more.chi2) / more.inflation**2 - _price(best)
        row |= {"gain_of_bic": lower, "unknown": more.unknown}
        if lower <= 0 or more.unknown:
            break
        best = more
    return best, tried


def _price(fit: RelaxationFit) -> float:
    """What Schwarz's criterion, BIC, asks of a further term: a share and a time."""
    return 2 * float(np.log(fit.readings))


def _further(fit: RelaxationFit) -> tuple[float, Floats]:
    """By how much a small further term promises to lower BIC, and where to begin with it."""
    n, theta, told = fit.terms, fit.trial.theta, fit.told
    r, J, _ = _residuals(fit.presses, told, fit.trial)
    best = (-np.inf, theta)
    for i, tau in ((0, theta[n] - np.log(_AWAY)), (n, theta[2 * n - 1] + np.log(_AWAY))):
        start = np.insert(theta, [i, n + i], [np.log(_SMALL), tau])
        pairs = [
            np.stack([own[0], p.readings(_series(start), float(np.exp(theta[-1])))])
            for p, own in zip(fit.presses, fit.trial.readings, strict=True)
        ]
        left = [
            unexplained(p, x)[0][:, k] for p, x, k in zip(fit.presses, pairs, told, strict=True)
        ]
        change = np.append(np.concatenate([np.ravel(x[1] - x[0]) for x in left]), 0.0)
        change -= J @ np.linalg.lstsq(J, change, rcond=None)[0]
        size = float(change @ change)
        along = -float(change @ r)  # a share below zero is none
        lower = max(along, 0.0) ** 2 / max(size, 1e-300) / fit.inflation**2
        best = max(best, (lower - _price(fit), start), key=lambda pair: pair[0])
    return best


def _series(theta: Floats) -> RelaxationSpec:
    n = len(theta) // 2
    gamma, tau = np.exp(theta[:n]), np.exp(theta[n : 2 * n])
    return RelaxationSpec(
        g=tuple(map(float, gamma / (1 + gamma.sum()))), tau=tuple(map(float, tau))
    )


def _fitted(data: SensorData, presses: tuple[HeldPress, ...], start: Floats) -> RelaxationFit:
    """The terms, as many as to start from, that follow the presses best."""
    first, longest = min(p.first for p in presses), max(p.hold for p in presses)
    count = len(start) // 2
    room = np.log([_LIMITS] * count + [(first / 3, _BEYOND * longest)] * count + [(0.5, 2.0)])
    told = tuple(_telling(p, p.readings(_series(start), 1.0)) for p in presses)
    trials: list[Trial] = []

    def at(theta: Floats) -> tuple[Floats, Floats]:
        trials.append(_trial(presses, theta))
        r, J, _ = _residuals(presses, told, trials[-1])
        return r, J

    found = solved_by_scipy(at, start, bounds=room.T, xtol=1e-6, ftol=1e-8, max_nfev=_TRIALS)
    end = next(t for t in reversed(trials) if np.array_equal(t.theta, found.x))
    _, J, count_of = _residuals(presses, told, end)
    _, steady, _ = _residuals(presses, told, end, drifts=False)
    chi2 = float(2 * found.cost)
    free = max(count_of - 3 * sum(map(np.sum, told)) - len(start) + 1, 1)
    inflation = np.sqrt(max(1.0, chi2 / free))
    root, alone = (inflation * np.linalg.pinv(x, rcond=1e-9) for x in (J, steady))
    if not np.all(np.isfinite(found.fun)) or not np.isfinite(chi2):
        raise NoCalibration(f"{data.paths}: the model has no state for some of the loads")
    return RelaxationFit(
        data,
        presses,
        told,
        end,
        chi2,
        count_of,
        free,
        root,
        np.linalg.norm(alone, axis=1),
    )


def _trial(presses: tuple[HeldPress, ...], theta: Floats) -> Trial:
    points = [theta, *(theta + _STEP * np.eye(len(theta)))]
    rows = (
        np.stack([p.readings(_series(x), float(np.exp(x[-1]))) for x in points])
        for p in presses
    )
    return Trial(theta, tuple(rows))


def _telling(press: HeldPress, readings: Floats) -> np.ndarray:
    """Which taxels move by more than their noise [taxel]."""
    change = np.ptp(np.nan_to_num(readings, nan=np.nanmedian(readings)), axis=1)
    return np.asarray(change > _MOVES * np.median(press.deviation, axis=1))


def _residuals(
    presses: tuple[HeldPress, ...],
    told: tuple[np.ndarray, ...],  # which taxels of each press
    trial: Trial,
    *,
    drifts: bool = True,
) -> tuple[Floats, Floats, int]:
    """Residuals over the noise [n], their derivatives [n, p], and of how many readings."""
    rows, count = [], 0
    for press, own, readings in zip(presses, told, trial.readings, strict=True):
        left, used = unexplained(press, readings, drifts=drifts)
        rows.append(left[:, own].reshape(len(left), -1))
        count += int(used[own].sum())
    at = np.concatenate(rows, 1)
    # The last residual is that of the factor on the constants, which the skin file states.
    J = np.zeros((at.shape[1] + 1, len(at) - 1))
    J[:-1] = (at[1:] - at[0]).T / _STEP
    J[-1, -1] = 1 / DEFAULTS[STIFFNESS]
    return np.append(at[0], trial.theta[-1] / DEFAULTS[STIFFNESS]), J, count


def unexplained(
    press: HeldPress, readings: Floats, *, drifts: bool = True
) -> tuple[Floats, np.ndarray]:
    """What offset, drift and gain of each taxel leave of its counts, over their noise.

    `readings` are the model's of some trials [trial, taxel, mean].
    Returns what is left, and which counts are used [taxel, mean].
    """
    used = np.isfinite(press.so) & np.isfinite(readings).all(0)
    weight = np.where(used, 1 / press.deviation, 0.0)
    model = np.nan_to_num(readings - readings[..., :1])
    fixed = [np.ones_like(model), np.broadcast_to(press.time / press.time[-1], model.shape)]
    stack = np.stack([*fixed[: 1 + drifts], model], -1) * weight[..., None]
    basis = np.linalg.qr(stack)[0]
    y = np.where(used, press.so, 0.0) * weight
    found = y - np.einsum("ktmc,ktnc,tn->ktm", basis, basis, y, optimize=True)
    return found, used
