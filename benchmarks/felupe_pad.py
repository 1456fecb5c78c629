"""The pad solved with FElupe as a continuum in three dimensions: the peer of shell and solid.

Taylor-Hood hexahedra (27 nodes, continuous trilinear pressure; exactly incompressible),
follower pressure on the inner face, dead forces even over patches of the undeformed outer
face, and a rigid wall by a stiff penalty. Needs the optional dependencies ``peers``.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence

import felupe as fem
import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import RegularGridInterpolator

from benchmarks.felupe_laws import AbstractRubber
from benchmarks.felupe_newton import OilFilledBody
from benchmarks.felupe_wall import Wall

_COARSENING = 0.25  # growth of the elements' size with the distance from what they resolve
_SAMPLES = 24  # points a direction at which a patch's force acts in an element
_ALONG = 20001  # points at which the arc of the outer face is measured
_STIFF = 200.0  # of the wall, in shear moduli per thickness


@dataclasses.dataclass(frozen=True)
class Membrane:
    """A pad whose inner face is x = a sin t, y = b cos t; SI units and radians."""

    semi_axes: tuple[float, float]  # a and b; a circle's are equal
    thickness: float  # along the normal of the inner face
    half_angle: float  # t at a clamp
    length: float  # between the clamped ends
    law: AbstractRubber  # of the material
    gap: float | None = None  # to the wall of a circle; None for no wall

    def inner(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and outward normal of the inner face in its plane [2, *t.shape]."""
        a, b = self.semi_axes
        normal = np.stack([b * np.sin(t), a * np.cos(t)])
        return np.stack([a * np.sin(t), b * np.cos(t)]), normal / np.hypot(*normal)

    def outer_arc(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters, and the arc length of the outer face from the crown there."""
        t = np.linspace(-self.half_angle, self.half_angle, _ALONG)
        place, normal = self.inner(t)
        steps = np.hypot(*np.diff(place + self.thickness * normal, axis=1))
        arc = np.concatenate([[0], np.cumsum(steps)])
        return t, arc - arc[-1] / 2


@dataclasses.dataclass(frozen=True)
class Patch:
    """A dead force, even over a part of the outer face."""

    angle: float = 0.0  # t of its centre
    axial: float = 0.0  # of its centre, from the middle
    # along the arc and along the axis; of a disc its diameter, twice
    size: tuple[float, float] = (6e-3, 6e-3)
    disc: bool = False  # whether it is round
    force: float = 1.0  # inward; negative pulls
    # of the force from the inward normal, counter-clockwise in the section's plane
    turn: float = 0.0
    tilt: float = 0.0  # of the force towards the axis

    def covers(self, arc: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Whether the patch covers points at these distances from its centre [m]."""
        if self.disc:
            return np.asarray(np.hypot(arc, along) <= self.size[0] / 2)
        return np.asarray((abs(arc) <= self.size[0] / 2) & (abs(along) <= self.size[1] / 2))

    def direction(self, normal: np.ndarray) -> np.ndarray:
        """Of a positive force, as nodes have it: x, axis, y."""
        angle = math.atan2(normal[0], normal[1]) - self.turn
        plane = math.cos(self.tilt)
        return -np.array(
            [plane * math.sin(angle), -math.sin(self.tilt), plane * math.cos(angle)]
        )


def graded(
    ends: tuple[float, float],  # of the interval [m]
    # their ends; they become nodes where they lie inside
    patches: Sequence[tuple[float, float]],
    fine: float,  # size of the elements there [m]
    coarse: float,  # largest size [m]
    edge: float,  # size at clamps [m]
) -> np.ndarray:
    """Nodes between elements: of size `fine` over patches, larger away from them."""
    inside = {x for patch in patches for x in patch if ends[0] < x < ends[1]}
    knots = [ends[0], *sorted(inside), ends[1]]
    nodes = [np.array([ends[0]])]
    for a, b in itertools.pairwise(knots):
        x = np.linspace(a, b, 2001)
        size = np.full_like(x, coarse)
        for first, last in patches:
            away = np.maximum(np.maximum(first - x, x - last), 0)
            size = np.minimum(size, fine + _COARSENING * away)
        end = np.minimum(x - ends[0], ends[1] - x)
        size = np.minimum(size, edge + _COARSENING * end)
        count = np.concatenate([[0], np.cumsum((1 / size[1:] + 1 / size[:-1]) / 2)])
        count *= x[1] - x[0]
        steps = max(round(count[-1]), 1)
        nodes.append(np.interp(np.linspace(0, count[-1], steps + 1)[1:], count, x))
    return np.concatenate(nodes)


class FelupePad:
    """The discretised pad."""

    def __init__(
        self,
        membrane: Membrane,  # what is solved
        patches: Sequence[Patch],  # what presses
        fine: float,  # size of the elements over the patches [m]
        # size of those far from them, along the arc and along the axis [m]
        coarse: tuple[float, float],
        across: int = 1,  # elements through the thickness
        *,
        # whether the arc's half and the axis' half are left out, of which the loads are their
        # own mirror image
        symmetric: tuple[bool, bool] = (False, False),
        solver: str = "pardiso",  # ``"pardiso"`` or ``"superlu"``
        # of the oil, volume over bulk modulus [m^3/Pa]; None for vented oil
        compliance: float | None = 0.0,
        # size of the elements at clamps [m]; by default half of the coarse ones
        edge: float | None = None,
    ) -> None:
        self.membrane, self.patches, self.symmetric = membrane, patches, symmetric
        self.t, self.arc_at = membrane.outer_arc()
        half = (self.arc_at[-1], membrane.length / 2)
        centres = [(self._arc_of(x.angle), x.axial) for x in patches]
        axes = []
        for k, (h, s) in enumerate(zip(half, symmetric, strict=True)):
            ends = [
                (c[k] - x.size[k] / 2, c[k] + x.size[k] / 2)
                for c, x in zip(centres, patches, strict=True)
            ]
            axes.append(graded((-h * (not s), h), ends, fine, coarse[k], edge or coarse[0] / 2))
        self.arcs, self.along = axes
        grid = self._positions(across)
        self.number = np.arange(grid[..., 0].size).reshape(grid.shape[:-1])
        counts = (len(self.arcs) - 1, len(self.along) - 1, across)
        mesh = fem.Mesh(grid.reshape(-1, 3), _cells(self.number, counts, 2), "hexahedron27")
        corners = np.arange(np.prod(np.add(counts, 1))).reshape(np.add(counts, 1))
        corner_points = grid[::2, ::2, ::2].reshape(-1, 3)
        corner_mesh = fem.Mesh(corner_points, _cells(corners, counts, 1), "hexahedron")
        region = fem.RegionTriQuadraticHexahedron(mesh)
        pressures = fem.RegionHexahedron(corner_mesh, quadrature=region.quadrature, grad=False)
        field = fem.FieldContainer([fem.Field(region, dim=3), fem.Field(pressures, dim=1)])
        inner = np.zeros(len(mesh.points), bool)
        inner[self.number[:, :, 0]] = True
        face_region = fem.RegionTriQuadraticHexahedronBoundary(
            mesh, only_surface=True, mask=inner
        )
        face = fem.FieldContainer([fem.Field(face_region, dim=3)])
        held = np.zeros(mesh.points.shape, bool)
        held[self.number[-1].ravel()] = held[self.number[:, -1].ravel()] = True
        for axis, plane in enumerate((self.number[0], self.number[:, 0])):
            held[plane.ravel(), axis if symmetric[axis] else slice(None)] = True
        far = 10 * membrane.semi_axes[0]
        self.share = 0.5 ** sum(symmetric)
        if compliance is not None:
            compliance *= self.share
        wall = None
        if membrane.gap is not None:
            stiffness = _STIFF * membrane.law.shear_modulus / membrane.thickness
            wall = Wall(face_region, membrane.semi_axes[0] - membrane.gap, stiffness)
        self.system = OilFilledBody(
            field, membrane.law, face, held, far, solver, compliance=compliance, wall=wall
        )
        self.points = np.asarray(mesh.points)
        self.load = self._even_forces()

    def inner_face(self) -> tuple[np.ndarray, np.ndarray]:
        """Reference positions and displacements of the inner face [arc, axis, 3]."""
        number = self.number[:, :, 0]
        return self.points[number], self.system.displacement[number]

    def under(self, patch: Patch, layer: int) -> float:
        """Displacement along a patch's force beneath its centre, of a layer of nodes [m]."""
        moved = self.system.displacement[self.number[:, :, layer]]
        place = self._arc_of(patch.angle), patch.axial
        value = np.zeros(3)
        found = [
            _quadratic(x, at) for x, at in zip((self.arcs, self.along), place, strict=True)
        ]
        (i, u), (j, v) = found
        value = np.einsum("a,b,abc->c", u, v, moved[i : i + 3, j : j + 3])
        return float(value @ self._direction(patch))

    def wall_force(self) -> float:
        """Sum of the wall's forces on the whole pad [N]."""
        wall = self.system.wall
        return 0.0 if wall is None else wall.force(self.system.displacement) / self.share

    def take(self, other: "FelupePad") -> None:
        """Start from the state of another mesh of the same pad."""
        ours, theirs = self._coordinates(), other._coordinates()
        for k in (0, 1):
            step = slice(None, None, k + 1)
            grids = [tuple(x[step] for x in axes) for axes in (theirs, ours)]
            values = other.system.field[k].values
            shape = [len(x) for x in grids[0]]
            rule = RegularGridInterpolator(grids[0], values.reshape(*shape, -1))
            points = np.stack(np.meshgrid(*grids[1], indexing="ij"), -1)
            new = self.system.field[k].values
            new[:] = rule(points).reshape(new.shape)
        self.system.oil = other.system.oil

    def _coordinates(self) -> tuple[np.ndarray, ...]:
        """Places of the nodes along arc, axis and thickness."""
        depth = np.linspace(0, 1, self.number.shape[2])
        return _with_middles(self.arcs), _with_middles(self.along), depth

    def _arc_of(self, angle: float) -> float:
        return float(np.interp(angle, self.t, self.arc_at))

    def _direction(self, patch: Patch) -> np.ndarray:
        return patch.direction(self.membrane.inner(np.array(patch.angle))[1])

    def _positions(self, across: int) -> np.ndarray:
        """Nodes: arc, axis and radius are right-handed in this order [arc, axis, depth, 3]."""
        t = np.interp(_with_middles(self.arcs), self.arc_at, self.t)
        place, normal = self.membrane.inner(t)
        z = _with_middles(self.along)
        depth = np.linspace(0, self.membrane.thickness, 2 * across + 1)
        plane = place[..., None] + normal[..., None] * depth
        shape = (len(t), len(z), len(depth))
        x, y = (np.broadcast_to(v[:, None], shape) for v in plane)
        return np.stack([x, np.broadcast_to(z[:, None], shape), y], -1)

    def _even_forces(self) -> np.ndarray:
        """Nodal forces of all patches [node, 3]."""
        load = np.zeros_like(self.points)
        nodes, weights = leggauss(_SAMPLES)
        shapes = np.stack([nodes * (nodes - 1) / 2, 1 - nodes**2, nodes * (nodes + 1) / 2])
        for patch in self.patches:
            share = np.zeros(self.number.shape[:2])
            for i in range(len(self.arcs) - 1):
                arc, of_arc = _scaled(self.arcs[i : i + 2], nodes, weights)
                for j in range(len(self.along) - 1):
                    along, of_axis = _scaled(self.along[j : j + 2], nodes, weights)
                    covered = patch.covers(
                        arc[:, None] - self._arc_of(patch.angle), along[None] - patch.axial
                    )
                    part = of_arc[:, None] * of_axis * covered
                    share[2 * i : 2 * i + 3, 2 * j : 2 * j + 3] += shapes @ part @ shapes.T
            share *= patch.force * self._modelled(patch) / share.sum()
            load[self.number[:, :, -1].ravel()] += share.reshape(-1, 1) * self._direction(patch)
        return load

    def _modelled(self, patch: Patch) -> float:
        """Part of a patch that is not left out: those on a plane of symmetry lose a half."""
        on = (patch.angle == 0, patch.axial == 0)
        return math.prod(0.5 for s, o in zip(self.symmetric, on, strict=True) if s and o)


def _quadratic(ends: np.ndarray, at: float) -> tuple[int, np.ndarray]:
    """First node of the element at a place, and the values of its three shapes there."""
    k = int(np.clip(np.searchsorted(ends, at) - 1, 0, len(ends) - 2))
    x = 2 * (at - ends[k]) / (ends[k + 1] - ends[k]) - 1
    return 2 * k, np.array([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2])


def _scaled(
    ends: np.ndarray, nodes: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    half = (ends[1] - ends[0]) / 2
    return ends[0] + half * (nodes + 1), half * weights


def _with_middles(x: np.ndarray) -> np.ndarray:
    return np.sort(np.concatenate([x, (x[1:] + x[:-1]) / 2]))


def _cells(number: np.ndarray, counts: tuple[int, ...], stride: int) -> np.ndarray:
    """Nodes of each element, in FElupe's order [element, node]."""
    element = fem.TriQuadraticHexahedron() if stride == 2 else fem.Hexahedron()
    offsets = np.rint((np.asarray(element.points) + 1) * stride / 2).astype(int)
    columns = [
        number[tuple(slice(o, o + stride * n, stride) for o, n in zip(at, counts, strict=True))]
        for at in offsets
    ]
    return np.stack([c.ravel() for c in columns], 1)
