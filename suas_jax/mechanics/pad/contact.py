"""The pad's inner face against the wall.

The inner face is the fibre at -t/2 of the thinned membrane, so its gap at a point depends on
the displacement and on its first and second derivatives: eighteen inputs. Points are even
in an element, the corners included: where the membrane first touches, the zone is smaller
than an element. Few elements are near the wall; only those have terms, a chunk at a time.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from suas_jax.mechanics.base import ContactState
from suas_jax.mechanics.contact.term import (
    ContactTerms,
    contact_pressure,
    contact_terms,
    expanded,
)
from suas_jax.mechanics.pad.faces import face_displacement
from suas_jax.mechanics.pad.mid_surface import KINDS, Rest, surface, vectors
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
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Wall

_INTERVALS = 8  # between points, along either side of an element
_CHUNK = 4  # elements whose terms are made together

_XI = np.linspace(0, 1, _INTERVALS + 1)
_WEIGHTS = np.where((_XI == 0) | (_XI == 1), 0.5, 1.0) / _INTERVALS
_COUNT = len(_XI)


@functools.cache
def _shapes(kinds: tuple[tuple[int, int], ...]) -> Float[np.ndarray, "kind point 16"]:
    """Bernstein polynomials at the points by kind of derivative (along stations, across)."""
    by_order = [np.stack(bernstein(_XI, order), 1) for order in range(3)]
    products = [np.einsum("ga,hb->ghab", by_order[m], by_order[n]) for m, n in kinds]
    return np.stack(products).reshape(len(kinds), _COUNT**2, 16)


class InnerFace:
    """One lane's inner face at its contact points [point, element].

    Args:
        net: the control net.
        wall: what it may touch.
        section: the undeformed membrane across the axis.
        qe: Bernstein coefficients of the displacement.
        growth: of the membrane; None where it fits its seat.
    """

    def __init__(
        self,
        net: Net,
        wall: Wall,
        section: AbstractSection,
        qe: ElementVector,
        growth: Growth | None,
    ) -> None:
        self.net, self.wall, self.growth = net, wall, growth
        self.section = section
        order = net.topology.ordered
        span, axial = jnp.diff(net.angles), jnp.diff(net.axial)
        long, across = order(section.size * span, axial)
        self.counts = len(long), len(across)
        kinds = tuple(order(*kind) for kind in KINDS)
        self.shapes = _shapes(kinds)
        powers = [1 / (long[:, None] ** m * across**n) for m, n in kinds]
        self.powers = jnp.stack(powers).reshape(len(KINDS), -1)  # [kind, element]
        values = jnp.einsum("kgs,cse->kcge", self.shapes, qe.reshape(3, 16, -1))
        self.inputs = (values * self.powers[:, None, None]).reshape(18, _COUNT**2, -1)
        self.angle = self._spread(net.angles[:-1], span, arc=True)
        self.axial = self._spread(net.axial[:-1], axial, arc=False)
        sides = order(section.size * span, axial)
        weights = np.outer(_WEIGHTS, _WEIGHTS).reshape(-1, 1)
        inner = 1 - section.curvature(self.angle) * section.thickness(self.angle) / 2
        self.area = weights * jnp.outer(sides[0], sides[1]).reshape(-1) * inner

    def _spread(self, start: Array, length: Array, *, arc: bool) -> Array:
        """A coordinate of one direction at all points [point, element]."""
        x = start + _XI[:, None] * length
        along = arc == self.net.topology.along_arc
        x = x[:, None, :, None] if along else x[None, :, None, :]
        return jnp.broadcast_to(x, (_COUNT, _COUNT, *self.counts)).reshape(_COUNT**2, -1)

    def position(self, z: Float[Array, "18 *point"], angle: Array) -> Array:
        """Current positions of the inner face [m].

        Args:
            z: displacement and its derivatives, in the order of `KINDS`.
            angle: reference angles [rad].
        """
        s = surface(vectors(z), Rest.of(self.section, angle))
        (x, y, axial), _ = face_displacement(s, -s.rest.thickness / 2, self.growth)
        rest = self.section.inner_face(angle)
        return jnp.stack([rest[0] + x, rest[1] + y, axial])

    def gap(self) -> Float[Array, "point element"]:
        """Distance from the wall at all points [m]."""
        return self.wall.gap(self.position(self.inputs, self.angle), self.angle)

    def energy(self) -> Array:
        """Energy of contact [J]."""
        return jnp.sum(self.area * self.wall.law.energy(self.gap()))

    def element_terms(self) -> tuple[ElementVector, Upper]:
        """First derivatives of the energy by the element unknowns, second ones as bands."""
        lowest = jnp.min(self.gap(), 0)
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
            terms = self._terms(element, jnp.where(index < count, 1.0, 0.0))
            force = force.at[:, :, element].add(self._forces(terms, element))
            side = jnp.divmod(element, self.counts[1])
            blocks = add_blocks(self.net, blocks, side, self._blocks(terms, element))
            return start + _CHUNK, (force, blocks)

        nothing = jnp.zeros((3, 16, count), self.inputs.dtype), no_blocks(self.net)
        _, (force, bands) = jax.lax.while_loop(closed, add, (jnp.zeros((), int), nothing))
        return force.reshape(3, 4, 4, *self.counts), upper_of(bands)

    def _terms(self, element: Int[Array, " chosen"], share: Array) -> ContactTerms:
        """Contact at the points of some elements, by its inputs."""
        angle = self.angle[:, element]
        inputs = self.inputs[:, :, element]
        gap = expanded(lambda z: self.wall.gap(self.position(z, angle), angle), inputs)
        return contact_terms(self.wall.law, gap, share * self.area[:, element])

    def _forces(self, terms: ContactTerms, element: Array) -> Float[Array, "3 16 chosen"]:
        force = terms.force.reshape(6, 3, _COUNT**2, -1)
        force = force * self.powers[:, None, None, element]
        return jnp.einsum("kgs,kcge->cse", self.shapes, force)

    def _blocks(self, terms: ContactTerms, element: Array) -> Array:
        """Second derivatives by control values, by `SLOTS` along the stations."""
        powers = self.powers[:, element]
        stiffness = terms.stiffness.reshape(6, 3, 6, 3, _COUNT**2, -1)
        stiffness = stiffness * (powers[:, None] * powers)[:, None, :, None, None]
        half = jnp.einsum("kgs,kcldge->csldge", self.shapes, stiffness)
        k = jnp.einsum("csldge,lgt->csdte", half, self.shapes)
        k = k.reshape(3, 4, 4, 3, 4, 4, -1)
        long, side = jnp.divmod(element, self.counts[1])
        along, across = self.net.along[:, :, long], self.net.across[:, :, :, side]
        k = jnp.einsum("iae,cabdxye->cibdxye", along, k)
        k = jnp.einsum("lxe,cibdxye->cibdlye", along, k)
        k = jnp.einsum("cjbe,cibdlye->cijdlye", across, k)
        k = jnp.einsum("dmye,cijdlye->cijdlme", across, k)
        pairs = k[:, ROWS, :, :, COLUMNS]  # [slot, component, across, component, across, .]
        return jnp.transpose(pairs, (0, 5, 2, 4, 1, 3))

    def state(self) -> ContactState:
        """Where the face is, and how it is pushed, on a grid [arc, axial]."""
        place = self.position(self.inputs, self.angle)
        polar, gap = self.wall.seen_from(place, self.angle)
        pressure = contact_pressure(self.wall.law, gap)
        axial = self.axial + place[2]
        fields = (self.angle, polar, gap, pressure, self.area, axial)
        return ContactState(*(self._gridded(x) for x in fields))

    def _gridded(self, x: Array | np.ndarray) -> Float[Array, "arc axial"]:
        x = jnp.broadcast_to(x, self.area.shape).reshape(_COUNT, _COUNT, *self.counts)
        x = jnp.transpose(x, (2, 0, 3, 1)).reshape(
            self.counts[0] * _COUNT, self.counts[1] * _COUNT
        )
        return x if self.net.topology.along_arc else x.T
