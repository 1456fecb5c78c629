"""The control net: from a station vector to element coefficients, and back into bands.

Stations run along one direction of the pad, the *long* one (the direction of elimination);
a station's unknowns are those of the control values *across* it, three each: tangential,
normal and axial in the frame of their column. Element arrays are in Bernstein form,
``[component, 4, 4, element, element]``, long direction first, components Cartesian.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.block_banded import REACH
from suas_jax.numerics.bspline import SplineAxis, bernstein
from suas_jax.numerics.quadrature import gauss_legendre

# Signs of Cartesian components in the crown's mirror, and in a plane across the axis.
ODD_ARC, ODD_AXIAL = (-1, 1, 1), (1, 1, -1)

ElementVector = Float[Array, "3 4 4 long across"]
ElementMatrix = Float[Array, "4 4 4 4 3 3 element"]


@dataclasses.dataclass(frozen=True)
class NetTopology:
    """What is static about a control net.

    Attributes:
        arc: splines along the arc; mirrored at the crown of half a pad.
        axial: splines along the axis; mirrored at the middle, and where ends may slide.
    """

    arc: SplineAxis
    axial: SplineAxis

    @property
    def along_arc(self) -> bool:
        """Whether the arc is the long direction."""
        return self.arc.stations >= self.axial.stations

    @property
    def long(self) -> SplineAxis:
        """Splines along the stations."""
        return self.arc if self.along_arc else self.axial

    @property
    def across(self) -> SplineAxis:
        """Splines across them."""
        return self.axial if self.along_arc else self.arc

    def ordered(self, arc: object, axial: object) -> tuple:
        """Two things in the order long, across."""
        return (arc, axial) if self.along_arc else (axial, arc)

    def by_direction(
        self, q: Float[Array, "dof station *lane"]
    ) -> Float[Array, "arc axial 3 *lane"]:
        """A station vector by its columns along the arc and along the axis."""
        q = q.reshape(self.across.stations, 3, *q.shape[1:])
        return jnp.moveaxis(q, (2, 0, 1), (0, 1, 2) if self.along_arc else (1, 0, 2))

    def to_stations(
        self, x: Float[Array, "arc axial 3 *lane"]
    ) -> Float[Array, "dof station *lane"]:
        """The inverse of `by_direction`."""
        q = jnp.moveaxis(x, (0, 1, 2) if self.along_arc else (1, 0, 2), (2, 0, 1))
        return q.reshape(-1, *q.shape[2:])

    @functools.cached_property
    def free_by_station(self) -> tuple[tuple[bool, ...], ...]:
        """Which unknowns may move, station by station."""
        return tuple(tuple(bool(x) for x in station) for station in self.free.T)

    @functools.cached_property
    def free(self) -> Float[np.ndarray, "dof station"]:
        """Mask of the unknowns that may move.

        Next to a clamp the normal component stays zero, which keeps the normal; on a mirror
        plane the component across it does.
        """
        free = np.ones((self.arc.stations, self.axial.stations, 3))
        for end, index in ((self.arc.left, 0), (self.arc.right, -1)):
            free[index, :, 1 if end == "open" else 0] = 0
        for end, index in ((self.axial.left, 0), (self.axial.right, -1)):
            free[:, index, 1 if end == "open" else 2] = 0
        if self.along_arc:
            return np.moveaxis(free, 0, -1).reshape(-1, self.arc.stations)
        return np.moveaxis(free, 1, -1).reshape(-1, self.axial.stations)


@dataclasses.dataclass(frozen=True)
class Tables:
    """Constants of one element on the unit square.

    Attributes:
        xi: Gauss points on the unit interval.
        weights: their weights on the square [gauss, gauss].
        values: of the Bernstein polynomials by kind of derivative [kind * gauss * gauss, 16].
        products: weighed products of them by pair of kinds [256, pair * gauss * gauss].
    """

    xi: np.ndarray
    weights: np.ndarray
    values: np.ndarray
    products: np.ndarray


@functools.cache
def tables(
    gauss: int, kinds: tuple[tuple[int, int], ...], pairs: tuple[tuple[int, int], ...]
) -> Tables:
    """Tables for a number of quadrature points.

    Args:
        gauss: points in each direction.
        kinds: orders of differentiation (long, across).
        pairs: pairs of kinds.
    """
    xi, w = gauss_legendre(gauss)
    shapes = [np.stack(bernstein(xi, order), 1) for order in range(3)]
    square = np.outer(w, w)
    values = np.stack([np.einsum("ga,hb->ghab", shapes[k], shapes[m]) for k, m in kinds])
    left = values[[k for k, _ in pairs]] * square[:, :, None, None]
    right = values[[m for _, m in pairs]]
    products = np.einsum("pghab,pghcd->abcdpgh", left, right)
    count = len(kinds) * gauss**2
    return Tables(xi, square, values.reshape(count, 16), products.reshape(256, -1))


class Net:
    """A control net with its breakpoints: the linear maps between its descriptions.

    Attributes:
        topology: what is static.
        frames: unit vectors (tangential, normal, axial) of the arc's columns.
    """

    def __init__(self, topology: NetTopology, angles: Array, axial: Array) -> None:
        """Prepare the maps.

        Args:
            topology: what is static.
            angles: breakpoints along the arc [rad].
            axial: breakpoints along the axis [m].
        """
        self.topology = topology
        arc, axis = topology.arc, topology.axial
        at = arc.abscissae(angles)
        sine, cosine, zero = jnp.sin(at), jnp.cos(at), jnp.zeros_like(at)
        one = zero + 1
        self.frames = jnp.stack(
            [
                jnp.stack([cosine, -sine, zero]),
                jnp.stack([sine, cosine, zero]),
                jnp.stack([zero, zero, one]),
            ]
        )  # [local, Cartesian, column]
        by_arc = _by_component(lambda p: arc.extraction(angles, p), ODD_ARC)
        by_axial = _by_component(lambda p: axis.extraction(axial, p), ODD_AXIAL)
        self.extraction = topology.ordered(by_arc, by_axial)
        by_arc = _by_component(lambda p: arc.matrix(angles, p), ODD_ARC)
        by_axial = _by_component(lambda p: axis.matrix(axial, p), ODD_AXIAL)
        self.matrix = topology.ordered(by_arc, by_axial)

    def cartesian(self, q: Float[Array, "dof station"]) -> Float[Array, "3 station across"]:
        """Control values in Cartesian components."""
        q = q.reshape(self.topology.across.stations, 3, -1)
        if self.topology.along_arc:
            return jnp.einsum("kls,lcs->csk", q, self.frames)
        return jnp.einsum("kls,lck->csk", q, self.frames)

    def local(self, x: Float[Array, "3 station across"]) -> Float[Array, "dof station"]:
        """Forces on control values in local components, zero where they are held."""
        if self.topology.along_arc:
            q = jnp.einsum("csk,lcs->kls", x, self.frames)
        else:
            q = jnp.einsum("csk,lck->kls", x, self.frames)
        return q.reshape(-1, q.shape[-1]) * self.topology.free

    def gather(self, q: Float[Array, "dof station"]) -> ElementVector:
        """Bernstein coefficients of the displacement."""
        return jnp.einsum(
            "caes,csk,cbfk->cabef", self.matrix[0], self.cartesian(q), self.matrix[1]
        )

    def scatter(self, f: ElementVector) -> Float[Array, "dof station"]:
        """Sum forces on Bernstein coefficients: the transpose of `gather`, masked."""
        return self.local(jnp.einsum("caes,cabef,cbfk->csk", self.matrix[0], f, self.matrix[1]))

    def bands(self, m: ElementMatrix) -> Float[Array, "station 4 dof dof"]:
        """Lower bands of M + M^T, in local components.

        Args:
            m: half the element matrices [row 4 x 4, column 4 x 4, components, elements].
        """
        long, across = self.topology.long, self.topology.across
        m = self._transformed(m)
        elements = (long.elements, across.elements)
        m = m.reshape(*m.shape[:-1], *elements)
        # Along the stations, by offset: rows at a station and columns ahead of it, and the
        # other way round.
        bands = []
        for o in range(REACH + 1):
            slots = range(4 - o)
            ahead = _summed([m[i, :, i + o] for i in slots], slots, -2, long)
            behind = _summed([m[i + o, :, i] for i in slots], slots, -2, long)
            bands.append(ahead + jnp.transpose(behind, (1, 0, 3, 2, 4, 5)))
        m = jnp.stack(bands)  # [offset, row, column, component, component, station, element]
        diagonals = []
        for o in range(-REACH, REACH + 1):
            slots = range(max(0, -o), min(4, 4 - o))
            diagonals.append(_summed([m[:, i, i + o] for i in slots], slots, -1, across))
        # [offset, component, component, station, row, diagonal]
        return _dense(self._turned(jnp.stack(diagonals, -1)))

    def _transformed(self, m: ElementMatrix) -> ElementMatrix:
        """From Bernstein coefficients to control values, rows and columns."""
        long, across = self.extraction  # [component, control, Bernstein, element]
        elements = (self.topology.long.elements, self.topology.across.elements)
        long = jnp.broadcast_to(long[..., None], (*long.shape, elements[1]))
        across = jnp.broadcast_to(across[..., None, :], (*across.shape[:-1], *elements))
        long, across = (c.reshape(3, 4, 4, -1) for c in (long, across))
        for axis, component, c in ((0, 4, long), (1, 4, across), (2, 5, long), (3, 5, across)):
            total: Array | float = 0.0
            for a in range(4):
                y = jnp.moveaxis(c[:, :, a], 0, 1)  # [control, component, element]
                shape = [1] * 6 + [y.shape[-1]]
                shape[axis], shape[component] = 4, 3
                part = jax.lax.slice_in_dim(m, a, a + 1, axis=axis)
                total = total + part * y.reshape(shape)
            m = jax.lax.optimization_barrier(total)
        return m

    def _turned(self, x: Array) -> Array:
        """Turn bands [offset, c, c, station, row, diagonal] into local components."""
        frames = self.frames[:2, 1]  # sine and cosine, with their signs, of the columns
        if self.topology.along_arc:
            rows = frames[:, None, None, None, :, None, None]
            ahead = jnp.stack([jnp.roll(frames, -o, 1) for o in range(REACH + 1)], 1)
            columns = ahead[:, :, None, None, :, None, None]
        else:
            rows = frames[:, None, None, None, None, :, None]
            offsets = range(-REACH, REACH + 1)
            ahead = jnp.stack([jnp.roll(frames, -o, 1) for o in offsets], 2)
            columns = ahead[:, None, None, None, None]
        for axis, (sine, cosine) in ((1, rows), (2, columns)):
            parts = [jax.lax.slice_in_dim(x, c, c + 1, axis=axis) for c in range(3)]
            tangential = cosine * parts[0] + sine * parts[1]
            normal = cosine * parts[1] - sine * parts[0]
            x = jnp.concatenate([tangential, normal, parts[2]], axis)
        return x


def _dense(x: Array) -> Float[Array, "station 4 dof dof"]:
    """Lower dense blocks from upper bands [offset, c, c, station, row, diagonal]."""
    *others, n, width = x.shape
    # Read with rows one shorter than they are, every row moves on by one more column.
    wide = jnp.pad(x, [(0, 0)] * 5 + [(0, n)]).reshape(*others, n * (n + width))
    rows = wide[..., : n * (n + width - 1)].reshape(*others, n, n + width - 1)
    square = rows[..., REACH : REACH + n]
    count = others[-1]
    return jnp.transpose(square, (3, 0, 5, 2, 4, 1)).reshape(count, REACH + 1, 3 * n, 3 * n)


def _summed(parts: list[Array], slots: range, axis: int, along: SplineAxis) -> Array:
    """Sum what elements give to their control values into stations.

    Args:
        parts: one for each of `slots`, elements along `axis`.
        slots: which of an element's control values.
        axis: negative.
        along: the splines in that direction.
    """
    total: Array | float = 0.0
    for slot, part in zip(slots, parts, strict=True):
        room = [(0, 0, 0)] * part.ndim
        zero = jnp.zeros((), part.dtype)
        if along.multiplicity is None:
            room[axis] = (slot - 1, along.stations - along.elements - slot + 1, 0)
            total = total + jax.lax.pad(part, zero, room)
        else:
            room[axis] = (0, 1, 0)
            element = np.full(along.stations + 1, along.elements)
            element[along.station_of[:, slot]] = np.arange(along.elements)
            total = total + jnp.take(jax.lax.pad(part, zero, room), element[:-1], axis)
    return total  # type: ignore[return-value]


def refined(
    net: Net, angles: Array, axial: Array, q: Float[Array, "dof station"]
) -> Float[Array, "dof station"]:
    """The same deformation on elements half as long in both directions.

    Args:
        net: the control net.
        angles: its breakpoints along the arc [rad].
        axial: its breakpoints along the axis [m].
        q: unknowns.
    """
    old = net.topology
    new = NetTopology(old.arc.halved(), old.axial.halved())
    finer = [_halved(x) for x in (angles, axial)]
    fine = Net(new, *finer)
    x = net.cartesian(q)  # [component, long, across]
    x = x if old.along_arc else jnp.swapaxes(x, 1, 2)
    by_component = []
    for c, (odd_arc, odd_axial) in enumerate(zip(ODD_ARC, ODD_AXIAL, strict=True)):
        arc = _prolongation(old.arc, new.arc, angles, finer[0], odd_arc)
        along = _prolongation(old.axial, new.axial, axial, finer[1], odd_axial)
        by_component.append(arc @ x[c] @ along.T)
    y = jnp.stack(by_component)
    return fine.local(y if new.along_arc else jnp.swapaxes(y, 1, 2))


def _halved(x: Float[Array, " breakpoint"]) -> Array:
    middle = (x[1:] + x[:-1]) / 2
    woven = jnp.stack([x[:-1], middle], 1).reshape(-1)
    return jnp.concatenate([woven, x[-1:]])


def _prolongation(
    old: SplineAxis, new: SplineAxis, coarse: Array, fine: Array, parity: int
) -> Float[Array, "fine coarse"]:
    """Stations' values on the finer elements from those on the coarser ones."""
    by_coarse = old.matrix(coarse, parity)  # [4, element, station]
    halves = np.array([_SPLIT, _SPLIT[::-1, ::-1]])
    split = jnp.einsum("hab,bes->aehs", halves, by_coarse)
    split = split.reshape(4, 2 * old.elements, -1)
    by_fine = new.matrix(fine, parity)
    rows = 4 * new.elements
    a, b = by_fine.reshape(rows, -1), split.reshape(rows, -1)
    # The finer splines contain the coarser ones: the least squares have no remainder.
    if new.stations == 0:
        return jnp.zeros((0, old.stations))
    factors = jax.scipy.linalg.cho_factor(a.T @ a + _odd_middle(new, parity))
    return jax.scipy.linalg.cho_solve(factors, a.T @ b)


def _odd_middle(axis: SplineAxis, parity: int) -> np.ndarray:
    """Unit entries for stations on mirror planes, which odd components don't have."""
    held = np.zeros(axis.stations)
    if parity < 0:
        held[0] = axis.left == "mirror"
        held[-1] = axis.right == "mirror"
    return np.diag(held)


# Bernstein coefficients on the left half of an element from those on the whole.
_SPLIT = np.array([[8, 0, 0, 0], [4, 4, 0, 0], [2, 4, 2, 0], [1, 3, 3, 1]]) / 8


def _by_component(make: object, parities: tuple[int, int, int]) -> Array:
    made = {p: make(p) for p in set(parities)}  # type: ignore[operator]
    return jnp.stack([made[p] for p in parities])
