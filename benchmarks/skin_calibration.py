"""Calibrating a membrane from its skin's own curve, when the truth is not the fitted model.

    python benchmarks/skin_calibration.py [CURVES]

The curve (force, displacement, oil pressure; 20 forces) is computed by the solid model for
the paper's EPDM; 1 % noise is added, and the lumped shell is fitted. Printed are

- the model's share: constants fitted to the curve without noise against the truth,
- coverage: how often the intervals of 2 (C1 + C2) contain the truth, with exact binomial
  p-values, once alone and once with C3 fitted too,
- what the fit says about what the curve can't tell,
- one sampled curve: 32 walkers, 2,000 steps, equilibria per second.
"""

import pathlib
import sys
import tempfile
import time

import numpy as np
from scipy import stats

from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.fit import fit_material
from fitting.material.fit.material_posterior import sample_material
from fitting.material.fit.result import MaterialFit
from fitting.statistics.posterior import Settings
from suas_jax import configure, sweep
from suas_jax.config import load_scene, with_solve

SCENE = pathlib.Path(__file__).parent.parent / "configs" / "scenes" / "case_a.toml"
FORCE = np.linspace(1.5, 30.0, 20)
NOISE = 0.01
C1, C2, C3 = 20.7e6, -4.4e6, 77e3
MODULUS = 2.0 * (C1 + C2)


def exact() -> tuple[np.ndarray, np.ndarray]:
    """Displacements [m] and oil pressures [Pa] of the solid."""
    scene = with_solve(load_scene(SCENE), oil_pressure=None, model="solid", mesh=[120, 2])
    points = sweep(scene, forces=FORCE).points
    moved = [point["loads"][0]["displacement_m"] for point in points]
    return np.array(moved), np.array([point["oil_pressure_Pa"] for point in points])


def measured(truth: tuple[np.ndarray, np.ndarray], noise: float, seed: int) -> Dataset:
    """The curve as a file with relative noise, read like a user's."""
    rng = np.random.default_rng(seed)
    u, p = (x * (1.0 + noise * rng.standard_normal(x.size)) for x in truth)
    rows = [f"{f},{1e3 * a},{1e-3 * b}" for f, a, b in zip(FORCE, u, p, strict=True)]
    lines = [f"# noise: {100 * NOISE} %", "force_N,displacement_mm,oil_pressure_kPa", *rows]
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "curve.csv"
        file.write_text("\n".join(lines))
        return load_dataset("skin", file, scene=SCENE)


def fitted(data: Dataset, terms: int) -> MaterialFit:
    return fit_material([data], "mooney-rivlin", terms, residual="noise")


def study(truth: tuple[np.ndarray, np.ndarray], terms: int, curves: int) -> None:
    """Print bias, coverage and what is said to be open for a number of constants."""
    free = fitted(measured(truth, 0.0, 0), terms)
    # Residuals without noise have a pattern, which widens their own intervals.
    value, *_ = free.shear_modulus()
    _, low, high = fitted(measured(truth, NOISE, 0), terms).shear_modulus(0.6827)
    error = 0.5 * (high - low)
    print(f"\nmooney-rivlin with {terms} constants")
    print(
        f"  without noise: 2 (C1 + C2) = {value / 1e6:.4f} MPa, {value / MODULUS - 1:+.2e} of "
        f"the truth ({(value - MODULUS) / error:+.2f} standard errors at 1 % noise); "
        f"chi-square {2 * free.cost:.3f}; allowed for: "
        f"{100 * free.problem.model_error:.2f} % of displacement and pressure"
    )
    print(f"  said to be open: {'; '.join(free.uncertainty.unidentifiable)}")
    hits, deviations, widths = np.zeros(2, int), [], []
    begin = time.perf_counter()
    for seed in range(curves):
        fit = fitted(measured(truth, NOISE, seed), terms)
        for i, level in enumerate((0.6827, 0.95)):
            value, low, high = fit.shear_modulus(level)
            hits[i] += low <= MODULUS <= high
        deviations.append(value / MODULUS - 1)
        widths.append((high - low) / MODULUS)
    seconds = (time.perf_counter() - begin) / curves
    print(
        f"  {curves} curves: mean deviation {100 * np.mean(deviations):+.3f} %, scatter "
        f"{100 * np.std(deviations):.3f} %, 95 % interval {100 * np.median(widths):.2f} % "
        f"wide; {seconds:.1f} s a fit"
    )
    for level, inside in zip((0.68, 0.95), hits, strict=True):
        chance = stats.binomtest(int(inside), curves, level).pvalue
        print(f"  truth inside the {100 * level:.0f} %: {inside} of {curves}, p = {chance:.3f}")


def sampled(truth: tuple[np.ndarray, np.ndarray], terms: int) -> None:
    """Print what one posterior says, and how fast it came."""
    begin = time.perf_counter()
    fit = fitted(measured(truth, NOISE, 0), terms)
    between = time.perf_counter()
    found = sample_material(fit, Settings(steps=2000, stop=False)).report
    end = time.perf_counter()
    modulus = found["shear_modulus_Pa"]
    print(
        f"\nposterior with {terms} constants, 20 forces, 32 walkers, 2,000 steps: fit "
        f"{between - begin:.1f} s, sampling with compilation {end - between:.1f} s, "
        f"{found['equilibria_per_s']:.0f} equilibria per second"
    )
    print(f"  {found['message']}")
    print(
        f"  2 (C1 + C2): {modulus['median'] / 1e6:.3f} MPa, 95 % from "
        f"{modulus['low95'] / 1e6:.3f} to {modulus['high95'] / 1e6:.3f}; truth "
        f"{MODULUS / 1e6:.3f}"
    )
    print(f"  prior, not data: {'; '.join(found['prior_dominated'])}")
    low, high = found["intervals"]["95"]["C3"] if terms == 3 else (np.nan, np.nan)
    if terms == 3:
        print(f"  C3: 95 % from {low / 1e6:.3g} to {high / 1e6:.3g} MPa; truth {C3 / 1e6:g}")


def main() -> None:
    curves = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    truth = exact()
    for terms in (2, 3):
        study(truth, terms, curves)
    for terms in (2, 3):
        sampled(truth, terms)


if __name__ == "__main__":
    configure()
    main()
