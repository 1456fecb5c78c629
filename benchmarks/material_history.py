"""Coverage of the intervals of Prony and Mullins constants over synthetic tests.

    python benchmarks/material_history.py [REPLICAS]

Relaxation: ramp of 0.1 s to a strain of 50 %, held for 200 s, 71 readings, instantaneous
modulus 0.5 MPa, g = 0.2 and 0.15, tau = 0.5 and 20 s. Cycles: four of them to stretches of 1.3,
1.6, 2.0 and 2.4, 316 readings, modulus 0.5 MPa, r = 1.8, m = 50 kPa, beta = 0.1. Noise of 1 %
of each reading: normal, with heavy tails (Student's t with 3 degrees of freedom, same standard
deviation), or correlated (0.6 from reading to reading). Printed: share of intervals that hold
the truth, by constant, and how often the number of Prony terms is found.
"""

import math
import pathlib
import sys
import tempfile
import time

import numpy as np

from suas_jax.runtime.settings import configure

configure()

from fitting.material.experiments.datasets import load_dataset  # noqa: E402
from fitting.material.fit.comparison import choose_prony_terms  # noqa: E402
from fitting.material.fit.fit import fit_material  # noqa: E402

MU, G, TAU = 0.5e6, np.array([0.2, 0.15]), np.array([0.5, 20.0])
RAMP, STRAIN = 0.1, 0.5
SOFTENING = (1.8, 5e4, 0.1)
NOISES = ("normal", "heavy tails", "correlated")


def relaxation() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, stretches and exact nominal stresses of the relaxation test."""
    clock = np.concatenate([np.linspace(0.0, RAMP, 11), RAMP + np.logspace(-2.0, 2.3, 60)])
    fine = np.unique(np.concatenate([np.linspace(0.0, RAMP, 4001), clock]))
    stretch = 1.0 + STRAIN * np.minimum(fine / RAMP, 1.0)
    tau = MU * (stretch**2 - 1.0 / stretch)
    pulled = np.stack([2.0 / 3.0 * tau / stretch**2, -tau / 3.0 * stretch])
    total = (1.0 - G.sum()) * pulled
    for g, tau_i in zip(G, TAU, strict=True):
        branch = np.zeros_like(pulled)
        for i in range(1, len(fine)):
            step = fine[i] - fine[i - 1]
            change = pulled[:, i] - pulled[:, i - 1]
            branch[:, i] = branch[:, i - 1] * np.exp(-step / tau_i)
            branch[:, i] += g * change * np.exp(-0.5 * step / tau_i)
        total += branch
    stress = stretch * total[0] - total[1] / stretch**2
    at = np.searchsorted(fine, clock)
    return clock, stretch[at], stress[at]


def cycles() -> tuple[np.ndarray, np.ndarray]:
    """Stretches and exact nominal stresses of the cyclic test."""
    parts = []
    for top in (1.3, 1.6, 2.0, 2.4):
        up = np.linspace(1.0, top, 40)
        parts += [up, up[-2::-1]]
    stretch = np.concatenate(parts)
    energy = 0.5 * MU * (stretch**2 + 2.0 / stretch - 3.0)
    largest = np.maximum.accumulate(energy)
    r, m, beta = SOFTENING
    eta = [
        1.0 - math.erf((top - now) / (m + beta * top)) / r
        for top, now in zip(largest, energy, strict=True)
    ]
    return stretch, np.array(eta) * MU * (stretch - stretch**-2)


def noise(kind: str, rng: np.random.Generator, count: int) -> np.ndarray:
    """Noise of unit standard deviation."""
    if kind == "heavy tails":
        return rng.standard_t(3.0, count) / math.sqrt(3.0)
    drawn = rng.standard_normal(count)
    if kind == "correlated":
        for i in range(1, count):
            drawn[i] = 0.6 * drawn[i - 1] + 0.8 * drawn[i]
    return drawn


def write(file: pathlib.Path, head: str, *columns: np.ndarray) -> pathlib.Path:
    """A file of readings."""
    rows = ("".join(f"{x:.9g}," for x in row)[:-1] for row in zip(*columns, strict=True))
    file.write_text(head + "\n" + "\n".join(rows) + "\n")
    return file


def coverage(kind: str, which: str, replicas: int, folder: pathlib.Path) -> str:
    """One line: share of 68 % and 95 % intervals that hold the truth, by constant."""
    rng = np.random.default_rng(0)
    inside: dict[float, list[np.ndarray]] = {0.6827: [], 0.95: []}
    flagged, named, modulus = 0, (), []
    begin = time.process_time()
    for _ in range(replicas):
        if which == "relaxation":
            clock, stretch, exact = relaxation_data
            truth = np.array([MU * (1.0 - G.sum()), *G, *TAU])
            noisy = exact * (1.0 + 0.01 * noise(kind, rng, len(exact)))
            file = write(folder / "r.csv", "time_s,stretch,stress_Pa", clock, stretch, noisy)
            options = {"prony": 2}
        else:
            stretch, exact = cycles_data
            truth = np.array([MU, *SOFTENING])
            noisy = exact * (1.0 + 0.01 * noise(kind, rng, len(exact)))
            file = write(folder / "c.csv", "stretch,nominal_stress_Pa", stretch, noisy)
            options = {"mullins": True}
        fit = fit_material([load_dataset("uniaxial", file)], "neo-hookean", **options)
        named = fit.family.names
        flagged += fit.misfit.significant
        for level, found in inside.items():
            low, high = fit.intervals(level)
            found.append((low <= truth) & (truth <= high))
        modulus.append(fit.constants[0] / truth[0])
    shares = " ".join(
        f"{name.split('.', 1)[-1]} {100 * a:.0f}/{100 * b:.0f}"
        for name, a, b in zip(
            named, *(np.mean(found, axis=0) for found in inside.values()), strict=True
        )
    )
    seconds = (time.process_time() - begin) / replicas
    return (
        f"{which}, {kind}: {shares} (68/95 %); called a misfit {flagged} of {replicas}; "
        f"{seconds:.2f} s of processor time a fit"
    )


def terms_found(replicas: int, folder: pathlib.Path) -> str:
    """How often two terms are chosen of data with two."""
    rng = np.random.default_rng(1)
    clock, stretch, exact = relaxation_data
    counts: dict[int, int] = {}
    for _ in range(replicas):
        noisy = exact * (1.0 + 0.01 * noise("normal", rng, len(exact)))
        file = write(folder / "r.csv", "time_s,stretch,stress_Pa", clock, stretch, noisy)
        found = choose_prony_terms([load_dataset("uniaxial", file)], "neo-hookean", None)
        count = found.best.family.prony  # type: ignore[attr-defined]
        counts[count] = counts.get(count, 0) + 1
    return f"Prony terms chosen, of two in the data: {counts}"


relaxation_data = relaxation()
cycles_data = cycles()

if __name__ == "__main__":
    replicas = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory() as name:
        for which in ("relaxation", "cycles"):
            for kind in NOISES:
                print(coverage(kind, which, replicas, pathlib.Path(name)), flush=True)
        print(terms_found(max(replicas // 4, 1), pathlib.Path(name)), flush=True)
