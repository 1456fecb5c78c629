"""Covariance and identifiability of fitted constants.

With r(c) the residuals, J = ∂r/∂c and s their standard deviation, the covariance s² (JᵀJ)⁻¹ is
computed from the singular values of J D; D holds a natural size for each constant: its own
magnitude, or the change that alters every reading by its own size, whichever is larger. A
combination of constants is unidentifiable where s over its singular value exceeds one half: the
data leave it free to change by half of that natural size.
"""

import dataclasses
import functools
import itertools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from scipy import stats

from fitting.statistics.residuals import AbstractResiduals, sensitivity

# No stress-strain test is repeatable to better than this: residuals smaller than it (of
# exact, made-up data) don't make a constant known.
SMALLEST_NOISE = 1e-4
_FREE = 0.5
_MOST_FREE = 1e4  # natural sizes: "any amount"
_RANK = 1e-10
_LARGEST = 1e100


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of fitted constants."""

    noise: float  # standard deviation of the residuals, one where the noise is known
    dof: int  # degrees of freedom, readings less constants
    inflation: float  # factor on the standard errors for a misfit that is not noise
    # R with R Rᵀ the covariance. Where some constants are free by any amount, what the data do
    # know of their combinations is lost to rounding in the covariance, not in R; shape [p, p].
    root: np.ndarray
    singular_values: np.ndarray  # of the scaled sensitivity matrix, largest first, shape [p]
    sizes: np.ndarray  # natural size of each constant, shape [p]
    unidentifiable: tuple[str, ...]  # combinations that the data don't determine, in words
    # how many of them there are without the inflation: constants too many for the noise alone,
    # whatever the law's misfit adds
    spare: int

    @functools.cached_property
    def covariance(self) -> np.ndarray:
        """Of the constants, SI units, inflation included, shape [p, p]."""
        return np.asarray(self.root @ self.root.T)

    @property
    def correlation(self) -> np.ndarray:
        """Of the constants, shape [p, p]."""
        deviation = self.standard_errors
        return self.covariance / np.maximum(np.outer(deviation, deviation), 1e-300)

    @property
    def standard_errors(self) -> np.ndarray:
        """Standard error of each constant, SI units, shape [p]."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def condition_number(self) -> float:
        """Largest over smallest singular value of the scaled sensitivity matrix."""
        smallest = self.singular_values[-1]
        return float(self.singular_values[0] / smallest) if smallest > 0.0 else np.inf

    def spread_of(self, slope: np.ndarray) -> np.ndarray:
        """Standard errors of quantities [n] with these derivatives by the constants [n, p]."""
        return np.asarray(np.linalg.norm(slope @ self.root, axis=-1))

    def with_error(self, error: np.ndarray) -> "Uncertainty":
        """The same with a further error that all constants share.

        `error`: by how much each constant moves at one standard deviation of it, shape [p].
        """
        return dataclasses.replace(self, root=np.column_stack([self.root, error]))

    def quantile(self, level: float) -> float:
        """Half width of a two-sided interval in standard errors.

        Student's t where the noise is estimated from the residuals.
        """
        return float(stats.t.ppf(0.5 + 0.5 * level, max(self.dof, 1)))


def uncertainty(
    residuals: AbstractResiduals,
    constants: np.ndarray,
    *,
    known_noise: bool,  # the residuals are in units of the known noise
    inflation: float = 1.0,  # factor on the standard errors, from `diagnostics.Misfit`
    held: Sequence[str] = (),  # constants that stopped at a bound; they are taken as known
    # standard deviation of each residual up to a common factor, where it is not the same for
    # all, shape [n]. The covariance is then that of the estimate under this noise, A
    # diag(ratio²) Aᵀ with A = (JᵀJ)⁻¹Jᵀ
    noise_ratio: np.ndarray | None = None,
) -> Uncertainty:
    """Judge what the data say about the constants at a minimum."""
    r, J = (np.asarray(x) for x in sensitivity(residuals, jnp.asarray(constants)))
    used = residuals.used
    kept = np.array([name not in held for name in residuals.names])
    r, J = r[used], J[used]
    weighed_value = np.asarray(residuals.value * residuals.inverse_scale)[used]
    whole = float(np.sqrt(np.sum(weighed_value**2)))
    columns = np.linalg.norm(J, axis=0)
    with np.errstate(divide="ignore"):
        effect = np.where(columns > 0.0, whole / columns, np.abs(constants))
    sizes = np.maximum(np.abs(constants), effect)
    # A term that has vanished in all but name would overflow its own variance.
    sizes = np.clip(np.where(sizes > 0.0, sizes, 1.0), 0.0, _LARGEST)
    # Null directions are needed, too, where readings are fewer than constants.
    scaled_rows = (J * sizes)[:, kept]
    few = len(scaled_rows) < scaled_rows.shape[1]
    left, s, vt = np.linalg.svd(scaled_rows, full_matrices=few)
    s = np.concatenate([s, np.zeros(len(vt) - len(s))])
    # A reading at rest, such as the first row of a test, is met by any constants: it is none.
    told = (np.abs(scaled_rows).max(1, initial=0.0) > _RANK * s[0]) | (r != 0.0)
    count = int(told.sum())
    dof = count - int(kept.sum())
    ratio = np.ones(len(r)) if noise_ratio is None else noise_ratio[used]
    whitened = r / ratio
    if noise_ratio is not None:
        # What the constants are off by, for they were weighed otherwise, is not noise.
        along, size, _ = np.linalg.svd(scaled_rows / ratio[:, None], full_matrices=False)
        along = along[:, size > _RANK * max(float(size[0]), 1e-300)]
        whitened = whitened - along @ (along.T @ whitened)
    estimated = float(np.sqrt(np.sum(whitened**2) / dof)) if dof > 0 else np.nan
    typical = whole / np.sqrt(max(count, 1))
    noise = 1.0 if known_noise else estimated
    spread = noise if np.isfinite(noise) else typical
    # A free direction is only as exact as the derivatives; made longer than it takes to be
    # called free, it would spill into what the data do know.
    limit = max(spread / _MOST_FREE, s[0] * 1e-14, 1e-300)
    root = np.zeros((len(constants), len(constants)))
    scaled = (vt.T / np.maximum(s, limit)) * spread * inflation
    noise_along = np.ones(len(s))
    if noise_ratio is not None and len(s) <= len(r):
        # Of directions that see more or less noise than the whole; R² = Uᵀ diag(ratio²) U.
        triangle = np.asarray(np.linalg.qr(ratio[:, None] * left[:, : len(s)], mode="r"))
        scaled = scaled @ triangle.T
        noise_along = np.linalg.norm(triangle, axis=0)
    root[np.ix_(kept, np.arange(len(s)))] = np.clip(
        scaled * sizes[kept, None], -_LARGEST, _LARGEST
    )
    # The same noise as that of the intervals, and the noise alone.
    floor, alone = (
        np.maximum(spread * factor * noise_along, SMALLEST_NOISE * typical)
        for factor in (inflation, 1.0)
    )
    free, spare = (
        (noise_of / np.maximum(s, limit) > _FREE) | (s < _RANK * s[0])
        for noise_of in (floor, alone)
    )
    names = tuple(itertools.compress(residuals.names, kept))
    units = tuple(itertools.compress(residuals.units, kept))
    named = [
        describe(names, units, vt[i], sizes[kept], floor[i] / max(s[i], limit))
        for i in range(len(s))
        if free[i]
    ]
    if dof <= 0:
        named.insert(0, f"everything: {count} readings for {len(constants)} constants")
    count = int(spare.sum()) + (dof <= 0)
    return Uncertainty(noise, dof, inflation, root, s, sizes, tuple(named), count)


def describe(
    names: tuple[str, ...],
    units: tuple[str, ...],
    direction: np.ndarray,
    sizes: np.ndarray,
    spread: float,
) -> str:
    """Name a combination of constants that the data leave free.

    A direction of stresses alone is written in pascals ("C1 - C2" where one may grow at
    the other's expense); a mixed one in relative changes.
    """
    taking_part = np.flatnonzero(np.abs(direction) > 0.1 * np.max(np.abs(direction)))
    in_pascals = all(units[i] == "Pa" for i in taking_part) and len(taking_part) > 1
    shown = direction * sizes if in_pascals else direction
    if in_pascals:
        taking_part = np.flatnonzero(np.abs(shown) > 0.02 * np.max(np.abs(shown)))
    if len(taking_part) == 1:
        (only,) = taking_part
        return f"{names[only]} (free by {_percent(spread)} of {sizes[only]:.3g} {units[only]})"
    # The largest share is one, the first is positive.
    largest = np.max(np.abs(shown[taking_part]))
    ratios = shown / (largest * np.sign(shown[taking_part[0]]))
    text = ""
    for i in taking_part:
        size = abs(ratios[i])
        factor = "" if abs(size - 1.0) < 5e-3 else f"{size:.2g} "
        name = names[i] if in_pascals else f"d{names[i]}/{sizes[i]:.3g}"
        sign = "-" if ratios[i] < 0.0 else "+"
        text += f" {sign} {factor}{name}" if text else f"{factor}{name}"
    return f"{text} (free by {_percent(spread)})"


def _percent(spread: float) -> str:
    return f"+-{100.0 * spread:.3g} %" if spread < 0.99 * _MOST_FREE else "any amount"
