"""How far a solution is from the exact one: its mesh's share and its model's.

Both are relative errors of the oil's pressure and of the mid-surface displacement, under the
line loads and where it is largest, relative to the largest displacement. The mesh's share is a
Newton correction on each comparison mesh, the model's is a share of the first-order effect of
the energy that the mechanics leaves out, by which states are corrected. Either answers for all
quantities with one linear solve, as adjoint weighting does for one quantity.
"""

import functools
from typing import NamedTuple

import jax.numpy as jnp

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import Lanes, StationVector
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
    ways = [x.direction(mechanics.section) for x in loads]
    return [
        jnp.sum(mechanics.under(q, x).mid_displacement * way, 0)
        for x, way in zip(loads, ways, strict=True)
    ]


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


def error_scales(problem: Problem, values: list[Lanes]) -> list[Lanes]:
    """What errors of the key quantities are relative to: the quantities themselves.

    A skin that carries stress may do so at no pressure, and hardly moved. Its scales are no
    smaller than the pressure that would buckle a half-cylinder, and than the displacement that
    would free it of its stress.

    Args:
        problem: membrane, oil and loads.
        values: the key quantities.
    """
    if not problem.prestressed:
        return values
    mechanics, section = problem.mechanics, problem.mechanics.section
    slender = section.mean_thickness / section.size
    least = 8 / 3 * mechanics.law.shear_modulus * slender**3
    pressure, *moved, largest = values
    if mechanics.growth is not None:
        largest = largest + jnp.abs(mechanics.growth.hoop) * section.size
    return [jnp.maximum(jnp.abs(pressure), least), *moved, largest]


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

    Args:
        solved: on the mesh of the solve.
        finer: on the comparison mesh.
        loads: the line loads.
    """
    pairs = zip(solved.changes(loads), finer.changes(loads), strict=True)
    return [2.0 * (here - there) for here, there in pairs]


def model_changes(solved: Corrected, loads: list[DeadLoad]) -> list[Lanes]:
    """The model's share: what remains of its error after the correction.

    Args:
        solved: the equilibrium and its correction.
        loads: the line loads and patches.
    """
    *changes, largest = solved.changes(loads)
    margin = solved.problem.mechanics.omitted_margin
    return [margin * x for x in (*changes, _PRESSURE_ALONE * largest)]
