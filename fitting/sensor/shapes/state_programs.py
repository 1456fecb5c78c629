"""The programs of one known state: its equilibrium, and derivatives of what is read there.

With known forces f the shape's derivative is the equilibrium's. Where a displacement u is
known instead, the force follows the constant c so that u stays: df/dc = -(du/df)^-1 du/dc.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.constants import (
    AXIAL,
    FORCE_ZERO,
    PLACE,
    PUSH,
    TOUCH,
    ZEROS,
    with_constants,
)
from fitting.sensor.model.counts import parts_of
from fitting.sensor.shapes.deformations import Deformed
from fitting.sensor.shapes.press import Press, first_only
from suas_jax.config import SkinSpec
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import Corrected, corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.section import section_of
from suas_jax.mechanics.shape import AbstractFace
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Structure, problem_of
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import SceneParts, scene_parts
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.sensing.taxels import DISC
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.plain import plain_geometry


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


Inputs = Mapping[str, Any]


class SolvedState(NamedTuple):
    """What a program says of one state, beside face, force and displacement of `Solved`."""

    state: State  # the equilibrium
    face: AbstractFace
    force: Array
    displacement: Array
    gap: Array  # the smallest [m]
    result: Array  # index of the outcome


def _problem(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, oil: AbstractOil | None
) -> tuple[SceneParts, Problem]:
    parts = scene_parts(scene.scene, inputs)
    if oil is not None:
        parts = parts._replace(skin=parts.skin._replace(oil=oil))
    return parts, problem_of(parts, plan)


def _read(
    parts: SceneParts, problem: Problem, found: Corrected, inner: Array
) -> tuple[AbstractFace, Array, Array]:
    """Inner face, forces and displacements of the loads in a known state."""
    root, shown, mechanics = found
    seen = dataclasses.replace(problem, mechanics=mechanics)
    entries = load_observables(parts, seen, shown, problem.mechanics, root)
    keys = ("force_N", "displacement_m", "inner_displacement_m")
    force, mid, below = (jnp.stack([x[key] for x in entries]) for key in keys)
    face = mechanics.face(shown.q)
    if face.varies_along_axis:
        face = taxel_face(face, parts.skin.sensing(), parts.skin.geometry)
    return face, force, jnp.where(inner[:, None], below, mid)


@eqx.filter_jit
def solve_state(
    scene: Structure,
    plan: AbstractPlan,
    inputs: Inputs,
    inner: Array,
    oil: AbstractOil | None,
    start: State,
) -> SolvedState:
    """The equilibrium from a start, without the wall, and what is read of it."""
    parts, problem = _problem(scene, plan, inputs, oil)
    found = equilibrium(problem, start)
    whole = corrected(problem, found.state)
    read = _read(parts, problem, whole, inner)
    gap = problem.mechanics.shape(found.state.q).smallest_gap(parts.skin.geometry).value
    return SolvedState(found.state, *read, gap, found.outcome)


@eqx.filter_jit
def state_slopes(
    scene: Structure,
    plan: AbstractPlan,
    known: tuple[Inputs, Array, Array, Array, Array, Array],
    moving: Moving,
    oil: AbstractOil | None,
    state: State,
    known_equilibrium: Callable[[Problem, State], Corrected],
) -> AbstractFace:
    """See `slopes_of`.

    `known`: numbers, angles [load], forces, what is wanted, inner, which loads press.
    `known_equilibrium`: `corrected`, or `uncorrected`, which takes half as long.
    """
    inputs, angle, force, wanted, inner, pressed = known
    section = plain_geometry(scene.scene.geometry).section

    def shape(values: Array, force: Array) -> tuple[Array, AbstractFace]:
        own = with_constants(scene.scene, inputs, moving.names, values)
        own["load.0.arc"] = section.arc(angle[:1] + moving.shift(PLACE, values))[0]
        own["load.0.axial"] = own["load.0.axial"] + moving.shift(AXIAL, values)
        for i in range(len(force)):
            if f"load.{i}.force" in own:
                push = 1 + moving.shift(PUSH, values) if i == 0 else 1
                zero = pressed[i] * moving.shift(FORCE_ZERO, values)
                own[f"load.{i}.force"] = push * force[i, 0] - zero
            if f"load.{i}.depth" in own:
                own[f"load.{i}.depth"] -= pressed[i] * moving.shift(TOUCH, values)
        parts, problem = _problem(scene, plan, own, oil)
        found = known_equilibrium(problem, state)
        face, _, moved = _read(parts, problem, found, inner)
        moved = moved + (pressed * moving.shift(TOUCH, values))[:, None]
        return moved, eqx.filter(face, eqx.is_inexact_array)

    return slopes_of(shape, moving.values, force, wanted)


class TaxelFace(AbstractFace):
    """A deformed inner face that is known along the taxels' own rays alone."""

    varies_along_axis: ClassVar[bool] = True
    # over the undeformed face, ray by ray [ray, taxel, state] [m]
    heights: Float[Array, "ray taxel state"]

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], geometry: SkinGeometry
    ) -> list[Float[Array, "taxel state"]]:
        """Gaps along the rays that the heights are of; see the base class."""
        assert len(rays) == len(self.heights)
        pairs = zip(self.heights, rays, strict=True)
        return [height + geometry.gap(angle, axial) for height, (angle, axial) in pairs]

    def height(self, angle: Array, axial: Array) -> Array:
        """See the base class.

        Raises ValueError: always; heights are known along the taxels' own rays alone.
        """
        raise ValueError("a calibration knows the pad along its taxels' own rays alone")


def taxel_face(face: AbstractFace, electrodes: Electrodes, geometry: SkinGeometry) -> TaxelFace:
    """What of a pad's inner face the taxels see."""
    rays = electrodes.taxels.rays(DISC, geometry)
    pairs = zip(face.gaps(rays, geometry), rays, strict=True)
    return TaxelFace(jnp.stack([gap - geometry.gap(*ray) for gap, ray in pairs]))
