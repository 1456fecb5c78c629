"""The pad's faces against rigid surfaces: the inner one's wall, the outer one's bodies.

The inner face is the fibre at -t/2 of the thinned membrane, so its gap at a point depends on
the displacement and on its first and second derivatives: eighteen inputs. The outer one is at
t/2 on the rigid normal, as for the section's shell: nine. Points are even in an element, the
corners included: where the membrane first touches, the zone is smaller than an element. Few
elements touch; only those have terms, a chunk at a time.
"""

import dataclasses
import functools
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from suas_jax.mechanics.contact.face import AbstractContactFace
from suas_jax.mechanics.contact.state import BodyContact, ContactState
from suas_jax.mechanics.contact.term import ContactTerms, by_travel, contact_terms, expanded
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
from suas_jax.mechanics.pad.stiffness import (
    COLUMNS,
    ROWS,
    Blocks,
    Upper,
    add_blocks,
    no_blocks,
    upper_of,
)
from suas_jax.numerics.bspline import bernstein
from suas_jax.numerics.staging import staged
from suas_jax.skin.body import Body, Grip, PlacedBody
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall

# Between points, along either side of an element: against the wall, and under bodies, where the
# place of contact turns the force.
_INTERVALS = {-1: 8, 1: 16}
_CHUNK = 4  # elements whose terms are made together


class _Rule(NamedTuple):
    """Local coordinates and weights of the trapezoidal rule, along either side."""

    xi: Float[np.ndarray, " point"]
    weights: Float[np.ndarray, " point"]

    @classmethod
    def of(cls, intervals: int) -> "_Rule":
        """With points at both ends."""
        xi = np.linspace(0, 1, intervals + 1)
        return cls(xi, np.where((xi == 0) | (xi == 1), 0.5, 1.0) / intervals)


_RULES = {side: _Rule.of(intervals) for side, intervals in _INTERVALS.items()}


@functools.cache
def _shapes(
    side: int, kinds: tuple[tuple[int, int], ...]
) -> Float[np.ndarray, "kind point 16"]:
    """Bernstein polynomials at the points by kind of derivative (along stations, across)."""
    by_order = [np.stack(bernstein(_RULES[side].xi, order), 1) for order in range(3)]
    products = [np.einsum("ga,hb->ghab", by_order[m], by_order[n]) for m, n in kinds]
    return np.stack(products).reshape(len(kinds), -1, 16)


class ContactFace(AbstractContactFace):
    """One lane's inner or outer face at its contact points [point, element]."""

    # kinds of derivatives that the place of a face's point depends on, by side
    kinds_of: ClassVar[dict[int, tuple[tuple[int, int], ...]]] = {-1: KINDS, 1: KINDS[:3]}

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
        self.net, self.obstacle, self.growth, self.section = net, obstacle, growth, section
        self.side = side = -1 if isinstance(obstacle, Wall) else 1
        order = net.topology.ordered
        span, axial = jnp.diff(net.angles), jnp.diff(net.axial)
        long, across = order(section.size * span, axial)
        self.counts = len(long), len(across)
        kinds = tuple(order(*kind) for kind in self.kinds_of[side])
        self.xi, along_side = _RULES[side]
        self.count = len(self.xi)
        self.shapes = _shapes(side, kinds)
        powers = [1 / (long[:, None] ** m * across**n) for m, n in kinds]
        self.powers = jnp.stack(powers).reshape(len(kinds), -1)  # [kind, element]
        values = jnp.einsum("kgs,cse->kcge", self.shapes, qe.reshape(3, 16, -1))
        values = values * self.powers[:, None, None]
        self.inputs = values.reshape(3 * len(kinds), self.count**2, -1)
        self.angle = self._spread(net.angles[:-1], span, arc=True)
        self.axial = self._spread(net.axial[:-1], axial, arc=False)
        sides = order(section.size * span, axial)
        weights = jnp.asarray(np.outer(along_side, along_side).reshape(-1, 1))
        half = side * section.thickness(self.angle) / 2
        face = 1 + section.curvature(self.angle) * half
        self.area = weights * jnp.outer(sides[0], sides[1]).reshape(-1) * face

    def _spread(self, start: Array, length: Array, *, arc: bool) -> Array:
        """A coordinate of one direction at all points [point, element]."""
        x = start + self.xi[:, None] * length
        along = arc == self.net.topology.along_arc
        x = x[:, None, :, None] if along else x[None, :, None, :]
        return jnp.broadcast_to(x, (self.count, self.count, *self.counts)).reshape(
            self.count**2, -1
        )

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

    def gap(self) -> Float[Array, "point element"]:
        """Distance from the obstacle at all points [m]."""
        return self.obstacle.gap(self.place(), self.angle)

    def place(self) -> Array:
        """See the base class."""
        return jnp.stack(staged([*self.position(self.inputs, self.angle, self.axial)]))

    def place_at_rest(self) -> Array:
        """See the base class."""
        return self.position(0 * self.inputs, self.angle, self.axial)

    def element_terms(self, body: Body | None = None) -> tuple[Array, Upper]:
        """First derivatives of the energy by the element unknowns, second ones as bands.

        `body`: whose travel the first derivatives are differentiated by as well.
        Returns the first derivatives and theirs by a factor on the travel, two element vectors;
        and the bands.
        """
        lowest, grip = jnp.min(self.gap(), 0), self.grip()
        if grip is not None:  # which holds what was touched before
            lowest = jnp.where(jnp.any(grip.bound > 0, 0), -jnp.inf, lowest)
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
            terms = self._terms(element, jnp.where(index < count, 1.0, 0.0), grip)
            rows = [terms.force]
            if body is not None:
                rows.append(by_travel(terms, body))
            more = jnp.stack([self._forces(row, element) for row in rows])
            force = force.at[..., element].add(more)
            side = jnp.divmod(element, self.counts[1])
            blocks = add_blocks(self.net, blocks, side, self._blocks(terms, element))
            return start + _CHUNK, (force, blocks)

        vectors = 1 if body is None else 2
        nothing = jnp.zeros((vectors, 3, 16, count), self.inputs.dtype), no_blocks(self.net)
        _, (force, bands) = jax.lax.while_loop(closed, add, (jnp.zeros((), int), nothing))
        return force.reshape(vectors, 3, 4, 4, *self.counts), upper_of(bands)

    def _terms(
        self, element: Int[Array, " chosen"], share: Array, grip: Grip | None
    ) -> ContactTerms:
        """Contact at the points of some elements, by its inputs."""
        angle, axial = self.angle[:, element], self.axial[:, element]
        inputs = self.inputs[:, :, element]

        def gap_of(z: Array) -> Array:
            return self.obstacle.gap(self.position(z, angle, axial), angle)

        def moved(z: Array) -> Array:
            return self.position(z, angle, axial) - self.position(0 * z, angle, axial)

        gap = expanded(gap_of, inputs)
        terms = contact_terms(self.obstacle.law, gap, share * self.area[:, element])
        if grip is not None:
            grip = Grip(share * grip.bound[:, element], grip.normal[..., element])
        return self.with_friction(terms, moved, inputs, grip)

    def _forces(self, by_inputs: Array, element: Array) -> Float[Array, "3 16 chosen"]:
        force = by_inputs.reshape(len(self.powers), 3, self.count**2, -1)
        force = force * self.powers[:, None, None, element]
        return jnp.einsum("kgs,kcge->cse", self.shapes, force)

    def _blocks(self, terms: ContactTerms, element: Array) -> Array:
        """Second derivatives by control values, by `SLOTS` along the stations."""
        powers = self.powers[:, element]
        kinds = len(powers)
        stiffness = terms.stiffness.reshape(kinds, 3, kinds, 3, self.count**2, -1)
        stiffness = stiffness * (powers[:, None] * powers)[:, None, :, None, None]
        half = jnp.einsum("kgs,kcldge->csldge", self.shapes, stiffness)
        k = jnp.einsum("csldge,lgt->csdte", half, self.shapes)
        k = k.reshape(3, 4, 4, 3, 4, 4, -1)
        long, side = jnp.divmod(element, self.counts[1])
        along, across = self.net.along[:, :, long], self.net.across[:3, :, :, side]
        k = jnp.einsum("iae,cabdxye->cibdxye", along, k)
        k = jnp.einsum("lxe,cibdxye->cibdlye", along, k)
        k = jnp.einsum("cjbe,cibdlye->cijdlye", across, k)
        k = jnp.einsum("dmye,cijdlye->cijdlme", across, k)
        pairs = k[:, ROWS, :, :, COLUMNS]  # [slot, component, across, component, across, .]
        return jnp.transpose(pairs, (0, 5, 2, 4, 1, 3))

    def state(self, place: Array | None = None) -> ContactState:
        """On a grid [arc, axial]; see the base class."""
        place = self.place() if place is None else place
        found = super().state(place)._replace(axial=place[2])
        return jax.tree.map(self._gridded, found)

    def touched(self, shift: Array | float = 0.0) -> BodyContact:
        """On a grid [arc, axial]; see the base class."""
        return jax.tree.map(self._gridded, super().touched(shift)._replace(axial=self.axial))

    def _gridded(self, x: Array) -> Float[Array, "*component arc axial"]:
        x = x.reshape(*x.shape[:-2], self.count, self.count, *self.counts)
        x = jnp.moveaxis(x, (-2, -1), (-4, -2))
        long, across = self.counts[0] * self.count, self.counts[1] * self.count
        x = x.reshape(*x.shape[:-4], long, across)
        return x if self.net.topology.along_arc else jnp.swapaxes(x, -1, -2)
