"""How well contacts on the pad are estimated, and how fast.

    python -m benchmarks.pad_estimation [--truth FILE] [--contacts N] [--pairs N]

Readings are those of the shipped pad (320 taxels of 4 mm) solved on 48 x 40 elements graded
around each contact; the estimator's own meshes have 24 x 20. They have 2 counts of noise and
are rounded. The bound is Cramer and Rao's from the noise alone, and the skin's numbers are
declared exact. Solving takes about a second a contact: --truth keeps the solutions.
"""

import argparse
import itertools
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from benchmarks.inverse_load import with_tolerances
from fitting.inverse_load.estimator import LoadEstimate, LoadEstimator
from suas_jax import configure
from suas_jax.config import load_skin
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin, skin_of

SKIN = Path(__file__).parent.parent / "configs/skins/suas-pad.toml"
NOISE = 2.0
FINE = (48, 40)
DIAMETER = 6e-3
_PLACES = np.array([np.deg2rad(45), 0.034])  # over the taxels
_FORCES = (1.0, 12.0)
_OF_PAIRS = (2.0, 7.0)
_DISTANCES = (0.015, 0.05)
_LIGHT = np.array([0.3, 0.5, 1.0, 3.0])  # ends of ranges of light contacts' forces
_FAR = 10e-3
NAMES = ("angle", "axial", "force")


class Truth(NamedTuple):
    """Contacts [frame, contact, (angle, axial, force)] and readings [frame, taxel]."""

    loads: np.ndarray
    so: np.ndarray


def contacts(count: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    place = random.uniform(-1, 1, (count, 2)) * _PLACES
    return np.concatenate([place, random.uniform(*_FORCES, (count, 1))], 1)[:, None]


def pairs(count: int, seed: int, radius: float) -> np.ndarray:
    random = np.random.default_rng(seed)
    found: list[np.ndarray] = []
    while len(found) < count:
        place = random.uniform(-1, 1, (2, 2)) * _PLACES
        apart = np.hypot(radius * (place[0, 0] - place[1, 0]), place[0, 1] - place[1, 1])
        if _DISTANCES[0] < apart < _DISTANCES[1]:
            found.append(np.append(place, random.uniform(*_OF_PAIRS, (2, 1)), 1))
    return np.array(found)


def solved(loads: np.ndarray) -> Truth:
    skin = skin_of(load_skin(SKIN), elements=FINE, contact=False)
    found = [readings_off_the_wall(skin, frame) for frame in loads]
    kept = [k for k, read in enumerate(found) if read is not None]
    return Truth(loads[kept], np.array([read[0] for read in found if read is not None]))


def readings_off_the_wall(skin: Skin, contacts: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Counts [taxel] and oil pressure under contacts [contact, (angle, axial, force)].

    None where no state was found, or one that touches the wall.
    """
    found = forward(skin, Loads.patch(*contacts.T[..., None], DIAMETER))
    touching = int(found.result[0]) or float(found.min_gap[0]) <= 0
    if touching:
        return None
    return np.asarray(found.so)[:, 0], float(found.oil_pressure[0])


def measured(so: np.ndarray, seed: int) -> np.ndarray:
    return np.round(so + np.random.default_rng(seed).normal(0, NOISE, so.shape))


def bounds(estimator: LoadEstimator, loads: np.ndarray) -> np.ndarray:
    """Smallest standard deviations [frame, contact, parameter], from the noise alone."""
    count = loads.shape[1]
    parameters = loads.transpose(0, 2, 1).reshape(len(loads), -1)
    interpolant: Any = estimator.selection.fitter
    jacobian = interpolant.interpolant(parameters, count).jacobian[..., :-1]
    information = jacobian @ jacobian.transpose(0, 2, 1) / (NOISE**2 + 1 / 12)
    variance = np.diagonal(np.linalg.inv(information), axis1=1, axis2=2)
    return np.sqrt(variance).reshape(len(loads), 3, count).transpose(0, 2, 1)


def report(
    name: str, estimator: LoadEstimator, truth: Truth, found: list[LoadEstimate]
) -> None:
    count = truth.loads.shape[1]
    right = np.array([len(e.contacts) == count for e in found])
    right &= np.array([all(c.covariance is not None for c in e.contacts) for e in found])
    print(f"{name}: {right.sum()} of {len(found)} with the right number of contacts")
    print(
        "  statuses:", dict(Counter(e.status for e in found)), "(what follows: of those `ok`)"
    )
    right &= np.array([e.status == "ok" for e in found])
    order = np.argsort(truth.loads[..., 0], 1)[..., None]
    loads = np.take_along_axis(truth.loads, order, 1)[right]
    bound = bounds(estimator, loads)
    chosen = [e for e, good in zip(found, right, strict=True) if good]
    error = np.array([[[getattr(c, n) for n in NAMES] for c in e.contacts] for e in chosen])
    error -= loads
    stated = np.array([[[c.deviation(n) for n in NAMES] for c in e.contacts] for e in chosen])
    ratio = np.sqrt(((error / bound) ** 2).mean((0, 1)))
    covered = (np.abs(error) < 1.96 * stated).mean((0, 1))
    radius = 1e3 * float(estimator.skin.geometry.outer_size[0])
    scale = np.array([radius, 1e3, 1.0])
    angle, axial, force = np.median(np.abs(error) * scale, (0, 1))
    print(f"  median |error|: {angle:.3f} mm, {axial:.3f} mm, {force:.3f} N")
    print("  rms of error over bound, coverage of 95 % intervals:")
    for k, quantity in enumerate(NAMES):
        print(f"    {quantity}: {ratio[k]:.2f}, {100 * covered[k]:.0f} %")


def light_contacts(estimator: LoadEstimator, count: int = 400) -> None:
    """Where light contacts are found; readings are of the table: it is the search on trial."""
    random = np.random.default_rng(3)
    place = random.uniform(-1, 1, (count, 2)) * _PLACES
    force = np.exp(random.uniform(*np.log(_LIGHT[[0, -1]]), (count, 1)))
    loads = np.append(place, force, 1)
    fitter: Any = estimator.selection.fitter
    so = fitter.interpolant(loads, 1).readings[:, :-1]
    found = estimator.estimate(measured(so, 6))
    radius = float(estimator.skin.geometry.outer_size[0])
    for low, high in itertools.pairwise(_LIGHT):
        rows = np.flatnonzero((force[:, 0] >= low) & (force[:, 0] < high))
        single = [k for k in rows if len(found[k].contacts) == 1]
        far = []
        for k in single:
            (c,) = found[k].contacts
            away = np.hypot(radius * (c.angle - loads[k, 0]), c.axial - loads[k, 1])
            far += [found[k].status] if away > _FAR else []
        print(
            f"{low:g} to {high:g} N: of {len(rows)} one contact in {len(single)}, over "
            f"{1e3 * _FAR:g} mm away {len(far)}, of them ok {far.count('ok')}"
        )


def by_scipy(estimator: LoadEstimator, so: np.ndarray, start: np.ndarray) -> float:
    """Seconds for a frame by SciPy with finite differences of the solved model."""
    skin = skin_of(load_skin(SKIN), contact=False)
    scale = np.array([0.1, 5e-3, 1.0])

    def residual(x: np.ndarray) -> np.ndarray:
        found = forward(skin, Loads.patch(*(scale * x), DIAMETER))
        return (np.asarray(found.so)[:, 0] - so) / NOISE

    residual(start / scale)  # compiles
    begin = time.perf_counter()
    least_squares(residual, start / scale, diff_step=1e-4)
    return time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--contacts", type=int, default=300)
    parser.add_argument("--pairs", type=int, default=100)
    options = parser.parse_args()
    configure()
    begin = time.perf_counter()
    exact = with_tolerances(load_skin(SKIN), exact=True)  # readings are of this very skin
    estimator = LoadEstimator(exact, most_contacts=4)
    print(f"table made or loaded in {time.perf_counter() - begin:.1f} s")
    radius = float(estimator.skin.geometry.outer_size[0])
    if options.truth is not None and options.truth.exists():
        with np.load(options.truth) as data:
            one = Truth(data["loads"], data["so"])
            two = Truth(data["pair_loads"], data["pair_so"])
    else:
        one = solved(contacts(options.contacts, 1))
        two = solved(pairs(options.pairs, 2, radius))
        if options.truth is not None:
            np.savez(
                options.truth, loads=one.loads, so=one.so, pair_loads=two.loads, pair_so=two.so
            )
    report("single contacts", estimator, one, estimator.estimate(measured(one.so, 1)))
    faulty = measured(one.so, 2)
    faulty[:, [5, 100, 200]] = np.nan
    stuck = np.zeros(faulty.shape, bool)
    stuck[:, [50, 150]] = True
    faulty[:, [50, 150]] = np.round(estimator.model_rest[[50, 150]])
    report("3 missing, 2 stuck", estimator, one, estimator.estimate(faulty, stuck))
    rest = measured(np.tile(estimator.model_rest, (3000, 1)), 3)
    alarms = np.mean([bool(e.contact) for e in estimator.estimate(rest)])
    print(f"false alarms: {100 * alarms:.2f} % at a rate of {100 * estimator.false_alarm:g} %")
    light_contacts(estimator)
    report("pairs", estimator, two, estimator.estimate(measured(two.so, 4)))
    single = LoadEstimator(estimator.spec, most_contacts=1, live=True)
    single.warm_up()
    frames = measured(one.so[np.arange(1000) % len(one.so)], 5)
    seconds = []
    for frame in frames[:200]:
        begin = time.perf_counter()
        single.estimate(frame[None])
        seconds.append(time.perf_counter() - begin)
    print(f"one frame, live: median {1e3 * np.median(seconds):.1f} ms")
    begin = time.perf_counter()
    estimator.estimate(frames)
    print(f"a log of 1,000 frames: {time.perf_counter() - begin:.1f} s")
    spent = by_scipy(estimator, frames[0], one.loads[0, 0] * [1, 1, 0.8] + [0.05, 2e-3, 0])
    print(f"one frame by SciPy and finite differences of the solved model: {spent:.1f} s")


if __name__ == "__main__":
    main()
