"""The whole pad as a thin shell: a half-cylinder clamped along its edges, in three dimensions.

Kirchhoff-Love, incompressible (Kiendl et al. 2015), cubic B-splines in both directions. The
displacement is interpolated over the exact cylinder, so the undeformed state is free of
stress to the last digit.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.base import AbstractMechanics, Assembly, Displacements, Profile
from suas_jax.mechanics.pad import loads as pad_loads
from suas_jax.mechanics.pad.net import ElementVector, Net, NetTopology, tables
from suas_jax.mechanics.pad.points import (
    KINDS,
    PAIRS,
    Layers,
    Surface,
    energy_density,
    layers,
    resultants,
    stress,
    surface,
    swept,
    tangent,
)
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.block_banded import BlockBanded
from suas_jax.skin.pad_loads import PadLoadPoints


class Pad(AbstractMechanics):
    """Discretised pad, or the half or quarter of a symmetric one.

    The unknowns of a station are the displacements of the control values across it, in the
    tangential, normal and axial directions of their column.

    Attributes:
        law: the membrane's material.
        mid_radius: radius of the undeformed mid-surface [m].
        thickness: [m].
        angles: breakpoints along the arc, from the symmetry axis [rad].
        axial: breakpoints along the axis, from the middle [m].
        points: the loads as points on the outer face [N].
        film_volume: volume of the undeformed oil film under the part covered [m^3].
        topology: how the splines end.
        gauss: quadrature points along either side of an element.
        layers: quadrature points through the thickness.
    """

    law: AbstractLaw
    mid_radius: Lanes
    thickness: Lanes
    angles: Float[Array, "breakpoint #lane"]
    axial: Float[Array, "breakpoint #lane"]
    points: PadLoadPoints
    film_volume: Lanes
    topology: NetTopology = eqx.field(static=True)
    gauss: int = eqx.field(static=True, default=3)
    layers: int = eqx.field(static=True, default=3)

    @property
    def lanes(self) -> int:
        """Number of lanes of the inputs."""
        return max(x.shape[-1] for x in jax.tree.leaves(self))

    @property
    def length_scale(self) -> Lanes:
        """The thickness [m]."""
        return self.thickness

    @property
    def clamp_reach(self) -> Lanes:
        """Zero: the shell's stretches are bounded [rad]."""
        return jnp.zeros_like(self.thickness)

    def rest(self) -> StationVector:
        """Zero displacement."""
        return jnp.zeros((*self.topology.free.shape, self.lanes), self.angles.dtype)

    def unknowns(self) -> int:
        """Free control displacements."""
        return int(self.topology.free.sum())

    def displacement_size(self, q: StationVector) -> Lanes:
        """Largest component of a control value's displacement [m]."""
        return jnp.max(jnp.abs(q), (0, 1))

    def _by_lane(self, function: Callable[..., Any], *arguments: Array) -> Any:
        """Call a function of one lane's pad and arguments, lane after lane."""
        lanes = max(self.lanes, *(x.shape[-1] for x in arguments))
        arrays, static = eqx.partition((self, arguments), eqx.is_array)

        def one(arrays: Any) -> Any:
            pad, rest = eqx.combine(arrays, static)
            return function(pad, *(x[..., 0] for x in rest))

        if lanes == 1:
            return jax.tree.map(lambda x: x[..., None], one(arrays))

        def chosen(lane: Array) -> Any:
            def pick(x: Array) -> Array:
                index = lane if x.shape[-1] > 1 else 0
                return jax.lax.dynamic_slice_in_dim(x, index, 1, -1)

            return one(jax.tree.map(pick, arrays))

        found = jax.lax.map(chosen, jnp.arange(lanes))
        return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), found)

    def strain_energy(self, q: StationVector) -> Lanes:
        """Strain energy [J]."""
        return self._by_lane(lambda pad, q: _One(pad).strain_energy(q), q)

    def volume_change(self, q: StationVector) -> Lanes:
        """Enclosed volume less its value at rest [m^3]."""
        return self._by_lane(lambda pad, q: _One(pad).volume_change(q), q)

    def work(self, q: StationVector) -> Lanes:
        """Work of the loads, which act at the rigid-normal point r + (t/2) n [J]."""
        return self._by_lane(lambda pad, q: _One(pad).work(q), q)

    def assemble(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Assembly:
        """Residual, tangent and border at a trial state; see the base class."""
        residual, bands, gradient, load, volume = self._by_lane(
            lambda pad, *given: _One(pad).assemble(*given), q, pressure, factor
        )
        operator = BlockBanded(jnp.moveaxis(bands, -1, 0), self.topology.free_by_station)
        return Assembly(residual, operator, gradient, load, volume)

    def profile(self, q: StationVector, samples: int) -> Profile:
        raise NotImplementedError

    def at_angle(self, q: StationVector, angle: Lanes) -> Displacements:
        raise NotImplementedError

    def mirrored(self, q: StationVector) -> StationVector:
        raise NotImplementedError

    def to_comparison_mesh(self, q: StationVector) -> StationVector:
        raise NotImplementedError

    @property
    def error_share(self) -> float:
        return 1.0

    def displacement(
        self, q: StationVector, angle: Float[Array, "point #lane"], axial: Array
    ) -> Float[Array, "3 point lane"]:
        """Displacement of the mid-surface at places [m].

        Args:
            q: unknowns.
            angle: reference angles [rad].
            axial: reference positions along the axis [m].
        """
        return self._by_lane(lambda pad, *given: _One(pad).displacement(*given), q, angle, axial)


class _One:
    """One lane of a pad; arrays without lanes, inputs with a lane axis of length one."""

    def __init__(self, pad: Pad) -> None:
        self.pad = pad
        self.topology = pad.topology
        self.net = Net(pad.topology, pad.angles[:, 0], pad.axial[:, 0])
        order = pad.topology.ordered
        self.kinds = tuple(order(*kind) for kind in KINDS)
        self.tables = tables(pad.gauss, self.kinds, PAIRS)
        arc = pad.mid_radius * (pad.angles[1:, 0] - pad.angles[:-1, 0])
        axial = pad.axial[1:, 0] - pad.axial[:-1, 0]
        long, across = order(arc, axial)
        self.lengths = long[:, None], across[None]
        self.elements = (len(long), len(across))
        self.fibres: Layers = layers(pad.layers, pad.thickness, pad.mid_radius)

    @property
    def powers(self) -> list[Array]:
        """What turns a derivative by local coordinates into one by length, for each kind."""
        long, across = self.lengths
        return [1 / (long**m * across**n) for m, n in self.kinds]

    @property
    def angle(self) -> Array:
        """Reference angle of the points, ready to broadcast [rad]."""
        start, end = self.pad.angles[:-1, 0], self.pad.angles[1:, 0]
        inside = start + jnp.asarray(self.tables.xi)[:, None] * (end - start)
        if self.topology.along_arc:
            return inside[:, None, :, None]
        return inside[None, :, None, :]

    @property
    def areas(self) -> Array:
        """Weights of the points in integrals over the undeformed mid-surface [m^2]."""
        long, across = self.lengths
        return self.tables.weights[:, :, None, None] * (long * across)

    def surface(self, qe: ElementVector) -> Surface:
        """The mid-surface at the quadrature points."""
        g = self.pad.gauss
        values = jnp.asarray(self.tables.values) @ _leading(qe, 16)
        values = values.reshape(len(KINDS), g, g, 3, *self.elements)
        derivatives = [
            jnp.moveaxis(x, 2, 0) * p for x, p in zip(values, self.powers, strict=True)
        ]
        return surface(derivatives, self.angle, self.pad.mid_radius)

    def strain_energy(self, q: Array) -> Array:
        s = self.surface(self.net.gather(q))
        density = energy_density(self.pad.law, s, self.fibres, self.pad.mid_radius)
        return jnp.sum(self.areas * density)

    def volume_change(self, q: Array) -> Array:
        s = self.surface(self.net.gather(q))
        return jnp.sum(self.areas * swept(s, self.pad.mid_radius)[0])

    def _points(self) -> tuple[PadLoadPoints, pad_loads.Spots]:
        pad = self.pad
        points = jax.tree.map(lambda x: x[..., 0], pad.points)
        at = (points.angle, points.axial)
        spots = pad_loads.spots(
            self.net, pad.angles[:, 0], pad.axial[:, 0], pad.mid_radius, at
        )
        return points, spots

    def work(self, q: Array) -> Array:
        points, spots = self._points()
        moved = pad_loads.interpolated(spots, self.net.gather(q))
        return pad_loads.load_work(points, spots, moved, self.pad.thickness)

    def displacement(self, q: Array, angle: Array, axial: Array) -> Array:
        pad = self.pad
        at = (angle, axial)
        spots = pad_loads.spots(
            self.net, pad.angles[:, 0], pad.axial[:, 0], pad.mid_radius, at
        )
        return pad_loads.interpolated(spots, self.net.gather(q))[0]

    def assemble(self, q: Array, pressure: Array, factor: Array) -> tuple[Array, ...]:
        pad, radius = self.pad, self.pad.mid_radius
        qe = self.net.gather(q)
        s = self.surface(qe)
        found = resultants(pad.law, s, self.fibres, radius)
        forces = stress(s, found.first)
        more, pulls = swept(s, radius)
        areas = self.areas
        internal = self._forces(dict(zip(range(1, 6), forces, strict=True)))
        gradient = self._forces(dict(zip(range(3), pulls, strict=True)))
        points, spots = self._points()
        moved = pad_loads.interpolated(spots, qe)
        vectors, matrices = pad_loads.load_terms(points, spots, moved, pad.thickness)
        load = pad_loads.add_vectors(jnp.zeros_like(qe), spots, vectors)
        blocks = tangent(s, found, pressure, radius)
        powers = jnp.stack([self.powers[k] * self.powers[m] for k, m in PAIRS])
        scale = (powers * (self.lengths[0] * self.lengths[1]))[:, None, None, None, None]
        g = pad.gauss
        blocks = jnp.transpose(blocks * scale, (0, 3, 4, 1, 2, 5, 6))
        half = jnp.asarray(self.tables.products) @ blocks.reshape(len(PAIRS) * g**2, -1)
        half = half.reshape(256, 9, -1)
        half = pad_loads.add_matrices(half, spots, -factor * matrices, self.elements)
        bands = self.net.bands(half.reshape(4, 4, 4, 4, 3, 3, *self.elements))
        scattered = [self.net.scatter(f) for f in (internal, gradient, load)]
        residual = scattered[0] - pressure * scattered[1] - factor * scattered[2]
        return residual, bands, scattered[1], scattered[2], jnp.sum(areas * more)

    def _forces(self, by_kind: dict[int, Array]) -> ElementVector:
        """Element vectors from derivatives of a density by the kinds of derivative."""
        g = self.pad.gauss
        rows = jnp.stack([f * self.areas * self.powers[k] for k, f in by_kind.items()])
        rows = jnp.moveaxis(rows, 1, 3).reshape(len(by_kind) * g**2, -1)
        values = self.tables.values.reshape(len(KINDS), g**2, 16)[list(by_kind)]
        flat = jnp.asarray(values.reshape(-1, 16).T) @ rows
        return jnp.moveaxis(flat.reshape(4, 4, 3, *self.elements), 2, 0)


def _leading(qe: ElementVector, count: int) -> Float[Array, "16 rest"]:
    """Element coefficients as columns of a matrix."""
    return jnp.moveaxis(qe.reshape(3, count, -1), 0, 1).reshape(count, -1)

