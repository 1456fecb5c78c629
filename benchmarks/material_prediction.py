"""Bands of modes that were not measured: how often they hold the readings, how wide they are.

`python benchmarks/material_prediction.py [law] [replicas]`: a law (yeoh) is fitted to one or
two modes of published rubbers, and to the uniaxial test of rubbers outside the list of laws;
the 95 % bands of the other modes are compared with their readings. Other modes of made rubbers
are exact: no specimen, machine or noise differs from the first test's. They are compared with
the band of a further test, which allows for that, and with the band of the rubber itself.
"""

import pathlib
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests"))
from rubbers import DATA, Curves, made, published, test_of, unlisted

from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import PATHS, StressTest
from fitting.material.fit.band import half_width, nominal_factors
from fitting.material.fit.fit import fit_material
from suas_jax.runtime.settings import configure

PUBLISHED = ("treloar1944", "kawabata1981", "meunier2008")
KEPT_BACK = (
    ("jones_treloar1975", "uniaxial", "biaxial_difference"),
    ("james1975", "uniaxial", "biaxial"),
    ("bitoh2011", "uniaxial", "equibiaxial"),
    ("bitoh2011", "uniaxial", "pure_shear"),
    ("bitoh2011", "equibiaxial", "uniaxial"),
    ("bitoh2011", "equibiaxial", "pure_shear"),
    ("bitoh2011", "pure_shear", "uniaxial"),
    ("bitoh2011", "pure_shear", "equibiaxial"),
    ("katashima2012", "equibiaxial", "pure_shear"),
    ("katashima2012", "equibiaxial", "biaxial"),
    ("katashima2012", "pure_shear", "equibiaxial"),
    ("kawamura2001", "uniaxial", "equibiaxial"),
    ("kawamura2001", "uniaxial", "biaxial"),
    ("kawamura2001", "equibiaxial", "uniaxial"),
    ("kawamura2001", "equibiaxial", "biaxial"),
)
MEASURED = (("uniaxial",), ("equibiaxial",), ("pure_shear",), ("uniaxial", "pure_shear"))


def judged(
    curves: Curves, measured: tuple[str, ...], law: str, *, exact: bool = False
) -> dict[str, tuple[float, ...]]:
    """Share of readings within the band, and its median half width, relative, by mode.

    `exact`: both also for the band of the rubber itself, without what a further test adds.
    """
    with tempfile.TemporaryDirectory() as folder:
        sets = [test_of(curves, mode, pathlib.Path(folder)) for mode in measured]
    fit = fit_material(sets, law, starts=16, doubt=False)
    found = {}
    for mode in PATHS:
        if mode not in measured:
            stretch, value = curves[mode].T
            band = fit.predict(mode, stretch)
            found[mode] = _told(value, band.nominal, band.half_width)
            if exact:
                factors = nominal_factors(mode, stretch)
                middle, deviation = fit.belief.reading(factors)
                found[mode] += _told(value, middle, half_width(deviation))
    return found


def _told(value: np.ndarray, middle: np.ndarray, half: np.ndarray) -> tuple[float, float]:
    """Share of values within an interval, and its median half width, relative."""
    share = float(np.mean(np.abs(value - middle) <= half))
    return share, float(np.median(half / np.abs(middle)))


def kept_back(law: str) -> list[tuple[float, float]]:
    """Rubbers on which nothing was set: readings of the last mode from a law of the first."""
    found = []
    for name, measured, asked in KEPT_BACK:
        known, states = (
            load_dataset(mode, DATA / f"{name}_{mode}.csv") for mode in (measured, asked)
        )
        assert isinstance(states, StressTest)
        belief = fit_material([known], law, starts=16, doubt=False).belief
        middle, deviation = belief.of_another_test(states.factors, belief.reach)
        share, width = _told(states.value, middle, half_width(deviation))
        print(f"{name:18} {measured:22} {asked:18} {share:4.0%} +-{width:.0%}", flush=True)
        found.append((share, width))
    return found


def main(law: str = "yeoh", replicas: str = "20") -> None:
    """Print the tables."""
    configure()
    for measured in MEASURED:
        for name in PUBLISHED:
            for mode, (share, width) in judged(published(name), measured, law).items():
                print(f"{name:14} {'+'.join(measured):22} {mode:12} {share:4.0%} +-{width:.0%}")
    share, width = np.mean(kept_back(law), axis=0)
    print(f"kept back, mean of {len(KEPT_BACK)}: {share:.0%} +-{width:.0%}")
    rng = np.random.default_rng(0)
    found: dict[str, list[tuple[float, ...]]] = {}
    for _ in range(int(replicas)):
        curves = made(unlisted(rng), rng.uniform(1.5, 3.0), rng, 0.01)
        for mode, pair in judged(curves, ("uniaxial",), law, exact=True).items():
            found.setdefault(mode, []).append(pair)
    for mode, pairs in found.items():
        further, wide, own, narrow = np.mean(pairs, axis=0)
        print(
            f"{replicas} made rubbers  {mode:12} further test {further:.1%} +-{wide:.0%}, "
            f"rubber itself {own:.1%} +-{narrow:.0%}"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
