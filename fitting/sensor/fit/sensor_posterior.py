"""The posterior of a calibration, sampled: its log-probability, its start, its summary."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from fitting.sensor.fit.result import SensorFit
from fitting.sensor.model.constants import SensorFamily, is_press_error
from fitting.statistics.chain import Posterior, constants_report
from fitting.statistics.log_probability import Gaussian
from fitting.statistics.posterior import Settings, sample
from fitting.statistics.residuals import sensitivity

_QUANTILES = (2.5, 15.865, 50.0, 84.135, 97.5)


def sample_sensor(
    fit: SensorFit,
    settings: Settings | None = None,
    progress: Callable[[int, int, float], None] = lambda step, steps, tau: None,
) -> tuple[Posterior, dict[str, Any]]:
    """Sample the constants of a calibration around its minimum.

    The noise is what the residuals showed, the priors are those of the fit: they are
    residuals like the readings, Gaussian in the constants. Priors on parameters without one
    are flat in theta, which is flat in the logarithm of a positive constant.

    Errors of single presses are integrated out: residuals are linear in them, r + E e, and half
    the square of r - Q Q^T r is left, with an orthonormal base Q of the columns of E. There are
    then at least twice as many walkers as constants.

    Returns:
        The chain in theta, and its summary: the key "posterior" of the report.

    Raises:
        ValueError: settings are not allowed, or a chain file belongs to something else.
        PosteriorError: no possible point was found.
    """
    family, residuals = fit.family, fit.residuals
    of_press = np.array([is_press_error(name) for name in family.names])
    own = np.flatnonzero(~of_press)
    sampled = SensorFamily(tuple(family.parts[i] for i in own))
    base = jnp.zeros((residuals.value.size, 0))
    if of_press.any():
        _, slopes = sensitivity(residuals, jnp.asarray(fit.constants))
        base = jnp.linalg.qr(slopes[:, of_press])[0]
        settings = settings or Settings()
        walkers = max(settings.walkers, 2 * len(own))
        settings = dataclasses.replace(settings, walkers=walkers)
    theta = sampled.unconstrained(jnp.asarray(fit.constants[own]))
    slope = np.asarray(jax.jacfwd(sampled.constants)(theta))
    inverse = np.linalg.inv(slope)
    spread = inverse @ fit.uncertainty.covariance[np.ix_(own, own)] @ inverse.T
    centre = np.array(theta)
    for name in fit.held:
        # Into what is possible, by one standard error.
        along = spread[:, sampled.names.index(name)]
        centre += along / np.sqrt(along[sampled.names.index(name)])
    start = Gaussian(centre, spread)
    widening = fit.misfit.inflation
    at = jnp.asarray(fit.constants)

    def one(theta: jax.Array) -> jax.Array:
        constants = sampled.constants(theta)
        possible = jnp.all(constants >= jnp.asarray(sampled.floors))
        r = residuals.of_constants(at.at[own].set(constants))
        r = r - base @ (base.T @ r)
        value = -0.5 * jnp.sum(r * r) / widening**2
        return jnp.where(possible & jnp.isfinite(value), value, -jnp.inf)

    leaves = [np.asarray(x) for x in jax.tree.leaves(residuals)]
    key = b"".join(x.tobytes() for x in leaves) + repr(family).encode()
    # Differences across a floor are infinite.
    with np.errstate(invalid="ignore"):
        chain = sample(
            jax.vmap(one), start, sampled.names, settings, key=key, progress=progress
        )
    constants = np.asarray(jax.vmap(sampled.constants)(jnp.asarray(chain.samples)))

    def by_name(values: Any) -> dict[str, Any]:
        return dict(zip(sampled.names, values, strict=True))

    return chain, {
        **constants_report(constants, sampled.names, _QUANTILES, by_name),
        **chain.report,
    }
