"""A section of any shape: a smooth curve, described anew by the arc length of its mid-line.

A kind of section gives the inner face by a parameter of its own. Here that curve is divided
into pieces, and everything that is asked of a section (direction, position, thickness, the
parameter itself) becomes a polynomial of the mid-line's arc length on each of them. What is
built once is then as cheap as a look-up, and derivatives by every number of the curve pass
through the polynomials.
"""

import abc
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.polynomials import polynomial, power_coefficients, with_derivatives
from suas_jax.skin.geometry import Along
from suas_jax.skin.section import INVERSE_STEPS, AbstractSection, Frame, outward, tangent

# Newton steps from a material point to the foot of a place near it, whose angle changes by
# little: on the piece at hand, which is looked up again at most so many times, and while a foot
# leaves its piece or the last step was no smaller than this [rad].
_FOOT_STEPS, _LOOKS, _SETTLED = 2, 3, 1e-7

# Nodes on a piece, and pieces at least: an ellipse of twice the height is told to 1e-12.
_NODES, _PIECES = 7, 48


class AbstractCurve(eqx.Module):
    """The inner face of a section by a parameter, from the left clamp to the right one."""

    @property
    def symmetric(self) -> bool:
        """Whether the left half is the mirror image of the right one."""
        return True

    @classmethod
    @abc.abstractmethod
    def of(cls, spec: Any, value: Callable[[str], Lanes]) -> "AbstractCurve":
        """The curve of a [geometry] table.

        `spec`: the table; its numbers are not used. `value`: gives them by key, with a lane
        axis [SI].
        """

    @abc.abstractmethod
    def edges(self) -> Float[Array, "edge lane"]:
        """Parameters of the clamps, and between them of where a derivative jumps."""

    @abc.abstractmethod
    def position(self, parameter: Array, interval: Array) -> Float[Array, "2 *shape"]:
        """Position [m] at parameters of the intervals between edges."""

    @property
    def kinks(self) -> tuple[int, ...]:
        """Edges where the curvature jumps, which meshes follow."""
        return ()

    def given_angle(self, parameter: Array, direction: Array) -> Array:
        """What a scene calls the angle of a place [rad]: by default that of its normal."""
        del parameter
        return direction


class AbstractArc(AbstractCurve):
    """A curve by the angle of scenes, alike on both sides of the crown."""

    last: eqx.AbstractVar[Lanes]  # angle of the right clamp [rad]

    def edges(self) -> Float[Array, "edge lane"]:
        """The clamps [rad]."""
        return jnp.stack([-self.last, self.last])

    def given_angle(self, parameter: Array, direction: Array) -> Array:
        """The parameter."""
        del direction
        return parameter


_FIELDS = ("parameter", "arc", "direction", "mid_direction", "thickness", "x", "y")
"""What is tabulated: the curve's parameter, arc length and normal of the inner face, normal of
the mid-line, thickness, position of the inner face."""


class ChartedSection(AbstractSection):
    """A curve with a thickness along it."""

    curve: AbstractCurve  # the inner face
    mean_thickness: Lanes  # of the membrane [m]
    half_angle: Lanes  # a quarter turn: the mid-line's length sets the size [rad]
    mid_length: Lanes  # of the mid-line [m]
    ends: Float[Array, "edge lane"]  # angles of the ends of the pieces
    # of every piece, `_FIELDS` by ascending powers of a coordinate that runs from -1 to 1 on it
    table: Float[Array, "piece field power lane"]
    # which ends of pieces the curvature jumps at
    kinks: tuple[int, ...] = eqx.field(static=True)
    flattest: Lanes  # smallest curvature of the inner face [1/m]
    # whether curve and thickness both are their own mirror images
    mirrored: bool = eqx.field(static=True)

    @classmethod
    def of(cls, curve: AbstractCurve, thickness: Lanes | Along) -> Self:
        """Describe a curve by the arc length of its mid-line.

        `curve`: the inner face. `thickness`: of the membrane, one for all or along the inner
        face's arc [m].
        """
        edges = curve.edges()
        each = -(-_PIECES // (edges.shape[0] - 1))
        interval = np.repeat(np.arange(edges.shape[0] - 1), each)
        share = np.tile(np.arange(each) / each, edges.shape[0] - 1)[:, None]
        step = jnp.diff(edges, axis=0)[interval] / each
        first = edges[interval] + share * each * step
        node, differentiate, integrate = _tables()
        t = first + (node[:, None, None] + 1) / 2 * step
        where = jnp.broadcast_to(interval[:, None], t.shape)

        def position(t: Array) -> Array:
            return curve.position(t, where)

        place, velocity = jax.jvp(position, (t,), (jnp.ones_like(t),))
        speed = jnp.sqrt(jnp.sum(velocity**2, 0))
        direction = _unwrapped(jnp.arctan2(-velocity[1], velocity[0]))

        def lengths(rate: Array) -> Array:
            """Arc length at all nodes from the rate by the piece's coordinate."""
            inside = jnp.einsum("nm,mpl->npl", integrate, rate)
            before = jnp.cumsum(inside[-1], 0) - inside[-1]
            return before + inside

        turning = jnp.einsum("nm,mpl->npl", differentiate, direction)
        flattest = jnp.min(turning / (speed * step / 2), (0, 1))
        arc = lengths(speed * step / 2)
        length = arc[-1, -1]
        symmetric = curve.symmetric
        if isinstance(thickness, Along):
            thick, mean = thickness(arc / length), thickness.mean()
            symmetric = symmetric and thickness.mirrored
        else:
            thick, mean = jnp.broadcast_to(thickness, arc.shape), thickness
        mid = place + thick / 2 * outward(direction)
        along = jnp.einsum("nm,cmpl->cnpl", differentiate, mid)
        mid_arc = lengths(jnp.sqrt(jnp.sum(along**2, 0)))
        mid_direction = direction
        if isinstance(thickness, Along):
            mid_direction = _unwrapped(jnp.arctan2(-along[1], along[0]))
        total = mid_arc[-1, -1]
        size = total / np.pi
        angle = (mid_arc - total / 2) / size
        ends = jnp.concatenate([angle[0], angle[-1, -1:]])
        local = (2 * angle - ends[:-1] - ends[1:]) / (ends[1:] - ends[:-1])
        fields = (t, arc - length / 2, direction, mid_direction, thick, place[0], place[1])
        powers = power_coefficients(local[:, None], jnp.stack(fields, 1))
        return cls(
            curve=curve,
            mean_thickness=mean,
            half_angle=jnp.full_like(total, np.pi / 2),
            mid_length=total,
            ends=ends,
            table=jnp.moveaxis(powers, (2, 1), (0, 1)),
            kinks=tuple(each * k for k in curve.kinks),
            flattest=jax.lax.stop_gradient(flattest),
            mirrored=symmetric,
        )

    @property
    def symmetric(self) -> bool:
        """See the base class."""
        return self.mirrored

    @property
    def size(self) -> Lanes:
        """See the base class."""
        return self.mid_length / np.pi

    @property
    def breakpoints(self) -> list[Lanes]:
        """See the base class."""
        return [self.ends[k] for k in self.kinks]

    def _at(self, angle: Array, *names: str) -> list[Array]:
        """Fields at angles [*shape, lane]."""
        return self._with_slopes(angle, names, ())

    def _pieces(
        self, angle: Float[Array, "*shape"], names: Sequence[str]
    ) -> tuple[Array, Array, list[Array]]:
        """Begin and inverse half length of the pieces at angles, powers [field, *shape]."""
        lanes = self.ends.shape[-1]
        # Not -1: a pad at rest has no load whose place could be counted.
        flat = angle.reshape(math.prod(angle.shape[:-1]), angle.shape[-1])

        # A product with ones and zeros: XLA makes gathers anew for all that is made of them,
        # and folds `searchsorted` wrongly where several lanes ask at constants.
        def look_up(ends: Array, table: Array, x: Array) -> Array:
            beyond = x[:, None] >= ends[1:-1]
            here = jnp.pad(beyond, ((0, 0), (1, 0)), constant_values=True)
            here &= ~jnp.pad(beyond, ((0, 0), (0, 1)))
            pieces = jnp.stack([ends[:-1], 2 / (ends[1:] - ends[:-1])], 1)
            every = jnp.concatenate([pieces, table.reshape(len(table), -1)], 1)
            return here.astype(x.dtype) @ every

        table = self.table[:, np.array([_FIELDS.index(name) for name in names])]
        axes = (None, None, -1) if lanes == 1 else (-1, -1, -1)
        own = (self.ends[:, 0], table[..., 0]) if lanes == 1 else (self.ends, table)
        fixed = jax.lax.stop_gradient(flat)
        found = jnp.moveaxis(jax.vmap(look_up, axes, -1)(*own, fixed), 1, 0)
        found = found.reshape(len(found), *angle.shape)
        return found[0], found[1], [found[2 + k :: _NODES] for k in range(_NODES)]

    # Asked outside of a program it is one, where each of thirty operations would be its own.
    @functools.partial(jax.jit, static_argnums=(2, 3), inline=True)
    def _with_slopes(
        self, angle: Array, values: tuple[str, ...], slopes: tuple[str, ...]
    ) -> list[Array]:
        """Fields at angles [*shape, lane], and the derivatives of some by the angle."""
        shape = jnp.broadcast_shapes(jnp.shape(angle), self.ends.shape[-1:])
        angle = jnp.broadcast_to(angle, shape)
        names = list(dict.fromkeys((*values, *slopes)))
        low, scale, powers = self._pieces(angle, names)
        v = (angle - low) * scale - 1
        found = []
        if values:
            all_values = polynomial(powers, v)
            found += [all_values[names.index(name)] for name in values]
        if slopes:
            all_slopes = _slope(powers, v) * scale
            found += [all_slopes[names.index(name)] for name in slopes]
        return found

    def frame(self, angle: Array) -> Frame:
        """See the base class."""
        thickness, direction, bend = self._with_slopes(
            angle, ("thickness", "mid_direction"), ("mid_direction",)
        )
        t, n = tangent(direction), outward(direction)
        return Frame(angle, t, n, bend / self.size, thickness)

    def foot(self, position: Float[Array, "2 *shape"], near: Array) -> tuple[Array, Array]:
        """On the normals of the inner face; see the base class."""
        start = jnp.broadcast_to(jax.lax.stop_gradient(near), position.shape[1:])
        found: tuple[Array, Array] = _foot(self, position[:2], start)
        return found

    def height_frame(
        self, position: Float[Array, "2 *shape"], near: Array
    ) -> tuple[Array, Float[Array, "2 *shape"], Array]:
        """See the base class."""
        angle, height = self.foot(position, near)
        direction, length, turn = self._with_slopes(angle, ("direction",), ("arc", "direction"))
        return height, outward(direction), turn / (length + turn * height)

    def may_lie_below(
        self, position: Float[Array, "2 *shape"], near: Array, depth: Lanes
    ) -> Bool[Array, "*shape"]:
        """Below the circle that touches the face at `near` and is as flat as the face gets.

        The face lies nowhere outside that circle. One look-up, where a foot takes several.
        """
        x, y, direction = self._at(near, "x", "y", "direction")
        away, k = position[:2] - jnp.stack([x, y]), self.flattest
        up = jnp.sum(away * outward(direction), 0)
        return 2 * up + k * jnp.sum(away**2, 0) < (k * depth - 2) * depth

    def thickness(self, angle: Array) -> Array:
        """See the base class."""
        return self._at(angle, "thickness")[0]

    def direction(self, angle: Array) -> Array:
        """See the base class."""
        return self._at(angle, "mid_direction")[0]

    def inner_direction(self, angle: Array) -> Array:
        """See the base class."""
        return self._at(angle, "direction")[0]

    def curvature(self, angle: Array) -> Array:
        """See the base class."""
        return self._with_slopes(angle, (), ("mid_direction",))[0] / self.size

    def mid_line(self, angle: Array) -> Float[Array, "2 *shape"]:
        """See the base class."""
        x, y, thick, direction = self._at(angle, "x", "y", "thickness", "direction")
        return jnp.stack([x, y]) + thick / 2 * outward(direction)

    def inner_face(self, angle: Array) -> Float[Array, "2 *shape"]:
        """See the base class."""
        return jnp.stack(self._at(angle, "x", "y"))

    def given_angle(self, angle: Array) -> Array:
        """See the base class."""
        return self.curve.given_angle(*self._at(angle, "parameter", "direction"))

    def from_given_angle(self, angle: Array) -> Array:
        """See the base class."""
        return self._inverse(angle, "parameter")

    def arc(self, angle: Array) -> Array:
        """See the base class."""
        return self._at(angle, "arc")[0]

    def from_arc(self, arc: Array) -> Array:
        """See the base class."""
        return self._inverse(arc, "arc")

    def _inverse(self, value: Array, name: str) -> Array:
        """The angle where a growing field has a value."""
        value = jnp.asarray(value)
        low, high = (self._at(x, name)[0] for x in (-self.half_angle, self.half_angle))
        start = (2 * (value - low) / (high - low) - 1) * self.half_angle

        def step(angle: Array, _: None) -> tuple[Array, None]:
            here, rate = self._with_slopes(angle, (name,), (name,))
            return angle + (value - here) / rate, None

        return jax.lax.scan(step, start, None, length=INVERSE_STEPS)[0]


class _Search(NamedTuple):
    """Of the feet of many places."""

    looks: Array  # so far
    settled: Array  # whether all feet are found
    angle: Array
    height: Array


@eqx.filter_custom_jvp
def _foot(section: ChartedSection, place: Array, near: Array) -> tuple[Array, Array]:
    """Newton's method; its steps have no derivatives, the foot has them in closed form."""
    ends, lane = section.ends, jnp.arange(section.ends.shape[-1])
    x, y = (section.table[:, _FIELDS.index(name)] for name in "xy")
    rows = jnp.concatenate([x, y, 2 / (ends[1:] - ends[:-1])[:, None], ends[:-1, None]], 1)
    rows = jnp.moveaxis(rows, 1, -1)

    def look(carry: _Search) -> _Search:
        # Gathered rows are quicker than the products of `_pieces`, but not to differentiate.
        *powers, scale, low = jnp.moveaxis(rows[_piece(ends, carry.angle), lane], -1, 0)
        x, y = powers[:_NODES], powers[_NODES:]
        v = (carry.angle - low) * scale - 1
        for _ in range(_FOOT_STEPS):
            (at_x, by_x, bend_x), (at_y, by_y, bend_y) = (
                with_derivatives(x, v),
                with_derivatives(y, v),
            )
            away_x, away_y = place[0] - at_x, place[1] - at_y
            rate = by_x**2 + by_y**2 - away_x * bend_x - away_y * bend_y
            step = (away_x * by_x + away_y * by_y) / rate
            v = v + step
        height = (away_y * by_x - away_x * by_y) / jnp.sqrt(by_x**2 + by_y**2)
        settled = jnp.all((jnp.abs(v) <= 1) & (jnp.abs(step) < _SETTLED * scale))
        return _Search(carry.looks + 1, settled, low + (v + 1) / scale, height)

    shape = jnp.broadcast_shapes(place.shape[1:], section.ends.shape[-1:])
    begin, zero = jnp.broadcast_to(near, shape), jnp.zeros(shape)
    start = _Search(jnp.array(0), jnp.array(False), begin, zero)
    *_, angle, height = jax.lax.while_loop(
        lambda carry: (carry.looks < _LOOKS) & ~carry.settled, look, start
    )
    return angle, height


@_foot.def_jvp
def _(primals: Any, tangents: Any) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """By the normal n and the tangent t at a foot that the section itself may move.

    With what the section changes at a fixed angle::

        dheight = n . (dplace - dinner)
        dangle = (t . (dplace - dinner) - height ddirection) / (darc + height bend)
    """
    section, place, _ = primals
    t_section, t_place, _ = tangents
    angle, height = _foot(*primals)
    direction, length, bend = section._with_slopes(angle, ("direction",), ("arc", "direction"))
    moved = jnp.zeros_like(place) if t_place is None else t_place
    turn: Array | float = 0.0
    if jax.tree.leaves(t_section):

        def here(section: ChartedSection) -> list[Array]:
            return section._at(angle, "x", "y", "direction")

        _, (x, y, turn) = eqx.filter_jvp(here, (section,), (t_section,))
        moved = moved - jnp.stack([x, y])
    along = jnp.sum(moved * tangent(direction), 0) - height * turn
    up = jnp.sum(moved * outward(direction), 0)
    return (angle, height), (along / (length + height * bend), up)


def _piece(ends: Float[Array, "edge #lane"], angle: Array) -> Array:
    """On which piece angles [*shape, lane] lie, by bisection."""
    last, lane = len(ends) - 2, jnp.arange(ends.shape[-1])
    found = jnp.zeros(angle.shape, int)
    for k in reversed(range(last.bit_length())):
        further = jnp.minimum(found + 2**k, last)
        found = jnp.where(angle >= ends[further, lane], further, found)
    return found


def _slope(powers: list[Array], v: Array) -> Array:
    """Derivative of a polynomial by its coordinate."""
    return polynomial([k * powers[k] for k in range(1, len(powers))], v)


def _tables() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Chebyshev-Lobatto nodes on [-1, 1]; matrices that differentiate and integrate from -1."""
    node = -np.cos(np.pi * np.arange(_NODES) / (_NODES - 1))
    powers = np.polynomial.chebyshev.chebvander(node, _NODES - 1)
    inverse = np.linalg.inv(powers)
    slopes, sums = np.empty((_NODES, _NODES)), np.empty((_NODES, _NODES))
    for k, unit in enumerate(np.eye(_NODES)):
        cheb = np.polynomial.chebyshev
        slopes[:, k] = cheb.chebval(node, cheb.chebder(unit))
        sums[:, k] = cheb.chebval(node, cheb.chebint(unit, lbnd=-1))
    return node, slopes @ inverse, sums @ inverse


def _unwrapped(direction: Float[Array, "node piece lane"]) -> Array:
    """Directions without jumps along the section, pieces one after another."""
    ordered = jnp.moveaxis(direction, 0, 1).reshape(-1, direction.shape[-1])
    smooth = jnp.unwrap(ordered, axis=0)
    return jnp.moveaxis(smooth.reshape(-1, _NODES, direction.shape[-1]), 1, 0)
