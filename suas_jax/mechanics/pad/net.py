"""The control net: from a station vector to element coefficients, and back into bands.

Stations run along one direction of the pad, the *long* one (the direction of elimination);
a station's unknowns are those of the control values *across* it, three each: tangential,
normal and axial in the frame of their column. Element arrays are in Bernstein form,
``[component, 4, 4, element, element]``, long direction first, components Cartesian.
"""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.bspline import SplineAxis, bernstein
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.section import AbstractSection, outward

# Signs of Cartesian components in the crown's mirror, and in a plane across the axis.
ODD_ARC, ODD_AXIAL = (-1, 1, 1), (1, 1, -1)

ElementVector = Float[Array, "width 4 4 long across"]


@dataclasses.dataclass(frozen=True)
class NetTopology:
    """What is static about a control net."""

    arc: SplineAxis  # splines along the arc; mirrored at the crown of half a pad
    # splines along the axis; mirrored at the middle, and where ends may slide
    axial: SplineAxis
    # of the displacement's polynomials through the thickness of a solid; None of a shell
    degree: int | None = None

    @property
    def vectors(self) -> int:
        """Fields of displacement: of a solid from the inner face outwards, of a shell one."""
        return 1 if self.degree is None else self.degree + 1

    @property
    def scalars(self) -> int:
        """Fields of pressure."""
        return self.degree or 0

    @property
    def width(self) -> int:
        """Unknowns of a control value: components of the vectors, then the scalars."""
        return 3 * self.vectors + self.scalars

    @property
    def parities(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Signs of Cartesian components in mirror planes along the stations and across."""
        even = (1,) * self.scalars
        odd = self.ordered(ODD_ARC, ODD_AXIAL)
        return odd[0] * self.vectors + even, odd[1] * self.vectors + even

    @property
    def held(self) -> tuple[bool, ...]:
        """Which components an open end holds at zero; the others have no slope there."""
        return (True,) * 3 * self.vectors + (False,) * self.scalars

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
    ) -> Float[Array, "arc axial width *lane"]:
        """A station vector by its columns along the arc and along the axis."""
        q = q.reshape(self.across.stations, self.width, *q.shape[1:])
        return jnp.moveaxis(q, (2, 0, 1), (0, 1, 2) if self.along_arc else (1, 0, 2))

    def to_stations(
        self, x: Float[Array, "arc axial width *lane"]
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

        Next to a clamp a shell's normal component stays zero, which keeps the normal; on a
        mirror plane the component across it does.
        """
        free = np.ones((self.arc.stations, self.axial.stations, self.width))
        vectors = free[..., : 3 * self.vectors].reshape(*free.shape[:2], self.vectors, 3)
        clamped = [1] if self.degree is None else []
        for end, index in ((self.arc.left, 0), (self.arc.right, -1)):
            vectors[index, ..., clamped if end == "open" else [0]] = 0
        for end, index in ((self.axial.left, 0), (self.axial.right, -1)):
            vectors[:, index, ..., clamped if end == "open" else [2]] = 0
        if self.along_arc:
            return np.moveaxis(free, 0, -1).reshape(-1, self.arc.stations)
        return np.moveaxis(free, 1, -1).reshape(-1, self.axial.stations)


@dataclasses.dataclass(frozen=True)
class Tables:
    """Constants of one element on the unit square."""

    xi: np.ndarray  # Gauss points on the unit interval
    weights: np.ndarray  # their weights there
    # of the Bernstein polynomials by kind of derivative [kind * gauss * gauss, 16]
    values: np.ndarray
    long: np.ndarray  # by order of differentiation [order, gauss, 4]
    # weighed products across by the orders of both [order, order, gauss, 16]
    across: np.ndarray


@functools.cache
def tables(gauss: int, kinds: tuple[tuple[int, int], ...]) -> Tables:
    """Tables for a number of quadrature points.

    `gauss`: points in each direction. `kinds`: orders of differentiation (long, across).
    """
    xi, w = gauss_legendre(gauss)
    shapes = np.stack([np.stack(bernstein(xi, order), 1) for order in range(3)])
    values = np.stack([np.einsum("ga,hb->ghab", shapes[k], shapes[m]) for k, m in kinds])
    across = np.einsum("g,mga,ngb->mngab", w, shapes, shapes).reshape(3, 3, gauss, 16)
    return Tables(xi, w, values.reshape(-1, 16), shapes, across)


class Net(eqx.Module):
    """A control net with its breakpoints: the linear maps between its descriptions.

    They are worked out once for a pad: every other thing asks for them, and each time they
    are traced anew costs time to compile. Made by `Net.of` all arrays end in a lane axis;
    methods are those of one lane's net, without that axis (`Net.lane`).
    """

    angles: Float[Array, "breakpoint *lane"]  # breakpoints along the arc [rad]
    axial: Float[Array, "breakpoint *lane"]  # breakpoints along the axis [m]
    # unit vectors (tangential, normal, axial) of the arc's columns
    frames: Float[Array, "local 3 column *lane"]
    # Bernstein coefficients by Cartesian component from stations'
    # values, along the stations and across
    matrices: tuple[
        Float[Array, "width 4 long row *lane"], Float[Array, "width 4 across column *lane"]
    ]
    along: Float[Array, "4 4 long *lane"]  # extraction matrices of all control values along
    # extraction matrices by component of the stations across
    across: Float[Array, "width 4 4 across *lane"]
    topology: NetTopology = eqx.field(static=True)  # what is static

    @classmethod
    def of(
        cls,
        topology: NetTopology,  # what is static
        section: AbstractSection,  # says which way columns of control values face
        angles: Float[Array, "breakpoint #lane"],
        axial: Float[Array, "breakpoint #lane"],
    ) -> "Net":
        """Work out the maps.

        `angles`: breakpoints along the arc [rad]. `axial`: breakpoints along the axis [m].
        """
        rows = angles, axial, section.direction(topology.arc.abscissae(angles))
        lanes = jnp.broadcast_shapes(*(x.shape[-1:] for x in rows))
        wide = [jnp.broadcast_to(x, (*x.shape[:-1], *lanes)) for x in rows]
        make = functools.partial(cls._of_one_lane, topology)
        if lanes == (1,):
            return jax.tree.map(lambda x: x[..., None], make(*(x[:, 0] for x in wide)))
        return jax.vmap(make, -1, -1)(*wide)

    @classmethod
    def _of_one_lane(
        cls, topology: NetTopology, angles: Array, axial: Array, direction: Array
    ) -> "Net":
        (x, y), zero = outward(direction), jnp.zeros_like(direction)
        rows = [[y, -x, zero], [x, y, zero], [zero, zero, zero + 1]]
        long, across = topology.ordered(angles, axial)
        signs = [[*zip(odd, topology.held, strict=True)] for odd in topology.parities]
        all_along = topology.long.extraction(long, None)
        folded = [
            {sign: axis.folded(extraction, *sign) for sign in {*of}}
            for axis, extraction, of in zip(
                (topology.long, topology.across),
                (all_along, topology.across.extraction(across, None)),
                signs,
                strict=True,
            )
        ]
        matrices = [
            jnp.stack([axis.on_stations(by_sign[sign]) for sign in of])
            for axis, by_sign, of in zip(
                (topology.long, topology.across), folded, signs, strict=True
            )
        ]
        return cls(
            angles=angles,
            axial=axial,
            frames=jnp.stack([jnp.stack(row) for row in rows]),
            matrices=(matrices[0], matrices[1]),
            along=all_along,
            across=jnp.stack([folded[1][sign] for sign in signs[1]]),
            topology=topology,
        )

    def lane(self, index: int) -> "Net":
        """One lane's net."""
        return jax.tree.map(lambda x: x[..., index], self)

    def cartesian(self, q: Float[Array, "dof station"]) -> Float[Array, "width station across"]:
        """Control values in Cartesian components."""
        t = self.topology
        q = q.reshape(t.across.stations, t.width, -1)
        vectors = q[:, : 3 * t.vectors].reshape(len(q), t.vectors, 3, -1)
        way = "kvls,lcs->vcsk" if t.along_arc else "kvls,lck->vcsk"
        x = jnp.einsum(way, vectors, self.frames).reshape(3 * t.vectors, -1, len(q))
        if not t.scalars:
            return x
        return jnp.concatenate([x, jnp.moveaxis(q[:, 3 * t.vectors :], 0, 2)])

    def local(self, x: Float[Array, "width station across"]) -> Float[Array, "dof station"]:
        """Forces on control values in local components, zero where they are held."""
        t = self.topology
        vectors = x[: 3 * t.vectors].reshape(t.vectors, 3, *x.shape[1:])
        way = "vcsk,lcs->kvls" if t.along_arc else "vcsk,lck->kvls"
        q = jnp.einsum(way, vectors, self.frames).reshape(x.shape[2], 3 * t.vectors, -1)
        if t.scalars:
            q = jnp.concatenate([q, jnp.moveaxis(x[3 * t.vectors :], 2, 0)], 1)
        return q.reshape(-1, q.shape[-1]) * t.free

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
