"""The oil film over every taxel, from its counts: without a solve, for any frame."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.runtime.compiled import jit, require_float64
from suas_jax.scene.parts import skin_parts
from suas_jax.sensing.electrodes import Electrodes


@jit
def _even_film(electrodes: Electrodes, so: Float[Array, "taxel frame"]) -> Array:
    return electrodes.even_film(so)


class TaxelFilm:
    """Where the taxels of a skin are, what they read at rest, and the gap that counts mean.

    Raises ValueError: the skin has no electrodes. Raises Float64Error: float64 is off.
    """

    def __init__(
        self,
        spec: SkinSpec,  # a skin, or a scene, with [electrodes]
        # readings at rest [taxel] [counts], as a baseline has them; those of the model where
        # not given or NaN
        rest: NDArray[np.float64] | None = None,
    ) -> None:
        require_float64()
        parts = skin_parts(spec, continuous_inputs(spec))
        self._electrodes = parts.sensing()
        taxels, geometry = self._electrodes.taxels, parts.geometry
        # which module carries a taxel, and its number there, from 1 [taxel]
        self.module, self.number = list(taxels.module), list(taxels.number)
        angle = geometry.section.given_angle(taxels.angle)
        gap = geometry.gap(taxels.angle, taxels.axial)
        # as scenes state angles and as sections define them [rad]; from the middle [m] [taxel]
        self.angle, self.section_angle, self.axial, self.diameter = (
            np.asarray(x)[:, 0] for x in (angle, taxels.angle, taxels.axial, taxels.diameter)
        )
        height = self._electrodes.height
        # x towards growing angles, y to the crown, z along the axis [taxel, 3] [m]
        self.positions = np.asarray(taxels.positions(geometry, height))
        # of the film at rest [taxel] [m]
        self.rest_gap = np.broadcast_to(np.asarray(gap)[..., 0], self.angle.shape)
        self._model_rest = self.rest_under(self.rest_gap)
        given = np.full(self.angle.shape, np.nan) if rest is None else rest
        self.rest = np.where(np.isfinite(given), given, self._model_rest)
        self.gap(self.rest)  # compiled here, not while the first frame of a stream waits

    def rest_under(self, gap: ArrayLike) -> NDArray[np.float64]:
        """The model's readings at rest under another oil gap, one or one a taxel [counts]."""
        film = jnp.asarray(gap, float).reshape(-1, 1)
        so = np.asarray(self._electrodes.read_even_film(film))[:, 0]
        return np.broadcast_to(so, self.angle.shape)

    def gap(self, so: Float[np.ndarray, "*frame taxel"]) -> Float[np.ndarray, "*frame taxel"]:
        """Gap of the even film over each taxel that gives its counts [m]; NaN where unknown.

        Counts are taken from `rest`, so that the gap at rest is `rest_gap`; zero where membrane
        and wall touch.
        """
        as_modelled = (so - self.rest + self._model_rest).reshape(-1, len(self.rest))
        gap = _even_film(self._electrodes, jnp.asarray(as_modelled.T))
        return np.asarray(gap).T.reshape(so.shape)
