"""The pad's faces against rigid surfaces: the inner one's wall, the outer one's bodies.

A face has hundreds of points in every element (see `contact_points`), and few elements touch.
A few points of each bound how near it comes; the others are made for elements that may touch,
a chunk at a time.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from suas_jax.mechanics.contact.face import BodyContact, ContactState, by_travel
from suas_jax.mechanics.pad.contact_points import RULES, ContactPoints, Kinds, Rule, Side
from suas_jax.mechanics.pad.faces import face_displacement
from suas_jax.mechanics.pad.mid_surface import (
    KINDS,
    Rest,
    components,
    cross,
    dot,
    surface,
    vectors,
)
from suas_jax.mechanics.pad.net import ElementVector, Net
from suas_jax.mechanics.pad.stiffness import Blocks, Upper, add_blocks, no_blocks, upper_of
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.jet import staged
from suas_jax.skin.body import Body, Grip, PlacedBody
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall

_CHUNK = 4  # elements whose terms are made together
_MORE = 8  # neighbours of which other things are asked together
_FEW = Rule.of(4)  # points from which the others of an element are bounded
_BENT = 1.25  # a face between those points over a flat one: the largest distance


class ContactFace:
    """One lane's inner or outer face."""

    # kinds of derivatives that the place of a face's point depends on, by side
    kinds_of: ClassVar[dict[int, Kinds]] = {-1: KINDS, 1: KINDS[:3]}

    def __init__(
        self,
        net: Net,
        obstacle: Obstacle,  # a wall inside, a body outside
        section: AbstractSection,  # the undeformed membrane across the axis
        qe: ElementVector,  # Bernstein coefficients of the displacement
        growth: Growth | None,  # of the membrane; None where it fits its seat
    ) -> None:
        if isinstance(obstacle, PlacedBody) and obstacle.body.grip is not None:
            grip = Grip(*(x[..., 0] for x in obstacle.body.grip))
            obstacle = dataclasses.replace(obstacle, body=obstacle.body.holding(grip))
        self.net, self.qe, self.growth, self.section = net, qe, growth, section
        self.side = side = -1 if isinstance(obstacle, Wall) else 1
        kinds = tuple(net.topology.ordered(*kind) for kind in self.kinds_of[side])
        self._side = Side(net, obstacle, section, kinds, self.position)
        arc, axial = len(net.angles) - 1, len(net.axial) - 1
        self.counts = net.topology.ordered(arc, axial)

    def position(self, z: Float[Array, "input *point"], angle: Array, axial: Array) -> Array:
        """Current positions of the face [m].

        `z`: displacement and its derivatives, in the order of `KINDS`. `angle`: reference
        angles [rad]. `axial`: reference positions along the axis [m].
        """
        if self.side > 0:
            return self._on_rigid_normal(z, angle, axial)
        s = surface(vectors(z), Rest.of(self.section, angle))
        (x, y, along), _ = face_displacement(s, -s.rest.below, self.growth)
        rest = self.section.inner_face(angle)
        return jnp.stack([rest[0] + x, rest[1] + y, axial + along])

    def _on_rigid_normal(self, z: Array, angle: Array, axial: Array) -> Array:
        rest, (u, us, uz) = Rest.of(self.section, angle), vectors(z)
        sine, cosine = rest.normal
        m = staged(cross((us[0] + cosine, us[1] - sine, us[2]), (uz[0], uz[1], uz[2] + 1)))
        outward = self.side * rest.above / jnp.sqrt(dot(components(m), components(m)))
        middle = (rest.place[0] + u[0], rest.place[1] + u[1], axial + u[2])
        return jnp.stack([x - outward * n for x, n in zip(middle, m, strict=True)])

    @property
    def elements(self) -> Int[Array, " element"]:
        """All of them."""
        return jnp.arange(self.counts[0] * self.counts[1])

    @property
    def _by_elements(self) -> Float[Array, "3 16 element"]:
        """Bernstein coefficients, elements in one row."""
        return self.qe.reshape(3, 16, -1)

    def points(
        self, element: Int[Array, " element"], share: Float[Array, " element"] | float = 1.0
    ) -> ContactPoints:
        """At their points, some elements with a share of their area."""
        qe = self._by_elements[..., element]
        return ContactPoints(self._side, qe, element, RULES[self.side], share)

    def _reach(self) -> tuple[Float[Array, " element"], Bool[Array, " element"]]:
        """Distances below which no point of an element is [m], and which ones may count.

        Those count that may touch, that friction holds, and that may hold the nearest point. A
        point is nowhere further from one of a cell's corners than half of two of its sides,
        and a distance from a body or a wall changes by no more than a way.
        """
        side = self._side
        held = None
        if isinstance(side.obstacle, PlacedBody) and side.obstacle.body.grip is not None:
            held = jnp.any(side.obstacle.body.grip.bound > 0, 0)
            body = side.obstacle.body.holding(None)
            side = side._replace(obstacle=dataclasses.replace(side.obstacle, body=body))
        few = ContactPoints(side, self._by_elements, self.elements, _FEW)
        place = jax.lax.stop_gradient(few.place())
        lowest = jnp.min(jax.lax.stop_gradient(few.obstacle.gap(place, few.angle)), 0)
        grid = place.reshape(3, len(_FEW.xi), len(_FEW.xi), -1)
        ways = [jnp.sqrt(jnp.sum(jnp.diff(grid, axis=k) ** 2, 0)) for k in (1, 2)]
        bound = lowest - _BENT * sum(jnp.max(way, (0, 1)) for way in ways) / 2
        counted = bound < jnp.maximum(jnp.min(lowest), 0.0)
        return bound, counted if held is None else counted | held

    def _asked(
        self, one: Callable[[ContactPoints], Any], counted: Bool[Array, " element"]
    ) -> Any:
        """What is asked of chunks of elements, leading; zeros where none of a chunk counts.

        `counted`: see `_reach`.
        """
        count = len(counted)
        chunks = -(-count // _MORE)
        index = jnp.arange(chunks * _MORE).reshape(chunks, _MORE)
        # Each step is given its own unknowns: the transpose of one that takes them out of all
        # adds to all of them: five times as slow.
        beyond = chunks * _MORE - count
        qe = jnp.pad(self._by_elements, [(0, 0), (0, 0), (0, beyond)])
        qe = jnp.moveaxis(qe.reshape(3, 16, chunks, _MORE), 2, 0)

        @jax.checkpoint
        def of(index: Int[Array, " chunk"], qe: Float[Array, "3 16 chunk"]) -> Any:
            element, share = jnp.minimum(index, count - 1), jnp.where(index < count, 1.0, 0.0)
            return one(ContactPoints(self._side, qe, element, RULES[self.side], share))

        def step(_: None, at: tuple[Array, Array]) -> tuple[None, Any]:
            nothing = jax.tree.map(jnp.zeros_like, jax.eval_shape(of, *at))
            some = jnp.any(counted[jnp.minimum(at[0], count - 1)])
            return None, jax.lax.cond(some, of, lambda *_: nothing, *at)

        return jax.lax.scan(step, None, (index, qe))[1]

    def _by_element(
        self, one: Callable[[ContactPoints], Any], counted: Bool[Array, " element"]
    ) -> Any:
        """What is asked of points, of all elements [.., point, element]."""

        def joined(x: Array) -> Array:
            x = jnp.moveaxis(x, 0, -2)
            return x.reshape(*x.shape[:-2], -1)[..., : len(counted)]

        return jax.tree.map(joined, self._asked(one, counted))

    def energy(self) -> Lanes:
        """Energy of contact, and work against friction at its bound."""
        return jnp.sum(self._asked(ContactPoints.energy, self._reach()[1]))

    def grip(self) -> Grip | None:
        """How friction holds the points [point, element]; None without friction."""
        obstacle = self._side.obstacle
        if not isinstance(obstacle, PlacedBody) or obstacle.body.friction is None:
            return None
        known = obstacle.body.grip
        return known or self._by_element(ContactPoints.grip, self._reach()[1])

    def element_terms(self, body: Body | None = None) -> tuple[Array, Upper]:
        """First derivatives of the energy by the element unknowns, second ones as bands.

        `body`: whose travel the first derivatives are differentiated by as well.
        Returns the first derivatives and theirs by a factor on the travel, two element vectors;
        and the bands.
        """

        def lowest_of(at: ContactPoints) -> Array:
            lowest, grip = jnp.min(at.gap(), 0, keepdims=True), at.grip()
            if grip is not None:  # which holds what was touched before
                lowest = jnp.where(jnp.any(grip.bound > 0, 0), -jnp.inf, lowest)
            return lowest

        lowest = self._by_element(lowest_of, self._reach()[1])[0]
        nearest = jnp.argsort(lowest)
        count = len(nearest)

        def closed(at: tuple[Int[Array, ""], Any]) -> Bool[Array, ""]:
            start = at[0]
            return (start < count) & (lowest[nearest[jnp.minimum(start, count - 1)]] < 0)

        def add(
            at: tuple[Int[Array, ""], tuple[Array, Blocks]],
        ) -> tuple[Int[Array, ""], tuple[Array, Blocks]]:
            start, (force, blocks) = at
            index = start + jnp.arange(_CHUNK)
            element = nearest[jnp.minimum(index, count - 1)]
            points = self.points(element, jnp.where(index < count, 1.0, 0.0))
            terms = points.terms()
            rows = [terms.force]
            if body is not None:
                rows.append(by_travel(terms, body))
            more = jnp.stack([points.forces(row) for row in rows])
            force = force.at[..., element].add(more)
            blocks = add_blocks(self.net, blocks, points.at, points.blocks(terms))
            return start + _CHUNK, (force, blocks)

        vectors = 1 if body is None else 2
        nothing = jnp.zeros((vectors, 3, 16, count), self.qe.dtype), no_blocks(self.net)
        _, (force, bands) = jax.lax.while_loop(closed, add, (jnp.zeros((), int), nothing))
        return force.reshape(vectors, 3, 4, 4, *self.counts), upper_of(bands)

    def state(self) -> ContactState:
        """Where the face is, and how its wall pushes it, on a grid [arc, axial]."""
        points = self.points(self.elements)
        place = points.place()
        found = points.state(place)._replace(axial=place[2])
        return jax.tree.map(self._gridded, found)

    def touched(self) -> BodyContact:
        """Where the face is, and how it pushes its body, on a grid [arc, axial].

        Of elements that no contact is near, the gap is a bound from below that is not the
        smallest, the position is zero.
        """
        bound, counted = self._reach()

        def of(at: ContactPoints) -> tuple[Array, ...]:
            found = at.touched()
            return found.position, found.gap, found.pressure, found.force

        position, gap, pressure, force = self._by_element(of, counted)
        gap, every = jnp.where(counted, gap, bound), self.points(self.elements)
        found = BodyContact(
            every.angle, position, gap, pressure, force, every.area, every.axial
        )
        return jax.tree.map(self._gridded, found)

    def pushed(self) -> Float[Array, "3"]:
        """Force on the body; see `BodyContact.push`."""
        return jnp.sum(self._asked(lambda at: at.touched().push, self._reach()[1]), 0)

    def _gridded(self, x: Array) -> Float[Array, "*component arc axial"]:
        count = len(RULES[self.side].xi)
        x = x.reshape(*x.shape[:-2], count, count, *self.counts)
        x = jnp.moveaxis(x, (-2, -1), (-4, -2))
        long, across = self.counts[0] * count, self.counts[1] * count
        x = x.reshape(*x.shape[:-4], long, across)
        return x if self.net.topology.along_arc else jnp.swapaxes(x, -1, -2)
