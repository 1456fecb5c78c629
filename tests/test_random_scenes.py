"""Random scenes converge, or fail by name after they have left the model's validity."""

import math
from collections.abc import Iterator
from typing import Any

import pytest

from benchmarks.random_scenes import Outcome, study

# Four patterns, programs each; every law, oil and number of loads in test_equilibrium,
# test_gradients and test_shell.
pytestmark = pytest.mark.long

# Every law, every oil, one and two loads; the benchmark crosses them all.
PATTERNS = [
    ("mooney-rivlin", "incompressible", 1),
    ("ogden", "compressible", 2),
    ("neo-hookean", "incompressible", 2),
    ("yeoh", "vented", 1),
]


@pytest.fixture(scope="module")
def outcomes() -> list[Outcome]:
    return study(12, seed=3, patterns=PATTERNS)


def numbers(tree: Any) -> Iterator[float]:
    if isinstance(tree, dict):
        tree = list(tree.values())
    if isinstance(tree, list):
        for branch in tree:
            yield from numbers(branch)
    else:
        yield float(tree)


def test_every_reported_number_is_finite(outcomes: list[Outcome]) -> None:
    assert all(math.isfinite(x) for o in outcomes for x in numbers(o.report))


def test_converged_scenes_are_in_equilibrium(outcomes: list[Outcome]) -> None:
    converged = [o for o in outcomes if o.result == "converged"]
    assert len(converged) > 12
    assert max(o.imbalance for o in converged) < 1e-5
    assert max(abs(o.report["volume_residual"]) for o in converged) < 1e-10


def test_trapped_oil_fails_only_out_of_validity(outcomes: list[Outcome]) -> None:
    trapped = [o for o in outcomes if o.oil != "vented"]
    assert any(o.result != "converged" for o in trapped)  # the loads are severe enough
    assert all(o.result == "converged" for o in trapped if o.valid)


def test_a_failure_keeps_the_last_good_state(outcomes: list[Outcome]) -> None:
    failed = [o for o in outcomes if o.result != "converged"]
    assert failed
    assert all(0 < o.level < 1 for o in failed)
