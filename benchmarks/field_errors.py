"""What `suas invert` says where the skin is not quite what its file says.

    python benchmarks/field_errors.py [--loads N] [--exact] [--seed K]

The skin is the paper's with 40 taxels of 4 mm from -80 to 80 degrees, 2 counts of noise. Each
row is a true skin that differs from the file's in one number, under 40 loads of 2 to 20 N
within 65 degrees. "Wrong" is a frame of status ok whose truth lies outside its own 99.9 %
region, or whose number of contacts is not one. Below each row: what the log as a whole says
about the skin file. --exact estimates as if the file's numbers were known exactly.
"""

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import chi2

from benchmarks.inverse_load import NOISE, skin_of_taxels, with_tolerances
from fitting.inverse_load.check.section_log import section_verdict
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.estimator import LoadEstimator
from suas_jax import configure, jit
from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.scene.forward import SensorOutput, forward
from suas_jax.scene.loads import SPREAD_POINTS, Loads
from suas_jax.scene.skin import skin_of

REGION = 0.999
_BASELINE_FRAMES = 100
_LANES = 64  # that a program computes at once
_FORWARD = jit(forward)


class Case(NamedTuple):
    """A way in which a skin differs from its file."""

    name: str  # what is printed
    changes: Mapping[str, float]  # of inputs, relative, by TOML path
    baseline: bool = True  # whether readings count from those of the true skin at rest
    width: float = 0.0  # arc of the outer face that contacts press [m]
    shift: int = 0  # taxels by which the readings are displaced in their columns
    force_known: bool = False  # whether the log holds the loads' true forces
    wall: bool = False  # whether loads may press the skin to the wall


CASES = (
    Case("as in the file", {}),
    Case("as in the file, no baseline", {}, baseline=False),
    Case("thickness +5 %", {"geometry.thickness": 0.05}),
    Case("C1 -10 %", {"material.C1": -0.10}),
    Case("C1 -10 %, forces known", {"material.C1": -0.10}, force_known=True),
    Case("gap +3 %", {"geometry.oil_gap": 0.03}),
    Case("gap +3 %, no baseline", {"geometry.oil_gap": 0.03}, baseline=False),
    Case("gain +1 %", {"electrodes.lsb": -0.01}),
    Case("gain +1 %, no baseline", {"electrodes.lsb": -0.01}, baseline=False),
    Case("permittivity +2 %", {"oil.relative_permittivity": 0.02}),
    Case("columns shifted by one", {}, shift=1),
    Case("contacts 20 mm wide", {}, width=20e-3),
    Case("contacts 20 mm wide, no baseline", {}, baseline=False, width=20e-3),
)


def drawn(loads: int, random: np.random.Generator) -> np.ndarray:
    """Angles [rad] and forces [N] of single contacts [load, 2]."""
    angle = np.deg2rad(random.uniform(-65, 65, loads))
    return np.stack([angle, random.uniform(2, 20, loads)], 1)


def true_readings(spec: SkinSpec, case: Case, loads: np.ndarray) -> np.ndarray:
    """Readings of the true skin without noise, under loads and, last, at rest."""
    return np.asarray(true_output(spec, case, loads).so).T


def true_output(spec: SkinSpec, case: Case, loads: np.ndarray) -> SensorOutput:
    """What the true skin puts out under loads and, last, at rest."""
    own = continuous_inputs(spec)
    true = {path: own[path] * (1 + by) for path, by in case.changes.items()}
    skin = skin_of(spec, true, contact=case.wall)
    # Every case runs the same program: a line is a contact of no width, and what fills the
    # lanes up is dropped again.
    points, weights = np.polynomial.legendre.leggauss(SPREAD_POINTS)
    half = case.width / 2 / float(skin.geometry.outer_size[0])
    every = np.zeros((-(-(len(loads) + 1) // _LANES) * _LANES, 2))
    every[: len(loads)] = loads
    # A contact presses in one direction: where it is off its middle, it is turned back.
    turn = np.repeat((points * half)[:, None], len(every), 1)
    angle = every[:, 0] + turn
    force = every[:, 1] * weights[:, None] / 2
    applied = Loads(*map(jnp.asarray, (angle, force, turn)), jnp.zeros(1))
    found: SensorOutput = _FORWARD(skin, applied)
    kept = len(loads) + 1
    return jax.tree.map(lambda x: x[..., :kept], found)


def estimated(
    spec: SkinSpec, case: Case, loads: np.ndarray, random: np.random.Generator, **settings: int
) -> tuple[LoadEstimator, np.ndarray]:
    """The estimator of a case, and the readings of its loads [frame, taxel]."""
    true = true_readings(spec, case, loads)

    def measured(so: np.ndarray) -> np.ndarray:
        so = np.roll(so, case.shift, 1)
        return np.round(so + random.normal(0, NOISE, so.shape))

    rest = None
    if case.baseline:
        rest = measured(np.repeat(true[-1:], _BASELINE_FRAMES, 0)).mean(0)
    variance = (NOISE**2 + 1 / 12) / _BASELINE_FRAMES if case.baseline else 0.0
    estimator = LoadEstimator(spec, rest=rest, rest_variance=variance, **settings)  # type: ignore[arg-type]
    return estimator, measured(true[:-1])


def is_wrong(
    estimate: LoadEstimate,  # of one contact
    load: np.ndarray,  # the true one, by name
    # of its parameters, the first ones of the covariance
    names: Sequence[str] = ("angle", "force"),
) -> bool:
    """Whether an estimate is said to hold and doesn't."""
    if estimate.status != "ok":
        return False
    if len(estimate.contacts) != 1:
        return True
    (contact,) = estimate.contacts
    assert contact.covariance is not None
    off, count = np.array([getattr(contact, name) for name in names]) - load, len(names)
    square = off @ np.linalg.solve(contact.covariance[:count, :count], off)
    return bool(square > chi2.ppf(REGION, count))


def main() -> None:
    """Print a row a case."""
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])  # type: ignore[union-attr]
    options.add_argument("--loads", type=int, default=40)
    options.add_argument("--exact", action="store_true")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--only", help="rows whose name holds this")
    given = options.parse_args()
    configure()
    spec = skin_of_taxels()
    if given.exact:
        spec = with_tolerances(spec, exact=True)
    print(f"{'':34} wrong  2+ contacts  force error  stated   statuses")
    for case in CASES:
        if given.only and not any(x in case.name for x in given.only.split("|")):
            continue
        random = np.random.default_rng(given.seed)
        loads = drawn(given.loads, random)
        estimator, so = estimated(spec, case, loads, random)
        found = estimator.estimate(so)
        wrong = sum(is_wrong(e, load) for e, load in zip(found, loads, strict=True))
        several = sum(len(e.contacts) > 1 and e.status == "ok" for e in found)
        one = [
            (e.contacts[0].force / load[1] - 1, e.contacts[0].deviation("force") / load[1])
            for e, load in zip(found, loads, strict=True)
            if len(e.contacts) == 1
        ]
        error, stated = np.median(one, 0) if one else (np.nan, np.nan)
        statuses = ", ".join(f"{n} {s}" for s, n in Counter(e.status for e in found).items())
        print(
            f"{case.name:34} {wrong:2d}/{len(loads)} {several:9d}     {100 * error:+8.1f} % "
            f"{100 * stated:7.1f} %   {statuses}",
            flush=True,
        )
        verdict = section_verdict(
            estimator,
            so,
            np.zeros(so.shape, bool),
            found,
            force=loads[:, 1] if case.force_known else None,
        )
        print(f"{'':36}{'too few contacts' if verdict is None else verdict.text}", flush=True)
    case = Case("at rest, gap +3 %, no baseline", {"geometry.oil_gap": 0.03}, baseline=False)
    random = np.random.default_rng(given.seed)
    estimator, so = estimated(spec, case, np.zeros((10, 2)), random)
    alarms = sum(e.contact is not False for e in estimator.estimate(so))
    print(f"{case.name:34} {alarms:2d}/10 contacts")


if __name__ == "__main__":
    main()
