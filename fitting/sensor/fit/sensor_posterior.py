"""The posterior of a calibration, sampled: its log-probability, its start, its summary."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from fitting.sensor.fit.result import SensorFit
from fitting.statistics.chain import Posterior, constants_report
from fitting.statistics.log_probability import Gaussian
from fitting.statistics.posterior import Settings, sample

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

    Returns:
        The chain in theta, and its summary: the key "posterior" of the report.

    Raises:
        ValueError: settings are not allowed, or a chain file belongs to something else.
        PosteriorError: no possible point was found.
    """
    family, residuals = fit.family, fit.residuals
    theta = family.unconstrained(jnp.asarray(fit.constants))
    slope = np.asarray(jax.jacfwd(family.constants)(theta))
    inverse = np.linalg.inv(slope)
    spread = inverse @ fit.uncertainty.covariance @ inverse.T
    centre = np.array(theta)
    for name in fit.held:
        # Into what is possible, by one standard error.
        along = spread[:, family.names.index(name)]
        centre += along / np.sqrt(along[family.names.index(name)])
    start = Gaussian(centre, spread)
    widening = fit.misfit.inflation

    def one(theta: jax.Array) -> jax.Array:
        possible = jnp.all(family.constants(theta) >= jnp.asarray(family.floors))
        value = residuals.log_likelihood(theta) / widening**2
        return jnp.where(possible, value, -jnp.inf)

    leaves = [np.asarray(x) for x in jax.tree.leaves(residuals)]
    key = b"".join(x.tobytes() for x in leaves) + repr(family).encode()
    # Differences across a floor are infinite.
    with np.errstate(invalid="ignore"):
        chain = sample(jax.vmap(one), start, family.names, settings, key=key, progress=progress)
    constants = np.asarray(jax.vmap(family.constants)(jnp.asarray(chain.samples)))

    def by_name(values: Any) -> dict[str, Any]:
        return dict(zip(family.names, values, strict=True))

    return chain, {
        **constants_report(constants, family.names, _QUANTILES, by_name),
        **chain.report,
    }
