"""Is the misfit noise? Residual patterns, chi-square, information criteria.

Residuals of the right law change sign at random along a test; a wrong law leaves runs of
one sign. Runs are counted (Wald and Wolfowitz), and where there are too few of them, or
where chi-square exceeds what the known noise allows, the intervals are widened.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import stats

# Chance of a false alarm. Small: a widened interval of the right law covers too often.
_SIGNIFICANT = 0.01
_MOST_CORRELATED = 0.97


@dataclasses.dataclass(frozen=True)
class Misfit:
    """What the residuals look like.

    Attributes:
        chi_square: Σ r² where the noise is known, else NaN.
        dof: degrees of freedom.
        chi_square_p: probability of a chi-square this large by chance, else NaN.
        runs: number of runs of one sign, over all tests.
        expected_runs: how many independent residuals would have.
        runs_p: probability of so few runs by chance.
        autocorrelation: of neighbouring residuals along a test.
        significant: whether the misfit is more than noise.
        inflation: factor by which standard errors grow.
    """

    chi_square: float
    dof: int
    chi_square_p: float
    runs: int
    expected_runs: float
    runs_p: float
    autocorrelation: float
    significant: bool
    inflation: float

    @property
    def words(self) -> str:
        """The misfit in a sentence; empty if it looks like noise."""
        if not self.significant:
            return ""
        reasons = []
        if self.chi_square_p < _SIGNIFICANT:
            reasons.append(
                f"chi-square is {self.chi_square:.4g} for {self.dof} degrees of freedom"
            )
        if self.runs_p < _SIGNIFICANT:
            reasons.append(
                f"residuals keep their sign along the tests ({self.runs} runs where noise "
                f"has about {self.expected_runs:.0f})"
            )
        return (
            "the law does not follow the data to within their noise: "
            + " and ".join(reasons)
            + f"; intervals are {self.inflation:.2g} times wider for it"
        )


def misfit(
    paths: Sequence[np.ndarray], constants: int, *, known_noise: bool, exact: float = 0.0
) -> Misfit:
    """Judge residuals.

    Args:
        paths: residuals of each test, in the order along which it deforms.
        constants: number of fitted constants.
        known_noise: the residuals are in units of the known noise.
        exact: residuals below this are rounding and have no pattern.
    """
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
    too_large = bool(chi_square_p < _SIGNIFICANT)
    inflation = 1.0
    if patterned:
        rho = min(max(correlation, 0.0), _MOST_CORRELATED)
        inflation *= np.sqrt((1.0 + rho) / (1.0 - rho))
    if too_large:
        inflation *= np.sqrt(square / dof)
    return Misfit(
        chi_square=square if known_noise else np.nan,
        dof=dof,
        chi_square_p=chi_square_p,
        runs=runs,
        expected_runs=expected,
        runs_p=runs_p,
        autocorrelation=correlation,
        significant=patterned or too_large,
        inflation=float(inflation),
    )


def information_criteria(
    square: float, count: int, constants: int, *, known_noise: bool
) -> tuple[float, float]:
    """AICc and BIC of a least-squares fit, up to a constant of the data.

    Args:
        square: Σ r².
        count: number of readings n.
        constants: number of fitted constants p.
        known_noise: −2 log L = Σ r²; else n log(Σ r²/n), the noise one parameter more.

    Returns:
        AICc = −2 log L + 2k + 2k(k + 1)/(n − k − 1) (infinite for n ≤ k + 1) and
        BIC = −2 log L + k log n.
    """
    k = constants if known_noise else constants + 1
    deviance = square if known_noise else count * np.log(max(square, 1e-300) / count)
    spare = count - k - 1
    aicc = deviance + 2.0 * k + (2.0 * k * (k + 1) / spare if spare > 0 else np.inf)
    return float(aicc), float(deviance + k * np.log(count))
