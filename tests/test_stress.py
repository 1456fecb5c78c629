"""Extremes converge or fail by name; `python -m benchmarks.stress` tries many more."""

import pytest

from benchmarks.stress import Outcome, Trial, attempt, skin

# Programs of their own; light, heavy and outward loads in test_equilibrium.
pytestmark = pytest.mark.long

TRIALS = {
    "thinnest": Trial("thickness", "0.02 mm", skin((30, 0.27), thickness=2e-5)),
    "thickest": Trial("thickness", "10 mm", skin((30, 130.0), thickness=0.01)),
    "weakest": Trial("force", "1e-6 N", skin((10, 1e-6))),
    "strongest": Trial("force", "1220 N", skin((10, 1220.0))),
    "outward": Trial("force", "-366 N", skin((10, -366.0))),
    "at the clamp": Trial("next to the clamp", "0.1 deg", skin((89.9, 20.0))),
    "tiny skin": Trial(
        "units",
        "micrometres",
        skin((20, 2e-11), inner_radius=5.75e-8, thickness=1.5e-9, width=1.23e-7, oil_gap=5e-9),
    ),
    "collapse": Trial(
        "vented", "200 N", skin((0, 200.0), oil="vented"), expected=("limit_point",)
    ),
    "single precision": Trial(
        "float32", "shell", skin((20, 20.0)), precision="float32", expected=("no_convergence",)
    ),
}


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    return {name: attempt(trial) for name, trial in TRIALS.items()}


@pytest.mark.parametrize("name", TRIALS)
def test_converged_and_balanced_or_a_named_failure(
    name: str, outcomes: dict[str, Outcome]
) -> None:
    assert outcomes[name].faults == []


def test_displacement_is_linear_in_a_tiny_force(outcomes: dict[str, Outcome]) -> None:
    weak = outcomes["weakest"].report["loads"][0]["displacement_m"]
    weaker = attempt(Trial("force", "1e-9 N", skin((10, 1e-9)))).report["loads"][0]
    assert weaker["displacement_m"] == pytest.approx(1e-3 * weak, rel=1e-5)


def test_units_don_t_matter(outcomes: dict[str, Outcome]) -> None:
    tiny = outcomes["tiny skin"].report
    usual = attempt(Trial("units", "metres", skin((20, 20.0)))).report
    assert tiny["oil_pressure_Pa"] == pytest.approx(usual["oil_pressure_Pa"], rel=1e-8)
    moved, reference = (r["loads"][0]["displacement_m"] for r in (tiny, usual))
    assert moved == pytest.approx(1e-6 * reference, rel=1e-8)
