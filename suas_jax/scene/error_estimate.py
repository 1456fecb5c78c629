"""How far a solution is from the exact one: its mesh's share and its model's.

Both are relative errors of the oil's pressure and of the mid-surface displacement under
the line loads, the displacements relative to the largest of them. The mesh's share is a
Newton correction on the comparison mesh, the model's is the first-order effect of the
energy that the mechanics leaves out. Either answers for all quantities with one linear
solve, as adjoint weighting does for one quantity.
"""

import functools

import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.equilibrium.balance import Problem, State, Verification
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad

# An estimate is wanted that the true error rarely exceeds; see docs/errors.md for how often.
_MESH_MARGIN = 2.0
_MODEL_MARGIN = 2.6
_TINY = 1e-300


def _displacements(problem: Problem, q: Array, loads: list[LineLoad]) -> list[Lanes]:
    """Of the mid-surface under the loads, along them: linear in the unknowns [m]."""
    found = []
    for load in loads:
        moved = problem.mechanics.at_angle(q, load.angle).mid_displacement[:, 0, 0]
        found.append(jnp.sum(moved * load.direction, 0))
    return found


def _largest(parts: list[Lanes], like: Lanes) -> Lanes:
    floor = jnp.full_like(like, _TINY)
    return functools.reduce(jnp.maximum, [jnp.abs(x) for x in parts], floor)


def _relative(pressure: Lanes, moved: list[Lanes], to: State, size: Lanes) -> Lanes:
    """Largest of the relative errors; a pressure that is zero has none."""
    of_pressure = jnp.abs(pressure) / jnp.maximum(jnp.abs(to.pressure), _TINY)
    return functools.reduce(jnp.maximum, [jnp.abs(x) / size for x in moved], of_pressure)


def discretisation_error(
    problem: Problem, state: State, finer: Problem, better: State, loads: list[LineLoad]
) -> Lanes:
    """The mesh's share.

    Args:
        problem: what was solved.
        state: its solution.
        finer: the same on the comparison mesh.
        better: the state there after a Newton correction.
        loads: the line loads.
    """
    here = _displacements(problem, state.q, loads)
    there = _displacements(finer, better.q, loads)
    moved = [a - b for a, b in zip(here, there, strict=True)]
    size = _largest(there, state.pressure)
    share = _MESH_MARGIN * problem.mechanics.error_share
    return share * _relative(state.pressure - better.pressure, moved, better, size)


def model_error(
    problem: Problem, check: Verification, loads: list[LineLoad], geometry: SkinGeometry
) -> Lanes:
    """The model's share; zero for the continuum.

    Args:
        problem: what was checked, on the comparison mesh.
        check: what its tangent said.
        loads: the line loads.
        geometry: dimensions of the skin.
    """
    better, change = check.correction, check.omitted
    if change is None:
        return jnp.zeros_like(better.pressure)
    size = _largest(_displacements(problem, better.q, loads), better.pressure)
    moved = _displacements(problem, change.q, loads)
    indentation = problem.mechanics.indentation
    if indentation is not None:
        for i, load in enumerate(loads):
            # Spread over an arc as wide as the membrane is thick, half of it is left.
            arc = 0.0 if load.spread is None else load.spread
            share = geometry.thickness / (geometry.thickness + arc)
            per_width = load.force * better.factor / geometry.width
            moved[i] = moved[i] + indentation * share * per_width
    return _MODEL_MARGIN * _relative(change.pressure, moved, better, size)
