"""How far a solution is from the exact one: its mesh's share and its model's.

Both are relative errors of the oil's pressure and of mid-surface displacements: by a Newton
correction on each comparison mesh, and by a share of the first-order effect of the energy that
the mechanics leaves out. Either takes one linear solve, as adjoint weighting does.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import corrected_contact
from suas_jax.equilibrium.equilibrium import smallest_gap
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.skin.loads import DeadLoad

# The true error should rarely exceed the estimate; how often it does: docs/errors_method.md.
_MESH_MARGIN = 2.0
# A pressure alone brings a vented arch near buckling, where what first order leaves is more.
_PRESSURE_ALONE = 2.5
BY_PENETRATION = 2.0
"""Relative error by a penetration over that in the length: pressures go with its square."""
MODEL_LIMIT, WALL_LIMIT = 0.3, 0.1
"""Bound of the model's error, and share of it that the wall has, beyond which a state of the
fast path is not an answer: what the first order does not tell would be a fifth and more."""
_BY_CHANCE = 0.2
_TINY = 1e-300
_ROUNDING = 1e-13  # of the section's size: a displacement below it is none


def _under_loads(
    mechanics: AbstractMechanics, q: StationVector, loads: list[DeadLoad]
) -> list[Lanes]:
    """Mid-surface displacement under the loads, along them: linear in the unknowns [m]."""
    if not loads:
        return []
    moved = mechanics.under(q, loads).mid_displacement
    ways = (x.direction(mechanics.section) for x in loads)
    return [jnp.sum(moved[:, k] * way, 0) for k, way in enumerate(ways)]


def _largest(mechanics: AbstractMechanics, q: StationVector) -> Lanes:
    """Largest magnitude of the mid-surface displacement [m], no less than rounding."""
    largest = mechanics.shape(q).largest_mid_displacement()
    return jnp.maximum(largest, _ROUNDING * mechanics.section.size)


def key_quantities(
    mechanics: AbstractMechanics, state: State, loads: list[DeadLoad]
) -> list[Lanes]:
    """What errors are judged by: oil pressure, displacements under loads, the largest one."""
    moved = _under_loads(mechanics, state.q, loads)
    return [state.pressure, *moved, _largest(mechanics, state.q)]


def error_scales(problem: Problem, values: list[Lanes]) -> list[Lanes]:
    """What errors of the key quantities are relative to: the quantities themselves.

    A skin that carries stress may do so at no pressure, and hardly moved. Its scales are no
    smaller than the pressure that would buckle a half-cylinder, and than the displacement that
    would free it of its stress.
    """
    if not problem.prestressed:
        return values
    mechanics, section = problem.mechanics, problem.mechanics.section
    least = _buckling(mechanics)
    pressure, *moved, largest = values
    if mechanics.growth is not None:
        largest = largest + jnp.abs(mechanics.growth.hoop) * section.size
    return [jnp.maximum(jnp.abs(pressure), least), *moved, largest]


def _buckling(mechanics: AbstractMechanics) -> Lanes:
    """Pressure that would buckle a half-cylinder of the membrane [Pa]."""
    slender = mechanics.section.mean_thickness / mechanics.section.size
    return 8 / 3 * mechanics.law.shear_modulus * slender**3


def relative_error(changes: list[Lanes], values: list[Lanes]) -> Lanes:
    """Largest of the key quantities' relative errors; a pressure that is zero has none.

    Displacements are compared with the largest one.
    """
    of_pressure = jnp.abs(changes[0]) / jnp.maximum(jnp.abs(values[0]), _TINY)
    moved = [jnp.abs(x) / values[-1] for x in changes[1:]]
    return functools.reduce(jnp.maximum, moved, of_pressure)


def sum_of_sizes(changes: list[list[Lanes]]) -> list[Lanes]:
    """Sizes of the changes of every key quantity by several meshes, added up."""
    return [functools.reduce(jnp.add, map(jnp.abs, of)) for of in zip(*changes, strict=True)]


def mesh_changes(
    share: float, values: list[Lanes], better: list[Lanes], loads: list[DeadLoad]
) -> list[Lanes]:
    """What a comparison mesh adds to the error of every key quantity.

    It is a share of the difference to those after a Newton correction on that mesh.
    """
    margin = _MESH_MARGIN if loads else _MESH_MARGIN * _PRESSURE_ALONE
    return [margin * share * (a - b) for a, b in zip(values, better, strict=True)]


class Corrected(NamedTuple):
    """A problem, its equilibrium, and the change by what its mechanics leaves out."""

    problem: Problem
    state: State
    change: State

    def changes(self, loads: list[DeadLoad]) -> list[Lanes]:
        """Changes of the key quantities; without loads, of the largest displacement."""
        mechanics, change = self.problem.mechanics, self.change
        largest = jnp.zeros_like(change.pressure)
        if not loads:
            largest = _largest(mechanics, self.state.q + change.q)
            largest = largest - _largest(mechanics, self.state.q)
        return [change.pressure, *_under_loads(mechanics, change.q, loads), largest]


def correction_mesh_changes(
    solved: Corrected, finer: Corrected, loads: list[DeadLoad]
) -> list[Lanes]:
    """The mesh's share of the correction: first order, by the kinks of a mid-line that shears.

    It is kept apart from that of the equilibrium: the two may cancel on one mesh.
    """
    pairs = zip(solved.changes(loads), finer.changes(loads), strict=True)
    return [2.0 * (here - there) for here, there in pairs]


def model_changes(solved: Corrected, loads: list[DeadLoad]) -> list[Lanes]:
    """The model's share: what remains of its error after the correction."""
    *changes, largest = solved.changes(loads)
    margin = solved.problem.mechanics.omitted_margin
    return [margin * x for x in (*changes, _PRESSURE_ALONE * largest)]


class Bounded(NamedTuple):
    """How far the model can be trusted at a state."""

    error: Lanes  # bound of its relative error
    # index of the outcome: `beyond_model` where the error exceeds `MODEL_LIMIT`, or the wall's
    # share of it `WALL_LIMIT`
    result: Int[Array, " lane"]


def bounded(
    problem: Problem, root: State, shown: State, result: Int[Array, " lane"]
) -> Bounded:
    """Bound the model's error by sums over the unknowns alone, for the fast path.

    With the first-order effect x of what the mechanics leaves out, relative to displacement and
    pressure, the bound is twice its share as in `model_changes`, x^2 for what first order does
    not tell, and twice the depth by which it takes the inner face into the wall, relative to
    the film. Relative errors of a pressure that is zero by chance mean little: they count
    up to `_BY_CHANCE`, or relative to the pressure that would buckle a half-cylinder.

    Args:
        problem: membrane, oil and loads.
        root: their equilibrium.
        shown: the same with the effect of what the mechanics leaves out.
        result: index of the outcome so far.
    """
    problem, root, shown = jax.lax.stop_gradient((problem, root, shown))
    mechanics = problem.mechanics
    if not mechanics.corrected:
        return Bounded(jnp.zeros_like(root.pressure), result)
    size = mechanics.displacement_size
    values = [root.pressure, jnp.maximum(size(root.q), _TINY)]
    pressure, moved = error_scales(problem, values)
    change = shown.pressure - root.pressure
    by_pressure = relative_error([change], [pressure])
    lasting = relative_error([change], [jnp.maximum(jnp.abs(pressure), _buckling(mechanics))])
    by_pressure = jnp.minimum(by_pressure, jnp.maximum(lasting, _BY_CHANCE))
    by_moving = size(shown.q - root.q) / moved
    first = 2 * mechanics.omitted_margin * jnp.maximum(by_pressure, by_moving)
    error = mechanics.omitted_floor + first + jnp.maximum(lasting, by_moving) ** 2
    by_wall = jnp.zeros_like(error)
    if mechanics.wall is not None:
        gap = corrected_contact(mechanics, shown, root).gap
        there = jnp.min(gap, tuple(range(gap.ndim - 1)))
        before = jnp.minimum(smallest_gap(mechanics, root.q, mechanics.wall), 0.0)
        film = mechanics.wall.geometry.oil_gap
        by_wall = BY_PENETRATION * jnp.maximum(before - there, 0.0) / film
        error = error + by_wall + jnp.where(before < 0, mechanics.omitted_at_wall, 0.0)
    beyond = (result == 0) & ~((error <= MODEL_LIMIT) & (by_wall <= WALL_LIMIT))
    named = jnp.where(beyond, index_of("beyond_model"), result).astype(result.dtype)
    return Bounded(error, named)
