"""The pad solved with FElupe as a continuum in three dimensions: the peer of the pad's shell.

Taylor-Hood hexahedra (27 nodes, continuous trilinear pressure; exactly incompressible),
follower pressure on the inner face, a dead force even over a patch of the undeformed outer
face. Needs the optional dependencies ``peers``.
"""

import dataclasses
import itertools
from typing import Any

import felupe as fem
import numpy as np
from numpy.polynomial.legendre import leggauss

from benchmarks.felupe_newton import OilFilledBody

_COARSENING = 0.25  # growth of the elements' size with the distance from what they resolve
_BULK = 10.0  # moduli against an element's own changes of volume, over the shear modulus
_SAMPLES = 24  # points a direction at which the patch's force acts in an element


@dataclasses.dataclass(frozen=True)
class Poke:
    """One patch on a pad of a Mooney-Rivlin material; SI units and radians.

    Attributes:
        inner_radius: of the membrane.
        thickness: of the membrane.
        half_angle: from the crown to a clamp.
        length: between the clamped ends.
        C1: first constant.
        C2: second constant.
        C3: third constant.
        angle: of the patch's centre.
        axial: of the patch's centre, from the middle.
        size: of the patch along the arc and along the axis, on the outer face; for a disc its
            diameter, twice.
        disc: whether the patch is round.
    """

    inner_radius: float
    thickness: float
    half_angle: float
    length: float
    C1: float
    C2: float
    C3: float
    angle: float = 0.0
    axial: float = 0.0
    size: tuple[float, float] = (6e-3, 6e-3)
    disc: bool = False

    def covers(self, arc: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Whether the patch covers points at these distances from its centre [m]."""
        if self.disc:
            return np.asarray(np.hypot(arc, along) <= self.size[0] / 2)
        return np.asarray((abs(arc) <= self.size[0] / 2) & (abs(along) <= self.size[1] / 2))


class _Material:
    """Psi = C1 (I1 - 3) + C2 (I2 - 3) + C3 (I2 - 3)^2 + p (J - 1) + U(J).

    U = K (J - 1)^2 / 2 - (2 C1 + 4 C2)(J - 1) changes nothing where J = 1. Elements hold that
    in the mean only, and without U their own changes of volume would have negative energy.
    """

    def __init__(self, poke: Poke) -> None:
        self.poke = poke
        self.bulk = _BULK * 2 * (poke.C1 + poke.C2)
        self.x = [np.zeros((3, 3)), np.zeros(1), np.zeros(0)]

    def gradient(self, x: list[Any]) -> list[Any]:
        F, p = x[0], x[1]
        C = fem.math.dot(fem.math.transpose(F), F)
        slope, second = self._second_invariant(F, C)
        J = fem.math.det(F)
        cofactor = J * fem.math.transpose(fem.math.inv(F, determinant=J))
        total = p + self._pressure(J)
        return [2 * self.poke.C1 * F + slope * second + total * cofactor, J[None] - 1, None]

    def hessian(self, x: list[Any]) -> list[Any]:
        F, p = x[0], x[1]
        C = fem.math.dot(fem.math.transpose(F), F)
        slope, second = self._second_invariant(F, C)
        unit = np.eye(3)[..., None, None]
        identity = np.einsum("ikqe,jlqe->ijklqe", unit, unit)
        turned = np.einsum("ilqe,kjqe->ijklqe", F, F)
        left = np.einsum("ikqe,ljqe->ijklqe", unit, C)
        B = fem.math.dot(F, fem.math.transpose(F))
        right = np.einsum("ikqe,jlqe->ijklqe", B, unit)
        tangent = (2 * self.poke.C1 + 2 * slope * _trace(C)) * identity
        tangent += 4 * slope * fem.math.dya(F, F) - 2 * slope * (left + turned + right)
        tangent += 2 * self.poke.C3 * fem.math.dya(second, second)
        J = fem.math.det(F)
        inverse = fem.math.transpose(fem.math.inv(F, determinant=J))
        both = fem.math.dya(inverse, inverse) - np.einsum("ilqe,kjqe->ijklqe", inverse, inverse)
        tangent += (p + self._pressure(J)) * J * both
        tangent += self.bulk * J**2 * fem.math.dya(inverse, inverse)
        return [tangent, J * inverse, None]

    def _pressure(self, J: np.ndarray) -> np.ndarray:
        """dU/dJ."""
        return self.bulk * (J - 1) - (2 * self.poke.C1 + 4 * self.poke.C2)

    def _second_invariant(self, F: np.ndarray, C: np.ndarray) -> tuple[Any, np.ndarray]:
        """dPsi/dI2 and dI2/dF."""
        first = _trace(C)
        I2 = (first**2 - fem.math.ddot(C, C)) / 2
        slope = self.poke.C2 + 2 * self.poke.C3 * (I2 - 3)
        return slope, 2 * (first * F - fem.math.dot(F, C))


def _trace(C: np.ndarray) -> np.ndarray:
    return np.asarray(C[0, 0] + C[1, 1] + C[2, 2])


def graded(
    ends: tuple[float, float], patch: tuple[float, float], fine: float, coarse: float
) -> np.ndarray:
    """Nodes between elements: of size `fine` over the patch, larger away from it.

    Args:
        ends: of the interval [m].
        patch: its ends; they become nodes where they lie inside.
        fine: size of the elements there [m].
        coarse: largest size [m]; elements at clamps have half of it.
    """
    inside = [x for x in patch if ends[0] < x < ends[1]]
    knots = [ends[0], *inside, ends[1]]
    nodes = [np.array([ends[0]])]
    for a, b in itertools.pairwise(knots):
        x = np.linspace(a, b, 2001)
        away = np.maximum(np.maximum(patch[0] - x, x - patch[1]), 0)
        end = np.minimum(x - ends[0], ends[1] - x)
        size = np.minimum(fine + _COARSENING * away, coarse)
        size = np.minimum(size, coarse / 2 + _COARSENING * end)
        count = np.concatenate([[0], np.cumsum((1 / size[1:] + 1 / size[:-1]) / 2)])
        count *= x[1] - x[0]
        steps = max(round(count[-1]), 1)
        nodes.append(np.interp(np.linspace(0, count[-1], steps + 1)[1:], count, x))
    return np.concatenate(nodes)


class FelupePad:
    """The discretised pad.

    Args:
        poke: what to solve.
        fine: size of the elements over the patch [m].
        coarse: size of those far from it [m].
        across: elements through the thickness.
        symmetric: whether the arc's half and the axis' half are left out; the patch lies at
            the crown, in the middle.
        solver: ``"pardiso"`` or ``"superlu"``.
    """

    def __init__(
        self,
        poke: Poke,
        fine: float,
        coarse: float,
        across: int = 1,
        *,
        symmetric: tuple[bool, bool] = (False, False),
        solver: str = "pardiso",
    ) -> None:
        self.poke, self.symmetric = poke, symmetric
        outer = poke.inner_radius + poke.thickness
        half = (outer * poke.half_angle, poke.length / 2)
        axes = [
            graded((-h * (not s), h), (c - d / 2, c + d / 2), fine, coarse)
            for h, s, c, d in zip(
                half, symmetric, (outer * poke.angle, poke.axial), poke.size, strict=True
            )
        ]
        self.arcs, self.along = axes
        nodes = [_with_middles(x) for x in (axes[0] / outer, axes[1])]
        radii = poke.inner_radius + np.linspace(0, poke.thickness, 2 * across + 1)
        phi, z, r = np.meshgrid(*nodes, radii, indexing="ij")
        # Angle, axis and radius are right-handed in this order.
        grid = np.stack([r * np.sin(phi), z, r * np.cos(phi)], -1)
        self.number = np.arange(phi.size).reshape(phi.shape)
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
        far = 10 * poke.inner_radius
        self.system = OilFilledBody(field, _Material(poke), face, held, far, solver)
        self.points = np.asarray(mesh.points)
        self.load = self._even_force()

    def inner_face(self) -> tuple[np.ndarray, np.ndarray]:
        """Reference positions and displacements of the inner face [arc, axis, 3]."""
        number = self.number[:, :, 0]
        return self.points[number], self.system.displacement[number]

    def _even_force(self) -> np.ndarray:
        """Nodal forces of one newton inward, even over the patch [node, 3]."""
        poke = self.poke
        outer = poke.inner_radius + poke.thickness
        nodes, weights = leggauss(_SAMPLES)
        shapes = np.stack([nodes * (nodes - 1) / 2, 1 - nodes**2, nodes * (nodes + 1) / 2])
        share = np.zeros(self.number.shape[:2])
        for i in range(len(self.arcs) - 1):
            arc, of_arc = _scaled(self.arcs[i : i + 2], nodes, weights)
            for j in range(len(self.along) - 1):
                along, of_axis = _scaled(self.along[j : j + 2], nodes, weights)
                covered = poke.covers(
                    arc[:, None] - outer * poke.angle, along[None] - poke.axial
                )
                part = of_arc[:, None] * of_axis * covered
                share[2 * i : 2 * i + 3, 2 * j : 2 * j + 3] += shapes @ part @ shapes.T
        share /= share.sum() * 2.0 ** sum(self.symmetric)
        load = np.zeros_like(self.points)
        inward = -np.array([np.sin(poke.angle), 0.0, np.cos(poke.angle)])
        load[self.number[:, :, -1].ravel()] = share.reshape(-1, 1) * inward
        return load


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
