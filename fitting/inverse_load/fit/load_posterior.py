"""Posterior of a frame's loads on a skin: prior, likelihood, distances."""

import abc

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.model.evaluation import loads_from
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.statistics.log_probability import LogProbability, NumpyBatch
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.scene.error_estimate import bounded

_SAME = np.deg2rad(1.0)


class AbstractLoadPosterior(abc.ABC):
    """The posterior of contacts on one skin."""

    def __init__(
        self,
        nodes: AbstractNodeSearch,  # which know distances
        places: int,  # coordinates of a place
        volume: float,  # of one contact's parameters under their prior
        same: float,  # distance below which two contacts are the same
        mirrors: Floats,  # signs of the coordinates of mirror places [image, coordinate]
    ) -> None:
        self.nodes, self.volume = nodes, volume
        self._places, self._same, self._mirrors = places, same, mirrors

    @abc.abstractmethod
    def log_probability(self, y: Floats, mode: Explanations) -> LogProbability | NumpyBatch:
        """The posterior of as many contacts as a mode has, but for a constant.

        `y`: readings as the model has them [channel]. `mode`: a fit of them.
        """

    def places(self, parameters: Floats, contacts: int) -> Floats:
        """Places [contact, coordinate] from parameters, all of a name together."""
        return parameters[: self._places * contacts].reshape(self._places, contacts).T

    def same(self, a: Floats, b: Floats) -> bool:
        """Whether as many contacts are at the same places [contact, coordinate]."""
        return self._near(a, b, self._same)

    def mirrored(self, a: Floats, b: Floats) -> bool:
        """Whether contacts are at the mirror places of others, roughly."""
        return any(self._near(a * signs, b, self.nodes.separate) for signs in self._mirrors)

    def apart(self, places: Floats) -> bool:
        """Whether all contacts lie apart from one another."""
        between = self.nodes.distance(places[:, None], places[None])
        return bool((between[np.triu_indices(len(places), 1)] > self.nodes.separate / 2).all())

    def _near(self, a: Floats, b: Floats, limit: float) -> bool:
        close = self.nodes.distance(a[:, None], b[None]) < limit
        return bool(close.any(0).all() and close.any(1).all())


class SectionPosterior(AbstractLoadPosterior):
    """The posterior of line loads in plane strain: even over angle, force and direction."""

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
            return jnp.where(inside & (trust.result == 0), -chi2 / 2, -jnp.inf)

        return log_probability
