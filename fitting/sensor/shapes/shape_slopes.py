"""Derivatives of the membrane's shape by the constants that move it, known inputs kept.

With known forces f the shape's derivative is the equilibrium's. Where a displacement u is
known instead, the force follows the constant c so that u stays: df/dc = -(du/df)^-1 du/dc.
"""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.sensor.model.counts import parts_of
from fitting.sensor.shapes.deformations import Deformed
from fitting.sensor.shapes.press import Press
from suas_jax.config import SkinSpec
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import State, equilibrium
from suas_jax.mechanics.section import section_of
from suas_jax.runtime.compiled import COMPILED
from suas_jax.skin.oil import AbstractOil


@eqx.filter_jit
def _slopes(
    press: Press,
    force: Array,
    start: State,
    wanted: Array,
    inputs: dict[str, Array],
    moving: Array,
    paths: tuple[str, ...],
    spec: SkinSpec,
    oil: AbstractOil | None,
) -> tuple[Array, Array]:
    """Derivatives of edges and radii by each moving constant, what is known kept."""

    def shape(moving: Array, force: Array) -> tuple[Array, Array, Array]:
        numbers = inputs | dict(zip(paths, moving, strict=True))
        geometry, law, answer, _ = parts_of(spec, numbers, oil)
        problem = press.problem(geometry, law, answer, force)
        found = equilibrium(problem, start)
        _, shown, shell = corrected(problem, found.state)
        face = section_of(shell).face(shown.q)
        return press.displacements(shell, shown.q), face.edges, face.powers

    _, push = jax.linearize(shape, moving, force)
    still, loads = jnp.zeros_like(moving), force.shape[0]
    unit = jnp.broadcast_to(jnp.eye(loads)[:, :, None], (loads, *force.shape))
    by_force = jax.vmap(lambda f: push(still, f))(unit)
    by_constant = jax.vmap(lambda t: push(t, jnp.zeros_like(force)))(jnp.eye(len(paths)))
    # Displacements that are known stay: the forces on them follow.
    compliance = jnp.moveaxis(by_force[0], -1, 0).swapaxes(1, 2)  # [state, of, by]
    both = wanted.T[:, :, None] * wanted.T[:, None, :]
    matrix = compliance * both + jnp.eye(loads) * (1 - wanted.T)[:, :, None]
    change = jnp.moveaxis(by_constant[0], -1, 0) * wanted.T[:, None, :]  # [state, const, of]
    follow = -jnp.linalg.solve(matrix, change.swapaxes(1, 2))  # [state, by, const]
    edges = by_constant[1] + jnp.einsum("sfc,fks->cks", follow, by_force[1])
    radius = by_constant[2] + jnp.einsum("sfc,fpes->cpes", follow, by_force[2])
    return edges, radius


def shape_slopes(
    shape: Deformed,
    wanted: np.ndarray,
    spec: SkinSpec,
    inputs: Mapping[str, Array],
    moving: Mapping[str, float],
    oil: AbstractOil | None,
) -> tuple[Array, Array]:
    """How the faces of solved states change with constants that move the membrane.

    Args:
        shape: the solved states.
        wanted: one where a displacement is known, zero where a force is [load, state].
        spec: the skin.
        inputs: SI values by TOML path.
        moving: the constants, by TOML path.
        oil: how the fluid answers, if not as the skin file says.

    Returns:
        Derivatives of the edges [constant, station, state] and of the radii [constant,
        power, element, state].
    """
    slopes: tuple[Array, Array] = COMPILED.run(
        _slopes,
        shape.press,
        jnp.asarray(shape.force),
        shape.state,
        jnp.asarray(wanted, float),
        dict(inputs),
        jnp.asarray(list(moving.values()), float),
        tuple(moving),
        spec,
        oil,
        once=True,
    )
    return slopes
