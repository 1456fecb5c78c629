"""Uncertainty of a law's constants, as a skin file states it."""

import numpy as np
from jaxtyping import Float
from scipy import stats

from fitting.material.experiments.measurements import PATHS
from fitting.material.fit.band import Belief, nominal_factors
from fitting.material.fit.fitted_law import FittedLaw

# A skin stretches by this much where nothing else is asked for.
_STRETCH = 1.05
# Combinations that the data leave open may change by their natural size: the signs of a law's
# constants hold, and so do small steps along them.
_OPEN = 1.0


def constants_root(
    fit: FittedLaw, belief: Belief, constants: Float[np.ndarray, " p"], up_to: float | None
) -> Float[np.ndarray, "k n"]:
    """R of the constants that a file states, with R Rᵀ their covariance, SI units.

    Three errors add: what the readings leave open of the constants together, zeros of the tests
    included; how specimens of one rubber scatter, for a skin is a further one; and how far the
    law is off in plane strain, the skin's own state, if that was not measured or the law does
    not follow it. The last two are factors on all stresses.

    `constants`: of the law and of what is beside
    it, but for the tests' zeros, shape [k]. `up_to`: largest stretch of the skin; None for
    1.05.
    """
    count = len(constants)
    # A file's deviations are read as normal: Student's t of few readings is wider.
    normal = float(stats.norm.ppf(0.975))
    wider = fit.uncertainty.quantile(0.95) / normal
    own = wider * fit.uncertainty.root[:count]
    size = np.maximum(np.abs(constants), 1e-300)
    u, s, _ = np.linalg.svd(own / size[:, None], full_matrices=False)
    own = size[:, None] * (u * np.minimum(s, _OPEN))
    largest = _STRETCH if up_to is None else up_to
    stretch = np.array([largest])
    # What is known of the stresses there is known of the constants, however ill the law follows
    # the data elsewhere.
    off, slopes = {}, {}
    for mode in PATHS:
        middle, deviation = belief.stress(mode, stretch, largest)
        law, slope = fit.stress(nominal_factors(mode, stretch))
        off[mode] = float(np.hypot(deviation[0], middle[0] - law[0]) / law[0])
        slopes[mode] = slope[0, :count] / law[0]
    seen = np.stack([slopes[mode] @ own / off[mode] for mode in PATHS])
    _, s, vt = np.linalg.svd(seen)
    shrunk = np.ones(own.shape[1])
    shrunk[: len(s)] = 1.0 / np.sqrt(1.0 + s[: own.shape[1]] ** 2)
    own = own @ vt.T * shrunk
    told = float(np.linalg.norm(slopes["pure_shear"] @ own))
    scatter = 0.0 if fit.specimens is None else fit.specimens.scatter.further / normal
    # How tests of two modes repeat is how their specimens scatter, where that is not known.
    repeats = 0.0 if "pure_shear" in belief.measured else belief.repeats
    factor = max(off["pure_shear"] ** 2 - told**2 - repeats**2, 0.0)
    factor = np.sqrt(factor + max(scatter, repeats) ** 2)
    stresses = fit.family.stresses[:count] & (np.arange(count) < fit.family.law_size)
    return np.column_stack([own, np.where(stresses, factor * constants, 0.0)])
