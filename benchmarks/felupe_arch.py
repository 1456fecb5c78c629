"""The skin solved with FElupe, as a user of that library would: the peer of the benchmarks.

Taylor-Hood elements (biquadratic displacement, bilinear pressure; plane strain, exactly
incompressible), follower pressure on the inner face, dead force on the outer one. FElupe
assembles; Newton's method on the system bordered by the oil's volume is written out here,
two right-hand sides a step, with PARDISO (pypardiso) or SciPy's SuperLU, FElupe's default.
Needs the optional dependencies ``peers``.
"""

import dataclasses
from typing import Any

import felupe as fem
import numpy as np
from scipy.sparse.linalg import spsolve

_TOLERANCE = 1e-9  # of a correction, relative to the displacement


@dataclasses.dataclass(frozen=True)
class Arch:
    """One line load on a skin of a Mooney-Rivlin material; SI units, per the whole width.

    Attributes:
        inner_radius: of the membrane.
        thickness: of the membrane.
        half_angle: from the symmetry axis to a clamp [rad].
        width: along the axis.
        C1: first constant.
        C2: second constant.
        C3: third constant.
        angle: of the load [rad].
        force: inward.
    """

    inner_radius: float
    thickness: float
    half_angle: float
    width: float
    C1: float
    C2: float
    C3: float
    angle: float
    force: float


class _Material:
    """Psi = (C1 + C2)(I1 - 3) + C3 (I1 - 3)^2 + p (J - 1), as I1 = I2 in plane strain."""

    def __init__(self, linear: float, square: float) -> None:
        self.linear, self.square = linear, square
        self.x = [np.zeros((3, 3)), np.zeros(1), np.zeros(0)]

    def gradient(self, x: list[Any]) -> list[Any]:
        F, p = x[0], x[1]
        return [2 * self._slope(F) * F + p * _cofactor(F), fem.math.det(F)[None] - 1, None]

    def hessian(self, x: list[Any]) -> list[Any]:
        F, p = x[0], x[1]
        unit = np.eye(3)
        tangent = 8 * self.square * fem.math.dya(F, F)
        identity = np.einsum("ik,jl->ijkl", unit, unit)[..., None, None]
        tangent = tangent + 2 * self._slope(F) * identity
        inverse = fem.math.transpose(_cofactor(F))  # of F, where J = 1 to first order
        J = fem.math.det(F)
        turned = fem.math.transpose(inverse) / J
        second = fem.math.dya(turned, turned) - fem.math.cdya_il(turned, turned)
        return [tangent + p * J * second, _cofactor(F), None]

    def _slope(self, F: np.ndarray) -> np.ndarray:
        return self.linear + 2 * self.square * (fem.math.ddot(F, F) - 3)


def _cofactor(F: np.ndarray) -> np.ndarray:
    """J F^-T of a deformation in plane strain."""
    out = np.zeros_like(F)
    out[0, 0], out[1, 1] = F[1, 1], F[0, 0]
    out[0, 1], out[1, 0] = -F[1, 0], -F[0, 1]
    out[2, 2] = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    return out


class FelupeArch:
    """The discretised arch.

    Args:
        arch: what to solve.
        along: elements along the arc, even in angle but for the load's, which is a node.
        across: elements through the thickness.
        solver: ``"pardiso"`` or ``"superlu"``.
    """

    def __init__(self, arch: Arch, along: int, across: int, solver: str) -> None:
        self.arch, self.solver = arch, solver
        share = (arch.angle + arch.half_angle) / (2 * arch.half_angle)
        left = min(max(round(along * share), 1), along - 1)
        angles = np.concatenate(
            [
                np.linspace(-arch.half_angle, arch.angle, 2 * left + 1),
                np.linspace(arch.angle, arch.half_angle, 2 * (along - left) + 1)[1:],
            ]
        )
        radii = arch.inner_radius + np.linspace(0, arch.thickness, 2 * across + 1)
        grid = np.stack([np.outer(np.sin(angles), radii), np.outer(np.cos(angles), radii)], -1)
        number = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
        offsets = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]
        last = (number.shape[0] - 2, number.shape[1] - 2)
        cells = [number[a : a + last[0] : 2, b : b + last[1] : 2].ravel() for a, b in offsets]
        mesh = fem.Mesh(grid.reshape(-1, 2), np.stack(cells, 1), "quad9")
        corners = np.arange((along + 1) * (across + 1)).reshape(along + 1, across + 1)
        coarse = [
            corners[a // 2 : a // 2 + along, b // 2 : b // 2 + across].ravel()
            for a, b in offsets[:4]
        ]
        corner_mesh = fem.Mesh(grid[::2, ::2].reshape(-1, 2), np.stack(coarse, 1), "quad")
        region = fem.RegionBiQuadraticQuad(mesh)
        pressures = fem.RegionQuad(corner_mesh, quadrature=region.quadrature, grad=False)
        self.field = fem.FieldContainer(
            [fem.FieldPlaneStrain(region, dim=2), fem.Field(pressures, dim=1)]
        )
        inner = np.zeros(len(mesh.points), bool)
        inner[number[:, 0]] = True
        face = fem.RegionBiQuadraticQuadBoundary(
            mesh, only_surface=True, mask=inner, ensure_3d=True
        )
        self.face = fem.FieldContainer([fem.FieldPlaneStrain(face, dim=2)])
        self.body = fem.SolidBody(_Material(arch.C1 + arch.C2, arch.C3), self.field)
        self.oil = fem.SolidBodyPressure(self.face)
        count = sum(f.values.size for f in self.field.fields)
        held = np.zeros(count, bool)
        held[: 2 * number.size].reshape(-1, 2)[number[[0, -1]].ravel()] = True
        self.free = np.flatnonzero(~held)
        self.displacements = 2 * number.size
        self.under = number[2 * left, across]
        inward = -np.array([np.sin(arch.angle), np.cos(arch.angle)])
        self.inward = inward
        self.load = np.zeros(count)
        start = 2 * number[2 * left, -1]
        self.load[start : start + 2] = arch.force / arch.width * inward

    @property
    def unknowns(self) -> int:
        """Free displacements and pressures, and the oil's pressure."""
        return len(self.free) + 1

    def solve(self, steps: int = 1) -> tuple[float, float, int]:
        """From rest to the full load in equal steps.

        Returns:
            Oil pressure [Pa], mid-surface displacement along the load [m], corrections.

        Raises:
            RuntimeError: a step did not converge.
        """
        for part in self.field.fields:
            part.values[:] = 0
        u, p = (part.values for part in self.field.fields)
        rest = self._volume_gradient()
        oil, corrections = 0.0, 0
        for step in range(1, steps + 1):
            for _ in range(25):
                gradient = self._volume_gradient()
                residual = self.body.assemble.vector(self.field).toarray().ravel()
                residual = residual - oil * gradient - step / steps * self.load
                tangent = self.body.assemble.matrix(self.field)
                stiffness = self.oil.assemble.matrix(self.face, pressure=oil, resize=tangent)
                volume = (gradient + rest)[: self.displacements] @ u.ravel() / 2
                both = self._solved(tangent - stiffness, np.stack([-residual, gradient], 1))
                first, second = both.T
                change = -(volume + gradient @ first) / (gradient @ second)
                move = first + change * second
                u += move[: self.displacements].reshape(u.shape)
                p += move[self.displacements :].reshape(p.shape)
                oil, corrections = oil + change, corrections + 1
                size = np.abs(u).max()
                if not np.isfinite(size) or size > 10 * self.arch.inner_radius:
                    raise RuntimeError("diverged")
                if np.abs(move[: self.displacements]).max() < _TOLERANCE * size:
                    break
            else:
                raise RuntimeError("not converged")
        return oil, float(u[self.under] @ self.inward), corrections

    def _volume_gradient(self) -> np.ndarray:
        self.face[0].values[:] = self.field[0].values
        force = self.oil.assemble.vector(self.face, pressure=1.0).toarray().ravel()
        return np.pad(force, (0, self.load.size - force.size))

    def _solved(self, matrix: Any, right: np.ndarray) -> np.ndarray:
        out = np.zeros_like(right)
        inside = matrix.tocsr()[self.free][:, self.free]
        if self.solver == "pardiso":
            import pypardiso

            out[self.free] = pypardiso.spsolve(inside, right[self.free])
        else:
            out[self.free] = spsolve(inside.tocsc(), right[self.free])
        return out
