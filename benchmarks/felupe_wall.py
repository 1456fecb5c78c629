"""A rigid, frictionless wall under a body of FElupe, by a stiff penalty."""

from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix


class Wall:
    """A cylinder about the axis, whose inside a face may not enter.

    With the depth d of a point below the wall's radius, the energy is k d^2 / 2 per area of the
    undeformed face.

    Args:
        region: FElupe's region of the face; coordinates are x, axis, y.
        radius: of the wall [m].
        stiffness: k [Pa/m].
    """

    def __init__(self, region: Any, radius: float, stiffness: float) -> None:
        self.radius, self.stiffness = radius, stiffness
        cells = np.asarray(region.mesh.cells)
        self.cells, self.points = cells, np.asarray(region.mesh.points)
        self.area = np.broadcast_to(region.dV, (np.shape(region.dV)[0], len(cells)))
        self.shapes = np.asarray(region.h)[..., 0]

    def force(self, displacement: np.ndarray) -> float:
        """Sum of the wall's forces [N]."""
        return float(np.sum(self._pressures(displacement)[0] * self.area))

    def assemble(self, displacement: np.ndarray, size: int) -> tuple[np.ndarray, csr_matrix]:
        """Gradient and Hessian of the energy by the unknowns, displacements first."""
        pressure, normal, height = self._pressures(displacement)
        near = np.flatnonzero((pressure > 0).any(0))
        p, n, r = pressure[:, near], normal[..., near], height[:, near]
        weight, cells = self.area[:, near], self.cells[near]
        gradient = -np.einsum("qe,iqe,aq->eai", p * weight, n, self.shapes)
        flat = np.array([1.0, 0.0, 1.0])
        plane = np.einsum("i,ij->ij", flat, np.eye(3))[..., None, None]
        both = np.einsum("iqe,jqe->ijqe", n, n)
        closed = self.stiffness * (p > 0)
        point = closed * both - p / r * (plane - both)
        blocks = np.einsum("ijqe,qe,aq,bq->eaibj", point, weight, self.shapes, self.shapes)
        index = (3 * cells[..., None] + np.arange(3)).reshape(len(cells), 3 * cells.shape[1])
        out = np.bincount(index.ravel(), gradient.ravel(), size)
        rows = np.repeat(index[..., None], index.shape[1], 2)
        entries = (blocks.ravel(), (rows.ravel(), rows.swapaxes(1, 2).ravel()))
        return out, coo_matrix(entries, (size, size)).tocsr()

    def _pressures(self, displacement: np.ndarray) -> tuple[np.ndarray, ...]:
        """Pressure, outward normal and distance from the axis at the face's points."""
        place = np.einsum("eai,aq->iqe", (self.points + displacement)[self.cells], self.shapes)
        height = np.hypot(place[0], place[2])
        normal = np.stack([place[0] / height, 0 * height, place[2] / height])
        return self.stiffness * np.maximum(self.radius - height, 0.0), normal, height
