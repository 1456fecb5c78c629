"""Incompressible rubbers for FElupe's mixed elements: energies of invariants, and Ogden's.

Psi(F) + p (J - 1) + U(J), with U = K (J - 1)^2 / 2 - s (J - 1), where s = dPsi/dJ at rest.
U changes nothing where J = 1. Elements hold that in the mean only, and without U their own
changes of volume would have negative energy.
"""

import abc
from collections.abc import Sequence
from typing import Any

import felupe as fem
import numpy as np

_BULK = 10.0  # moduli against an element's own changes of volume, over the shear modulus
_EQUAL = 1e-7  # squares of stretches whose difference is rounding


class AbstractRubber(abc.ABC):
    """A law as FElupe's bodies take it: gradient and Hessian by F and the pressure."""

    shear_modulus: float
    slope: float  # s [Pa]

    def __init__(self) -> None:
        self.x = [np.zeros((3, 3)), np.zeros(1), np.zeros(0)]
        self.bulk = _BULK * self.shear_modulus

    @abc.abstractmethod
    def stress(self, F: np.ndarray) -> np.ndarray:
        """dPsi/dF."""

    @abc.abstractmethod
    def stiffness(self, F: np.ndarray) -> np.ndarray:
        """d2Psi/dF2."""

    def gradient(self, x: list[Any]) -> list[Any]:
        """Derivatives of the whole energy by F and the pressure."""
        F, p = x[0], x[1]
        J = fem.math.det(F)
        cofactor = J * fem.math.transpose(fem.math.inv(F, determinant=J))
        return [self.stress(F) + (p + self._pressure(J)) * cofactor, J[None] - 1, None]

    def hessian(self, x: list[Any]) -> list[Any]:
        """Second derivatives: by F twice, by F and the pressure."""
        F, p = x[0], x[1]
        J = fem.math.det(F)
        inverse = fem.math.transpose(fem.math.inv(F, determinant=J))
        both = fem.math.dya(inverse, inverse) - np.einsum("ilqe,kjqe->ijklqe", inverse, inverse)
        tangent = self.stiffness(F) + (p + self._pressure(J)) * J * both
        tangent += self.bulk * J**2 * fem.math.dya(inverse, inverse)
        return [tangent, J * inverse, None]

    def _pressure(self, J: np.ndarray) -> np.ndarray:
        """dU/dJ."""
        return np.asarray(self.bulk * (J - 1) - self.slope)


class MooneyRivlin(AbstractRubber):
    """Psi = C1 (I1 - 3) + C2 (I2 - 3) + C3 (I2 - 3)^2."""

    def __init__(self, C1: float, C2: float = 0.0, C3: float = 0.0) -> None:
        self.C1, self.C2, self.C3 = C1, C2, C3
        self.shear_modulus, self.slope = 2 * (C1 + C2), 2 * C1 + 4 * C2
        super().__init__()

    def stress(self, F: np.ndarray) -> np.ndarray:
        """See the base class."""
        slope, second = self._second_invariant(F, _cauchy_green(F))
        return np.asarray(2 * self.C1 * F + slope * second)

    def stiffness(self, F: np.ndarray) -> np.ndarray:
        """See the base class."""
        C = _cauchy_green(F)
        slope, second = self._second_invariant(F, C)
        unit = np.eye(3)[..., None, None]
        identity = np.einsum("ikqe,jlqe->ijklqe", unit, unit)
        turned = np.einsum("ilqe,kjqe->ijklqe", F, F)
        left = np.einsum("ikqe,ljqe->ijklqe", unit, C)
        B = fem.math.dot(F, fem.math.transpose(F))
        right = np.einsum("ikqe,jlqe->ijklqe", B, unit)
        tangent = (2 * self.C1 + 2 * slope * _trace(C)) * identity
        tangent += 4 * slope * fem.math.dya(F, F) - 2 * slope * (left + turned + right)
        return np.asarray(tangent + 2 * self.C3 * fem.math.dya(second, second))

    def _second_invariant(self, F: np.ndarray, C: np.ndarray) -> tuple[Any, np.ndarray]:
        """dPsi/dI2 and dI2/dF."""
        first = _trace(C)
        I2 = (first**2 - fem.math.ddot(C, C)) / 2
        slope = self.C2 + 2 * self.C3 * (I2 - 3)
        return slope, 2 * (first * F - fem.math.dot(F, C))


class Yeoh(AbstractRubber):
    """Psi = C1 (I1 - 3) + C2 (I1 - 3)^2 + C3 (I1 - 3)^3."""

    def __init__(self, C1: float, C2: float, C3: float) -> None:
        self.C1, self.C2, self.C3 = C1, C2, C3
        self.shear_modulus = self.slope = 2 * C1
        super().__init__()

    def stress(self, F: np.ndarray) -> np.ndarray:
        """See the base class."""
        return np.asarray(2 * self._slopes(F)[0] * F)

    def stiffness(self, F: np.ndarray) -> np.ndarray:
        """See the base class."""
        first, second = self._slopes(F)
        unit = np.eye(3)
        identity = np.einsum("ik,jl->ijkl", unit, unit)[..., None, None]
        return np.asarray(2 * first * identity + 4 * second * fem.math.dya(F, F))

    def _slopes(self, F: np.ndarray) -> tuple[Any, Any]:
        """First and second derivative by I1."""
        x = _trace(_cauchy_green(F)) - 3
        first = self.C1 + 2 * self.C2 * x + 3 * self.C3 * x**2
        return first, 2 * self.C2 + 6 * self.C3 * x


class Ogden(AbstractRubber):
    """Psi = sum mu / alpha (l1^alpha + l2^alpha + l3^alpha - 3), by principal directions."""

    def __init__(self, mu: Sequence[float], alpha: Sequence[float]) -> None:
        self.mu, self.alpha = np.array(mu), np.array(alpha)
        self.shear_modulus, self.slope = float(self.mu @ self.alpha / 2), float(sum(mu))
        super().__init__()

    def stress(self, F: np.ndarray) -> np.ndarray:
        """See the base class."""
        squares, axes = self._principal(F)
        second = np.einsum("...a,...ia,...ja->ij...", self._rate(squares), axes, axes)
        return np.asarray(fem.math.dot(F, second))

    def stiffness(self, F: np.ndarray) -> np.ndarray:
        """See the base class."""
        squares, axes = self._principal(F)
        rate, half = self._rate(squares), self.alpha[:, None] / 2 - 1
        slope = np.sum(self.mu[:, None] * half * squares[..., None, :] ** (half - 1), -2)
        apart = squares[..., None] - squares[..., None, :]
        equal = np.abs(apart) < _EQUAL
        mean = (slope[..., None] + slope[..., None, :]) / 2
        steep = (rate[..., None] - rate[..., None, :]) / np.where(equal, 1.0, apart)
        turned = np.einsum("ij...,...ja->...ia", F, axes)
        pairs = np.where(equal, mean, steep)
        # Of both orders of a pair: dS = pairs (dC_ab + dC_ba) / 2, twice.
        order = ("ka,...lb", "kb,...la")
        tangent = sum(
            np.einsum(f"...ab,...ia,...jb,...{x}->ijkl...", pairs, turned, axes, turned, axes)
            for x in order
        )
        second = np.einsum("...a,...ia,...ja->ij...", rate, axes, axes)
        return np.asarray(tangent + np.einsum("ik,jl...->ijkl...", np.eye(3), second))

    def _principal(self, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squares of the stretches [..., 3], and their directions [..., 3, 3]."""
        found = np.linalg.eigh(np.moveaxis(_cauchy_green(F), (0, 1), (-2, -1)))
        return found[0], found[1]

    def _rate(self, squares: np.ndarray) -> np.ndarray:
        """Twice the derivative of the energy by each square."""
        power = self.alpha[:, None] / 2 - 1
        return np.asarray(np.sum(self.mu[:, None] * squares[..., None, :] ** power, -2))


def _cauchy_green(F: np.ndarray) -> np.ndarray:
    return np.asarray(fem.math.dot(fem.math.transpose(F), F))


def _trace(C: np.ndarray) -> np.ndarray:
    return np.asarray(C[0, 0] + C[1, 1] + C[2, 2])
