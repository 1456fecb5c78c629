"""Posterior of line loads on a skin in plane strain."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.load_posterior import AbstractLoadPosterior
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.model.evaluation import loads_from
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.statistics.log_probability import LogProbability
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.state import State
from suas_jax.scene.error_estimate import bounded

_SAME = np.deg2rad(1.0)


class SectionPosterior(AbstractLoadPosterior):
    """The posterior of line loads in plane strain: even over angle, force and direction.

    Where directions are not free, friction and width are integrated out (`LeftOutOfContacts`).
    """

    def __init__(self, fitter: SectionFitter, nodes: AbstractNodeSearch) -> None:
        low, high = (x[:, 0] for x in fitter.limits(1, 1, False))
        super().__init__(nodes, 1, float(np.prod(high - low)), _SAME, np.array([[-1.0]]))
        self._fitter = fitter

    def log_probability(self, y: Floats, mode: Explanations) -> LogProbability:
        """See the base class."""
        count, skin = int(mode.contacts[0]), self._fitter.skin
        pull = bool(mode.parameters[0, count] < 0)
        low, high = (x[..., 0] for x in self._fitter.limits(count, 1, pull))
        state, reading, weight = mode.state, jnp.asarray(y), jnp.asarray(mode.weight[0])
        left_out = self._fitter.left_out
        others = [] if left_out is None else left_out.of_mode(mode)

        def log_probability(points: Float[Array, "point p"]) -> Float[Array, " point"]:
            lanes = points.shape[0]
            inside = jnp.all((points >= low) & (points <= high), 1)
            problem = skin.problem(loads_from(jnp.clip(points, low, high).T, count))
            near = State(*(jnp.repeat(jnp.asarray(x), lanes, -1) for x in state))
            found = equilibrium(problem, near, omitted=True)
            shown = corrected(problem, found.state, found.change)
            so = skin.electrodes.read(shown.mechanics, shown.state.q).so
            residual = jnp.where(weight[:, None] > 0, reading[:, None] - so, 0.0)
            chi2 = jnp.sum(weight[:, None] * residual**2, 0)
            trust = bounded(problem, found.state, shown.state, found.outcome)
            log = -chi2 / 2
            for own, rare in others:
                gain = jnp.sum((own @ (weight[:, None] * residual)) ** 2, 0) / 2 - rare
                log = jnp.logaddexp(log, gain - chi2 / 2)
            return jnp.where(inside & (trust.result == 0), log, -jnp.inf)

        return log_probability
