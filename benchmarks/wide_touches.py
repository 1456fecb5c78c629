"""Straps, palms and many fingers on a small pad beside pokes and strips: docs/load_evidence.md.

    python -m benchmarks.wide_touches [--pressure-noise PA] [--load-fields]

A pad of 5 mm rubber with 35 taxels; its table has 16 x 14 elements. Readings are solved on
24 x 20 graded ones, with 2 counts of noise and rounding; touches within 0.1 mm of the wall are
left out. Wrong: `ok` or `imprecise`, and the sum of forces is off by more than 10 %. The table
takes two minutes of processor time, the readings one, the estimates three.
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.inverse_load import measured
from fitting.arrays import Floats
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.pad.table import PadResolution
from suas_jax import configure
from suas_jax.config import SkinSpec, load_skin
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import skin_of
from tests.test_pad_estimation import small_pad

_SLOTS = 9  # discs of a touch: one program for all
_PLACES = np.array([0.6, 0.03])  # over the taxels [rad], [m]
_RESOLUTION = PadResolution((16, 14), 8e-3, (3, 3), (24, 20))
_FINGERS = {"two": (20, 20e-3), "three": (15, 20e-3), "four": (15, 20e-3), "five": (15, 18e-3)}


def loaded_pad() -> SkinSpec:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "skin.toml"
        path.write_text(small_pad())
        return load_skin(path)


def touches(random: np.random.Generator, radius: float) -> list[tuple[str, Floats]]:
    """Kinds, and discs [disc, (angle, axial, force, diameter)]."""
    found: list[tuple[str, Floats]] = []

    def place(share: float = 1.0) -> Floats:
        return random.uniform(-share, share, 2) * _PLACES

    def force(low: float, high: float) -> float:
        return float(np.exp(random.uniform(*np.log([low, high]))))

    def row(middle: Floats, way: float, length: float, total: float, size: float) -> Floats:
        count = 5 if size < 10e-3 else _SLOTS
        steps = ((np.arange(count) - (count - 1) / 2) / count * length)[:, None]
        places = middle + steps * [np.cos(way) / radius, np.sin(way)]
        return np.column_stack([places, np.full((count, 2), [total / count, size])])

    for size in (3e-3, 6e-3, 12e-3, 20e-3, 30e-3):
        for _ in range(10):
            found.append(("poke", np.array([[*place(), force(2, 12), size]])))
    for count, (kind, (frames, apart)) in enumerate(_FINGERS.items(), 2):
        while sum(name == kind for name, _ in found) < frames:
            places = np.array([place() for _ in range(count)])
            metres = places * [radius, 1.0]
            distance = np.linalg.norm(metres[:, None] - metres, axis=-1) + np.eye(count)
            if distance.min() > apart:
                own = random.uniform(2, 7, count), np.full(count, 8e-3)
                found.append((kind, np.column_stack([places, *own])))
    for k in range(24):
        way = [0, np.pi / 2, np.pi / 4][k % 3]
        size = random.uniform(15e-3, 45e-3)
        found.append(("strip", row(place(0.7), way, size, force(3, 14), 8e-3)))
        along = np.array([k % 2, 1 - k % 2])
        strap = place(0.6) * along, k % 2 * np.pi / 2, random.uniform(50e-3, 90e-3)
        found.append(("strap", row(*strap, force(10, 40), 12e-3)))
        palm = [*place(0.25), force(10, 40), random.uniform(40e-3, 70e-3)]
        found.append(("palm", np.array([palm])))
    for _ in range(15):
        palm = [*place(0.25), force(8, 25), random.uniform(40e-3, 60e-3)]
        finger = [*place(), random.uniform(3, 6), 8e-3]
        found.append(("palm and finger", np.array([palm, finger])))
    return found


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--pressure-noise", type=float, default=np.inf, help="[Pa]")
    parser.add_argument("--load-fields", action="store_true")
    options = parser.parse_args()
    configure()
    spec, random = loaded_pad(), np.random.default_rng(7)
    how = {"pressure_noise": options.pressure_noise, "load_fields": options.load_fields}
    estimator = LoadEstimator(spec, resolution=_RESOLUTION, **how)
    finer = skin_of(spec, elements=(24, 20), contact=False)
    kept, so, pressure = [], [], []
    for kind, rows in touches(random, float(estimator.skin.geometry.outer_size[0])):
        unused = np.tile(rows[:1] * [1, 1, 0, 1], (_SLOTS - len(rows), 1))
        state = forward(finer, Loads.patch(*np.concatenate([rows, unused]).T[..., None]))
        if not int(state.result[0]) and float(state.min_gap[0]) > 1e-4:
            kept.append((kind, float(rows[:, 2].sum())))
            so.append(np.asarray(state.so)[:, 0])
            pressure.append(float(state.oil_pressure[0]))
    noise = options.pressure_noise if np.isfinite(options.pressure_noise) else 0.0
    told = np.array(pressure) + random.normal(0, noise, len(kept))
    found = estimator.estimate(measured(np.array(so), 1), pressure=told)
    for kind in dict.fromkeys(kind for kind, _ in kept):
        own = [(e, f) for e, (name, f) in zip(found, kept, strict=True) if name == kind]
        sure = [(e, f) for e, f in own if e.status in ("ok", "imprecise")]
        off = [abs(sum(c.force for c in e.contacts) / f - 1) for e, f in sure]
        far = sum(x > 0.1 for x in off)
        statuses = dict(Counter(e.status for e, _ in own))
        print(f"{kind}: {len(own)}, ok or imprecise {len(sure)}, wrong {far}; {statuses}")


if __name__ == "__main__":
    main()
