"""Contact detection: a test with a stated rate of false alarms.

Of all contacts the one that raises the likelihood most is looked for, so the chance that
noise alone looks like one of them grows with the variety of patterns. With readings scaled
by their noise, a light contact at angle t has the unit pattern s(t), and the statistic is
z = max_t s(t).e. Under noise alone (Hotelling's tube formula, one-sided)

    P(z > u) = L / (2 pi) exp(-u^2 / 2) + Phi(-u),      L = length of the curve s

where L follows from the taxels in use: missing ones change it, and the rate still holds.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr


class Detection(NamedTuple):
    """Result of the test, frame by frame.

    Attributes:
        statistic: z, the significance of the best light contact.
        p_value: probability that noise alone reaches it.
        length: of the curve of patterns.
    """

    statistic: NDArray[np.float64]
    p_value: NDArray[np.float64]
    length: NDArray[np.float64]


class Detector:
    """The test for one skin.

    Args:
        signatures: change of readings under a light contact [angle, taxel].
    """

    def __init__(self, signatures: NDArray[np.float64]) -> None:
        self._patterns = signatures
        self._squares = signatures**2
        self._products = signatures[1:] * signatures[:-1]

    def test(self, change: NDArray[np.float64], weight: NDArray[np.float64]) -> Detection:
        """Test frames.

        Args:
            change: readings less those at rest [frame, taxel]; anything where not used.
            weight: inverse variance, zero where not used [frame, taxel].
        """
        along = (weight * np.where(weight > 0, change, 0.0)) @ self._patterns.T
        size = np.sqrt(weight @ self._squares.T)
        safe = np.where(size > 0, size, 1.0)
        z = np.where(size > 0, along / safe, -np.inf).max(1)
        cosine = (weight @ self._products.T) / (safe[:, 1:] * safe[:, :-1])
        length = np.arccos(np.clip(cosine, -1, 1)).sum(1)
        return Detection(z, false_alarm_rate(z, length), length)


def false_alarm_rate(
    z: NDArray[np.float64], length: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Probability that noise alone reaches z."""
    bounded = np.maximum(z, 0.0)
    tail = length / (2 * np.pi) * np.exp(-(bounded**2) / 2)
    return np.minimum(tail + ndtr(-z), 1.0)


def threshold(rate: float, length: float) -> float:
    """The z that noise alone reaches at a given rate."""
    return float(
        brentq(
            lambda z: float(false_alarm_rate(np.array(z), np.array(length))) - rate, -8.0, 40.0
        )
    )
