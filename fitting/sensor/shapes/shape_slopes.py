"""Derivatives of the membrane's shape by the constants that move it, known inputs kept.

With known forces f the shape's derivative is the equilibrium's. Where a displacement u is
known instead, the force follows the constant c so that u stays: df/dc = -(du/df)^-1 du/dc.
"""

from collections.abc import Callable, Mapping
from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.constants import FORCE_ZERO, PLACE, PUSH, TOUCH, ZEROS, with_constants
from fitting.sensor.model.counts import parts_of
from fitting.sensor.shapes.deformations import Deformed
from fitting.sensor.shapes.press import Press, first_only
from suas_jax.config import SkinSpec
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import State, equilibrium
from suas_jax.mechanics.section import section_of
from suas_jax.mechanics.shape import AbstractFace
from suas_jax.runtime.compiled import COMPILED
from suas_jax.skin.oil import AbstractOil


class Moving(eqx.Module):
    """Constants that move the membrane, and then the errors of the first load."""

    values: Float[Array, " constant"]  # SI [constant]
    # of the constants, those of `PRESS_ERRORS` among them
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Self:
        """From values by name. Loads are those less the zeros, which count from there."""
        own = [0.0 if name in ZEROS else x for name, x in values.items()]
        return cls(jnp.asarray(own, float), tuple(values))

    def shift(self, kind: str, values: Array) -> Array | float:
        """Of the first load's place or force."""
        return values[self.names.index(kind)] if kind in self.names else 0.0


# Displacements of the loads [load, state] and the faces, from constants and forces.
Shape = Callable[[Array, Array], tuple[Array, AbstractFace]]


def slopes_of(shape: Shape, values: Array, force: Array, wanted: Array) -> AbstractFace:
    """Derivatives of the faces by each constant, what is known kept.

    `shape` gives the shape for constants and forces, here constants [constant] and forces on
    the loads [load, state] [N]. `wanted` is one where a displacement is known [load, state].
    """
    _, push = jax.linearize(shape, values, force)
    loads = force.shape[0]
    unit = jnp.broadcast_to(jnp.eye(loads)[:, :, None], (loads, *force.shape))
    by_force = jax.vmap(lambda f: push(jnp.zeros_like(values), f))(unit)
    by_constant = jax.vmap(lambda c: push(c, jnp.zeros_like(force)))(jnp.eye(len(values)))
    # Displacements that are known stay: the forces on them follow.
    compliance = jnp.moveaxis(by_force[0], -1, 0).swapaxes(1, 2)  # [state, of, by]
    both = wanted.T[:, :, None] * wanted.T[:, None, :]
    matrix = compliance * both + jnp.eye(loads) * (1 - wanted.T)[:, :, None]
    change = jnp.moveaxis(by_constant[0], -1, 0) * wanted.T[:, None, :]  # [state, const, of]
    follow = -jnp.linalg.solve(matrix, change.swapaxes(1, 2))  # [state, by, const]
    slopes: AbstractFace = jax.tree.map(
        lambda own, by: own + jnp.einsum("sfc,f...s->c...s", follow, by),
        by_constant[1],
        by_force[1],
    )
    return slopes


@eqx.filter_jit
def _of_section(
    press: Press,
    force: Array,
    start: State,
    wanted: Array,
    told: Array,
    inputs: dict[str, Array],
    moving: Moving,
    spec: SkinSpec,
    oil: AbstractOil | None,
) -> AbstractFace:
    def shape(values: Array, force: Array) -> tuple[Array, AbstractFace]:
        numbers = with_constants(spec, inputs, moving.names, values)
        geometry, law, answer, _ = parts_of(spec, numbers, oil)
        moved = press.shifted(moving.shift(PLACE, values))
        push = 1 + first_only(force) * moving.shift(PUSH, values)
        own = push * force - told * moving.shift(FORCE_ZERO, values)
        problem = moved.problem(geometry, law, answer, own)
        found = equilibrium(problem, start)
        _, shown, shell = corrected(problem, found.state)
        face = section_of(shell).face(shown.q)
        travel = moved.displacements(shell, shown.q) + told * moving.shift(TOUCH, values)
        return travel, eqx.filter(face, eqx.is_inexact_array)

    return slopes_of(shape, moving.values, force, wanted)


def shape_slopes(
    shape: Deformed,  # the solved states
    loads: KnownLoads,  # what is known of them
    spec: SkinSpec,
    inputs: Mapping[str, Array],  # SI values by TOML path, without the constants that move
    moving: Mapping[str, float],  # the constants by name, then errors of the first load
    oil: AbstractOil | None,  # how the fluid answers, if not as the skin file says
) -> AbstractFace:
    """How the faces of solved states change with constants that move the membrane.

    Returns a face whose arrays hold derivatives, by the constants along a leading axis; none
    where it holds no numbers.
    """
    slopes: AbstractFace = COMPILED.run(
        _of_section,
        shape.press,
        jnp.asarray(shape.force),
        shape.state,
        jnp.asarray(np.isfinite(loads.displacement), float),
        jnp.asarray(loads.pressed, float),
        dict(inputs),
        Moving.of(moving),
        spec,
        oil,
        once=True,
    )
    return slopes
