"""Does a log say what is wrong with its skin file? Random skins, random mistakes.

    python -m benchmarks.field_variants [--logs N] [--seed K] [--only NAME]

Each log is of a skin with a radius of 45-70 mm, 1-2 mm thick, with a gap of 4-6.5 mm and 24 to
56 taxels of 4 mm from -80 to 80 degrees; 30 to 100 contacts within 65 degrees, 2 to 20 N where
the thickness is 1.5 mm; 2 counts of noise. In each kind of log one number of the true skin is
further off than the tolerances that are taken where a file states none, or the columns are
shifted, or the contacts are wide. "Named": the end of the log names that number as the cause,
or among those that explain the log as well. "Wrong": frames of status ok whose truth lies
outside their own 99.9 % region, or whose number of contacts is not one. In the last kinds all
numbers are drawn from the tolerances themselves: wrong frames must be as rare as stated.
"""

import argparse
from typing import NamedTuple

import numpy as np

from benchmarks.field_errors import Case, drawn, estimated, is_wrong, true_output
from benchmarks.inverse_load import NOISE, skin_of_40
from fitting.inverse_load.check.section_log import section_verdict
from fitting.inverse_load.check.verdict import WIDTH, ModelVerdict
from suas_jax import configure
from suas_jax.config import ElectrodesSpec, SkinSpec, continuous_inputs
from suas_jax.config.input_errors import DEFAULTS, STIFFNESS

GAP, PERMITTIVITY = "geometry.oil_gap", "oil.relative_permittivity"
SCALE, THICKNESS = "electrodes.lsb", "geometry.thickness"


class Kind(NamedTuple):
    """A kind of log.

    Attributes:
        wrong: what is wrong: an input's path, STIFFNESS, "shift", WIDTH, "" for tolerances.
        sizes: smallest and largest relative change.
        baseline: whether readings count from those at rest.
        known: "force" or "pressure", where the log holds that.
    """

    wrong: str
    sizes: tuple[float, float] = (0.0, 0.0)
    baseline: bool = True
    known: str = ""


KINDS = {
    "gap": Kind(GAP, (0.04, 0.10)),
    "gap, no baseline": Kind(GAP, (0.04, 0.10), baseline=False),
    "permittivity": Kind(PERMITTIVITY, (0.04, 0.10)),
    "permittivity, no baseline": Kind(PERMITTIVITY, (0.04, 0.10), baseline=False),
    "scale": Kind(SCALE, (0.02, 0.06)),
    "scale, no baseline": Kind(SCALE, (0.02, 0.06), baseline=False),
    "thickness": Kind(THICKNESS, (0.05, 0.15)),
    "thickness, no baseline": Kind(THICKNESS, (0.05, 0.15), baseline=False),
    "stiffness, forces known": Kind(STIFFNESS, (0.15, 0.35), known="force"),
    "stiffness, pressures known": Kind(STIFFNESS, (0.15, 0.35), known="pressure"),
    "columns shifted": Kind("shift"),
    "columns shifted, no baseline": Kind("shift", baseline=False),
    "contacts 15 to 25 mm wide": Kind(WIDTH),
    "all within tolerances": Kind(""),
    "all within tolerances, no baseline": Kind("", baseline=False),
}


def drawn_skin(random: np.random.Generator) -> SkinSpec:
    """A random skin file."""
    spec = skin_of_40()
    size = {
        "thickness": random.uniform(1e-3, 2e-3),
        "inner_radius": random.uniform(45e-3, 70e-3),
        "oil_gap": random.uniform(4e-3, 6.5e-3),
    }
    places = np.deg2rad(np.linspace(-80, 80, int(random.choice([24, 32, 40, 56]))))
    taxels = [{"angle": angle} for angle in places.tolist()]
    assert spec.electrodes is not None
    electrodes = ElectrodesSpec(taxels=taxels, noise=NOISE, lsb=spec.electrodes.lsb)
    geometry = spec.geometry.model_copy(update=size)
    return spec.model_copy(update={"geometry": geometry, "electrodes": electrodes})


def changes_of(
    kind: Kind, spec: SkinSpec, random: np.random.Generator
) -> tuple[dict[str, float], float]:
    """Relative changes of the true skin's inputs by path, and that of what is wrong."""
    law = [path for path in continuous_inputs(spec) if path.startswith("material.C")]

    def paths(name: str) -> list[str]:
        return law if name == STIFFNESS else [name]

    if not kind.wrong:
        sizes = {name: share * random.normal() for name, share in DEFAULTS.items()}
        return {path: by for name, by in sizes.items() for path in paths(name)}, 0.0
    by = random.uniform(*kind.sizes) * random.choice([-1, 1])
    return (dict.fromkeys(paths(kind.wrong), by) if kind.sizes[1] else {}), by


class Log(NamedTuple):
    """What came out of a log.

    Attributes:
        frames: number of them.
        wrong: how many are wrong at status ok.
        named: whether the cause is named.
        text: what is said, and what was changed.
    """

    frames: int
    wrong: int
    named: bool
    text: str


def _named(kind: Kind, verdict: ModelVerdict | None, shift: int) -> bool:
    """Whether a verdict names what is wrong, or finds nothing where nothing is."""
    if verdict is None:
        return False
    if kind.wrong == "shift":
        return verdict.shift == -shift
    return not kind.wrong or kind.wrong in verdict_names(verdict)


def verdict_names(verdict: ModelVerdict) -> set[str | None]:
    """The causes that a verdict names."""
    return {verdict.name, *(other.name for other in verdict.others)}


def log_of(kind: Kind, random: np.random.Generator) -> Log:
    """Draw a skin, its mistake and a log, and estimate the log."""
    spec = drawn_skin(random)
    changes, by = changes_of(kind, spec, random)
    shift = int(random.choice([-2, -1, 1, 2])) if kind.wrong == "shift" else 0
    width = random.uniform(15e-3, 25e-3) if kind.wrong == WIDTH else 0.0
    loads = drawn(int(random.integers(30, 100)), random)
    loads[:, 1] *= spec.geometry.mean_thickness / 1.5e-3
    case = Case("", changes, kind.baseline, width, shift, wall=True)
    estimator, so = estimated(spec, case, loads, random)
    found = estimator.estimate(so)
    pressure = None
    if kind.known == "pressure":
        pressure = np.ravel(true_output(spec, case, loads).oil_pressure)[:-1]
    verdict = section_verdict(
        estimator,
        so,
        np.zeros(so.shape, bool),
        found,
        pressure=pressure,
        force=loads[:, 1] if kind.known == "force" else None,
    )
    wrong = sum(map(is_wrong, found, loads))
    text = "too few contacts" if verdict is None else verdict.text
    said = f"true change {100 * by:+.1f} %, shift {shift}, width {1e3 * width:.0f} mm: {text}"
    return Log(len(loads), wrong, _named(kind, verdict, shift), said)


def main() -> None:
    """Print a row a kind of log."""
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])  # type: ignore[union-attr]
    options.add_argument("--logs", type=int, default=10)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--only", default="", help="kinds whose name holds this")
    given = options.parse_args()
    configure()
    for k, (name, kind) in enumerate(KINDS.items()):
        if given.only not in name:
            continue
        logs = []
        for i in range(given.logs):
            logs.append(log_of(kind, np.random.default_rng([given.seed, k, i])))
            print(f"    {logs[-1].text}; wrong {logs[-1].wrong}", flush=True)
        frames, wrong = sum(x.frames for x in logs), sum(x.wrong for x in logs)
        named = "" if not kind.wrong else f"{sum(x.named for x in logs)} of {len(logs)} named, "
        print(f"{name}: {named}{wrong} of {frames} frames wrong", flush=True)


if __name__ == "__main__":
    main()
