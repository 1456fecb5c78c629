"""How wrong a body's force may be: by what the shell leaves out, and by its stiff contact."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mechanics.contact.face import BodyContact
from suas_jax.numerics.array_types import Lanes
from suas_jax.scene.error_estimate import BY_PENETRATION
from suas_jax.scene.parts import SceneParts

_SMALL = 0.01  # share of all forces below which one of a body is small
_LEAST = 1e-300


def touched_by_bodies(problem: Problem, state: State) -> list[BodyContact]:
    """Contact with each body."""
    mechanics = problem.mechanics
    return [mechanics.touched(state.q, b.placed(state.factor)) for b in mechanics.bodies]


def error_by_bodies(
    parts: SceneParts, problem: Problem, touched: list[BodyContact], report: dict[str, Any]
) -> Lanes:
    """Largest relative error of a body's force by the change that the report gives it.

    It is relative to the smaller force of both, as a change as large as that tells no more, but
    to no less than a share of all that presses: other loads move the skin off a body.
    """
    mechanics, largest = problem.mechanics, jnp.zeros_like(report["oil_pressure_Pa"])
    shown = [load["force_N"] for load in report["loads"] if "depth_m" in load]
    width = parts.skin.geometry.width if mechanics.per_width else 1.0
    pairs = zip(mechanics.bodies, touched, strict=True)
    own = [width * jnp.einsum("c...l,cl->l", at.force, b.frame[-1]) for b, at in pairs]
    area = parts.skin.geometry.width * mechanics.section.size
    pressed = area * jnp.abs(parts.external_pressure)
    least = _SMALL * sum(map(jnp.abs, (*own, *(load.force for load in parts.forces))), pressed)
    for force, there in zip(shown, own, strict=True):
        smaller = jnp.maximum(jnp.minimum(jnp.abs(force), jnp.abs(there)), least)
        apart = jnp.abs(there - force) / jnp.maximum(smaller, _LEAST)
        largest = jnp.maximum(largest, apart)
    return mechanics.omitted_margin * largest


def error_by_penetration(
    parts: SceneParts,
    problem: Problem,
    state: State,
    touched: list[BodyContact],  # see `touched_by_bodies`
    report: dict[str, Any],
) -> dict[str, Lanes]:
    """Relative error of a body's force by how deep its points lie in it, which no mesh changes.

    A body is a stiff spring. As far as its points lie in it, by the mean over the force, a
    rigid one has come less far: relative to its travel that counts twice, as forces grow with
    up to its square. Where other loads press the skin on it, too, it is relative to the largest
    displacement. A body that is in a skin at rest and touches none of its points lies deeper
    than they are apart from it.
    """
    if not touched:
        return {}
    others = parts.forces or parts.pressures or len(touched) > 1 or problem.prestressed
    largest = jnp.zeros_like(state.pressure)
    for body, at in zip(problem.mechanics.bodies, touched, strict=True):
        push = at.area * at.pressure
        deep = jnp.sum(-push * at.gap, (0, 1)) / jnp.maximum(jnp.sum(push, (0, 1)), _LEAST)
        own = jnp.abs(state.factor * body.travel)
        if not others and body.drag is None:
            missed, inside = jnp.min(at.gap, (0, 1)), state.factor * body.travel > 0
            deep += jnp.where((missed >= 0) & inside, own + missed, 0.0)
        size = report["max_displacement_m"] if others else own
        largest = jnp.maximum(largest, BY_PENETRATION * deep / jnp.maximum(size, _LEAST))
    return {"penetration_error": largest}


def error_by_squeezing(problem: Problem, state: State, touched: list[BodyContact]) -> Lanes:
    """Largest relative error of a body's force by what no shell knows: how thin it is squeezed.

    Between a body and the wall beneath it the membrane is thinner by f / (2 pi G), with the
    force f per length that passes through it. The wall's own law says what that much travel
    is worth: nothing on a soft layer, everything on a rigid wall.
    """
    mechanics, largest = problem.mechanics, jnp.zeros_like(state.pressure)
    if mechanics.wall is None:
        return largest
    held = mechanics.contact(state.q, mechanics.wall)
    push, depth = held.area * held.pressure, jnp.max(-held.gap, (0, 1))
    thickness = mechanics.section.mean_thickness
    margin = thickness / mechanics.section.size
    for at in touched:
        near = _between(held.angle, at.angle, at.gap, margin)
        length = jnp.ones_like(thickness)
        if at.axial is not None and held.axial is not None:
            near &= _between(held.axial, at.axial, at.gap, thickness)
            length = 2 * thickness
        through = jnp.sum(jnp.where(near, push, 0.0), (0, 1))
        thinner = through / (2 * jnp.pi * mechanics.law.shear_modulus * length)
        whole = jnp.sqrt(jnp.sum(jnp.sum(at.force, (1, 2)) ** 2, 0))
        share = through / jnp.maximum(whole, _LEAST)
        largest = jnp.maximum(largest, share * thinner / jnp.maximum(depth, _LEAST))
    return largest


def _between(place: Array, of: Array, gap: Array, margin: Lanes) -> Bool[Array, "..."]:
    """Whether places lie within a margin of those where a gap is closed."""
    of = jnp.broadcast_to(of, gap.shape)
    low = jnp.min(jnp.where(gap < 0, of, jnp.inf), (0, 1)) - margin
    high = jnp.max(jnp.where(gap < 0, of, -jnp.inf), (0, 1)) + margin
    return (place >= low) & (place <= high)
