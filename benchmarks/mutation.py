"""Mutants: single mistakes put into the code, each of which the named tests must notice.

    python -m benchmarks.mutation            all of them
    python -m benchmarks.mutation cobs dof   those whose names contain one of the words

The mistakes are made in a temporary copy of the tree, one at a time; the tree itself is only
read. A test file is first run on the copy as it is: a mutant is killed only if tests fail that
passed before. Processor time of a mutant is that of its test file. Exit status 1 if one
survived.
"""

import pathlib
import sys
import time
from typing import NamedTuple

from benchmarks.mutation_runner import copied, run_tests


class Mutant(NamedTuple):
    """A mistake.

    Attributes:
        name: what is wrong.
        file: where, from the root of the tree.
        old: the right text, which stands there once.
        new: the wrong one.
        tests: test file that must fail.
    """

    name: str
    file: str
    old: str
    new: str
    tests: str


COBS = "suas_jax/acquisition/frames/formats/cobs.py"
TEXT = "suas_jax/acquisition/frames/formats/text.py"
BASELINE = "suas_jax/acquisition/baseline.py"
CONVERTER = "suas_jax/sensing/converter.py"
OUTLIERS = "fitting/inverse_load/fit/outliers.py"
SELECTION = "fitting/inverse_load/fit/selection.py"
RESIDUALS = "fitting/statistics/residuals.py"
IDENTIFIABILITY = "fitting/statistics/identifiability.py"
EQUILIBRIUM = "suas_jax/equilibrium/equilibrium.py"
EQUILIBRIUM_PATH = "suas_jax/equilibrium/equilibrium_path.py"
LOAD_PATH = "suas_jax/equilibrium/load_path.py"

MUTANTS = (
    Mutant(
        "cobs: frames without taxels are accepted",
        COBS,
        "not 0 < n <= _MAX_TAXELS",
        "not 0 <= n <= _MAX_TAXELS",
        "tests/test_frames.py",
    ),
    Mutant(
        "cobs: bytes behind the counts are accepted",
        COBS,
        "right_size != end",
        "right_size > end",
        "tests/test_frames.py",
    ),
    Mutant(
        "text: another number of counts is believed too early",
        TEXT,
        "_CHANGED = 20",
        "_CHANGED = 19",
        "tests/test_frames.py",
    ),
    Mutant(
        "text: another number of counts is believed too late",
        TEXT,
        "_CHANGED = 20",
        "_CHANGED = 21",
        "tests/test_frames.py",
    ),
    Mutant(
        "baseline: noise of differences taken for noise of frames",
        BASELINE,
        "steps / math.sqrt(2)",
        "steps",
        "tests/test_baseline.py",
    ),
    Mutant(
        "baseline: common factor from the mean of all taxels",
        BASELINE,
        "np.nanmedian(ratio)",
        "np.nanmean(ratio)",
        "tests/test_baseline.py",
    ),
    Mutant(
        "converter: repeated frames lose their saturation",
        CONVERTER,
        "counts[last_new], saturated[last_new]",
        "counts[last_new], saturated",
        "tests/test_sensing.py",
    ),
    Mutant(
        "converter: repeated frames have new counts",
        CONVERTER,
        "counts[last_new], saturated[last_new]",
        "counts, saturated[last_new]",
        "tests/test_sensing.py",
    ),
    Mutant(
        "inverse load: taxels are left out free of charge",
        OUTLIERS,
        "left_out * _OUTLIER**2",
        "left_out * 0.0",
        "tests/test_inverse_load.py",
    ),
    Mutant(
        "inverse load: contacts without a force are kept",
        SELECTION,
        "gain < self.penalty)",
        "gain < 0)",
        "tests/test_inverse_load.py",
    ),
    Mutant(
        "likelihood: n log noise dropped",
        RESIDUALS,
        " - count * jnp.log(noise)",
        "",
        "tests/test_linear_model.py",
    ),
    Mutant(
        "intervals: normal quantile for Student's t",
        IDENTIFIABILITY,
        "stats.t.ppf(0.5 + 0.5 * level, max(self.dof, 1))",
        "stats.norm.ppf(0.5 + 0.5 * level)",
        "tests/test_linear_model.py",
    ),
    Mutant(
        "degrees of freedom: held constants are counted",
        IDENTIFIABILITY,
        "dof = count - int(kept.sum())",
        "dof = count - len(kept)",
        "tests/test_linear_model.py",
    ),
    Mutant(
        "identifiability: no test of the rank",
        IDENTIFIABILITY,
        "(noise_of / np.maximum(s, limit) > _FREE) | (s < _RANK * s[0])",
        "noise_of / np.maximum(s, limit) > _FREE",
        "tests/test_linear_model.py",
    ),
    Mutant(
        "equilibrium: failure of the first stage forgotten",
        LOAD_PATH,
        "failed = jnp.any(found.result != 0, 0)",
        "failed = found.result[-1] != 0",
        "tests/test_equilibrium.py",
    ),
    # The next two survive: no state was found that they change for the worse (shells thin
    # and thick, presses, pulls and loads along the arc, 1e-5 Pa to 10 MPa).
    Mutant(
        "equilibrium: steps towards a pressure of any length",
        EQUILIBRIUM,
        "    careful = dataclasses.replace(stepping, largest_step=1.0)\n    if start",
        "    careful = stepping\n    if start",
        "tests/test_equilibrium.py",
    ),
    Mutant(
        "path: steps from pressure to pressure of any length",
        EQUILIBRIUM_PATH,
        "careful = dataclasses.replace(stepping, largest_step=1.0)\n            y =",
        "careful = stepping\n            y =",
        "tests/test_equilibrium.py",
    ),
)


def judge(copy: pathlib.Path, mutant: Mutant) -> tuple[str, float]:
    """Put a mistake into the copy, run its tests and take it out again."""
    file = copy / mutant.file
    right = file.read_text()
    if right.count(mutant.old) != 1:
        return "no such text", 0.0
    file.write_text(right.replace(mutant.old, mutant.new))
    try:
        outcome, _, seconds = run_tests(copy, mutant.tests)
    finally:
        file.write_text(right)
    named = {"failed": "killed", "hung": "killed", "passed": "SURVIVED"}
    return named.get(outcome, outcome), seconds


def main(words: list[str]) -> int:
    chosen = [m for m in MUTANTS if not words or any(word in m.name for word in words)]
    start = time.perf_counter()
    with copied() as copy:
        sound: dict[str, str] = {}
        for tests in sorted({m.tests for m in chosen}):
            sound[tests], _, seconds = run_tests(copy, tests)
            print(f"{sound[tests]:14}{seconds:6.1f} s  {tests}, no mutant", flush=True)
        killed = 0
        for mutant in chosen:
            outcome, seconds = "tests unsound", 0.0
            if sound[mutant.tests] == "passed":
                outcome, seconds = judge(copy, mutant)
            killed += outcome == "killed"
            print(f"{outcome:14}{seconds:6.1f} s  {mutant.name}", flush=True)
    print(f"{killed} of {len(chosen)} killed, {time.perf_counter() - start:.0f} s")
    return int(killed < len(chosen))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
