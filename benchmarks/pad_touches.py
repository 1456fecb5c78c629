"""Touches of many kinds on the shipped pad: docs/load_evidence.md.

    python -m benchmarks.pad_touches [--truth FILE] [--seed N]

Pokes of 3 to 30 mm, palms of 40 to 80 mm, forces inclined by 10 to 30 degrees, two fingers 15
to 50 mm apart, strips of 15 to 45 mm along the arc, along the axis and askew, contacts near the
clamps, pulls, fingers of 4 N with one of 1 N 25 mm away, and pulls of 1 N over 20 mm. Readings
are solved on 36 x 30 elements, as discs (strips: five of 8 mm), with 2 counts of noise and
rounding; the table's own states have 24 x 20 elements and discs of 6 mm.
Tolerances are those that are taken where a file states none. Solving takes about a second a
touch: --truth keeps it.
"""

import argparse
import json
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inverse_load import measured
from fitting.inverse_load.estimator import LoadEstimate, LoadEstimator
from suas_jax import configure
from suas_jax.config import load_skin
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import skin_of

SKIN = Path(__file__).parent.parent / "configs/skins/suas-pad.toml"
_FINE = (36, 30)
_SLOTS = 5  # discs of a touch: one program for all
_KINDS = ("poke", "palm", "drag", "two", "strip", "edge", "pull", "faint", "light pull")
_OF_TWO = ("two", "faint")
_PLACES = np.array([0.6, 0.03])  # over the taxels [rad], [m]


def touches(random: np.random.Generator, radius: float) -> list[tuple[str, np.ndarray]]:
    """Kinds, and discs [disc, (angle, axial, force, diameter, turn, tilt)]."""
    found: list[tuple[str, Any]] = []

    def place() -> np.ndarray:
        return random.uniform(-1, 1, 2) * _PLACES

    def force(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    for _ in range(6):
        for size in (3e-3, 6e-3, 12e-3, 20e-3, 30e-3):
            found.append(("poke", [[*place(), force(1, 10), size, 0, 0]]))
    for _ in range(8):
        for lean in np.tan(np.deg2rad([10, 20, 30])):
            way = random.uniform(0, 2 * np.pi)
            along, out = lean * np.cos(way), lean * np.sin(way)
            size = np.hypot(1, lean)
            turn, tilt = np.arctan(along), np.arcsin(out / size)
            found.append(("drag", [[*place(), size * force(2, 10), 6e-3, turn, tilt]]))
    while sum(kind == "two" for kind, _ in found) < 18:
        a, b = place(), place()
        if 0.015 < np.hypot(radius * (a - b)[0], (a - b)[1]) < 0.05:
            found.append(("two", [[*x, random.uniform(1.5, 6), 6e-3, 0, 0] for x in (a, b)]))
    for k in range(12):
        way, length = np.deg2rad([0, 90, 45])[k % 3], random.uniform(15e-3, 45e-3)
        steps = (np.arange(5) - 2)[:, None] / 5 * length
        off = steps * [np.cos(way) / radius, np.sin(way)]
        share, middle = force(2, 12) / 5, place()
        found.append(("strip", [[*(middle + x), share, 8e-3, 0, 0] for x in off]))
    for size in (40e-3, 60e-3, 80e-3):
        for total in (10.0, 20.0):
            found.append(("palm", [[*(place() / 6), total, size, 0, 0]]))
    for angle in np.deg2rad([60, 70, 76, 80, 82, 84]):
        for axial in (0.0, 30e-3, 54e-3):
            found.append(("edge", [[angle, axial, force(3, 15), 6e-3, 0, 0]]))
    for total in (-1.0, -2.0, -4.0):
        for size in (6e-3, 20e-3):
            found.append(("pull", [[*place(), total, size, 0, 0]]))
    for _ in range(20):
        middle, way = place(), random.uniform(0, 2 * np.pi)
        off = 12.5e-3 * np.array([np.cos(way) / radius, np.sin(way)])
        pair = zip((-1, 1), (4.0, 1.0), strict=True)
        found.append(("faint", [[*(middle + k * off), f, 6e-3, 0, 0] for k, f in pair]))
    found += [("light pull", [[*place(), -1.0, 20e-3, 0, 0]]) for _ in range(20)]
    return [(kind, np.array(rows, float)) for kind, rows in found]


def solved(found: list[tuple[str, np.ndarray]]) -> tuple[list[tuple[str, np.ndarray]], Any]:
    """The touches off the wall that have a state, and their readings [touch, taxel]."""
    skin = skin_of(load_skin(SKIN), elements=_FINE, contact=False)
    kept, so = [], []
    for kind, rows in found:
        unused = np.tile(rows[:1] * [1, 1, 0, 1, 1, 1], (_SLOTS - len(rows), 1))
        state = forward(skin, Loads.patch(*np.concatenate([rows, unused]).T[..., None]))
        if not int(state.result[0]) and float(state.min_gap[0]) > 0:
            kept.append((kind, rows))
            so.append(np.asarray(state.so)[:, 0])
    return kept, np.array(so)


def held(estimate: LoadEstimate, rows: np.ndarray) -> list[bool]:
    """Whether 95 % intervals of one contact hold its angle, axial position and inward force."""
    (contact,) = estimate.contacts
    if contact.covariance is None:
        return []
    inward = rows[:, 2] * np.cos(rows[:, 4]) * np.cos(rows[:, 5])
    centre = inward @ rows[:, :2] / inward.sum()
    error = np.array([contact.angle, contact.axial, contact.force])
    error -= [*centre, inward.sum()]
    return list(np.abs(error) < 1.96 * np.sqrt(np.diag(contact.covariance))[:3])


def report(
    kind: str, rows: list[np.ndarray], found: list[LoadEstimate], seconds: list[float]
) -> None:
    wanted = 2 if kind in _OF_TWO else 1
    right = [len(e.contacts) == wanted for e in found]
    ok = [e.status == "ok" for e in found]
    both = sum(a and b for a, b in zip(right, ok, strict=True))
    forces = [(r[:, 2] * np.cos(r[:, 4]) * np.cos(r[:, 5])).sum() for r in rows]
    errors = [
        abs(sum(c.force for c in e.contacts) / f - 1)
        for e, f, good in zip(found, forces, right, strict=True)
        if good
    ]
    inside = [
        x for e, r, a in zip(found, rows, ok, strict=True)
        if a and len(e.contacts) == 1 and wanted == 1 for x in held(e, r)
    ]  # fmt: skip
    coverage = f"{100 * np.mean(inside):.0f} %" if inside else "-"
    print(
        f"{kind}: {sum(right)} of {len(found)} with the right number, ok {sum(ok)}, of these "
        f"right {both}; force error median {100 * np.median(errors or [np.nan]):.1f} %, "
        f"largest {100 * max(errors or [np.nan]):.0f} %; 95 % intervals at ok hold {coverage}; "
        f"{1e3 * np.median(seconds):.0f} ms; {dict(Counter(e.status for e in found))}"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--seed", type=int, default=43)
    options = parser.parse_args()
    configure()
    estimator = LoadEstimator(load_skin(SKIN))
    if options.truth is not None and options.truth.exists():
        with np.load(options.truth) as data:
            so, told = data["so"], json.loads(str(data["touches"]))
        kept = [(kind, np.array(rows)) for kind, rows in told]
    else:
        radius = float(estimator.skin.geometry.outer_size[0])
        kept, so = solved(touches(np.random.default_rng(options.seed), radius))
        if options.truth is not None:
            told = [(kind, rows.tolist()) for kind, rows in kept]
            np.savez(options.truth, so=so, touches=json.dumps(told))
    estimator.warm_up()
    y = measured(so, 1)
    for kind in _KINDS:
        index = [k for k, (name, _) in enumerate(kept) if name == kind]
        found, seconds = [], []
        for k in index:
            begin = time.process_time()
            found += estimator.estimate(y[k : k + 1])
            seconds.append(time.process_time() - begin)
        report(kind, [kept[k][1] for k in index], found, seconds)


if __name__ == "__main__":
    main()
