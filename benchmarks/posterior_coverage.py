"""Does the posterior cover the truth as often as it says?

    python benchmarks/posterior_coverage.py [DATA_SETS]

Synthetic uniaxial and equibiaxial tests of a one-term Ogden rubber with 1 % noise, the noise
not told to the fit. Each data set is sampled by emcee until its chain has converged; the
table counts how often the truth lies inside the 68 % and 95 % intervals, with the exact
two-sided binomial p-value of that count.
"""

import dataclasses
import pathlib
import sys

import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.fit import fit_material
from fitting.material.fit.material_posterior import sample_material
from fitting.material.fit.problem import pose
from fitting.material.laws.registry import family
from fitting.statistics.posterior import Settings
from suas_jax.constitutive import Ogden

DATA = pathlib.Path(__file__).parent.parent / "configs" / "data"
TRUTH = np.array([3.5e5, 2.4])
NOISE = 0.01
NAMES = ("mu", "alpha", "noise")


def made(sets: list[Dataset], seed: int) -> list[Dataset]:
    """The tests of the true law with noise."""
    rng = np.random.default_rng(seed)
    law = Ogden(jnp.asarray(TRUTH[:1]), jnp.asarray(TRUTH[1:]))
    noisy = []
    for data in sets:
        test = pose([data], family("neo-hookean"), "absolute").residuals.experiments[0]
        exact = np.asarray(test.predict(law))[: data.size]
        value = exact * (1.0 + NOISE * rng.standard_normal(data.size))
        noisy.append(dataclasses.replace(data, value=value))
    return noisy


def inside(sets: list[Dataset], seed: int) -> tuple[np.ndarray, bool]:
    """Whether the truth lies in the 68 % and 95 % intervals, shape [2, 3]; converged."""
    fit = fit_material(made(sets, seed), "ogden", 1)
    found = sample_material(fit, Settings(seed=seed))
    theta = found.posterior.samples
    draws = np.column_stack([found.constants(theta), np.exp(theta[:, -1])])
    truth = np.append(TRUTH, NOISE)
    ends = np.percentile(draws, [16, 84, 2.5, 97.5], axis=0).reshape(2, 2, 3)
    return (ends[:, 0] <= truth) & (truth <= ends[:, 1]), found.posterior.converged


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    sets = [
        load_dataset(mode, DATA / f"treloar1944_{mode}.csv")
        for mode in ("uniaxial", "equibiaxial")
    ]
    results = [inside(sets, seed) for seed in range(count)]
    hits = np.sum([hit for hit, _ in results], axis=0)
    print(f"{count} data sets, {sum(done for _, done in results)} chains converged")
    for level, row in zip((0.68, 0.95), hits, strict=True):
        for name, inside_count in zip(NAMES, row, strict=True):
            p = stats.binomtest(int(inside_count), count, level).pvalue
            print(f"{name:6s} in {100 * level:.0f} %: {inside_count} of {count}, p = {p:.3f}")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
