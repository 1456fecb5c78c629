"""The lumped shell's faces against rigid surfaces: the inner one's wall, bodies on the outer.

The inner face is the fibre at -t/2 of the thinned membrane, so its gap at a point depends on
the mid-line's displacement and on its first two derivatives by arc length: six inputs. The
outer one is at t/2 on the rigid normal, which loads act on, too: four inputs. Beneath a body
the shell bends more sharply than a continuum, and thinned by that bending it would meet the
body too early.
Points are even along an element: the shell touches in zones much shorter than its elements,
and even points leave the least between them.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.contact.face import (
    AbstractContactFace,
    ContactTerms,
    Gap,
    contact_pressure,
    contact_terms,
)
from suas_jax.mechanics.shell.shape import carried, reach, turn
from suas_jax.numerics.jet import second_order
from suas_jax.numerics.lanes import mix
from suas_jax.numerics.polynomials import hermite
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall

# Between contact points of an element, whose ends are points, too: against the wall, and under
# bodies, where the place of contact turns the force.
_INTERVALS = {-1: 16, 1: 64}
_AT_ONCE = 4  # elements that touch the wall
_ORDERS = {-1: 3, 1: 2}  # of the derivatives that the face's position depends on, and one more

ElementVector = Float[Array, "4 2 element lane"]
ElementMatrix = Float[Array, "4 4 2 2 element lane"]


class _Rule(NamedTuple):
    """Local coordinates and weights of the trapezoidal rule, and shape functions there."""

    xi: Float[np.ndarray, " point"]
    weights: Float[np.ndarray, " point"]
    shapes: Float[np.ndarray, "point order 4"]

    @classmethod
    def of(cls, side: int) -> "_Rule":
        """For the inner face (-1) or the outer one (1)."""
        intervals = _INTERVALS[side]
        weights = np.full(intervals + 1, 1.0 / intervals)
        weights[[0, -1]] /= 2
        xi = np.linspace(0, 1, intervals + 1)
        shapes = [hermite(xi, order).T for order in range(_ORDERS[side])]
        return cls(xi, weights, np.stack(shapes, 1))


_RULES = {side: _Rule.of(side) for side in (-1, 1)}


class ContactFace(AbstractContactFace):
    """A face of a shell at the contact points of its elements.

    `elements`: angles where they start and which they span [rad]. `there`: one for every
    element, zero for a place that is empty.
    """

    def __init__(
        self,
        obstacle: Obstacle,  # a wall inside, a body outside
        section: AbstractSection,
        elements: tuple[Float[Array, "element #lane"], Float[Array, "element #lane"]],
        qe: ElementVector,  # element unknowns [shape, component]
        growth: Growth | None,  # of the membrane; None where it fits its seat
        there: Float[Array, "element #lane"] | float = 1.0,
    ) -> None:
        self.elements, self.qe, self.growth = elements, qe, growth
        start, span = elements
        length = section.size * span
        self.obstacle, self.section = obstacle, section
        self.side = -1 if isinstance(obstacle, Wall) else 1  # inner or outer face
        self.xi, weights, self.shapes = _RULES[self.side]
        self.angle = start + self.xi[:, None, None] * span
        self.at = section.frame(self.angle)
        # Derivatives by arc length from those by the local coordinate [order].
        one = jnp.ones_like(length)
        self.power = jnp.stack([one, 1 / length, 1 / length**2])
        orders = self.shapes.shape[1]
        self.power = self.power[:orders]
        values = mix(self.shapes.reshape(-1, 4), qe).reshape(-1, orders, *qe.shape[1:])
        values = values * self.power[:, None]
        # [order and component, point, ...]
        self.inputs = jnp.moveaxis(values, 0, 2).reshape(
            2 * orders, len(self.xi), *qe.shape[2:]
        )
        # Of the undeformed face, which a unit of width covers [m].
        face = 1 + self.at.curvature * self._offset
        self.area = jnp.asarray(weights)[:, None, None] * face * length * there
        self.rest = section.mid_line(self.angle)

    def place(self) -> Array:
        """See the base class."""
        return self.position(self.inputs)

    def place_at_rest(self) -> Array:
        """See the base class."""
        return self.position(jnp.zeros_like(self.inputs))

    @property
    def _offset(self) -> Array:
        """Of the face from the mid-line, outwards [m]."""
        return self.side * self.at.thickness / 2

    def _tangents(self, z: Float[Array, "input *point"]) -> tuple[Array, Array, Array, Array]:
        """Current r' and r'' of the mid-line, x and y of each; no r'' on the outer face."""
        t, n, k = self.at.tangent, self.at.normal, self.at.curvature
        x1, y1 = t[0] + z[2], t[1] + z[3]
        if self.side > 0:
            return x1, y1, jnp.zeros_like(x1), jnp.zeros_like(y1)
        return x1, y1, z[4] - n[0] * k, z[5] - n[1] * k

    def _reach(self, size: Array, curl: Array) -> Array:
        """Distance of the face from the mid-line, over the length of the tangent [m]."""
        if self.side > 0:
            return self._offset / jnp.sqrt(size)
        return reach(size, curl, self._offset, self.at.curvature, self.growth)

    def position(self, z: Float[Array, "input *point"]) -> Float[Array, "2 *point"]:
        """Current positions of the face [m].

        `z`: displacement of the mid-line and its derivatives by arc length.
        """
        x1, y1, x2, y2 = self._tangents(z)
        far = self._reach(x1**2 + y1**2, x2 * y1 - y2 * x1)
        return self.rest + z[:2] + far * jnp.stack([-y1, x1])

    def gap(self, position: Float[Array, "2 *point"]) -> Float[Array, "*point"]:
        """Distance of places near the contact points from the obstacle [m]."""
        return self.obstacle.gap(position, self.angle)

    def _expanded_gap(self) -> Gap:
        """The gap and its derivatives by the inputs.

        The face is at f(a, c) (-y', x') from the mid-line, a and c polynomials of the inputs,
        and the gap is a function of its two coordinates: two expansions in two numbers each,
        and products. Differentiated by all inputs at once they take ten times as long.
        """
        z = self.inputs
        x1, y1, x2, y2 = self._tangents(z)
        size, curl = x1**2 + y1**2, x2 * y1 - y2 * x1
        far = second_order(self._reach, size, curl, once=True)
        place = self.rest + z[:2] + far.value * jnp.stack([-y1, x1])
        gap = self.obstacle.expanded(place, self.angle)
        count = len(z) - 2
        one, zero = jnp.ones_like(x1), jnp.zeros_like(x1)
        by_size = [2 * x1, 2 * y1, zero, zero][:count]
        by_curl = [-y2, x2, y1, -x1][:count]
        slope = [far.x * a + far.y * c for a, c in zip(by_size, by_curl, strict=True)]
        # Of the coordinates by the inputs.
        by_x = [one, zero, *(-y1 * f for f in slope)]
        by_y = [zero, one, *(x1 * f for f in slope)]
        by_x[3], by_y[2] = by_x[3] - far.value, by_y[2] + far.value
        aside, turned = x1 * gap.y - y1 * gap.x, [gap.y, -gap.x, zero, zero]

        def bent(i: int, k: int) -> Array:
            """Second derivatives of the coordinates, times the gap's first ones."""
            a, c = by_size, by_curl
            second = far.xx * a[i] * a[k] + far.xy * (a[i] * c[k] + c[i] * a[k])
            second = second + far.yy * c[i] * c[k]
            if i == k < 2:
                second = second + 2 * far.x
            if (i, k) in ((0, 3), (1, 2)):
                second = second + (-far.y if i == 0 else far.y)
            return aside * second + slope[i] * turned[k] + turned[i] * slope[k]

        first = [gap.x * x + gap.y * y for x, y in zip(by_x, by_y, strict=True)]
        rows: list[list[Array]] = [[zero] * len(z) for _ in z]
        for i in range(len(z)):
            along = gap.xx * by_x[i] + gap.xy * by_y[i], gap.xy * by_x[i] + gap.yy * by_y[i]
            for k in range(i, len(z)):
                entry = along[0] * by_x[k] + along[1] * by_y[k]
                rows[i][k] = rows[k][i] = entry + bent(i - 2, k - 2) if i > 1 else entry
        return Gap(gap.value, jnp.stack(first), jnp.stack([jnp.stack(row) for row in rows]))

    def terms(self) -> ContactTerms:
        """Contact at every point, by its inputs."""
        terms = contact_terms(self.obstacle.law, self._expanded_gap(), self.area)
        return self.with_friction(terms, self.moved, self.inputs, self.grip())

    def _picked(self, select: Float[Array, "place element lane"]) -> "ContactFace":
        """Some of the elements, a row of ones and zeros for each."""
        there = jnp.sum(select, 1)
        # An empty place takes the first element, without an area.
        first = (jnp.arange(select.shape[1]) == 0)[:, None]
        select = jnp.where(there[:, None] > 0, select, first)
        start, span = (jnp.sum(select * x, 1) for x in self.elements)
        qe = jnp.sum(self.qe[:, :, None] * select, 3)
        chosen = start, span
        return ContactFace(self.obstacle, self.section, chosen, qe, self.growth, there)

    def assembled(self) -> tuple[ElementVector, ElementMatrix]:
        """Element forces and matrices, worked out for the elements that touch.

        They are few, `_AT_ONCE` in turn: all of them take ten times as long as all else that is
        assembled. Without derivatives in reverse mode; see `push`.
        """
        assert isinstance(self.obstacle, Wall)
        touching = jnp.any(self.obstacle.may_touch(self.place(), self.angle), 0)
        place = jnp.cumsum(touching, 0) - 1
        rounds = -(-jnp.max(jnp.sum(touching, 0)) // _AT_ONCE)

        def some(round_: Array, sums: tuple[Array, Array]) -> tuple[Array, Array]:
            wanted = round_ * _AT_ONCE + jnp.arange(_AT_ONCE)[:, None, None]
            select = (touching & (place == wanted)).astype(self.qe.dtype)
            face = self._picked(select)
            terms = face.terms()

            def placed(found: Array) -> Array:
                of = [found[..., k, None, :] * select[k] for k in range(_AT_ONCE)]
                return functools.reduce(jnp.add, of)

            forces, matrices = sums
            return forces + placed(face.forces(terms.force)), matrices + placed(
                face.matrix(terms)
            )

        shape = self.qe.shape[2:]
        zeros = (jnp.zeros((4, 2, *shape)), jnp.zeros((4, 4, 2, 2, *shape)))
        found: tuple[Array, Array] = jax.lax.fori_loop(0, rounds, some, zeros)
        return found

    def push(self) -> ElementVector:
        """Element forces alone, with derivatives of any order."""

        def energy(z: Array) -> Array:
            return jnp.sum(self.area * self.obstacle.law.energy(self.gap(self.position(z))))

        return self.forces(jax.grad(energy)(self.inputs))

    def moved(self, z: Float[Array, "input *point"]) -> Float[Array, "2 *point"]:
        """Displacements of the points of the face [m]."""
        return self.position(z) - self.place_at_rest()

    def forces(self, by_inputs: Float[Array, "input point element lane"]) -> ElementVector:
        """Element forces from derivatives by the inputs."""
        force = by_inputs.reshape(-1, 2, *by_inputs.shape[1:]) * self.power[:, None, None]
        force = jnp.moveaxis(force, 2, 0).reshape(-1, 2, *by_inputs.shape[2:])
        return mix(self.shapes.reshape(-1, 4).T, force)

    def matrix(self, terms: ContactTerms) -> ElementMatrix:
        """Second derivatives of the energy by the element unknowns."""
        power, tail = self.power, terms.force.shape[2:]
        orders = len(power)
        stiffness = terms.stiffness.reshape(orders, 2, orders, 2, *terms.stiffness.shape[2:])
        stiffness = stiffness * (power[:, None] * power)[:, None, :, None, None]
        stiffness = stiffness.transpose(4, 0, 2, 1, 3, 5, 6)  # [point, order, order, c, c]
        stiffness = stiffness.reshape(-1, 2, 2, *tail)
        products = np.einsum("gon,gpm->nmgop", self.shapes, self.shapes).reshape(16, -1)
        return mix(products, stiffness).reshape(4, 4, 2, 2, *tail)

    def shares(self, z: Float[Array, "input point element lane"]) -> Array:
        """Force of every point, along its own normal, by its inputs [N/m]."""
        return self.area * contact_pressure(self.obstacle.law, self.gap(self.position(z)))

    def pulled(self, by_share: Float[Array, "point element lane"]) -> ElementVector:
        """Element forces from derivatives by `shares`."""
        (by_inputs,) = jax.vjp(self.shares, self.inputs)[1](by_share)
        return self.forces(by_inputs)

    def carried(self, change: Float[Array, "6 point element lane"]) -> Array:
        """Places of the points after a small change of the inputs that moves and turns normals.

        See `shifted`.
        """
        place, t, z = self.place(), self.at.tangent, self.inputs
        angle = turn((t[0] + z[2], t[1] + z[3]), (change[2], change[3]))
        return place + carried(place - self.rest - z[:2], change[:2], angle)
