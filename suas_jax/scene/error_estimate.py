"""How far a solution is from the exact one: its mesh's share and its model's.

Both are relative errors of the oil's pressure and of the mid-surface displacement, under the
line loads and where it is largest, relative to the largest displacement. The mesh's share is a
Newton correction on the comparison mesh, the model's is a share of the first-order effect of
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
_TINY = 1e-300


def _under_loads(
    mechanics: AbstractMechanics, q: StationVector, loads: list[DeadLoad]
) -> list[Lanes]:
    """Mid-surface displacement under the loads, along them: linear in the unknowns [m]."""
    return [jnp.sum(mechanics.under(q, x).mid_displacement * x.direction, 0) for x in loads]


def _largest(mechanics: AbstractMechanics, q: StationVector) -> Lanes:
    """Largest magnitude of the mid-surface displacement [m]."""
    return jnp.maximum(mechanics.shape(q).largest_mid_displacement(), _TINY)


def _relative(pressure: Lanes, moved: list[Lanes], to: State, size: Lanes) -> Lanes:
    """Largest of the relative errors; a pressure that is zero has none."""
    of_pressure = jnp.abs(pressure) / jnp.maximum(jnp.abs(to.pressure), _TINY)
    return functools.reduce(jnp.maximum, [jnp.abs(x) / size for x in moved], of_pressure)


def discretisation_error(
    problem: Problem, state: State, finer: Problem, better: State, loads: list[DeadLoad]
) -> Lanes:
    """The mesh's share.

    Args:
        problem: what was solved.
        state: its solution.
        finer: the same on the comparison mesh.
        better: the state there after a Newton correction.
        loads: the line loads.
    """
    coarse, fine = problem.mechanics, finer.mechanics
    size = _largest(fine, better.q)
    here = [*_under_loads(coarse, state.q, loads), _largest(coarse, state.q)]
    there = [*_under_loads(fine, better.q, loads), size]
    moved = [a - b for a, b in zip(here, there, strict=True)]
    share = _MESH_MARGIN * problem.mechanics.error_share
    return share * _relative(state.pressure - better.pressure, moved, better, size)


def correction_mesh_error(
    solved: tuple[Problem, State],
    finer: tuple[Problem, State],
    better: State,
    loads: list[DeadLoad],
) -> Lanes:
    """The mesh's share of the correction: first order, by the kinks of a mid-line that shears.

    It is kept apart from that of the equilibrium: the two may cancel on one mesh.

    Args:
        solved: what was solved, and the change by what its mechanics leaves out.
        finer: the same on the comparison mesh.
        better: the equilibrium there.
        loads: the line loads.
    """
    coarse, fine = solved[0].mechanics, finer[0].mechanics
    here = _under_loads(coarse, solved[1].q, loads)
    there = _under_loads(fine, finer[1].q, loads)
    moved = [a - b for a, b in zip(here, there, strict=True)]
    pressure = solved[1].pressure - finer[1].pressure
    return 2.0 * _relative(pressure, moved, better, _largest(fine, better.q))


def model_error(
    problem: Problem, state: State, change: State | None, parts: SceneParts
) -> Lanes:
    """The model's share: what remains of its error after the correction.

    Zero for the continuum.

    Args:
        problem: membrane, oil and loads.
        state: their equilibrium.
        change: first-order effect of what the mechanics leaves out.
        parts: of the scene.
    """
    if change is None:
        return jnp.zeros_like(state.pressure)
    mechanics, loads = problem.mechanics, parts.forces
    size = _largest(mechanics, state.q)
    moved = _under_loads(mechanics, change.q, loads)
    if not loads:
        moved.append(_largest(mechanics, state.q + change.q) - size)
    effect = _relative(change.pressure, moved, state, size)
    return mechanics.omitted_margin * effect + mechanics.omitted_floor
