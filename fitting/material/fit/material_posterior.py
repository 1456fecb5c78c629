"""The posterior of a law's constants: likelihood of the fit's residuals, priors, summary.

Sampled are the unconstrained θ of the law's family and, where the noise is not stated, the
logarithm of its standard deviation s::

    log p = -1/2 Σ r(θ)²/s² - n log s - 1/2 Σ (θ_i / d_i)²

r are the residuals of the fit, d the prior's standard deviations (`prior_deviation` of the
family); log s is uniform over a wide range. The prior is wide, and where the data do not
narrow it the report names the constant.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.material.fit.problem import settle
from fitting.material.fit.result import MaterialFit
from fitting.statistics.chain import Posterior, constants_report
from fitting.statistics.log_probability import Gaussian
from fitting.statistics.posterior import Settings, sample
from fitting.statistics.residuals import sensitivity

_NOISE = (1e-6, 10.0)
_PRIOR_DOMINATED = 0.5
_QUANTILES = (2.5, 16.0, 50.0, 84.0, 97.5)
_ENDS = ("low95", "low68", "median", "high68", "high95")


@dataclasses.dataclass(frozen=True)
class MaterialPosterior:
    """Samples of a law's constants."""

    fit: MaterialFit  # the fit that was sampled around
    posterior: Posterior  # the chain in θ (and log s)
    noise_known: bool  # whether s was stated and not sampled
    bounds: Mapping[str, tuple[float, float]]  # hard bounds on constants, SI units

    def constants(self, theta: np.ndarray) -> np.ndarray:
        """Constants in SI units of samples [n, p]."""
        size = self.fit.family.size
        return np.asarray(_constants(self.fit.problem.residuals, jnp.asarray(theta[:, :size])))

    @property
    def priors(self) -> dict[str, str]:
        """Every prior in words."""
        family = self.fit.family
        priors = {
            name: f"normal, mean 0, standard deviation {d:g} (unconstrained, dimensionless)"
            for name, d in zip(family.theta_names, family.prior_deviation, strict=True)
        }
        if not self.noise_known:
            priors["noise"] = (
                f"log-uniform from {_NOISE[0]:g} to {_NOISE[1]:g} (of the residuals)"
            )
        for name, (low, high) in self.bounds.items():
            priors[f"bound on {name}"] = f"zero outside {low:g} to {high:g} (SI)"
        return priors

    @property
    def report(self) -> dict[str, Any]:
        """The key "posterior" of `suas fit material --sample --json`."""
        family, posterior = self.fit.family, self.posterior
        theta = posterior.samples
        constants = self.constants(theta)
        moduli = np.asarray(_moduli(self.fit.problem.residuals, jnp.asarray(constants)))
        share = theta.std(axis=0)[: family.size] / family.prior_deviation
        report: dict[str, Any] = {
            **constants_report(constants, family.names, _QUANTILES, family.tree),
            "shear_modulus_Pa": dict(
                zip(_ENDS, np.percentile(moduli, _QUANTILES).tolist(), strict=True)
            ),
            "priors": self.priors,
            "prior_dominated": [
                f"{name} (the data leave {100.0 * s:.0f} % of the prior's width)"
                for name, s in zip(family.theta_names, share, strict=True)
                if s > _PRIOR_DOMINATED
            ],
            "warnings": self._warnings(),
            "laplace": self._laplace(),
            **posterior.report,
            "evaluations": posterior.evaluations,
            "evaluations_per_s": posterior.evaluations / max(posterior.seconds, 1e-9),
        }
        if not self.noise_known:
            spread = np.percentile(np.exp(theta[:, -1]), _QUANTILES)
            report["noise"] = {
                "median": spread[2],
                "68": spread[[1, 3]].tolist(),
                "95": spread[[0, 4]].tolist(),
            }
        return report

    def _warnings(self) -> list[str]:
        """What the samples do not allow for."""
        misfit = self.fit.misfit
        if not misfit.significant:
            return []
        return [
            f"the samples take the misfit for independent noise, which it is not: their "
            f"intervals are about {misfit.inflation:.2g} times too narrow; quote those of the "
            f"fit, or choose another law"
        ]

    def _laplace(self) -> dict[str, Any] | None:
        gaussian = self.posterior.laplace
        if gaussian is None:
            return None
        family = self.fit.family
        size, scales = family.size, self.fit.problem.residuals.scales
        mean = jnp.asarray(gaussian.mean[:size])
        slope = np.asarray(jax.jacfwd(lambda t: family.constants(t, scales))(mean))
        covariance = slope @ gaussian.covariance[:size, :size] @ slope.T
        return {
            "parameters": family.tree(np.asarray(family.constants(mean, scales)).tolist()),
            "standard_deviations": family.tree(np.sqrt(np.diagonal(covariance)).tolist()),
            "covariance": covariance.tolist(),
        }


def sample_material(
    fit: MaterialFit,
    settings: Settings | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    progress: Callable[[int, int, float], None] = lambda step, steps, tau: None,
) -> MaterialPosterior:
    """Sample the constants of a fitted law.

    Args:
        fit: the fit; its residuals are the likelihood, known noise where they are "noise".
        settings: of the sampler.
        bounds: hard bounds by constant, SI units.
        progress: see `posterior.sample`.

    Raises:
        ValueError: settings are not allowed, or a chain file belongs to something else.
        PosteriorError: no possible point was found.
    """
    problem = settle(fit.problem, fit.constants)
    fit = dataclasses.replace(fit, problem=problem)
    family, residuals = fit.family, problem.residuals
    known = problem.kind == "noise"
    limits = np.array([(bounds or {}).get(name, (-np.inf, np.inf)) for name in family.names])
    low, high = jnp.asarray(limits[:, 0]), jnp.asarray(limits[:, 1])
    deviation = jnp.asarray(family.prior_deviation)

    def one(theta: Array) -> Array:
        t = theta[: family.size]
        scale = 1.0 if known else jnp.exp(theta[-1])
        c = family.constants(t, residuals.scales)
        value = residuals.log_likelihood(t, scale) - 0.5 * jnp.sum((t / deviation) ** 2)
        possible = jnp.all((c >= low) & (c <= high))
        if not known:
            possible &= (scale > _NOISE[0]) & (scale < _NOISE[1])
        return jnp.where(possible, value, -jnp.inf)

    names = (*family.theta_names, *(() if known else ("log(noise)",)))
    leaves = [np.asarray(x) for x in jax.tree.leaves(residuals)]
    key = (
        b"".join(x.tobytes() for x in leaves)
        + repr((family, known, sorted((bounds or {}).items()))).encode()
    )
    chain = sample(
        jax.vmap(one), _start(fit, known), names, settings, key=key, progress=progress
    )
    return MaterialPosterior(fit, chain, known, dict(bounds or {}))


def _start(fit: MaterialFit, known: bool) -> Gaussian:
    """Gauss-Newton's approximation at the fit, prior included."""
    family, residuals = fit.family, fit.problem.residuals
    theta = family.unconstrained(jnp.asarray(fit.constants), residuals.scales)
    r, by_constant = (np.asarray(x) for x in sensitivity(residuals, jnp.asarray(fit.constants)))
    J = by_constant @ np.asarray(
        jax.jacfwd(lambda t: family.constants(t, residuals.scales))(theta)
    )
    count = int(residuals.used.sum())
    spread = np.sqrt(np.sum(r**2) / max(count, 1))
    noise = 1.0 if known else float(np.clip(spread, 10.0 * _NOISE[0], 0.1 * _NOISE[1]))
    precision = J.T @ J / noise**2 + np.diag(1.0 / family.prior_deviation**2)
    mean, covariance = np.asarray(theta), np.linalg.pinv(precision, hermitian=True)
    if known:
        return Gaussian(mean, covariance)
    size = family.size
    wide = np.zeros((size + 1, size + 1))
    wide[:size, :size], wide[size, size] = covariance, 0.5 / max(count, 1)
    return Gaussian(np.append(mean, np.log(noise)), wide)


@eqx.filter_jit
def _constants(residuals: Any, theta: Array) -> Array:
    return jax.vmap(lambda t: residuals.family.constants(t, residuals.scales))(theta)


@eqx.filter_jit
def _moduli(residuals: Any, constants: Array) -> Array:
    return jax.vmap(lambda c: residuals.family.law(c).shear_modulus)(constants)
