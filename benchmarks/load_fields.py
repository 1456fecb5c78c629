"""Palms, many fingers and palms with a finger on a section: docs/load_evidence.md.

    python -m benchmarks.load_fields [--touches N] [--taxels N] [--pressure-noise PA]

Readings are those of 64 elements under up to 48 line loads, radial ones, with 2 counts of noise
and rounding; the estimator's fields have nodes 4 mm apart on 32 elements. Palms are even, or
half a wave of a cosine, over 30 to 80 % of the arc, with 10 to 50 N. All numbers of the skin
are exact.
"""

import argparse
import time
from collections import Counter
from typing import NamedTuple

import numpy as np

from benchmarks.inverse_load import NOISE, skin_of_taxels, with_tolerances
from fitting.arrays import Floats
from fitting.inverse_load.estimate.load_field import Interval
from fitting.inverse_load.estimator import LoadEstimate, LoadEstimator
from suas_jax import configure
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import skin_of

_POINTS = 48  # line loads of a touch: one program for all
_HALF = np.deg2rad(90)
_FINGERS = {"one finger": 1, "two fingers": 2, "four fingers": 4, "five fingers": 5}
_APART = {1: 0.0, 2: 25.0, 4: 18.0, 5: 15.0}  # [deg]
_KINDS = (*_FINGERS, "palm", "palm and finger")


class Touch(NamedTuple):
    """A kind, and line loads: angles [rad], forces [N]."""

    kind: str
    angle: Floats
    force: Floats


def touch(kind: str, random: np.random.Generator) -> Touch:
    if kind in _FINGERS:
        count = _FINGERS[kind]
        angle = np.zeros(count)
        while (count > 1 and np.diff(angle).min() <= _APART[count]) or not angle.any():
            angle = np.sort(random.uniform(-65, 65, count))
        return Touch(kind, np.deg2rad(angle), random.uniform(3, 10, count))
    along = (np.arange(_POINTS - 1) + 0.5) / (_POINTS - 1) - 0.5
    share = random.uniform(0.3, 0.8)
    middle = np.deg2rad(80) * (1 - share) * random.uniform(-1, 1)
    profile = np.cos(np.pi * along) if random.uniform() < 0.4 else np.ones(len(along))
    total = np.exp(random.uniform(*np.log([10, 50])))
    angle, force = middle + 2 * _HALF * share * along, total * profile / profile.sum()
    if kind == "palm":
        return Touch(kind, angle, force)
    finger = np.deg2rad(random.uniform(-60, 60)), random.uniform(3, 10)
    return Touch(kind, np.append(angle, finger[0]), np.append(force, finger[1]))


def holds(interval: Interval, value: float) -> bool:
    return interval.low <= value <= interval.high


def report(kind: str, rows: list[tuple[Touch, LoadEstimate, float]]) -> None:
    """Of frames told as contacts with errors, and of those with a field."""
    plain, fields = [], []
    for one, e, _ in rows:
        total = one.force.sum()
        if e.field is not None:
            centre = one.angle @ one.force / total
            held = holds(e.field.force, total), holds(e.field.angle, centre)
            fields.append((e.field.force.value / total - 1, e.field.force.low / total, *held))
        elif e.status in ("ok", "imprecise"):
            plain.append(sum(c.force for c in e.contacts) / total - 1)
    far = sum(abs(x) > 0.1 for x in plain)
    text = f"{kind}: {dict(Counter(e.status for _, e, _ in rows))}; without a field "
    text += f"{len(plain)}, off by more than 10 % {far}"
    if fields:
        error, low, force, centre = np.array(fields).T
        text += f"; fields {len(fields)}: error median {100 * np.median(np.abs(error)):.0f} %, "
        text += f"lower end {np.median(low):.2f} of the truth, "
        text += f"hold the force {force.sum():.0f}, the centre {centre.sum():.0f}"
    print(f"{text}; {1e3 * np.median([s for *_, s in rows]):.0f} ms", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--touches", type=int, default=8, help="of each kind")
    parser.add_argument("--taxels", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    text = "of a measured oil pressure [Pa]; none is measured without it"
    parser.add_argument("--pressure-noise", type=float, default=np.inf, help=text)
    options = parser.parse_args()
    configure()
    spec = with_tolerances(skin_of_taxels(options.taxels), exact=True)
    estimator = LoadEstimator(spec, pressure_noise=options.pressure_noise)
    random = np.random.default_rng(options.seed)
    touches = [touch(kind, random) for kind in _KINDS for _ in range(options.touches)]
    angle, force = np.zeros((2, _POINTS, len(touches)))
    for k, one in enumerate(touches):
        angle[: len(one.angle), k], force[: len(one.force), k] = one.angle, one.force
    found = forward(skin_of(spec, elements=64, contact=False), Loads.line(angle, force))
    off = (np.asarray(found.result) == 0) & (np.asarray(found.min_gap) > 0)
    so = np.asarray(found.so).T
    y = np.round(so + random.normal(0, NOISE, so.shape))
    pressure = np.full(len(y), np.nan)
    if np.isfinite(options.pressure_noise):
        measured = np.asarray(found.oil_pressure)
        pressure = measured + random.normal(0, options.pressure_noise, len(y))
    estimator.estimate(y)  # compiles
    rows: dict[str, list[tuple[Touch, LoadEstimate, float]]] = {kind: [] for kind in _KINDS}
    for k in np.flatnonzero(off).tolist():
        begin = time.process_time()
        (estimate,) = estimator.estimate(y[k : k + 1], pressure=pressure[k : k + 1])
        seconds = time.process_time() - begin
        rows[touches[k].kind].append((touches[k], estimate, seconds))
    for kind in _KINDS:
        report(kind, rows[kind])


if __name__ == "__main__":
    main()
