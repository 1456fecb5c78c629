"""Rubbers measured in several modes, and made ones that no law of the list follows."""

import csv
import pathlib
from collections.abc import Callable

import numpy as np
from scipy import special

from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import PATHS, Dataset

DATA = pathlib.Path(__file__).parent.parent / "configs" / "data"

Curves = dict[str, np.ndarray]
"""Stretch and nominal stress [Pa], shape [n, 2], by mode."""
Energy = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Energy over the shear modulus, from both invariants."""


def _rows(name: str) -> np.ndarray:
    lines = (DATA / f"{name}.csv").read_text().splitlines()
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    return np.array(rows[1:], float)


def published(name: str) -> Curves:
    """Treloar (1944), Kawabata (1981) or Meunier (2008)."""
    if name == "kawabata1981":
        rows = _rows("kawabata1981_general_biaxial")
        chosen = {
            "uniaxial": rows[:, 3] == 0.0,
            "equibiaxial": rows[:, 0] == rows[:, 1],
            "pure_shear": rows[:, 1] == 1.0,
        }
        found = {mode: rows[own][:, [0, 2]] for mode, own in chosen.items()}
    else:
        found = {mode: _rows(f"{name}_{mode}") for mode in PATHS}
    return {mode: curve * [1.0, 1e6] for mode, curve in found.items()}


def gent_gent(share: float, limit: float) -> Energy:
    """Gent's law with C log(I₂/3), whose share of the modulus at rest is given."""
    return lambda i1, i2: (
        -(1.0 - share) * 0.5 * limit * np.log(1.0 - (i1 - 3.0) / limit)
        + 1.5 * share * np.log(i2 / 3.0)
    )


def lopez_pamies(first: float, second: float, stiffening: float) -> Energy:
    """Two powers of I₁."""

    def energy(i1: np.ndarray, i2: np.ndarray) -> np.ndarray:
        terms = ((1.0, first), (stiffening, second))
        return sum(
            m * 3.0 ** (1.0 - a) / (2.0 * a) * (i1**a - 3.0**a) for m, a in terms
        ) + 0.0 * np.asarray(i2)

    return energy


def alexander(share: float, growth: float, offset: float) -> Energy:
    """exp(γ(I₁ - 3)²) under the integral, and log(1 + (I₂ - 3)/offset)."""

    def energy(i1: np.ndarray, i2: np.ndarray) -> np.ndarray:
        root = np.sqrt(growth)
        first = 0.5 * np.sqrt(np.pi) / root * special.erfi(root * (i1 - 3.0))
        return 0.5 * (1.0 - share) * first + 0.5 * share * offset * np.log1p(
            (i2 - 3.0) / offset
        )

    return energy


def unlisted(rng: np.random.Generator) -> Energy:
    """A rubber that no law of the list is."""
    kind = rng.integers(3)
    if kind == 0:
        return gent_gent(rng.uniform(0.0, 0.4), rng.uniform(15.0, 90.0))
    if kind == 1:
        powers = rng.uniform(0.5, 0.95), rng.uniform(1.5, 3.0)
        return lopez_pamies(*powers, rng.uniform(0.001, 0.02))
    return alexander(rng.uniform(0.05, 0.4), rng.uniform(5e-4, 5e-3), rng.uniform(0.5, 4.0))


def stress(energy: Energy, mode: str, stretch: np.ndarray, modulus: float = 4e5) -> np.ndarray:
    """Nominal stress [Pa] of an energy."""
    ratio = {"uniaxial": -0.5, "equibiaxial": 1.0, "pure_shear": 0.0}[mode]

    def along(e: np.ndarray) -> np.ndarray:
        squares = np.exp(2.0 * e), np.exp(2.0 * ratio * e), np.exp(-2.0 * (1.0 + ratio) * e)
        i2 = np.asarray(sum(1.0 / x for x in squares))
        return energy(np.asarray(sum(squares)), i2)

    e, step = np.log(stretch), 1e-5
    work = (along(e + step) - along(e - step)) / (2.0 * step)
    return modulus * work / stretch / (2.0 if mode == "equibiaxial" else 1.0)


def made(energy: Energy, farthest: float, rng: np.random.Generator, noise: float) -> Curves:
    """Tests of all three modes; the uniaxial one has noise, relative to each reading."""
    stretch = np.linspace(1.0, farthest, 26)[1:]
    found = {}
    for mode in PATHS:
        own = 1.0 + 0.55 * (stretch - 1.0) if mode == "equibiaxial" else stretch
        found[mode] = np.stack([own, stress(energy, mode, own)], axis=1)
    found["uniaxial"][:, 1] *= 1.0 + noise * rng.standard_normal(len(stretch))
    return found


def test_of(curves: Curves, mode: str, folder: pathlib.Path) -> Dataset:
    """One mode as a file of measurements that is read again."""
    file = folder / f"{mode}.csv"
    rows = [f"{x:.10g},{y:.10g}" for x, y in curves[mode]]
    file.write_text("\n".join(["stretch,nominal_stress_Pa", *rows]))
    return load_dataset(mode, file)


test_of.__test__ = False  # type: ignore[attr-defined]
