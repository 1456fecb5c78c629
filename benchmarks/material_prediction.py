"""Bands of modes that were not measured: how often they hold the readings, how wide they are.

`python benchmarks/material_prediction.py [law] [replicas]`: a law (yeoh) is fitted to one or
two modes of published rubbers, and to the uniaxial test of rubbers that are no law of the list;
the 95 % bands of the other modes are compared with their readings.
"""

import pathlib
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests"))
from rubbers import DATA, Curves, made, published, test_of, unlisted

from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import PATHS, StressTest
from fitting.material.fit.band import half_width
from fitting.material.fit.fit import fit_material
from suas_jax.runtime.settings import configure

PUBLISHED = ("treloar1944", "kawabata1981", "meunier2008")
KEPT_BACK = (
    ("jones_treloar1975", "uniaxial", "biaxial_difference"),
    ("james1975", "uniaxial", "biaxial"),
    ("bitoh2011", "uniaxial", "equibiaxial"),
    ("bitoh2011", "uniaxial", "pure_shear"),
    ("bitoh2011", "equibiaxial", "pure_shear"),
    ("katashima2012", "equibiaxial", "biaxial"),
)
MEASURED = (("uniaxial",), ("equibiaxial",), ("pure_shear",), ("uniaxial", "pure_shear"))


def judged(curves: Curves, measured: tuple[str, ...], law: str) -> dict[str, tuple[float, ...]]:
    """Share of readings within the band, and its median half width, relative, by mode."""
    with tempfile.TemporaryDirectory() as folder:
        sets = [test_of(curves, mode, pathlib.Path(folder)) for mode in measured]
    fit = fit_material(sets, law, starts=16, doubt=False)
    found = {}
    for mode in PATHS:
        if mode not in measured:
            band = fit.predict(mode, curves[mode][:, 0])
            off = np.abs(curves[mode][:, 1] - band.nominal)
            width = float(np.median(band.half_width / np.abs(band.nominal)))
            found[mode] = (float(np.mean(off <= band.half_width)), width)
    return found


def kept_back(law: str) -> list[tuple[float, float]]:
    """Rubbers on which nothing was set: readings of the last mode from a law of the first."""
    found = []
    for name, measured, asked in KEPT_BACK:
        known, states = (
            load_dataset(mode, DATA / f"{name}_{mode}.csv") for mode in (measured, asked)
        )
        assert isinstance(states, StressTest)
        belief = fit_material([known], law, starts=16, doubt=False).belief
        middle, deviation = belief.reading(states.factors, belief.repeats)
        half = half_width(deviation)
        share = float(np.mean(np.abs(states.value - middle) <= half))
        width = float(np.median(half / np.abs(middle)))
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
        for mode, pair in judged(curves, ("uniaxial",), law).items():
            found.setdefault(mode, []).append(pair)
    for mode, pairs in found.items():
        share, width = np.mean(pairs, axis=0)
        print(f"{replicas} made rubbers  {mode:12} {share:.1%} +-{width:.0%}")


if __name__ == "__main__":
    main(*sys.argv[1:])
