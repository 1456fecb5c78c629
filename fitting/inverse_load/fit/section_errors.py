"""Errors of the inputs of a skin in plane strain: what they do to its readings.

Under one radial contact the derivatives come from a table over the states of `LoadTable`,
which costs nothing in a frame; under several contacts, or with directions free, from the
model itself.
"""

import io
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import platformdirs
from jaxtyping import Array, Float
from numpy.typing import NDArray

from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.model.evaluation import at_rest, loads_from
from fitting.inverse_load.search.table import LANES, LoadTable, table_key
from suas_jax.config import InputErrors, SkinSpec, continuous_inputs
from suas_jax.equilibrium.equilibrium import State, differentiable
from suas_jax.files.cache_folder import CacheFolder
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import content_key
from suas_jax.scene.forward import Skin
from suas_jax.scene.parts import skin_parts

_RADIAL = 2  # parameters of a contact whose direction is held


class SectionErrors(AbstractSystematicErrors):
    """Errors of the inputs of one skin.

    Args:
        spec: the skin.
        errors: of its inputs.
        skin: the model made from it.
        table: its states.
        from_rest: whether readings count from a baseline.
        live: one lane instead of a batch.
    """

    def __init__(
        self,
        spec: SkinSpec,
        errors: InputErrors,
        skin: Skin,
        table: LoadTable,
        *,
        from_rest: bool,
        live: bool,
    ) -> None:
        self.names = errors.names
        self._skin, self._table = skin, table
        self._lanes = 1 if live else LANES // 4
        self._spec, self._errors = spec, errors
        self._tangents: list[Skin] = []
        moved, at_zero = self._tabulated()
        self._at_zero = at_zero
        # The change from rest, per newton: nearly even in the force, and zero at none.
        forces = table.forces[:, :, None, None]
        self._per_newton = ((moved - at_zero) / forces).astype(np.float32)
        self.rest = np.zeros_like(at_zero) if from_rest else at_zero

    def slopes(
        self, best: Explanations, per_contact: int, contacts: int
    ) -> NDArray[np.float64]:
        """See the base class."""
        if contacts == 1 and per_contact == _RADIAL:
            return self.under_one(best.parameters[:, 0], best.parameters[:, 1])
        width = per_contact * contacts
        there = best.state
        exact = self._computed(best.parameters[:, :width], there, contacts, self._lanes)
        return exact - self._at_zero + self.rest

    def under_one(
        self, angle: NDArray[np.float64], force: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Change of readings under one radial contact [frame, error, taxel].

        Args:
            angle: of the contact [frame, rad].
            force: of the contact [frame, N].
        """
        table = self._table
        by_angle, by_log = table.steps
        place = np.clip((angle - table.angles[0]) / by_angle, 0, len(table.angles) - 1)
        low = np.minimum(place.astype(int), len(table.angles) - 2)
        total = np.zeros((len(angle), *self._per_newton.shape[2:]))
        positive = np.maximum(np.abs(force), 1e-12)
        last = table.forces.shape[1] - 1
        for i, share in ((low, low + 1 - place), (low + 1, place - low)):
            level = np.clip(np.log(positive / table.forces[i, 0]) / by_log, 0, last)
            k = np.minimum(level.astype(int), last - 1)
            up = (level - k)[:, None, None]
            value = (1 - up) * self._per_newton[i, k] + up * self._per_newton[i, k + 1]
            total += share[:, None, None] * value
        return np.asarray(total * force[:, None, None] + self.rest)

    def _tabulated(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Change of readings at all states [angle, force, error, taxel] and at rest."""
        folder = CacheFolder(platformdirs.user_cache_path("suas_jax") / "tables")
        name = content_key(
            {
                "table": table_key(self._spec, self._skin),
                "paths": self._errors.paths,
                "directions": self._errors.directions,
            }
        )
        content = folder.get(name)
        if content is not None:
            with np.load(io.BytesIO(content)) as data:
                return data["moved"], data["rest"]
        table = self._table
        angle = np.repeat(table.angles, table.forces.shape[1])
        parameters = np.stack([angle, table.forces.reshape(-1)], 1)
        states = table.start(np.arange(len(parameters)))
        moved = self._computed(parameters, states, 1, LANES)
        moved = moved.reshape(*table.forces.shape, *moved.shape[1:])
        for k in range(1, moved.shape[1]):  # where no state was found, that of less force
            share = (table.forces[:, k] / table.forces[:, k - 1])[:, None, None]
            moved[:, k] = np.where(
                np.isfinite(moved[:, k]), moved[:, k], share * moved[:, k - 1]
            )
        moved = np.nan_to_num(moved)
        rest = self._computed(np.zeros((1, 2)), at_rest(self._skin, 1), 1, LANES)[0]
        stream = io.BytesIO()
        np.savez(stream, moved=moved.astype(np.float32), rest=rest)
        folder.put(name, stream.getvalue())
        return moved, rest

    def _computed(
        self, parameters: NDArray[np.float64], state: State, count: int, lanes: int
    ) -> NDArray[np.float64]:
        """Change of readings by each error, from the model [frame, error, taxel]."""
        if not self._tangents:
            self._tangents = [
                _tangent(self._spec, self._skin, self._errors.paths, column)
                for column in self._errors.directions
            ]
        parts = []
        for begin in range(0, len(parameters), lanes):
            pick = np.minimum(np.arange(begin, begin + lanes), len(parameters) - 1)
            there = jax.tree.map(lambda x, i=pick: np.asarray(x)[..., i], state)
            columns = [
                COMPILED.run(_PROGRAMS[count], self._skin, tangent, parameters[pick].T, there)
                for tangent in self._tangents
            ]
            parts.append(np.stack([np.asarray(column).T for column in columns], 1))
        return np.concatenate(parts)[: len(parameters)]


def _tangent(
    spec: SkinSpec, skin: Skin, paths: tuple[str, ...], column: NDArray[np.float64]
) -> Skin:
    """Derivative of a skin by its inputs along a direction."""
    known = continuous_inputs(spec)
    assert spec.electrodes is not None
    at = [known.get(path, spec.electrodes.lsb) for path in paths]  # the only one not given

    def changed(values: Float[Array, " path"]) -> Skin:
        parts = skin_parts(spec, {**known, **dict(zip(paths, values, strict=True))})
        wall = None if skin.wall is None else parts.wall
        return Skin(parts.geometry, parts.law, parts.oil, parts.sensing(), wall, skin.elements)

    _, tangent = eqx.filter_jvp(changed, (jnp.array(at),), (jnp.asarray(column),))
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
