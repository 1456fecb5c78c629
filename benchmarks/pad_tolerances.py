"""The pad's skin file is a little wrong: are contacts as sure as stated, is the cause named?

    python -m benchmarks.pad_tolerances [--logs N] [--contacts N] [--seed K] [--only NAME]

The shipped pad with 320 taxels, whose file states no tolerances. Each log is of a true pad that
differs from the file: in all numbers, drawn from the tolerances that are then taken, or in one,
further off than these. Contacts are discs of 6 mm of 1 to 12 N, solved on 48 x 40 elements
where the estimator has 24 x 20; 2 counts of noise. "Wrong": frames of status ok whose truth
lies outside their own 99.9 % region of angle, axial position and force, or whose number of
contacts is not one. "Named" as in `benchmarks.field_variants`.
"""

import argparse
from collections.abc import Mapping

import numpy as np

from benchmarks.field_errors import is_wrong
from benchmarks.field_variants import KINDS, Kind, changes_of, verdict_names
from benchmarks.pad_estimation import (
    FINE,
    NAMES,
    NOISE,
    SKIN,
    contacts,
    readings_off_the_wall,
)
from fitting.inverse_load.check.skin_file import model_verdict
from fitting.inverse_load.check.verdict import WIDTH
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.pad.rest import rest_readings
from suas_jax import configure
from suas_jax.config import SkinSpec, continuous_inputs, load_skin
from suas_jax.scene.skin import skin_of

_BASELINE_FRAMES = 100
_PRESSURE_NOISE = 20.0  # [Pa], where the oil's pressure is measured


def true_frames(
    spec: SkinSpec, changes: Mapping[str, float], loads: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Loads that have a state off the wall, their readings and pressures, readings at rest."""
    own = continuous_inputs(spec)
    inputs = {path: own[path] * (1 + by) for path, by in changes.items()}
    skin = skin_of(spec, inputs, elements=FINE, contact=False)
    rows = []
    for load in loads:
        found = readings_off_the_wall(skin, load[None])
        if found is not None:
            rows.append((load, *found))
    kept, so, pressure = map(np.array, zip(*rows, strict=True))
    return kept, so, pressure, rest_readings(skin)


def log_of(
    kind: Kind, spec: SkinSpec, count: int, random: np.random.Generator
) -> tuple[int, int, bool, str]:
    """Frames of a log, how many are wrong, whether the cause is named, what is said."""
    changes, by = changes_of(kind, spec, random)
    loads = contacts(count, int(random.integers(1 << 30)))[:, 0]
    loads, so, pressure, rest = true_frames(spec, changes, loads)

    def measured(x: np.ndarray) -> np.ndarray:
        return np.round(x + random.normal(0, NOISE, x.shape))

    settings = {}
    if kind.baseline:
        settings["rest"] = measured(np.tile(rest, (_BASELINE_FRAMES, 1))).mean(0)
        settings["rest_variance"] = (NOISE**2 + 1 / 12) / _BASELINE_FRAMES
    known = kind.known == "pressure"
    if known:
        settings["pressure_noise"] = _PRESSURE_NOISE
        pressure = pressure + random.normal(0, _PRESSURE_NOISE, pressure.shape)
    estimator = LoadEstimator(spec, most_contacts=2, **settings)
    so, own = measured(so), pressure if known else None
    found = estimator.estimate(so, pressure=own)
    verdict = model_verdict(estimator, so, np.zeros(so.shape, bool), own, found)
    text = "too few contacts" if verdict is None else verdict.text
    named = verdict is not None and kind.wrong in verdict_names(verdict)
    wrong = sum(is_wrong(e, x, NAMES) for e, x in zip(found, loads, strict=True))
    return len(loads), wrong, named, f"true change {100 * by:+.1f} %: {text}"


def main() -> None:
    """Print a row a kind of log."""
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])  # type: ignore[union-attr]
    options.add_argument("--logs", type=int, default=10)
    options.add_argument("--contacts", type=int, default=24)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--only", default="", help="kinds whose name holds this")
    given = options.parse_args()
    configure()
    spec = load_skin(SKIN)
    for k, (name, kind) in enumerate(KINDS.items()):
        of_sections = kind.known == "force" or kind.wrong in ("shift", WIDTH)
        if given.only not in name or of_sections:
            continue
        logs = []
        for i in range(given.logs):
            random = np.random.default_rng([given.seed, k, i])
            logs.append(log_of(kind, spec, given.contacts, random))
            print(f"    {logs[-1][3]}; wrong {logs[-1][1]}", flush=True)
        frames, wrong, named = (sum(x[j] for x in logs) for j in range(3))
        said = f"{named} of {len(logs)} named, " if kind.wrong else ""
        print(f"{name}: {said}{wrong} of {frames} frames wrong", flush=True)


if __name__ == "__main__":
    main()
