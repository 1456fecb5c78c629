"""Errors of the inputs of a skin in plane strain: what they do to its readings.

Under one radial contact the derivatives come from a table over the states of `LoadTable`
(`TabulatedChanges`), which costs nothing in a frame; under several contacts, or with
directions free, from the model itself.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.other_stiffness import AbstractSectionErrors
from fitting.inverse_load.fit.tabulated_changes import TabulatedChanges
from fitting.inverse_load.model.evaluation import (
    CONTACTS,
    FRAMES,
    at_rest,
    filled_up,
    in_batches,
    loads_from,
)
from fitting.inverse_load.search.table import LoadTable, table_key
from suas_jax.config import InputErrors, SkinSpec, continuous_inputs
from suas_jax.config.input_errors import ELECTRICAL, value_of
from suas_jax.equilibrium.equilibrium import State, differentiable
from suas_jax.files.cache_folder import kept_arrays
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import content_key
from suas_jax.scene.parts import SkinStructure, skin_parts
from suas_jax.scene.skin import Skin

_RADIAL = 2  # parameters of a contact whose direction is held
_TOGETHER = 8  # directions of one program, whatever the number of errors


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

    def by_errors(
        self, parameters: Floats, state: State, count: int, lanes: int = FRAMES
    ) -> Floats:
        """Change of readings by each error, from the model [frame, error, taxel]."""

        def run(parameters: Floats, state: State) -> Floats:
            given = self.skin, parameters, state
            rows = [COMPILED.run(_SLOPE_PROGRAM, *given, group) for group in self._tangents]
            return np.concatenate(rows)

        found = in_batches(run, filled_up(parameters, count), state, lanes)
        return found[:, : len(self._errors)]


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
        self._lanes = 1 if live else FRAMES
        self._errors = errors
        self._changes, at_zero = self._tabulated()
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
        return self._changes.under(angle, force, jacobian) + self.rest

    def under_field(
        self, places: Floats, force: Floats, jacobian: Floats, channels: Floats
    ) -> Floats:
        """The sum of what the errors do under its nodes; see the base class.

        A membrane that answers with other forces does so at as much more pressure.
        """
        angle, (counts, pressure) = places[:, 0], np.split(jacobian, [-1])
        by_angle = force[:, None] * np.gradient(counts.T, angle, axis=0)
        alike, left = self._changes.at(angle, force)
        moved = left + alike @ np.stack([by_angle, counts.T], 1)
        softer = (self.of_membrane * alike[:, :, 1]).T  # change of force at each node
        more = softer @ pressure[0] - softer.sum(1) / force.sum() * channels[-1]
        return np.column_stack([self.rest + moved.sum(0), more])

    def _tabulated(self) -> tuple[TabulatedChanges, Floats]:
        """What errors do at all states, and their change of readings at rest [error, taxel]."""
        name = content_key(
            {
                "table": table_key(self._errors.spec, self._model.skin),
                "paths": self._errors.paths,
                "directions": self._errors.directions,
            }
        )
        data = kept_arrays(name, self._computed_table)
        return TabulatedChanges(self._table, data["alike"], data["left"]), data["rest"]

    def _computed_table(self) -> dict[str, NDArray[Any]]:
        table = self._table
        angle = np.repeat(table.angles, table.forces.shape[1])
        parameters = np.stack([angle, table.forces.reshape(-1)], 1)
        rest = self._model.at_rest()
        moved = self._model.by_errors(parameters, table.start(np.arange(len(angle))), 1) - rest
        changes = TabulatedChanges.of(table, moved.reshape(*table.forces.shape, *rest.shape))
        return {"left": changes.left, "alike": changes.alike, "rest": rest}


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
    parameters: Float[Array, "parameter lane"],
    state: State,
    tangents: Skin,  # arrays with an axis of directions first
) -> Float[Array, "direction taxel lane"]:
    """Change of readings as the skin changes along tangents.

    The tangent stiffness is factorised once for all directions.
    """

    def so(skin: Skin) -> Array:
        problem = skin.problem(loads_from(parameters, CONTACTS))
        q = differentiable(problem, state).q
        return skin.electrodes.read(problem.mechanics, q).so

    def one(tangent: Skin) -> Array:
        change: Array = eqx.filter_jvp(so, (skin,), (tangent,))[1]
        return change

    return jax.vmap(one)(tangents)


_SLOPE_PROGRAM = eqx.filter_jit(_slopes)
"""Derivatives of readings as the skin changes."""
