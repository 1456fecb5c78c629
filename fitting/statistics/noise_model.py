"""Noise of readings that grows with them: relative, absolute or both, from the data.

The standard deviation of a reading y is √(a² + b² y²). It is estimated from how much each
residual differs from the line through its neighbours along the test, which a wrong law or a
drift, smooth as they are, hardly change::

    d_i = e_i - w_i e_(i-1) - (1 - w_i) e_(i+1)
    var d_i = v_i + w_i² v_(i-1) + (1 - w_i)² v_(i+1)

by maximum likelihood of independent Gaussian d_i (a composite likelihood: neighbours share
residuals).
"""

import dataclasses

import numpy as np
from scipy import optimize, stats

FEWEST = 12
"""Readings of a test from which its noise can be estimated."""
# Gain of the composite log-likelihood that a further parameter must bring: it is about 3/2
# times too large, for neighbours share residuals.
_GAIN = 4.5
# Chance of calling a right noise model wrong.
_EXCLUDED = 1e-3
_OUTLIER = 6.0


@dataclasses.dataclass(frozen=True)
class NoiseModel:
    """Noise of one test."""

    absolute: float  # a, in the unit of the readings
    relative: float  # b
    kind: str  # "absolute", "relative" or "both"
    gain: float  # how much the log-likelihood exceeds that of the assumed noise

    def deviation(self, size: np.ndarray) -> np.ndarray:
        """Standard deviation of readings of this size, shape [n]."""
        return np.hypot(self.absolute, self.relative * size)

    @property
    def excludes_assumed(self) -> bool:
        """Whether the assumed noise is excluded: its likelihood is too small by chance."""
        return bool(stats.chi2.sf(2.0 * self.gain / 1.5, 1) < _EXCLUDED)


def estimate_noise(
    error: np.ndarray,
    size: np.ndarray,  # of the readings themselves, such as their predictions, shape [n]
    assumed: np.ndarray,  # standard deviation that the fit assumes, up to a factor, shape [n]
    along: np.ndarray,  # coordinate that orders the test, shape [n]
    weight: np.ndarray,  # number of readings of which each is the mean, shape [n]
) -> NoiseModel | None:
    """Estimate the noise of a test from its residuals.

    `error`: predicted less measured readings in the order of deformation, shape [n].
    Returns the noise, or None where the data are too few or exact.
    """
    if len(error) < FEWEST:
        return None
    d, parts = _differences(error, along)
    if not np.any(d) or np.sqrt(np.mean(d**2)) <= 1e-9 * np.max(np.abs(size)):
        return None
    size, thin = np.abs(size), 1.0 / np.sqrt(weight)
    assumed = assumed * thin
    # An outlier is not a sign of how the noise grows.
    spread = np.median(np.abs(d) / _deviation(parts, assumed)) / 0.6745
    d = np.clip(d, *(_OUTLIER * spread * _deviation(parts, assumed) * s for s in (-1.0, 1.0)))
    shapes = {"relative": size, "absolute": np.ones_like(size)}
    found = {
        kind: _likelihood(d, _deviation(parts, thin * np.maximum(shape, 1e-9 * np.max(size))))
        for kind, shape in shapes.items()
    }
    reference, _ = _likelihood(d, _deviation(parts, assumed))
    best = max(found, key=lambda kind: found[kind][0])
    value, scale = found[best]
    a, b = (scale, 0.0) if best == "absolute" else (0.0, scale)
    both, (a2, b2) = _both(d, parts, size, thin, found["absolute"][1], found["relative"][1])
    kind = best
    if both > value + _GAIN:
        value, a, b, kind = both, a2, b2, "both"
    return NoiseModel(float(a), float(b), kind, float(value - reference))


def _differences(error: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals less the line through their neighbours, and the neighbours' weights."""
    gap = along[2:] - along[:-2]
    near = np.where(gap > 0.0, along[2:] - along[1:-1], 1.0)
    w = np.where(gap > 0.0, near / np.where(gap > 0.0, gap, 1.0), 0.5)
    return error[1:-1] - w * error[:-2] - (1.0 - w) * error[2:], w


def _deviation(w: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Standard deviation of the differences for that of the readings."""
    return np.sqrt(sigma[1:-1] ** 2 + (w * sigma[:-2]) ** 2 + ((1.0 - w) * sigma[2:]) ** 2)


def _likelihood(d: np.ndarray, shape: np.ndarray) -> tuple[float, float]:
    """Largest log-likelihood of d with standard deviations s·shape, and s."""
    scale = float(np.sqrt(np.mean((d / shape) ** 2)))
    return -len(d) * np.log(scale) - float(np.sum(np.log(shape))) - 0.5 * len(d), scale


def _both(
    d: np.ndarray,
    w: np.ndarray,
    size: np.ndarray,
    thin: np.ndarray,
    absolute: float,
    relative: float,
) -> tuple[float, tuple[float, float]]:
    """Largest log-likelihood with both parts, and the parts."""

    def cost(x: np.ndarray) -> float:
        sigma = _deviation(w, thin * np.hypot(np.exp(x[0]), np.exp(x[1]) * size))
        return float(np.sum(np.log(sigma)) + 0.5 * np.sum((d / sigma) ** 2))

    start = np.log([0.5 * absolute, 0.5 * relative])
    low = start - 8.0
    found = optimize.minimize(
        cost, start, method="L-BFGS-B", bounds=[(b, b + 12.0) for b in low]
    )
    return -float(found.fun), (float(np.exp(found.x[0])), float(np.exp(found.x[1])))
