"""What wall and bodies carry, where the membrane lies on them, and how wrong that may be."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mechanics.contact.face import BodyContact, ContactState, Strip
from suas_jax.numerics.array_types import Lanes
from suas_jax.scene.error_estimate import BY_PENETRATION
from suas_jax.scene.parts import SceneParts
from suas_jax.skin.body import Body
from suas_jax.skin.circle import Circle
from suas_jax.skin.geometry import SkinGeometry

# Points of contact from which a zone's width and its peak pressure are told.
_RESOLVED = 12
# The same along either direction of a pad, whose elements have 17: a zone of two elements.
_RESOLVED_PAD = 32
# Gap between two zones of contact up to which they count as one, in thicknesses.
_TOGETHER = 1e-3

Grid = Float[Array, "along line lane"]
_SMALL = 0.01  # share of all forces below which one of a body is small
_LEAST = 1e-300


def contact_zone(contact: ContactState, geometry: SkinGeometry) -> dict[str, Any]:
    """Force, area and extent of contact of the inner face at its contact points.

    The extent means something only where there is contact.
    """
    force = jnp.sum(contact.area * contact.pressure, (0, 1))
    if contact.axial is None:  # a section: point after point along the arc
        gap, angle = (
            _along_arc(jnp.broadcast_to(x, contact.gap.shape))
            for x in (contact.gap, contact.polar_angle)
        )
        half = geometry.width / 2
        force, width = force * geometry.width, geometry.width
        axial = [-half, half]
    else:
        gap, angle = contact.gap, contact.polar_angle
        across = [jnp.swapaxes(x, 0, 1) for x in (contact.gap, contact.axial)]
        axial = list(_closed(*across)[:2])
        steps = jnp.diff(jnp.mean(contact.axial, 0), axis=0) / 2
        width = jnp.pad(steps, ((1, 0), (0, 0))) + jnp.pad(steps, ((0, 1), (0, 0)))
    section = geometry.section
    start, end, _ = _closed(gap, angle)
    covered = _closed(gap, geometry.wall_arc(angle))[2]
    places = {"angle_deg": [jnp.rad2deg(section.given_angle(x)) for x in (start, end)]}
    if not isinstance(section, Circle):
        places["arc_m"] = [section.arc(x) for x in (start, end)]
    return {
        "force_N": force,
        "area_m2": jnp.sum(covered * width, 0),
        **places,
        "axial_m": axial,
    }


def _resolved(contact: BodyContact) -> Bool[Array, " lane"]:
    """Whether enough points touch, on a pad along either direction."""
    closed = contact.gap < 0
    if contact.axial is None:
        return jnp.sum(closed, (0, 1)) >= _RESOLVED
    across = [jnp.max(jnp.sum(closed, way), 0) for way in (0, 1)]
    return jnp.minimum(*across) >= _RESOLVED_PAD


def body_observables(
    contact: BodyContact,  # the outer face at its contact points
    body: Body,  # that is pressed on it
    factor: Lanes,  # on its travel
    geometry: SkinGeometry,  # of the skin
    strip: Strip | None = None,  # that it touches, where the points do not tell it
) -> dict[str, Any]:
    """What a body does to the skin, and where it touches.

    Forces are those on the skin: along the approach, and along growing angles; the moment is
    about the body's centre, counter-clockwise.
    """
    travel = factor * body.travel
    width = geometry.width if contact.axial is None else 1.0
    force = -jnp.sum(contact.force, (1, 2)) * width
    out, along = body.frame[-1], body.along
    centre = body.origin + factor * body.way + body.shape.centre * out
    lever = contact.position - centre[:, None, None]
    moment = jnp.sum(lever[0] * contact.force[1] - lever[1] * contact.force[0], (0, 1))
    touched = jnp.any(contact.gap < 0, (0, 1))
    found = {
        "depth_m": travel + jnp.zeros_like(moment),
        "force_N": -jnp.sum(out * force, 0),
        "tangential_force_N": jnp.sum(along * force[:2], 0),
        "moment_Nm": -moment * width,
        **_extent(contact, body, geometry, touched),
        "max_contact_pressure_Pa": jnp.max(contact.pressure, (0, 1)),
        "contact_resolved": ~touched | _resolved(contact),
    }
    if len(force) == 3:
        found["tangential_force_axial_N"] = force[2]
    if body.drag is not None:
        drag = factor * body.drag + jnp.zeros_like(moment)
        found["drag_m"] = jnp.sum(along * drag[:2], 0)
        if len(drag) == 3:
            found["drag_axial_m"] = drag[2]
    return found if strip is None else found | _as_strip(found, strip, touched, geometry)


def _as_strip(
    found: dict[str, Any], strip: Strip, touched: Bool[Array, " lane"], geometry: SkinGeometry
) -> dict[str, Any]:
    """Width and pressure of one zone of contact, told by a strip."""
    one = found["zones"] == 1
    half = jnp.where(one, strip.half, found["contact_half_width_m"])
    middle = (found["contact_from_m"] + found["contact_to_m"]) / 2
    peak = found["max_contact_pressure_Pa"]
    return {
        "contact_half_width_m": half,
        "contact_from_m": middle - half,
        "contact_to_m": middle + half,
        "contact_area_m2": jnp.where(one, 2 * half * geometry.width, found["contact_area_m2"]),
        "max_contact_pressure_Pa": jnp.where(one, strip.pressure, peak),
        "contact_resolved": ~touched | (one & strip.told),
    }


def _extent(
    contact: BodyContact, body: Body, geometry: SkinGeometry, touched: Bool[Array, " lane"]
) -> dict[str, Any]:
    """Area, width and number of the zones in which a body touches."""

    def ends(gap: Grid, place: Array) -> tuple[Lanes, Lanes, Array]:
        first, last, covered = _closed(gap, place)
        return jnp.where(touched, first, 0.0), jnp.where(touched, last, 0.0), covered

    along = geometry.outer_arc(contact.angle) - geometry.outer_arc(body.angle)
    gap, along = jnp.broadcast_arrays(contact.gap, along)
    if contact.axial is None:
        gap, along = _along_arc(gap), _along_arc(along)
        start, end, covered = ends(gap, along)
        own = {
            "contact_area_m2": jnp.sum(covered, 0) * geometry.width,
            "contact_from_m": start,
            "contact_to_m": end,
        }
        lines = [gap]
    else:
        start, end, _ = ends(gap, along)
        across = jnp.swapaxes(gap, 0, 1), jnp.swapaxes(contact.axial, 0, 1)
        first, last, _ = ends(*across)
        own = {
            "contact_area_m2": jnp.sum(jnp.where(gap < 0, contact.area, 0.0), (0, 1)),
            "contact_half_width_axial_m": (last - first) / 2,
        }
        lines = [gap, across[0]]
    zones = [_parts(jnp.min(x, 1), geometry) for x in lines]
    count = functools.reduce(jnp.maximum, zones)
    half = {"contact_half_width_m": (end - start) / 2}
    return half | own | {"zones": jnp.where(touched, count, 0)}


def _parts(gap: Float[Array, "along lane"], geometry: SkinGeometry) -> Int[Array, " lane"]:
    """How many stretches of a line touch; short gaps between them don't count."""
    near = gap < _TOGETHER * geometry.thickness
    begins = near & ~jnp.pad(near, [(1, 0), (0, 0)])[:-1]
    return jnp.sum(begins, 0, dtype=jnp.int32)


def _along_arc(x: Float[Array, "point element lane"]) -> Grid:
    """Points of a section one after the other."""
    return jnp.moveaxis(x, 1, 0).reshape(-1, 1, x.shape[-1])


@functools.partial(jax.jit, inline=True)
def _closed(gap: Grid, place: Grid) -> tuple[Lanes, Lanes, Float[Array, "line lane"]]:
    """Smallest and largest place where the gap along lines is closed, the extent on each."""
    first, second = gap[:-1], gap[1:]
    crosses = (first < 0) != (second < 0)
    share = jnp.where(crosses, first / jnp.where(crosses, first - second, 1.0), 0.0)
    crossing = place[:-1] + share * (place[1:] - place[:-1])
    closed = (first < 0) | (second < 0)
    start = jnp.where(closed, jnp.where(first < 0, place[:-1], crossing), jnp.inf)
    end = jnp.where(closed, jnp.where(second < 0, place[1:], crossing), -jnp.inf)
    covered = jnp.sum(jnp.where(closed, end - start, 0.0), 0)
    return jnp.min(start, (0, 1)), jnp.max(end, (0, 1)), covered


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
