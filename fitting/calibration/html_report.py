"""A calibration on one page: self-contained HTML, without scripts or links."""

import math
from collections.abc import Sequence
from typing import Any

from fitting.calibration.plan import Press, Step
from fitting.calibration.verification import Verification
from fitting.html.page import page
from suas_jax.acquisition.health import FAULTS, Health
from suas_jax.config import SkinSpec, format_quantity

_DIMENSIONS = {"m": "length", "F": "capacitance", "Pa": "stress"}
_WIDTH, _HEIGHT, _MARGIN = 640, 200, 20  # of the drawing [px]


def html_report(
    spec: SkinSpec,
    places: Sequence[tuple[float, float]],
    report: dict[str, Any],
    steps: Sequence[Step],
    verified: Sequence[Verification],
    health: Health,
) -> str:
    """The page.

    Args:
        spec: the skin before its calibration.
        places: of the taxels on the unrolled wall, along arc and axis [m].
        report: of `suas fit sensor`.
        steps: that were recorded.
        verified: known loads and their estimates; empty where none were asked for.
        health: of the taxels at rest.
    """
    passed = all(check.passed for check in verified)
    verdict = "verified" if passed else "verification failed"
    if not verified:
        verdict = "not verified"
    pressed = [(step, step.press) for step in steps if step.press is not None]
    return page(
        "fitting.calibration",
        "report.html.j2",
        report=report,
        verdict=verdict,
        constants=[_constant(name, report) for name in report["parameters"]],
        drawing=_drawing(spec, places, pressed),
        loads=[(step.name, press.text) for step, press in pressed],
        checks=[_check(check) for check in verified],
        taxels=len(health.taxels),
        faulty=[
            (
                f"{t.module}.{t.taxel}",
                ", ".join(t.faults),
                "; ".join(FAULTS[f] for f in t.faults),
            )
            for t in health.faulty
        ],
    )


def _constant(name: str, report: dict[str, Any]) -> tuple[str, ...]:
    unit = report["units"][name]
    before = report["before"].get(name)
    prior = report["priors"].get(name)
    return (
        name,
        "–" if before is None else _quantity(before, unit),
        _quantity(report["parameters"][name], unit),
        _quantity(report["standard_errors"][name], unit),
        "nothing" if prior is None else str(prior["reason"]),
    )


def _quantity(value: float, unit: str) -> str:
    if unit in _DIMENSIONS and value:
        return format_quantity(value, _DIMENSIONS[unit])  # type: ignore[arg-type]
    return f"{value:.5g}"


def _check(check: Verification) -> tuple[str, ...]:
    if math.isnan(check.force):
        return check.press.text, "no contact", check.status, "failed"
    found = Press(check.angle, check.force, check.axial)
    return check.press.text, found.text, check.status, "passed" if check.passed else "failed"


def _drawing(
    spec: SkinSpec,
    places: Sequence[tuple[float, float]],
    pressed: Sequence[tuple[Step, Press]],
) -> dict[str, Any]:
    """The unrolled wall with taxels, and where it was pressed [px]."""
    geometry = spec.geometry
    half = geometry.half_angle * (geometry.inner_radius - geometry.oil_gap)
    across = geometry.width / 2

    def point(arc: float, axial: float) -> tuple[str, str]:
        x = _MARGIN + (arc / half + 1) / 2 * (_WIDTH - 2 * _MARGIN)
        y = _MARGIN + (1 - axial / across) / 2 * (_HEIGHT - 2 * _MARGIN)
        return f"{x:.1f}", f"{y:.1f}"

    def place(press: Press) -> tuple[str, str]:
        return point(half * press.angle / geometry.half_angle, press.axial or 0.0)

    return {
        "width": _WIDTH,
        "height": _HEIGHT,
        "margin": _MARGIN,
        "taxels": [point(*at) for at in places],
        "presses": [
            (*place(press), step.verifies, f"{step.name}: {press.text}")
            for step, press in pressed
        ],
    }
