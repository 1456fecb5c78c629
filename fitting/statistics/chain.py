"""Samples of a posterior and their convergence.

A chain is judged by its integrated autocorrelation time tau (Goodman & Weare 2010): it is
called converged when it is 50 tau long for every parameter and tau no longer changes. The
first 2 tau are burn-in.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fitting.statistics.log_probability import Gaussian

LONG_ENOUGH = 50.0
TAU_SETTLED = 0.05
_BURN_IN = 2.0
_DRAWS = 100
# Laplace and chain agree where means differ by less than this, in standard deviations,
# and standard deviations by less than this factor.
_MEANS_AGREE, _DEVIATIONS_AGREE = 0.5, 1.2


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Samples of a posterior and how far they can be trusted."""

    names: tuple[str, ...]  # of the parameters
    chain: np.ndarray  # every step of every walker, shape [step, walker, p]
    log_probability: np.ndarray  # shape [step, walker]
    tau: np.ndarray  # integrated autocorrelation time of each parameter, in steps, shape [p]
    tau_change: float  # largest relative change of tau since the look before
    acceptance: float  # mean fraction of accepted proposals
    laplace: Gaussian | None  # the Gaussian at the maximum, or None where there is none
    evaluations: int  # log-probabilities computed in this run
    seconds: float  # spent on computing them

    @property
    def steps(self) -> int:
        """Length of the chain."""
        return len(self.chain)

    @property
    def length(self) -> float:
        """Length of the chain in autocorrelation times of the slowest parameter."""
        slowest = float(np.max(self.tau))
        return self.steps / slowest if np.isfinite(slowest) and slowest > 0.0 else 0.0

    @property
    def converged(self) -> bool:
        """Whether the chain is long enough and its autocorrelation time known."""
        return self.length >= LONG_ENOUGH and self.tau_change <= TAU_SETTLED

    @property
    def burn_in(self) -> int:
        """Steps that are left out: two autocorrelation times, at most half of the chain."""
        tau = float(np.max(self.tau))
        if not np.isfinite(tau):
            return self.steps // 2
        return min(int(np.ceil(_BURN_IN * tau)), self.steps // 2)

    @property
    def samples(self) -> np.ndarray:
        """Samples after burn-in, all walkers in a row, shape [n, p]."""
        return self.chain[self.burn_in :].reshape(-1, self.chain.shape[-1])

    @property
    def effective_samples(self) -> np.ndarray:
        """Independent samples of each parameter, shape [p]."""
        kept = (self.steps - self.burn_in) * self.chain.shape[1]
        return kept / np.maximum(np.where(np.isfinite(self.tau), self.tau, np.inf), 1.0)

    def draws(self, count: int = _DRAWS, seed: int = 0) -> np.ndarray:
        """A few samples at random, shape [count, p]."""
        kept = self.samples
        return kept[np.random.default_rng(seed).integers(0, len(kept), count)]

    @property
    def message(self) -> str:
        """Whether the chain can be trusted, with the numbers."""
        slowest = int(np.argmax(np.where(np.isfinite(self.tau), self.tau, np.inf)))
        tau, name = float(self.tau[slowest]), self.names[slowest]
        if not np.isfinite(tau):
            return (
                f"not converged: {self.steps} steps are too few to estimate the "
                f"autocorrelation time of {name}; raise --steps"
            )
        numbers = (
            f"{self.steps} steps are {self.length:.1f} autocorrelation times "
            f"({tau:.1f} steps for {name}, the slowest; {LONG_ENOUGH:.0f} are needed)"
        )
        if self.converged:
            return f"converged: {numbers}; acceptance {self.acceptance:.2f}"
        if self.length >= LONG_ENOUGH:
            reason = f"its estimate still changed by {100.0 * self.tau_change:.1f} %"
            advice = f"raise --steps to {2 * self.steps}"
        else:
            reason, advice = "", f"raise --steps to {_round_up(1.2 * LONG_ENOUGH * tau)}"
        return f"not converged: {numbers}{'; ' if reason else ''}{reason}; {advice}"

    @property
    def report(self) -> dict[str, Any]:
        """How long the chain is and how far it can be trusted, for JSON."""
        return {
            "agreement": self.agreement,
            "steps": self.steps,
            "walkers": self.chain.shape[1],
            "burn_in": self.burn_in,
            "autocorrelation_time": dict(zip(self.names, self.tau.tolist(), strict=True)),
            "effective_samples": float(np.min(self.effective_samples)),
            "acceptance": self.acceptance,
            "converged": self.converged,
            "status": "converged" if self.converged else "not_converged",
            "message": self.message,
        }

    @property
    def agreement(self) -> dict[str, Any]:
        """The chain compared with Laplace's approximation."""
        if self.laplace is None:
            return {"agree": False, "message": "there is no interior maximum to expand at"}
        kept = self.samples
        deviation = np.maximum(self.laplace.deviation, 1e-300)
        shift = (kept.mean(axis=0) - self.laplace.mean) / deviation
        ratio = kept.std(axis=0) / deviation
        factor = np.maximum(ratio, 1.0 / np.maximum(ratio, 1e-300))
        # What the finite chain itself leaves open is not a disagreement.
        slack = 3.0 / np.sqrt(np.maximum(self.effective_samples, 1.0))
        apart = (np.abs(shift) > _MEANS_AGREE + slack) | (factor > _DEVIATIONS_AGREE + slack)
        bad = [name for name, wrong in zip(self.names, apart, strict=True) if wrong]
        text = (
            f"not Gaussian in {', '.join(bad)}: quote the quantiles of the chain"
            if bad
            else "chain and Laplace's approximation agree"
        )
        return {
            "agree": not bad,
            "shift_in_deviations": dict(zip(self.names, shift.tolist(), strict=True)),
            "deviation_ratio": dict(zip(self.names, ratio.tolist(), strict=True)),
            "message": text,
        }


def constants_report(
    constants: np.ndarray,  # samples, SI units, shape [n, p]
    names: Sequence[str],
    quantiles: Sequence[float],  # ends of the 95 %, of the 68 % interval, median, ascending [%]
    tree: Callable[[Any], dict[str, Any]],  # puts one value a constant under its name
) -> dict[str, Any]:
    """Samples of constants in numbers, for JSON."""
    low95, low, middle, high, high95 = np.percentile(constants, quantiles, axis=0)
    covariance = np.atleast_2d(np.cov(constants.T))
    return {
        "parameters": tree(middle.tolist()),
        "mean": tree(constants.mean(axis=0).tolist()),
        "standard_deviations": tree(np.sqrt(np.diagonal(covariance)).tolist()),
        "covariance": covariance.tolist(),
        "covariance_order": list(names),
        "intervals": {
            "68": tree(np.stack([low, high], axis=1).tolist()),
            "95": tree(np.stack([low95, high95], axis=1).tolist()),
        },
    }


def _round_up(value: float) -> int:
    """The next number with two significant digits."""
    unit = 10 ** max(int(np.floor(np.log10(max(value, 1.0)))) - 1, 0)
    return int(-(-value // unit) * unit)
