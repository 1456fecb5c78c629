"""What a skin's calibration leaves open, carried into the covariance of its loads.

`suas fit sensor` writes the covariance V of the calibrated constants c into the skin file.
A wrong constant moves every frame's estimate alike. To first order, with J and S the
derivatives of the readings by loads and constants and W the weights::

    dx = -G dc,    G = (J^T W J)^-1 J^T W S,    Cov_systematic(x) = G V G^T

Readings that count from a baseline are moved by S less its value at rest only.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from fitting.inverse_load.fit.covariance import inverse
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.model.evaluation import at_rest, loads_from
from fitting.inverse_load.search.table import LANES
from fitting.sensor.model.counts import GAP, LAYERS, PATHS
from suas_jax.config import SkinSpec
from suas_jax.equilibrium.equilibrium import State, differentiable
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.forward import Skin, skin_of
from suas_jax.sensing.taxels import taxel_names


class CalibrationUncertainty:
    """Systematic errors of the loads on one skin.

    Args:
        spec: the skin, with a record of its calibration.
        skin: the model made from it.
        from_rest: whether readings count from a baseline.
        live: one lane instead of a batch.

    Raises:
        ValueError: the record can't be understood.
    """

    def __init__(self, spec: SkinSpec, skin: Skin, *, from_rest: bool, live: bool) -> None:
        assert spec.calibration is not None
        names = spec.calibration.parameters
        values = np.array(spec.calibration.values, float)
        covariance = np.array(spec.calibration.covariance, float)
        if covariance.shape != (len(names), len(names)) or len(values) != len(names):
            raise ValueError(
                f"[calibration] covariance: {len(names)} rows of as many numbers are needed, "
                "one for each of parameters and values"
            )
        if not (np.isfinite(covariance).all() and np.isfinite(values).all()):
            raise ValueError("[calibration] covariance and values: finite numbers are needed")
        # Columns of a root of V: each is one independent error of one standard deviation.
        size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        size = np.where(size > 0, size, 1.0)
        widths, axes = np.linalg.eigh(covariance / np.outer(size, size))
        kept = widths > 1e-9
        root = size[:, None] * axes[:, kept] * np.sqrt(widths[kept])
        height = jnp.zeros((len(skin.electrodes.taxels.angle), 1)) + skin.electrodes.height
        self._skin = eqx.tree_at(lambda s: s.electrodes.height, skin, height)
        self._lanes = 1 if live else LANES // 4
        self._tangents = [
            _tangent(spec, self._skin, names, values, column) for column in root.T
        ]
        self._rest = self._slopes(np.zeros((1, 2)), at_rest(skin, 1), 1)[0]
        self._from_rest = from_rest

    @property
    def rest_variance(self) -> NDArray[np.float64]:
        """Variance of the model's readings at rest [taxel, counts^2]."""
        return np.asarray(
            np.zeros(self._rest.shape[1]) if self._from_rest else (self._rest**2).sum(0)
        )

    def covariance(self, best: Explanations, per_contact: int) -> NDArray[np.float64]:
        """Systematic covariances, padded as the information is."""
        total = np.full(best.information.shape, np.nan)
        for count in np.unique(best.contacts):
            frames = np.flatnonzero(best.contacts == count)
            width = per_contact * int(count)
            total[frames, :width, :width] = self._of(best.rows(frames), width, int(count))
        return total

    def _of(self, best: Explanations, width: int, count: int) -> NDArray[np.float64]:
        moved = self._slopes(best.parameters[:, :width], best.state, count)
        if self._from_rest:
            moved = moved - self._rest
        moved = np.where(best.weight[:, None] > 0, np.nan_to_num(moved), 0.0)
        jacobian = np.where(
            best.weight[:, None] > 0, np.nan_to_num(best.jacobian[:, :width]), 0.0
        )
        along = np.einsum("fpt,ft,fct->fpc", jacobian, best.weight, moved)
        gain = inverse(best.information[:, :width, :width]) @ along
        return np.asarray(gain @ np.swapaxes(gain, 1, 2))

    def _slopes(
        self, parameters: NDArray[np.float64], state: State, count: int
    ) -> NDArray[np.float64]:
        """Change of readings by each independent error [frame, error, taxel]."""
        parts = []
        for begin in range(0, len(parameters), self._lanes):
            pick = np.minimum(np.arange(begin, begin + self._lanes), len(parameters) - 1)
            there = jax.tree.map(lambda x, i=pick: np.asarray(x)[..., i], state)
            columns = [
                COMPILED.run(_PROGRAMS[count], self._skin, tangent, parameters[pick].T, there)
                for tangent in self._tangents
            ]
            parts.append(np.stack([np.asarray(column).T for column in columns], 1))
        return np.concatenate(parts)[: len(parameters)]


def _tangent(
    spec: SkinSpec,
    skin: Skin,
    names: tuple[str, ...],
    values: NDArray[np.float64],
    column: NDArray[np.float64],
) -> Skin:
    """Derivative of a skin by its calibrated constants along a direction."""
    assert spec.electrodes is not None
    module, number = (np.array(x) for x in taxel_names(spec.electrodes))

    def changed(constants: Float[Array, " constant"]) -> Skin:
        inputs: dict[str, Array] = {}
        layers, height = skin.electrodes.layers, skin.electrodes.height
        for i, name in enumerate(names):
            if name == LAYERS:
                layers = constants[i, None]
            elif name.startswith(f"{GAP}."):
                which = [int(text) for text in name.split(".")[1:]]
                mine = (module == which[0]) & (number == (which[1:] or number))
                height = height - mine[:, None] * (constants[i] - values[i])
            else:
                inputs[PATHS.get(name, name)] = constants[i]
        contact = skin.wall is not None
        new = skin_of(spec, inputs, elements=skin.elements, contact=contact)
        changing = (layers, height)
        return eqx.tree_at(lambda s: (s.electrodes.layers, s.electrodes.height), new, changing)

    constants = jnp.asarray(values)
    _, tangent = eqx.filter_jvp(changed, (constants,), (jnp.asarray(column),))
    return tangent


def _slope(
    skin: Skin,
    tangent: Skin,
    parameters: Float[Array, "parameter lane"],
    state: State,
    contacts: int,
) -> Float[Array, "taxel lane"]:
    """Change of readings as the skin changes, the loads kept."""
    loads = loads_from(parameters, contacts)

    def so(skin: Skin) -> Array:
        problem = skin.problem(loads)
        q = differentiable(problem, state).q
        return skin.electrodes.read(problem.mechanics, q).so

    return eqx.filter_jvp(so, (skin,), (tangent,))[1]


_PROGRAMS = {k: eqx.filter_jit(partial(_slope, contacts=k)) for k in (1, 2, 3)}
