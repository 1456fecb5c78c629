"""Material calibration: speed against SciPy, published constants, coverage, robustness.

Prints the tables of docs/material_method.md. Run from the repository's root:

    python benchmarks/material_calibration.py [scipy] [coverage] [misfit] [random] [noise]
"""

import contextlib
import pathlib
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from unittest import mock

import jax.numpy as jnp
import numpy as np
import scipy.optimize

from fitting.material.experiments import measurements
from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.fit import fit_material
from fitting.material.fit.problem import pose
from fitting.material.fit.search import NoFit
from fitting.material.laws.parameters import Family
from fitting.material.laws.registry import family
from fitting.material.report.summary import material_report
from fitting.statistics.least_squares import minimise
from suas_jax import configure
from suas_jax.constitutive import AbstractLaw

DATA = "configs/data/"
TABLE_1 = np.array([6.3e5, 0.012e5, -0.1e5, 1.3, 5.0, -2.0])


def treloar() -> list[Dataset]:
    return [
        load_dataset(mode, f"{DATA}treloar1944_{mode}.csv")
        for mode in ("uniaxial", "equibiaxial", "pure_shear")
    ]


def against_scipy() -> None:
    """Ogden-3 on three modes: 64 starts here, 200 SciPy least-squares starts."""
    for kind in ("relative", "absolute"):
        law = family("ogden", 3)
        problem = pose(treloar(), law, kind)
        starts = law.random(np.random.default_rng(0), 64)
        minimise(problem.residuals, starts)
        times = []
        for _ in range(5):
            begin = time.process_time()
            found = minimise(problem.residuals, starts)
            times.append(time.process_time() - begin)
        ours = statistics.median(times)
        begin = time.process_time()
        best, good = _scipy(problem.residuals, np.random.default_rng(1), 200)
        theirs = time.process_time() - begin
        published = problem.residuals.of_constants(jnp.asarray(TABLE_1))
        used = int(problem.residuals.used.sum())
        rms = [
            float(np.sqrt(2 * cost / used))
            for cost in (found.cost[0], 0.5 * float(jnp.sum(published**2)))
        ]
        print(
            f"{kind}: cost {found.cost[0]:.10g} ({found.agreeing} of 16 finalists agree), "
            f"SciPy best of 200 {best:.10g} ({good} within 1e-6), relative difference "
            f"{found.cost[0] / best - 1:.1e}"
        )
        print(f"  rms of residuals {rms[0]:.5f}, Table I {rms[1]:.5f}")
        print(
            f"  processor time: {ours:.3f} s (64 starts), SciPy {theirs:.2f} s: "
            f"{theirs / ours:.0f} times"
        )


def _scipy(residuals: object, rng: np.random.Generator, count: int) -> tuple[float, int]:
    """Plain NumPy Ogden, log shares and exponents, analytic-free Jacobian (2-point)."""
    test = residuals.experiments[0]  # type: ignore[attr-defined]
    used = residuals.used  # type: ignore[attr-defined]
    e1, e2, c1, c2 = (np.asarray(x)[used] for x in (test.e1, test.e2, test.c1, test.c2))
    value = np.asarray(residuals.value)[used]  # type: ignore[attr-defined]
    inverse = np.asarray(residuals.inverse_scale)[used]  # type: ignore[attr-defined]

    def misfit(theta: np.ndarray) -> np.ndarray:
        share, alpha = 4e5 * np.exp(theta[:3]), theta[3:]
        alpha = np.where(np.abs(alpha) < 1e-4, 1e-4, alpha)
        third = np.exp(-np.outer(e1 + e2, alpha))
        mu = 2.0 * share / alpha
        tau_1 = (np.exp(np.outer(e1, alpha)) - third) @ mu
        tau_2 = (np.exp(np.outer(e2, alpha)) - third) @ mu
        return (c1 * tau_1 + c2 * tau_2 - value) * inverse

    costs = []
    with np.errstate(all="ignore"):
        for _ in range(count):
            alpha = rng.uniform(-6.0, 8.0, 3)
            start = np.concatenate([rng.uniform(-3.0, 1.0, 3) - 1.5 * np.abs(alpha), alpha])
            try:
                costs.append(
                    scipy.optimize.least_squares(
                        misfit, start, method="lm", xtol=1e-12, ftol=1e-12, max_nfev=2000
                    ).cost
                )
            except ValueError:
                costs.append(np.inf)
    best = min(costs)
    return best, sum(cost <= best * (1 + 1e-6) for cost in costs)


def synthetic(
    law: AbstractLaw, rng: np.random.Generator, noise: float, sets: list[Dataset]
) -> list[Dataset]:
    """The same tests with readings made by a law and relative Gaussian noise."""
    made = []
    for data in sets:
        problem = pose([data], Family("given", (), lambda: law), "absolute")
        exact = np.asarray(problem.residuals.predict(jnp.zeros(0)))[: data.size]
        sigma = noise * np.abs(exact)
        value = exact + sigma * rng.standard_normal(data.size)
        made.append(_replaced(data, value, sigma))
    return made


def _replaced(data: Dataset, value: np.ndarray, sigma: np.ndarray) -> Dataset:
    import dataclasses

    return dataclasses.replace(data, value=value, sigma=sigma)


def coverage(count: int = 200, only: str = "") -> None:
    """Share of synthetic data sets whose intervals contain the true constants."""
    cases: dict[str, tuple[Family, np.ndarray]] = {
        "mooney-rivlin": (family("mooney-rivlin", 2), np.array([1.8e5, 1.2e4])),
        "yeoh": (family("yeoh", 3), np.array([1.9e5, -1.8e3, 44.0])),
        "gent": (family("gent"), np.array([3.0e5, 90.0])),
        "ogden-2": (family("ogden", 2), np.array([5e5, 800.0, 1.5, 5.2])),
        "ogden-3": (family("ogden", 3), TABLE_1[[0, 2, 1, 3, 5, 4]]),
    }
    sets = treloar()
    for name, (law, truth) in cases.items():
        if only and name != only:
            continue
        for kind in ("relative", "noise"):
            rng = np.random.default_rng(7)
            inside = {0.6827: [], 0.95: []}  # type: ignore[var-annotated]
            failed = 0
            begin = time.perf_counter()
            for _ in range(count):
                made = synthetic(law.law(jnp.asarray(truth)), rng, 0.02, sets)
                try:
                    fit = fit_material(made, law, residual=kind, starts=16)
                except NoFit:
                    failed += 1
                    for hits in inside.values():
                        hits.append(np.zeros(law.size))
                    continue
                good = fit.status != "not_converged"
                failed += not good
                for level, hits in inside.items():
                    low, high = fit.intervals(level)
                    hits.append(good & (low <= truth) & (truth <= high))
            shares = {level: 100 * np.mean(hits, axis=0) for level, hits in inside.items()}
            text = "  ".join(
                f"{100 * level:.0f} %: {np.round(share, 1)} mean {share.mean():.1f}"
                for level, share in shares.items()
            )
            seconds = (time.perf_counter() - begin) / count
            print(f"{name:14s} {kind:8s} {text}  failed {failed}  {1e3 * seconds:.0f} ms each")


def misspecified(count: int = 50) -> None:
    """Data of one law fitted by another: is it said, and is the modulus covered?"""
    sets = treloar()
    makers = {
        "ogden-3": family("ogden", 3).law(jnp.asarray(TABLE_1)),
        "yeoh": family("yeoh", 3).law(jnp.asarray([1.9e5, -1.8e3, 44.0])),
        "gent": family("gent").law(jnp.asarray([3.0e5, 90.0])),
    }
    pairs = [
        ("ogden-3", "mooney-rivlin", 3),
        ("ogden-3", "neo-hookean", 1),
        ("ogden-3", "yeoh", 3),
        ("ogden-3", "gent", 1),
        ("yeoh", "ogden", 1),
        ("yeoh", "gent", 1),
        ("gent", "yeoh", 3),
        ("gent", "mooney-rivlin", 2),
    ]
    for maker, name, terms in pairs:
        truth = float(makers[maker].shear_modulus)
        for kind in ("relative", "noise"):
            rng = np.random.default_rng(3)
            said, covered, widths = 0, 0, []
            for _ in range(count):
                made = synthetic(makers[maker], rng, 0.02, sets)
                fit = fit_material(made, name, terms, residual=kind, starts=16)
                said += fit.misfit.significant
                low, high = modulus_interval(fit)
                covered += low <= truth <= high
                widths.append((high - low) / truth)
            print(
                f"{maker} data, {name} {kind}: misfit said {said}/{count}, 95 % interval of "
                f"the shear modulus contains the truth {covered}/{count}, width "
                f"{100 * np.median(widths):.0f} %"
            )


def modulus_interval(fit: object, level: float = 0.95) -> tuple[float, float]:
    import jax

    value, slope = jax.value_and_grad(lambda c: fit.family.law(c).shear_modulus)(  # type: ignore[attr-defined]
        jnp.asarray(fit.constants)  # type: ignore[attr-defined]
    )
    variance = float(slope @ fit.uncertainty.covariance @ slope)  # type: ignore[attr-defined]
    half = fit.uncertainty.quantile(level) * np.sqrt(variance)  # type: ignore[attr-defined]
    return float(value) - half, float(value) + half


def random_cases(count: int = 1000) -> None:
    """Random laws, data, noise and starts: every case converges or is named."""
    rng = np.random.default_rng(11)
    sets = treloar()
    choices = [("neo-hookean", 1), ("mooney-rivlin", 3), ("yeoh", 3), ("gent", 1)]
    choices += [("arruda-boyce", 1), ("polynomial", 3), *(("ogden", n) for n in range(1, 5))]
    outcomes: dict[str, int] = {}
    for case in range(count):
        chosen = [data for data in sets if rng.uniform() < 0.6] or [sets[rng.integers(3)]]
        made = []
        for data in chosen:
            keep = np.sort(rng.permutation(data.size)[: rng.integers(1, data.size + 1)])
            part = data.select(keep)
            size = 10 ** rng.uniform(-3, 3)
            noise = 10 ** rng.uniform(-4, 0.5)
            value = part.value * size * (1 + noise * rng.standard_normal(part.size))
            if rng.uniform() < 0.1:
                value = -value
            if rng.uniform() < 0.1:
                value = 0.0 * value
            made.append(_replaced(part, value, np.maximum(np.abs(value), 1.0)))
        name, terms = choices[rng.integers(len(choices))]
        kind = ("relative", "absolute", "noise")[rng.integers(3)]
        try:
            fit = fit_material(made, name, terms, residual=kind, starts=16, seed=case)
            report = material_report(fit)
            outcome = report["status"]
            finite = np.all(np.isfinite(fit.constants)) and np.all(
                np.isfinite(fit.uncertainty.standard_errors)
            )
            outcome += "" if finite else ", not finite"
        except NoFit:
            outcome = "no fit (named)"
        except ValueError as error:
            outcome = f"refused: {str(error)[:40]}"
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
    print(f"{count} random cases: {outcomes}")


def noisy_curve(count: int = 20) -> None:
    """Mooney-Rivlin from one tensile curve with the noise of a load cell.

    RMS error of C1, and how often 95 % intervals hold it: relative residuals with a floor of
    1 % of the median alone, with the scatter near rest as well, and weighed by the noise.
    """
    stretch, true = np.linspace(1.0, 3.0, 120), 110e3
    stress = 2 * (true + 20e3 / stretch) * (stretch - stretch**-2)
    for share in (0.001, 0.006, 0.016):
        found: dict[str, list[tuple[float, bool]]] = {}
        for seed in range(count):
            noise = share * stress[-1] * np.random.default_rng(seed).normal(size=120)
            with tempfile.TemporaryDirectory() as folder:
                file = pathlib.Path(folder) / "curve.csv"
                rows = np.column_stack([stretch, stress + noise])
                header = "stretch_1,nominal_stress_Pa"
                np.savetxt(file, rows, "%.9g", ",", header=header, comments="")
                data = load_dataset("uniaxial", file)
            quiet = mock.patch.object(measurements, "least_size", return_value=0.0)
            for name, kind, change in (
                ("1 % of the median", "relative", quiet),
                ("and the scatter", "relative", contextlib.nullcontext()),
                ("estimated", "estimated", contextlib.nullcontext()),
            ):
                own = found.setdefault(name, [])
                with change, contextlib.suppress(NoFit):
                    fit = fit_material(
                        [data], "mooney-rivlin", residual=kind, starts=8, doubt=False
                    )
                    low, high = fit.intervals(0.95)[:, 0]
                    own.append((fit.constants[0] / true - 1, low <= true <= high))
        print(f"noise of {100 * share:.1f} % of the largest stress, {count} curves")
        for name, rows_of in found.items():
            errors, inside = np.array(rows_of).T
            rms = 100 * np.sqrt(np.mean(errors**2))
            held, lost = 100 * inside.mean(), count - len(inside)
            print(f"  {name:18} C1 to {rms:5.1f} %, held {held:.0f} %; {lost} without a fit")


def main() -> None:
    configure()
    studies: dict[str, Callable[[], None]] = {
        "scipy": against_scipy,
        "coverage": coverage,
        "misfit": misspecified,
        "random": random_cases,
        "noise": noisy_curve,
    }
    for name in sys.argv[1:] or studies:
        print(f"--- {name}")
        studies[name]()


if __name__ == "__main__":
    main()
