"""Residual diagnostics: runs of one sign, lack of fit, chi-square, information criteria.

Residuals of the right law change sign at random along a test; a wrong law leaves runs of one
sign (Wald and Wolfowitz) and smooth patterns: low polynomials along each test are fitted to the
residuals beside the constants (a lack-of-fit test: chi-square for known noise, else F). Where
one of them, or chi-square, is too large by chance, the intervals are widened; and for
correlated neighbours, which leave fewer independent readings.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy import linalg, stats

# Chance of a false alarm. Small: a widened interval of the right law covers too often.
_SIGNIFICANT = 0.01
_NOTABLE = 1.05  # widening of intervals below which nothing is said of it
_MOST_CORRELATED = 0.97
# Correlations of neighbouring residuals below this many standard errors are chance.
_CORRELATED = 2.0
_PATTERNS = 4  # polynomials of degree 0 to 3 along a test
_FEWEST_SPARE = 4
# Of a pattern less than this share is left where constants follow it.
_LEFT = 1e-3
_SMOOTH_DEGREE = 10
_FLIPS, _FEWEST_FLIPPED = 2000, 10  # fewer readings have too few signs


@dataclasses.dataclass(frozen=True)
class Misfit:
    """What the residuals look like."""

    chi_square: float  # Σ r² where the noise is known, else NaN
    dof: int  # degrees of freedom
    chi_square_p: float  # probability of a chi-square this large by chance, else NaN
    runs: int  # number of runs of one sign, over all tests
    expected_runs: float  # how many independent residuals would have
    runs_p: float  # probability of so few runs by chance
    # probability of smooth patterns this large by chance; NaN where the data are too few to
    # tell
    pattern_p: float
    autocorrelation: float  # of neighbouring residuals along a test
    significant: bool  # whether the misfit is more than noise
    inflation: float  # factor by which standard errors grow

    @property
    def report(self) -> dict[str, Any]:
        """The attributes as plain numbers, for JSON."""
        values = dataclasses.asdict(self)
        return {k: v.item() if isinstance(v, np.generic) else v for k, v in values.items()}

    @property
    def description(self) -> str:
        """The misfit or the correlation in a sentence; empty for independent noise."""
        wider = f"; intervals are {self.inflation:.2g} times wider for it"
        wider = wider if self.inflation >= _NOTABLE else ""
        if not self.significant:
            text = (
                f"neighbouring residuals are correlated ({self.autocorrelation:.2g}), which "
                f"leaves fewer independent readings{wider}"
            )
            return text if wider else ""
        reasons = {
            f"chi-square is {self.chi_square:.4g} for {self.dof} degrees of freedom": (
                self.chi_square_p
            ),
            f"residuals keep their sign along the tests ({self.runs} runs where noise has "
            f"about {self.expected_runs:.0f})": self.runs_p,
            f"residuals bend smoothly along the tests (p-value {self.pattern_p:.1g})": (
                self.pattern_p
            ),
        }
        found = " and ".join(text for text, p in reasons.items() if p < _SIGNIFICANT)
        return f"the law does not follow the data to within their noise: {found}{wider}"


def misfit(
    paths: Sequence[np.ndarray],  # residuals of each test, in the order along which it deforms
    constants: int,
    *,
    known_noise: bool,  # the residuals are in units of the known noise
    exact: float = 0.0,  # residuals below this are rounding and have no pattern
    # residuals [n] and their derivatives by the constants [n, p] of tests in which smooth
    # patterns are looked for, on a scale that is smooth along the test itself
    smooth: Sequence[tuple[np.ndarray, np.ndarray]] = (),
) -> Misfit:
    """Judge residuals."""
    everything = np.concatenate(paths)
    count = len(everything)
    dof = count - constants
    square = float(np.sum(everything**2))
    chi_square_p = float(stats.chi2.sf(square, dof)) if known_noise and dof > 0 else np.nan
    runs, expected, variance = 0, 0.0, 0.0
    products, squares = 0.0, 0.0
    for path in paths:
        # Noise scatters about the fit, and the fit about zero; zeros have no sign.
        path = path[path != 0.0]
        if len(path) < 2:
            continue
        positive = path > 0.0
        n1, n2 = int(positive.sum()), int((~positive).sum())
        n = n1 + n2
        # Expected over both signs being equally likely, so that a test whose residuals
        # all have one sign counts as a pattern too.
        runs += 1 + int(np.sum(positive[1:] != positive[:-1]))
        expected += 1.0 + 0.5 * (n - 1)
        variance += 0.25 * (n - 1)
        products += float(np.sum(path[1:] * path[:-1]))
        squares += float(np.sum(path**2)) * (n - 1) / n
    # A fit of p constants adds up to p sign changes.
    z = (runs - expected + 0.5) / np.sqrt(variance) if variance > 0.0 else 0.0
    runs_p = float(stats.norm.cdf(z))
    correlation = products / squares if squares > 0.0 else 0.0
    rounding = np.sqrt(square / max(count, 1)) <= exact
    patterned = runs_p < _SIGNIFICANT and not rounding
    pattern_p, ratio = np.nan, 1.0
    if smooth and not rounding:
        pattern_p, ratio = _patterns(smooth, known_noise)
    bent = bool(pattern_p < _SIGNIFICANT)
    too_large = bool(chi_square_p < _SIGNIFICANT)
    inflation = 1.0
    if patterned or (correlation > _CORRELATED / np.sqrt(max(count, 1)) and not rounding):
        # Constants take part of the correlation away from the residuals.
        rho = correlation + (constants + 1) * (1.0 + correlation) / max(count, 1)
        rho = min(max(rho, 0.0), _MOST_CORRELATED)
        inflation *= np.sqrt((1.0 + rho) / (1.0 - rho))
    if bent:
        # Constants follow smooth patterns, not scatter: theirs is the noise that they see.
        inflation = max(inflation, np.sqrt(ratio))
    if too_large:
        size = np.sqrt(square / dof)
        inflation = max(inflation, size) if bent else inflation * size
    return Misfit(
        chi_square=square if known_noise else np.nan,
        dof=dof,
        chi_square_p=chi_square_p,
        runs=runs,
        expected_runs=expected,
        runs_p=runs_p,
        pattern_p=pattern_p,
        autocorrelation=correlation,
        significant=patterned or too_large or bent,
        inflation=float(inflation),
    )


def _patterns(
    tests: Sequence[tuple[np.ndarray, np.ndarray]], known_noise: bool
) -> tuple[float, float]:
    """Do smooth patterns explain more of the residuals than noise would?

    Returns probability by chance, and the mean square of the patterns over that of all
    residuals (over one, where the noise is known); NaN and one where the data are too few.
    """
    r, J = (np.concatenate(parts) for parts in zip(*tests, strict=True))
    sizes = np.linalg.norm(J, axis=0)
    lengths = [len(path) for path, _ in tests]
    blocks = [
        legvander(np.linspace(-1.0, 1.0, n), _PATTERNS - 1)[:, : max(n - 1, 0)] for n in lengths
    ]
    patterns = linalg.block_diag(*blocks)
    known, rank = _basis(J[:, sizes > 0.0] / sizes[sizes > 0.0])
    # Derivatives at noisy states are noisy themselves, with the noise of the residuals: what
    # patterns leave of them must not be that noise.
    smooth_J = np.concatenate([_smoothed(own) for _, own in tests])
    taken, _ = _basis(smooth_J[:, sizes > 0.0] / sizes[sizes > 0.0])
    if not patterns.size:
        return np.nan, 1.0
    patterns = patterns / np.linalg.norm(patterns, axis=0)
    basis, extra = _basis(patterns - taken @ (taken.T @ patterns), _LEFT)
    spare = len(r) - rank - extra
    if extra == 0 or spare < _FEWEST_SPARE:
        return np.nan, 1.0
    r = r - known @ (known.T @ r)
    explained = float(np.sum((basis.T @ r) ** 2))
    mean = explained / extra
    if known_noise:
        return float(stats.chi2.sf(explained, extra)), mean
    rest = (float(r @ r) - explained) / spare
    if rest <= 0.0:
        return np.nan, 1.0
    whole = float(r @ r) / (spare + extra)
    chance = float(stats.f.sf(mean / rest, extra, spare))
    if chance < _SIGNIFICANT and len(r) >= _FEWEST_FLIPPED:
        flipped = _by_flipped_signs(basis, r)
        chance = flipped if flipped >= _SIGNIFICANT else chance
    return chance, mean / whole


def _by_flipped_signs(basis: np.ndarray, r: np.ndarray) -> float:
    """Share of random signs of the residuals with as large patterns (wild bootstrap, Liu 1988).

    One reading with far more noise than the fit assumed makes a pattern whatever its sign.
    """
    rng = np.random.default_rng(0)
    own = float(np.sum((basis.T @ r) ** 2))
    larger, rows = 0, max(1, min(_FLIPS, 4_000_000 // len(r)))
    for start in range(0, _FLIPS, rows):
        signs = rng.integers(0, 2, (min(rows, _FLIPS - start), len(r))) * 2.0 - 1.0
        larger += int(np.sum(np.sum((signs * r @ basis) ** 2, axis=1) >= own))
    return (larger + 1) / (_FLIPS + 1)


def _smoothed(columns: np.ndarray) -> np.ndarray:
    """Columns along a test as polynomials, where there are readings enough."""
    n = len(columns)
    degree = min(_SMOOTH_DEGREE, n // 4)
    if degree < _PATTERNS:
        return columns
    vander = np.polynomial.chebyshev.chebvander(np.linspace(-1.0, 1.0, n), degree)
    return np.asarray(vander @ np.linalg.lstsq(vander, columns, rcond=None)[0])


def _basis(columns: np.ndarray, tolerance: float = 1e-10) -> tuple[np.ndarray, int]:
    """Orthonormal basis of the space of columns no longer than one, and its dimension."""
    if columns.shape[1] == 0:
        return columns, 0
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    # What is left of columns that others take is rounding: no scale to measure it by.
    kept = s > tolerance * max(float(s[0]), 1.0)
    return u[:, kept], int(kept.sum())


def information_criteria(
    square: float,  # Σ r²
    count: int,  # number of readings N
    constants: int,  # number of fitted constants p
    *,
    known_noise: bool,  # −2 log L = n Σ r²/N; else n log(Σ r²/N), the noise one parameter more
    effective: float | None = None,  # number n of independent readings; None for all
) -> tuple[float, float]:
    """AICc and BIC of a least-squares fit, up to a constant of the data.

    Returns AICc = −2 log L + 2k + 2k(k + 1)/(n − k − 1) (infinite for n ≤ k + 1) and BIC = −2
    log L + k log n.
    """
    n = float(count) if effective is None else effective
    k = constants if known_noise else constants + 1
    deviance = n * (square / count if known_noise else np.log(max(square, 1e-300) / count))
    spare = n - k - 1
    aicc = deviance + 2.0 * k + (2.0 * k * (k + 1) / spare if spare > 0 else np.inf)
    return float(aicc), float(deviance + k * np.log(n))
