"""Errors of the inputs of a skin in plane strain: what they do to its readings.

Under one radial contact the derivatives come from a table over the states of `LoadTable`,
which costs nothing in a frame; under several contacts, or with directions free, from the
model itself. Near the wall readings change steeply, their derivatives by an input as those by
the contact. The table holds, state by state, the change of the contact that does most nearly
what the error does, and the little that is left; both change slowly from state to state::

    S = J g + S'        J of the frame's own contact, g and S' from the table
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.other_stiffness import AbstractSectionErrors
from fitting.inverse_load.model.evaluation import at_rest, loads_from
from fitting.inverse_load.search.table import LANES, LoadTable, table_key
from suas_jax.config import InputErrors, SkinSpec, continuous_inputs
from suas_jax.config.input_errors import ELECTRICAL, value_of
from suas_jax.equilibrium.equilibrium import State, differentiable
from suas_jax.files.kept_arrays import kept_arrays
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import content_key
from suas_jax.scene.parts import SkinStructure, skin_parts
from suas_jax.scene.skin import Skin

_RADIAL = 2  # parameters of a contact whose direction is held
_TOGETHER = 8  # directions of one program, whatever the number of errors
_CONTACTS = 3  # of one program, whatever their number: the others press with no force
_LANES = LANES // 4  # of one program where many frames or states are asked for
_RIDGE = 1e-12  # of squared cosines: where angle and force do the same


class InputSlopes:
    """What errors of the inputs of one skin do to its readings, by the model itself."""

    def __init__(self, errors: InputErrors, skin: Skin) -> None:
        # Made anew, as the errors' file may name what the skin's leaves out.
        self.skin = changed_skin(errors.spec, skin, {})
        self._errors = errors

    @cached_property
    def _tangents(self) -> list[Skin]:
        """Changes of the skin, `_TOGETHER` errors each."""
        errors = self._errors
        columns = np.zeros((-(-len(errors) // _TOGETHER) * _TOGETHER, len(errors.paths)))
        columns[: len(errors)] = errors.directions
        return [
            skin_tangents(errors.spec, self.skin, errors.paths, group)
            for group in columns.reshape(-1, _TOGETHER, columns.shape[1])
        ]

    def at_rest(self) -> Floats:
        """Change of the readings at rest by each error [error, taxel]."""
        return self.by_errors(np.zeros((1, _RADIAL)), at_rest(self.skin, 1), 1)[0]

    def by_contact(self, parameters: Floats, state: State) -> Floats:
        """Derivatives of readings by angle and force of one contact [frame, 2, taxel]."""
        # Of the arrays that errors change: the program is theirs.
        none = jax.tree.map(np.zeros_like, self._tangents[0])
        units = np.eye(_TOGETHER, _RADIAL)
        return self._along([(none, units)], parameters, state, 1, _LANES)[:, :_RADIAL]

    def by_errors(
        self, parameters: Floats, state: State, count: int, lanes: int = _LANES
    ) -> Floats:
        """Change of readings by each error, from the model [frame, error, taxel]."""
        errors = len(self._errors)
        none = np.zeros((_TOGETHER, parameters.shape[1]))
        along = [(tangents, none) for tangents in self._tangents]
        return self._along(along, parameters, state, count, lanes)[:, :errors]

    def _along(
        self,
        directions: Sequence[tuple[Skin, Floats]],
        parameters: Floats,
        state: State,
        count: int,
        lanes: int,
    ) -> Floats:
        """Derivatives of readings as skin and contacts change [frame, direction, taxel].

        Directions come `_TOGETHER` at a time.
        """
        parts = []
        parameters = _of_all(parameters, count)
        directions = [(tangents, _of_all(loads, count)) for tangents, loads in directions]
        for begin in range(0, len(parameters), lanes):
            pick = np.minimum(np.arange(begin, begin + lanes), len(parameters) - 1)
            there = jax.tree.map(lambda x, i=pick: np.asarray(x)[..., i], state)
            found = [
                COMPILED.run(_SLOPE_PROGRAM, self.skin, *along, parameters[pick].T, there)
                for along in directions
            ]
            parts.append(np.moveaxis(np.concatenate(found), -1, 0))
        return np.concatenate(parts)[: len(parameters)]


class SectionErrors(AbstractSectionErrors):
    """Errors of the inputs of one skin."""

    def __init__(
        self,
        errors: InputErrors,
        skin: Skin,
        table: LoadTable,
        *,
        from_rest: bool,
        live: bool,
    ) -> None:
        self.names = errors.names
        read = [path.startswith(ELECTRICAL) for path in errors.paths]
        self.of_membrane = ~(errors.directions[:, read] != 0).any(1)
        self._model, self._table = InputSlopes(errors, skin), table
        self._lanes = 1 if live else _LANES
        self._errors = errors
        self._per_newton, self._alike, at_zero = self._tabulated()
        self._at_zero = at_zero
        self.rest = np.zeros_like(at_zero) if from_rest else at_zero

    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """See the base class."""
        if contacts == 1 and per_contact == _RADIAL:
            jacobian = best.held[:, :_RADIAL]
            return self.under_one(best.parameters[:, 0], best.parameters[:, 1], jacobian)
        width = per_contact * contacts
        there = best.state
        exact = self._model.by_errors(best.parameters[:, :width], there, contacts, self._lanes)
        return exact - self._at_zero + self.rest

    def under_one(self, angle: Floats, force: Floats, jacobian: Floats) -> Floats:
        """Change of readings under one radial contact [frame, error, taxel].

        The contact has an angle [frame, rad] and a force [frame, N]; the jacobian has the
        derivatives of the readings by the two [frame, 2, taxel].
        """
        alike, left = self._changes(angle, force)
        return np.asarray(left + alike @ np.nan_to_num(jacobian) + self.rest)

    def _changes(self, angle: Floats, force: Floats) -> tuple[Floats, Floats]:
        """What errors do under one contact: most of it a change of the contact does, too.

        Returns that change [frame, error, 2], what is left of readings [frame, error, taxel].
        """
        table = self._table
        by_angle, by_log = table.steps
        place = np.clip((angle - table.angles[0]) / by_angle, 0, len(table.angles) - 1)
        low = np.minimum(place.astype(int), len(table.angles) - 2)
        left = np.zeros((len(angle), *self._per_newton.shape[2:]))
        alike = np.zeros((len(angle), *self._alike.shape[2:]))
        positive = np.maximum(np.abs(force), 1e-12)
        last = table.forces.shape[1] - 1
        for i, share in ((low, low + 1 - place), (low + 1, place - low)):
            level = np.clip(np.log(positive / table.forces[i, 0]) / by_log, 0, last)
            k = np.minimum(level.astype(int), last - 1)
            for level_of, part in ((k, share * (k + 1 - level)), (k + 1, share * (level - k))):
                weight = part[:, None, None]
                left += weight * self._per_newton[i, level_of]
                alike += weight * self._alike[i, level_of]
        alike[:, :, 1] *= force[:, None]
        return alike, left * force[:, None, None]

    def under_field(
        self, places: Floats, force: Floats, jacobian: Floats, channels: Floats
    ) -> Floats:
        """The sum of what the errors do under its nodes; see the base class.

        A membrane that answers with other forces does so at as much more pressure.
        """
        angle, (counts, pressure) = places[:, 0], np.split(jacobian, [-1])
        by_angle = force[:, None] * np.gradient(counts.T, angle, axis=0)
        alike, left = self._changes(angle, force)
        moved = left + alike @ np.stack([by_angle, counts.T], 1)
        softer = (self.of_membrane * alike[:, :, 1]).T  # change of force at each node
        more = softer @ pressure[0] - softer.sum(1) / force.sum() * channels[-1]
        return np.column_stack([self.rest + moved.sum(0), more])

    def _tabulated(self) -> tuple[NDArray[Any], NDArray[Any], Floats]:
        """What errors do at all states and at rest.

        Returns the change of readings that no change of the contact does, per newton
        [angle, force, error, taxel]; change of the contact that does the rest, of its angle
        and, per newton, of its force [angle, force, error, 2]; change at rest [error, taxel].
        """
        name = content_key(
            {
                "table": table_key(self._errors.spec, self._model.skin),
                "paths": self._errors.paths,
                "directions": self._errors.directions,
            }
        )
        data = kept_arrays(name, self._computed_table)
        return data["left"], data["alike"], data["rest"]

    def _computed_table(self) -> dict[str, NDArray[Any]]:
        table = self._table
        angle = np.repeat(table.angles, table.forces.shape[1])
        parameters = np.stack([angle, table.forces.reshape(-1)], 1)
        states = table.start(np.arange(len(parameters)))
        rest = self._model.at_rest()
        moved = self._model.by_errors(parameters, states, 1) - rest
        jacobian = self._model.by_contact(parameters, states)
        alike = _most_alike(jacobian, moved)
        left = (moved - alike @ jacobian) / parameters[:, 1, None, None]
        alike[:, :, 1] /= parameters[:, 1, None]
        shape = table.forces.shape
        found = [
            _filled(x.reshape(*shape, *x.shape[1:])).astype(np.float32) for x in (left, alike)
        ]
        return {"left": found[0], "alike": found[1], "rest": rest}


def _of_all(parameters: Floats, count: int) -> Floats:
    """Parameters of `_CONTACTS` contacts [row, parameter], of those of fewer."""
    rows = len(parameters)
    whole = np.zeros((rows, parameters.shape[1] // count, _CONTACTS))
    whole[..., :count] = parameters.reshape(rows, -1, count)
    return whole.reshape(rows, -1)


def _most_alike(jacobian: Floats, moved: Floats) -> Floats:
    """Changes of a contact that come nearest to changes of readings [frame, change, 2].

    The jacobian is that of readings by the contact [frame, 2, taxel]; `moved` are the changes
    of readings [frame, change, taxel].
    """
    size = np.sqrt((jacobian**2).sum(-1, keepdims=True))
    unit = jacobian / np.where(size > 0, size, 1.0)
    across = np.swapaxes(unit, 1, 2)
    normal = unit @ across + _RIDGE * np.eye(jacobian.shape[1])
    found = np.linalg.solve(normal, np.swapaxes(moved @ across, 1, 2))
    return np.asarray(np.swapaxes(found / np.where(size > 0, size, np.inf), 1, 2))


def _filled(values: Floats) -> Floats:
    """Where no state was found at a force, the values at less force [angle, force, ...]."""
    for k in range(1, values.shape[1]):
        values[:, k] = np.where(np.isfinite(values[:, k]), values[:, k], values[:, k - 1])
    return np.nan_to_num(values)


def changed_skin(spec: SkinSpec, skin: Skin, inputs: Mapping[str, ArrayLike]) -> Skin:
    """A skin with some inputs changed.

    `skin` is the model made from the file; its wall and mesh are kept. Inputs are values by
    TOML path, traced or not.
    """
    parts = skin_parts(spec, {**continuous_inputs(spec), **inputs})
    wall = None if skin.wall is None else parts.wall
    return Skin(parts.geometry, parts.law, parts.oil, parts.sensing(), wall, skin.elements)


@eqx.filter_jit
def _tangents(
    file: SkinStructure,
    skin: Skin,
    paths: tuple[str, ...],
    numbers: dict[str, Floats],  # of the file, by path
    at: Floats,  # [path]
    columns: Floats,  # [direction, path]
) -> Skin:
    def changed(values: Float[Array, " path"]) -> Skin:
        return changed_skin(file.spec, skin, numbers | dict(zip(paths, values, strict=True)))

    def along(column: Float[Array, " path"]) -> Skin:
        tangent: Skin = eqx.filter_jvp(changed, (at,), (column,))[1]
        return tangent

    found: Skin = eqx.filter_vmap(along)(columns)
    return found


def skin_tangents(spec: SkinSpec, skin: Skin, paths: tuple[str, ...], columns: Floats) -> Skin:
    """Derivatives of a skin by its inputs along directions, an axis of which comes first.

    `skin` is the model made from the file; `columns` are changes of the inputs at the paths
    [direction, path], SI. By one program: operation by operation, those of a section with
    tables take half a minute.
    """
    numbers = {path: np.asarray(x, float) for path, x in continuous_inputs(spec).items()}
    at = np.array([value_of(spec, path) for path in paths])
    given = SkinStructure(spec), skin, paths, numbers, at, columns
    found: Skin = COMPILED.run(_tangents, *given, once=True)
    return found


def _slopes(
    skin: Skin,
    tangents: Skin,  # arrays with an axis of directions first
    along: Float[Array, "direction parameter"],
    parameters: Float[Array, "parameter lane"],
    state: State,
) -> Float[Array, "direction taxel lane"]:
    """Change of readings as the skin changes along tangents, and all loads along others.

    The tangent stiffness is factorised once for all directions.
    """

    def so(skin: Skin, parameters: Array) -> Array:
        problem = skin.problem(loads_from(parameters, _CONTACTS))
        q = differentiable(problem, state).q
        return skin.electrodes.read(problem.mechanics, q).so

    def one(tangent: Skin, along: Float[Array, " parameter"]) -> Array:
        moved = jnp.broadcast_to(along[:, None], parameters.shape)
        change: Array = eqx.filter_jvp(so, (skin, parameters), (tangent, moved))[1]
        return change

    return jax.vmap(one)(tangents, along)


_SLOPE_PROGRAM = eqx.filter_jit(_slopes)
"""Derivatives of readings as skin and contacts change together."""
