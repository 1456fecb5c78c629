"""The skin solved with FElupe, as a user of that library would: the peer of the benchmarks.

Taylor-Hood elements (biquadratic displacement, bilinear pressure; plane strain, exactly
incompressible), follower pressure on the inner face, dead force on the outer one.
Needs the optional dependencies ``peers``.
"""

import dataclasses
from typing import Any

import felupe as fem
import numpy as np

from benchmarks.felupe_newton import OilFilledBody


@dataclasses.dataclass(frozen=True)
class Arch:
    """One line load on a skin of a Mooney-Rivlin material; SI units, per the whole width."""

    inner_radius: float  # of the membrane
    thickness: float  # of the membrane
    half_angle: float  # from the symmetry axis to a clamp [rad]
    width: float  # along the axis
    C1: float  # first constant
    C2: float  # second constant
    C3: float  # third constant
    angle: float  # of the load [rad]
    force: float  # inward


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
    """The discretised arch."""

    def __init__(
        self,
        arch: Arch,  # what to solve
        along: int,  # elements along the arc, even in angle but for the load's, which is a node
        across: int,  # elements through the thickness
        solver: str,  # ``"pardiso"`` or ``"superlu"``
    ) -> None:
        self.arch = arch
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
        field = fem.FieldContainer(
            [fem.FieldPlaneStrain(region, dim=2), fem.Field(pressures, dim=1)]
        )
        inner = np.zeros(len(mesh.points), bool)
        inner[number[:, 0]] = True
        face_region = fem.RegionBiQuadraticQuadBoundary(
            mesh, only_surface=True, mask=inner, ensure_3d=True
        )
        face = fem.FieldContainer([fem.FieldPlaneStrain(face_region, dim=2)])
        material = _Material(arch.C1 + arch.C2, arch.C3)
        held = np.zeros((number.size, 2), bool)
        held[number[[0, -1]].ravel()] = True
        far = 10 * arch.inner_radius
        self.system = OilFilledBody(field, material, face, held, far, solver)
        self.under = number[2 * left, across]
        inward = -np.array([np.sin(arch.angle), np.cos(arch.angle)])
        self.inward = inward
        self.load = np.zeros((number.size, 2))
        self.load[number[2 * left, -1]] = arch.force / arch.width * inward

    @property
    def unknowns(self) -> int:
        """Free displacements and pressures, and the oil's pressure."""
        return self.system.unknowns

    def solve(self, steps: int = 1) -> tuple[float, float, int]:
        """From rest to the full load in equal steps.

        Returns oil pressure [Pa], mid-surface displacement along the load [m], corrections.
        Raises RuntimeError: a step did not converge.
        """
        self.system.rest()
        corrections = sum(
            self.system.advance(step / steps * self.load) for step in range(1, steps + 1)
        )
        inward = self.system.displacement[self.under] @ self.inward
        return self.system.oil, float(inward), corrections
