"""How far a solution is from the exact one: its mesh's share and its model's.

Both are relative errors of the oil's pressure and of the mid-surface displacement, under the
line loads and where it is largest, relative to the largest displacement. The mesh's share is a
Newton correction on the comparison mesh, the model's is the first-order effect of the
energy that the mechanics leaves out. Either answers for all quantities with one linear
solve, as adjoint weighting does for one quantity.
"""

import functools

import jax.numpy as jnp

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.scene.parts import SceneParts
from suas_jax.skin.loads import LineLoad
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


def model_error(
    problem: Problem, state: State, change: State | None, parts: SceneParts
) -> Lanes:
    """The model's share; zero for the continuum.

    Args:
        problem: membrane, oil and loads.
        state: their equilibrium.
        change: first-order effect of what the mechanics leaves out.
        parts: of the scene.
    """
    if change is None:
        return jnp.zeros_like(state.pressure)
    mechanics, loads, geometry = problem.mechanics, parts.forces, parts.skin.geometry
    size = _largest(mechanics, state.q)
    moved = _under_loads(mechanics, change.q, loads)
    indentation = mechanics.indentation
    if indentation is not None:
        for i, load in enumerate(loads):
            assert isinstance(load, LineLoad)  # in plane strain alone
            # Spread over an arc as wide as the membrane is thick, half of it is left.
            arc = 0.0 if load.spread is None else load.spread
            share = geometry.thickness / (geometry.thickness + arc)
            per_width = load.force * state.factor / geometry.width
            moved[i] = moved[i] + indentation * share * per_width
    if not loads:  # a line load's own field is part of the displacement beneath it alone
        moved.append(_largest(mechanics, state.q + change.q) - size)
    return mechanics.omitted_margin * _relative(change.pressure, moved, state, size)
