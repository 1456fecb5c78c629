"""The control net: from a station vector to element coefficients, and back into bands.

Stations run along one direction of the pad, the *long* one (the direction of elimination);
a station's unknowns are those of the control values *across* it, three each: tangential,
normal and axial in the frame of their column. Element arrays are in Bernstein form,
``[component, 4, 4, element, element]``, long direction first, components Cartesian.
"""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.bspline import SplineAxis, bernstein
from suas_jax.numerics.quadrature import gauss_legendre

# Signs of Cartesian components in the crown's mirror, and in a plane across the axis.
ODD_ARC, ODD_AXIAL = (-1, 1, 1), (1, 1, -1)

ElementVector = Float[Array, "3 4 4 long across"]


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
        weights: their weights there.
        values: of the Bernstein polynomials by kind of derivative [kind * gauss * gauss, 16].
        long: by order of differentiation [order, gauss, 4].
        across: weighed products by pair of kinds [pair, gauss, 16].
    """

    xi: np.ndarray
    weights: np.ndarray
    values: np.ndarray
    long: np.ndarray
    across: np.ndarray


@functools.cache
def tables(
    gauss: int, kinds: tuple[tuple[int, int], ...], pairs: tuple[tuple[int, int], ...]
) -> Tables:
    """Tables for a number of quadrature points.

    Args:
        gauss: points in each direction.
        kinds: orders of differentiation (long, across).
        pairs: pairs of kinds, row and column.
    """
    xi, w = gauss_legendre(gauss)
    shapes = np.stack([np.stack(bernstein(xi, order), 1) for order in range(3)])
    values = np.stack([np.einsum("ga,hb->ghab", shapes[k], shapes[m]) for k, m in kinds])
    orders = np.array([m for _, m in kinds])
    rows, columns = (shapes[orders[[pair[side] for pair in pairs]]] for side in (0, 1))
    across = np.einsum("g,pga,pgb->pgab", w, rows, columns).reshape(len(pairs), gauss, 16)
    return Tables(xi, w, values.reshape(-1, 16), shapes, across)


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
        at = topology.arc.abscissae(angles)
        sine, cosine, zero = jnp.sin(at), jnp.cos(at), jnp.zeros_like(at)
        one = zero + 1
        self.frames = jnp.stack(
            [
                jnp.stack([cosine, -sine, zero]),
                jnp.stack([sine, cosine, zero]),
                jnp.stack([zero, zero, one]),
            ]
        )  # [local, Cartesian, column]
        self.long, self.across = topology.ordered(angles, axial)
        parities = topology.ordered(ODD_ARC, ODD_AXIAL)
        self.matrices = tuple(
            _by_component(functools.partial(a.matrix, x), odd)
            for a, x, odd in zip(
                (topology.long, topology.across),
                (self.long, self.across),
                parities,
                strict=True,
            )
        )
        self.parities = parities

    def extraction(self) -> tuple[Float[Array, "4 4 long"], Float[Array, "3 4 4 across"]]:
        """Extraction matrices: of all control values along, by component of stations across."""
        topology = self.topology
        along = topology.long.extraction(self.long, None)
        across = _by_component(
            lambda p: topology.across.extraction(self.across, p), self.parities[1]
        )
        return along, across

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
            "caes,csk,cbfk->cabef", self.matrices[0], self.cartesian(q), self.matrices[1]
        )

    def scatter(self, f: ElementVector) -> Float[Array, "dof station"]:
        """Sum forces on Bernstein coefficients: the transpose of `gather`, masked."""
        return self.local(
            jnp.einsum("caes,cabef,cbfk->csk", self.matrices[0], f, self.matrices[1])
        )


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


def _by_component(make: Callable[[int], Array], parities: tuple[int, int, int]) -> Array:
    made = {p: make(p) for p in set(parities)}
    return jnp.stack([made[p] for p in parities])
