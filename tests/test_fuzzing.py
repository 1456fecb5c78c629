"""The short version of benchmarks/fuzzing.py."""

from benchmarks.fuzzing import fuzz


def test_no_mutated_input_ends_in_a_traceback_or_a_hang() -> None:
    trials, findings = fuzz(3.0, seed=1_000_000)
    assert findings == []
    assert min(trials.values()) > 2
