"""How far a solution is from the exact one: its mesh's share and its model's.

Both are relative errors of the oil's pressure and of the mid-surface displacement, under the
line loads and where it is largest, relative to the largest displacement. The mesh's share is a
Newton correction on each comparison mesh, the model's is a share of the first-order effect of
the energy that the mechanics leaves out, by which states are corrected. Either answers for all
quantities with one linear solve, as adjoint weighting does for one quantity.
"""

import functools

import jax.numpy as jnp

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.scene.parts import SceneParts
from suas_jax.skin.pad_loads import DeadLoad

# An estimate is wanted that the true error rarely exceeds; see docs/errors.md for how often.
_MESH_MARGIN = 2.0
# A pressure alone brings a vented arch near buckling, where what first order leaves is more.
_PRESSURE_ALONE = 2.5
_TINY = 1e-300


def _under_loads(
    mechanics: AbstractMechanics, q: StationVector, loads: list[DeadLoad]
) -> list[Lanes]:
    """Mid-surface displacement under the loads, along them: linear in the unknowns [m]."""
    return [jnp.sum(mechanics.under(q, x).mid_displacement * x.direction, 0) for x in loads]


def _largest(mechanics: AbstractMechanics, q: StationVector) -> Lanes:
    """Largest magnitude of the mid-surface displacement [m]."""
    return jnp.maximum(mechanics.shape(q).largest_mid_displacement(), _TINY)


def key_quantities(
    mechanics: AbstractMechanics, state: State, loads: list[DeadLoad]
) -> list[Lanes]:
    """What errors are judged by: oil pressure, displacements under loads, the largest one.

    Args:
        mechanics: the membrane.
        state: its state.
        loads: the line loads and patches.
    """
    moved = _under_loads(mechanics, state.q, loads)
    return [state.pressure, *moved, _largest(mechanics, state.q)]


def relative_error(changes: list[Lanes], values: list[Lanes]) -> Lanes:
    """Largest of the relative errors; displacements are compared with the largest one.

    Args:
        changes: of the key quantities.
        values: of the key quantities; a pressure that is zero has no error.
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

    Args:
        share: of the difference that is error.
        values: key quantities of the solution.
        better: those after a Newton correction on the comparison mesh.
        loads: the line loads and patches.
    """
    margin = _MESH_MARGIN if loads else _MESH_MARGIN * _PRESSURE_ALONE
    return [margin * share * (a - b) for a, b in zip(values, better, strict=True)]


def correction_mesh_changes(
    solved: tuple[Problem, State], finer: tuple[Problem, State], loads: list[DeadLoad]
) -> list[Lanes]:
    """The mesh's share of the correction: first order, by the kinks of a mid-line that shears.

    It is kept apart from that of the equilibrium: the two may cancel on one mesh.

    Args:
        solved: what was solved, and the change by what its mechanics leaves out.
        finer: the same on the comparison mesh.
        loads: the line loads.
    """
    here = _under_loads(solved[0].mechanics, solved[1].q, loads)
    there = _under_loads(finer[0].mechanics, finer[1].q, loads)
    moved = [2.0 * (a - b) for a, b in zip(here, there, strict=True)]
    pressure = 2.0 * (solved[1].pressure - finer[1].pressure)
    largest = jnp.zeros_like(pressure)
    if not loads:
        of_mesh = [_largest(problem.mechanics, change.q) for problem, change in (solved, finer)]
        largest = 2.0 * (of_mesh[0] - of_mesh[1])
    return [pressure, *moved, largest]


def model_changes(
    problem: Problem, state: State, change: State, parts: SceneParts
) -> list[Lanes]:
    """The model's share: what remains of its error after the correction.

    Args:
        problem: membrane, oil and loads.
        state: their equilibrium.
        change: first-order effect of what the mechanics leaves out.
        parts: of the scene.
    """
    mechanics, loads = problem.mechanics, parts.forces
    moved = _under_loads(mechanics, change.q, loads)
    largest = jnp.zeros_like(state.pressure)
    if not loads:
        largest = _largest(mechanics, state.q + change.q) - _largest(mechanics, state.q)
        largest = _PRESSURE_ALONE * largest
    margin = mechanics.omitted_margin
    return [margin * x for x in (change.pressure, *moved, largest)]
