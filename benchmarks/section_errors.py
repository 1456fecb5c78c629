"""Is the stated error of other sections honest? Random ones, by four laws, against solids.

    python -m benchmarks.section_errors [SECTIONS] [--seed N] [--laws N] [--elements N]

Ellipses, flat tops and splines as `benchmarks.random_scenes` draws them, 0.5 to 3 mm thick,
each with one line load from 1 % to 150 % of what gives the paper's skin its pressure, by every
law: the shell on one mesh, against the solid. Scenes that reach the wall or have no
equilibrium are counted, not compared.
"""

import argparse
import dataclasses
import sys
from collections import Counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.error_estimate import true_error
from benchmarks.random_scenes import FORCE_AT_10_KPA, LAWS, SECTIONS, pattern, sample_section
from suas_jax import configure
from suas_jax.config import SceneSpec, continuous_inputs, with_inputs, with_solve
from suas_jax.scene.solve import solve

TRUTH = (384, 4)  # at the joints of paths fewer elements are not exact enough
_MODULI = {"mooney-rivlin": 32.6e6, "neo-hookean": 3e6, "yeoh": 1.2e6, "ogden": 4.225e5}


@dataclasses.dataclass(frozen=True)
class Case:
    """One section of one law."""

    section: str  # its kind
    law: str  # of the membrane
    status: str  # of the shell; "at the wall" where it is out of range
    stable: bool  # whether it is
    stated: float  # the shell's error
    true: float  # its difference from the solid
    unsure: float  # the solid's own stated error
    scene: SceneSpec  # what was solved

    @property
    def told(self) -> bool:
        """Whether the stated error is above the true one, as surely as that is known."""
        return self.true <= self.stated + self.unsure


def sample(section: str, law: str, seed: tuple[int, int]) -> SceneSpec:
    """The same section, place and share of the load for every law."""
    rng = np.random.default_rng([*seed, list(SECTIONS).index(section)])
    scene = sample_section(rng, pattern(law, "incompressible", 1, section))
    share = np.exp(rng.uniform(*np.log([0.01, 1.5])))
    relative = scene.geometry.mean_thickness / 1.5e-3 * _MODULI[law] / 32.6e6
    drawn = with_inputs(scene, {"load.0.force": float(share * relative * FORCE_AT_10_KPA)})
    wall = drawn.wall.model_copy(update={"contact": False})
    return drawn.model_copy(update={"wall": wall})


def case_of(scene: SceneSpec, elements: int) -> Case:
    """Solve with both models."""
    own = solve(with_solve(scene, model="shell", elements=elements)).report
    kind = scene.geometry.section, scene.material.law
    status, none = own["status"], (np.nan, np.nan)
    if status == "converged" and own["wall_contact"]:
        status = "at the wall"
    if status != "converged":
        return Case(*kind, status, False, np.nan, *none, scene)
    truth = solve(with_solve(scene, model="solid", mesh=TRUTH)).report
    if truth["status"] != "converged":
        return Case(*kind, f"solid: {truth['status']}", False, np.nan, *none, scene)
    errors = own["error_estimate"], true_error(own, truth), truth["error_estimate"]
    return Case(*kind, status, bool(own["stable"]), *errors, scene)


def study(sections: int, seed: int, elements: int, laws: int) -> list[Case]:
    """As many sections of each kind, by some of the laws in turn."""
    cases = []
    for j, section in enumerate(name for name in SECTIONS if name != "circle"):
        for i in range(laws):
            law = list(LAWS)[(2 * j + i) % len(LAWS)]
            for k in range(sections):
                cases.append(case_of(sample(section, law, (seed, k)), elements))
                c = cases[-1]
                words = f"{c.status}, {c.stable=}, {c.stated:.1e} for {c.true:.1e}"
                print(section, law, k, words, f"({c.unsure:.0e})", file=sys.stderr, flush=True)
    return cases


def rows(cases: list[Case]) -> list[list[Any]]:
    """A line for every kind of section and law."""
    found = []
    for kind in dict.fromkeys((c.section, c.law) for c in cases):
        group = [c for c in cases if (c.section, c.law) == kind]
        good = [c for c in group if c.status == "converged"]
        others = Counter(c.status for c in group if c.status != "converged")
        ratios = [c.stated / c.true for c in good] or [np.nan]
        told = sum(c.told for c in good)
        met = sum(c.true <= c.stated for c in good)
        found.append([*kind, len(good), dict(others), met, told, np.median(ratios)])
    return found


def main() -> None:
    """Print how often the stated error holds, and where it does not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="?", type=int, default=99)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--laws", type=int, default=len(LAWS), help="of each kind of section")
    parser.add_argument("--elements", type=int, default=64)
    options = parser.parse_args()
    configure()
    cases = study(-(-options.sections // 3), options.seed, options.elements, options.laws)
    columns = ("section", "law", "compared", "not", "true < stated", "within the solid's")
    table = Table(*columns, "stated over true, median")
    for row in rows(cases):
        table.add_row(*map(str, row[:-1]), f"{row[-1]:.1f}")
    console = Console(width=140)
    console.print(table)
    for c in cases:
        if c.status == "converged" and not c.true <= c.stated:
            numbers = {k: round(v, 6) for k, v in continuous_inputs(c.scene).items()}
            words = f"{c.section}, {c.law}, {c.stable=}: {c.stated:.1e} for {c.true:.1e}"
            console.print(f"{words} (solid {c.unsure:.0e}): {numbers}")


if __name__ == "__main__":
    main()
