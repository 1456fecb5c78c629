"""How well loads are estimated from readings of the solid model: docs/load_evidence.md.

    python benchmarks/inverse_load.py [--truth FILE] [--frames N] [--write CSV]

The readings are those of the continuum (160 x 2 nine-node elements, a mesh for each load),
at angles and forces that no node of the estimator's table holds, with 2 counts of noise and
rounding. The skin is the paper's with 40 taxels of 4 mm from -80 to 80 degrees. The bound is
Cramer and Rao's, from the skin's own derivatives and the noise alone, and the skin's numbers
are declared exact: what its tolerances cost is shown by benchmarks/field_errors.py. Solving
takes some minutes: --truth keeps the solutions. --write writes the short set of tests/data.
"""

import argparse
import csv
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.stats import binom, chi2

from fitting.inverse_load.estimator import LoadEstimate, LoadEstimator
from suas_jax import configure, jit
from suas_jax.config import (
    ElectrodesSpec,
    LineLoadSpec,
    SceneSpec,
    SkinSpec,
    SolveSpec,
    UncertainQuantity,
    continuous_inputs,
    load_skin,
    with_inputs,
)
from suas_jax.config.input_errors import default_errors
from suas_jax.scene.forward import load_jacobian
from suas_jax.scene.loads import Loads
from suas_jax.scene.solve import solve

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
NOISE = 2.0
_MESH = (160, 2)
_DIGITS = 1 / 12  # variance of the converter's rounding
_LANES = 64
_JACOBIAN = jit(load_jacobian)
KINDS = {
    "single": (300, 1),
    "two": (200, 2),
    "weak": (100, 2),
    "turned": (100, 1),
    "turned two": (100, 2),
}
"""Sets of loads: frames and contacts."""
_LEAN = {"turned": 30.0, "turned two": 20.0}  # largest one from the radial [deg]


class Truth(NamedTuple):
    """Loads and the continuum's readings under them."""

    loads: np.ndarray  # angle [rad], force [N], direction [rad] [frame, contact, 3]
    so: np.ndarray  # readings without noise [frame, taxel]


def skin_of_taxels(count: int = 40) -> SkinSpec:
    """The paper's skin with so many taxels, evenly over 160 degrees."""
    taxels = [{"angle": angle} for angle in np.deg2rad(np.linspace(-80, 80, count)).tolist()]
    spec = load_skin(SKIN)
    electrodes = ElectrodesSpec(taxels=taxels, noise=NOISE, lsb=spec.sensing.lsb)
    return spec.model_copy(update={"electrodes": electrodes})


def with_tolerances(spec: SkinSpec, *, exact: bool) -> SkinSpec:
    """The same skin with what has a default tolerance known exactly, or not stated."""
    values = continuous_inputs(spec)
    changes = {
        path: UncertainQuantity(values[path], 0.0) if exact else values[path]
        for path in default_errors(spec).paths
    }
    return with_inputs(spec, changes)  # type: ignore[arg-type]


def drawn_loads(kind: str, frames: int, random: np.random.Generator) -> np.ndarray:
    """Loads of a set [frame, contact, 3]; two contacts are 30 (weak: 12) degrees apart."""
    rows: list[np.ndarray] = []
    of_two = {"two": (10, 20, 30), "weak": (2, 10, 12), "turned two": (3, 12, 30)}
    low, high, apart = of_two.get(kind, (2, 25, 0))
    while len(rows) < frames:
        angle = np.sort(random.uniform(-65, 65, KINDS[kind][1]))
        force = random.uniform(low, high, len(angle))
        turn = random.uniform(-1, 1, len(angle)) * _LEAN.get(kind, 0.0)
        if np.all(np.diff(angle) >= apart):
            rows.append(np.stack([np.deg2rad(angle), force, np.deg2rad(turn)], 1))
    return np.array(rows)


def solid_readings(spec: SkinSpec, loads: np.ndarray) -> np.ndarray:
    """Readings of the continuum under some loads [frame, taxel]."""
    found = []
    for row in loads:
        scene = SceneSpec(
            geometry=spec.geometry,
            material=spec.material,
            oil=spec.oil,
            electrodes=spec.electrodes,
            load=tuple(
                LineLoadSpec(kind="line", angle=float(a), force=float(f), direction=float(d))
                for a, f, d in row
            ),
            solve=SolveSpec(model="solid", mesh=_MESH),
        )
        report = solve(scene).report
        if report["status"] != "converged":
            raise SystemExit(f"{row}: {report['status']}")
        found.append([taxel["so"] for taxel in report["taxels"]])
    return np.array(found)


def truths(spec: SkinSpec, file: Path | None, scale: float) -> dict[str, Truth]:
    """All sets, from a file if it is there."""
    if file is not None and file.exists():
        with np.load(file) as data:
            return {kind: Truth(data[f"{kind}_loads"], data[f"{kind}_so"]) for kind in KINDS}
    random, sets = np.random.default_rng(20), {}
    for kind, (frames, _) in KINDS.items():
        loads = drawn_loads(kind, max(round(scale * frames), 2), random)
        sets[kind] = Truth(loads, solid_readings(spec, loads))
        print(f"solved {len(loads)} frames: {kind}", flush=True)
    if file is not None:
        arrays = {f"{k}_{n}": getattr(t, n) for k, t in sets.items() for n in ("loads", "so")}
        np.savez(file, **arrays)
    return sets


def write_short(sets: dict[str, Truth], file: Path, frames: int = 40) -> None:
    """The first frames of every set as CSV."""
    with file.open("w", newline="") as stream:
        stream.write("# readings of the solid model, benchmarks/inverse_load.py --write\n")
        rows = csv.writer(stream)
        names = [f"{q}_{k}" for k in (1, 2) for q in ("angle_rad", "force_N", "direction_rad")]
        taxels = next(iter(sets.values())).so.shape[1]
        rows.writerow(["set", *names, *(f"so_{k + 1}" for k in range(taxels))])
        for kind, truth in sets.items():
            for loads, so in list(zip(truth.loads, truth.so, strict=True))[:frames]:
                own = [f"{x:.9g}" for x in loads.reshape(-1)]
                own += [""] * (len(names) - len(own))
                rows.writerow([kind, *own, *(f"{x:.3f}" for x in so)])


def measured(so: np.ndarray, seed: int) -> np.ndarray:
    """Counts of a converter with noise."""
    return np.round(so + np.random.default_rng(seed).normal(0.0, NOISE, so.shape))


def bounds(estimator: LoadEstimator, loads: np.ndarray, free: int) -> np.ndarray:
    """Cramer-Rao bounds of standard deviations [frame, contact, quantity]."""
    frames, contacts, _ = loads.shape
    parts = []
    for begin in range(0, frames, _LANES):  # one compiled program, the last batch filled up
        index = np.minimum(np.arange(begin, begin + _LANES), frames - 1)
        columns = [jnp.asarray(loads[index, :, k].T) for k in range(3)]
        _, slopes = _JACOBIAN(estimator.skin, Loads(*columns, jnp.zeros(_LANES)))
        parts.append(np.moveaxis(np.asarray(slopes)[:free], -1, 0))  # frame, kind, load, taxel
    jacobian = np.concatenate(parts)[:frames].reshape(frames, free * contacts, -1)
    information = jacobian @ np.swapaxes(jacobian, 1, 2) / (NOISE**2 + _DIGITS)
    variance = np.diagonal(np.linalg.inv(information), axis1=1, axis2=2)
    return np.sqrt(np.moveaxis(variance.reshape(frames, free, contacts), 1, 2))


class Score(NamedTuple):
    """Estimates against the truth, frames with the right number of contacts."""

    right: np.ndarray  # which frames these are [frame]
    errors: np.ndarray  # estimate less truth [frame, contact, quantity]
    bound: np.ndarray  # Cramer-Rao, likewise
    covered: np.ndarray  # whether the truth lies in the 95 % region [frame, contact]

    @property
    def ratio(self) -> np.ndarray:
        """RMS over all frames of the error in terms of the bound, quantity by quantity."""
        return np.asarray(np.sqrt(((self.errors / self.bound) ** 2).mean((0, 1))))

    def median(self, loads: np.ndarray) -> tuple[float, float]:
        """Median errors: angle [deg], force relative."""
        size = np.median(np.abs(self.errors[..., 0]))
        force = np.median(np.abs(self.errors[..., 1]) / loads[self.right][..., 1])
        return float(np.rad2deg(size)), float(force)


def score(
    estimator: LoadEstimator, found: list[LoadEstimate], loads: np.ndarray, free: int = 2
) -> Score:
    """Judge estimates of frames with known loads."""
    count = loads.shape[1]
    right = np.array([len(e.contacts) == count and e.status != "wall_contact" for e in found])
    kept = [e.contacts for e, ok in zip(found, right, strict=True) if ok]
    values = np.array(
        [[(c.angle, c.force, c.direction or 0.0)[:free] for c in cs] for cs in kept]
    )
    covariance = np.array([[c.covariance for c in cs] for cs in kept])
    errors = values - loads[right][..., :free]
    distance = np.einsum("fci,fcij,fcj->fc", errors, np.linalg.inv(covariance), errors)
    bound = bounds(estimator, loads[right], free)
    return Score(right, errors, bound, distance < chi2.ppf(0.95, free))


def show(name: str, judged: Score, loads: np.ndarray, found: list[LoadEstimate]) -> None:
    """One row of the table."""
    angle, force = judged.median(loads)
    ratio = ", ".join(f"{x:.2f}" for x in judged.ratio)
    rms = np.sqrt((judged.errors**2).mean((0, 1)))
    print(
        f"{name:28s} {len(found):5d} frames, {100 * judged.right.mean():5.1f} % right number; "
        f"rms {np.rad2deg(rms[0]):.3f} deg, {rms[1]:.3f} N; rms/bound {ratio}; median "
        f"{angle:.3f} deg, {100 * force:.2f} %; 95 % region {100 * judged.covered.mean():.1f} %"
    )
    print(" " * 29 + ", ".join(f"{n} {k}" for k, n in Counter(e.status for e in found).items()))


def accuracy(sets: dict[str, Truth], spec: SkinSpec) -> None:
    """One contact, two contacts, weak ones; faulty taxels; free directions."""
    estimator = LoadEstimator(spec)
    for kind in ("single", "two", "weak"):
        found = estimator.estimate(measured(sets[kind].so, 0))
        show(kind, score(estimator, found, sets[kind].loads), sets[kind].loads, found)
    truth = sets["turned two"]
    found, inward = estimator.estimate(measured(truth.so, 0)), truth.loads.copy()
    inward[..., 1] *= np.cos(truth.loads[..., 2])
    show("two, inclined", score(estimator, found, inward), inward, found)
    truth = sets["single"]
    counts, random = measured(truth.so, 0), np.random.default_rng(1)
    clean = score(estimator, estimator.estimate(counts), truth.loads)
    for row in counts:
        taxels = random.permutation(counts.shape[1])[:5]
        row[taxels[:3]] = np.nan
        row[taxels[3:]] = measured(np.full(2, estimator.table.rest.mean()), random.integers(99))
    found = estimator.estimate(counts)
    judged = score(estimator, found, truth.loads)
    show("2 stuck at rest, 3 missing", judged, truth.loads, found)
    grown = np.sqrt((judged.errors**2).mean((0, 1)) / (clean.errors**2).mean((0, 1)))
    print(f"{'':29s}errors x {grown[0]:.2f} (angle), x {grown[1]:.2f} (force)")
    truth, free = sets["turned"], LoadEstimator(spec, direction=True, most_contacts=1)
    found = free.estimate(measured(truth.so, 0))
    judged = score(free, found, truth.loads, 3)
    show("direction free", judged, truth.loads, found)
    for low, high in ((0, 20), (20, 45), (45, 65)):
        where = np.abs(np.rad2deg(truth.loads[judged.right][:, 0, 0]))
        some = (where >= low) & (where < high)
        turn = np.rad2deg(np.sqrt((judged.errors[some, 0, 2] ** 2).mean()))
        bound = np.rad2deg(np.sqrt((judged.bound[some, 0, 2] ** 2).mean()))
        print(f"{'':29s}{low}-{high} deg: direction rms {turn:.2f} deg, bound {bound:.2f} deg")
    angles = np.deg2rad([30, 50, 65, 75, 80, 83])
    loads = np.stack([angles, np.full(6, 10.0), np.zeros(6)], -1)[:, None]
    sigma = np.rad2deg(bounds(free, loads, 3)[:, 0, 2])
    row = ", ".join(
        f"{d:.1f} at {a:.0f}" for a, d in zip(np.rad2deg(angles), sigma, strict=True)
    )
    print(f"bound of the direction under 10 N [deg]: {row} deg")


def false_alarms(spec: SkinSpec) -> None:
    """Frames that nothing touches."""
    for rate in (0.05, 0.01, 0.001):
        estimator = LoadEstimator(spec, false_alarm=rate)
        frames = max(1000, round(20 / rate))
        counts = measured(np.tile(estimator.table.rest, (frames, 1)), 5)
        alarms = sum(e.contact is not False for e in estimator.estimate(counts))
        low, high = binom.ppf((0.025, 0.975), frames, rate)
        print(
            f"no contact, rate {rate:g}: {alarms} alarms in {frames} frames; 95 % of such runs "
            f"give {low:.0f} to {high:.0f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--frames", type=float, default=1.0, help="share of the frames")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    configure()
    spec = with_tolerances(
        skin_of_taxels(), exact=True
    )  # readings are of this very skin: it is exact
    sets = truths(spec, options.truth, options.frames)
    if options.write is not None:
        write_short(sets, options.write)
    accuracy(sets, spec)
    false_alarms(spec)


if __name__ == "__main__":
    main()
