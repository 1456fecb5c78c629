"""A calibration verified by known loads, and all of it on one page of self-contained HTML."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from fitting.calibration.plan import Press, Step
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.readings import readings_of
from fitting.report.description import quantity_text
from fitting.report.page import page
from suas_jax.acquisition.baseline import Baseline
from suas_jax.acquisition.health import FAULTS, Health
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.acquisition.taxel_faults import mean
from suas_jax.config import SkinSpec
from suas_jax.skin.plain import angles_at, plain_geometry

_ANGLE, _ARC, _AXIAL = math.radians(2.0), 2e-3, 2e-3  # tolerated places
_FORCE = 0.1  # and share of force
_ERRORS = 3.0  # standard errors that are tolerated, too

_WIDTH, _HEIGHT, _MARGIN = 640, 200, 20  # of the drawing [px]


@dataclass(frozen=True)
class Verification:
    """One known load and what was estimated."""

    press: Press  # the known load
    status: str  # of the estimate
    place: float  # estimated, as the press tells it [rad or m]; NaN where nothing was found
    force: float  # likewise [N]
    axial: float | None  # likewise on a pad [m]
    # whether it is within 2 degrees (or 2 mm of arc), 2 mm and 10 % of the force, or three
    # standard errors
    passed: bool


def verify(
    spec: SkinSpec, baseline: Baseline, logs: Sequence[tuple[Press, Path]]
) -> list[Verification]:
    """Estimate known loads.

    The skin is the calibrated one. `baseline`: at rest, from which the readings count. `logs`:
    the known loads, and their logs.
    """
    from fitting.inverse_load.readings import Layout

    rest, variance = Layout(spec).baseline(baseline, "rest")
    # A pad's estimator carries no calibration's errors; readings count from rest anyway.
    bare = spec.model_copy(update={"calibration": None})
    estimator = LoadEstimator(bare, rest=rest, rest_variance=variance, most_contacts=1)
    found = []
    for press, path in logs:
        readings = readings_of(read_log(path), spec, estimator.reading_noise)
        so = np.where(readings.stuck, np.nan, readings.so)
        (estimate,) = estimator.estimate(mean(so)[None])
        if not estimate.contacts:
            found.append(Verification(press, estimate.status, math.nan, math.nan, None, False))
            continue
        contact = max(estimate.contacts, key=lambda c: c.force)
        place, tolerance = contact.angle, _ANGLE
        if press.by == "arc":
            assert contact.arc is not None  # a section without angles states arcs
            place, tolerance = contact.arc, _ARC
        errors = {
            press.by: abs(place - press.place) / _allowed(contact, press.by, tolerance),
            "force": abs(contact.force - press.force)
            / _allowed(contact, "force", _FORCE * press.force),
        }
        if contact.axial is not None and press.axial is not None:
            allowed = _allowed(contact, "axial", _AXIAL)
            errors["axial"] = abs(contact.axial - press.axial) / allowed
        found.append(
            Verification(
                press,
                estimate.status,
                place,
                contact.force,
                contact.axial,
                max(errors.values()) <= 1.0,
            )
        )
    return found


def _allowed(contact: object, name: str, tolerance: float) -> float:
    deviation = contact.deviation(name)  # type: ignore[attr-defined]
    return max(tolerance, _ERRORS * deviation if math.isfinite(deviation) else 0.0)


def html_report(
    spec: SkinSpec,  # the skin before its calibration
    places: Sequence[tuple[float, float]],
    report: dict[str, Any],  # of `suas fit sensor`
    steps: Sequence[Step],  # that were recorded
    verified: Sequence[Verification],
    health: Health,  # of the taxels at rest
) -> str:
    """The page.

    Places are those of the taxels on the unrolled wall, along arc and axis [m]. The list of
    verified known loads is empty where none were asked for.
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
        "–" if before is None else quantity_text(before, unit),
        quantity_text(report["parameters"][name], unit),
        quantity_text(report["standard_errors"][name], unit),
        "nothing" if prior is None else str(prior["reason"]),
    )


def _check(check: Verification) -> tuple[str, ...]:
    if math.isnan(check.force):
        return check.press.text, "no contact", check.status, "failed"
    found = Press(check.place, check.force, check.axial, check.press.by)
    return check.press.text, found.text, check.status, "passed" if check.passed else "failed"


def _drawing(
    spec: SkinSpec, places: Sequence[tuple[float, float]], pressed: Sequence[tuple[Step, Press]]
) -> dict[str, Any]:
    """The unrolled wall with taxels, and where it was pressed [px]."""
    geometry = plain_geometry(spec.geometry)
    half, across = float(geometry.wall_arc(geometry.half_angle)[0]), spec.geometry.width / 2

    def point(arc: float, axial: float) -> tuple[str, str]:
        x = _MARGIN + (arc / half + 1) / 2 * (_WIDTH - 2 * _MARGIN)
        y = _MARGIN + (1 - axial / across) / 2 * (_HEIGHT - 2 * _MARGIN)
        return f"{x:.1f}", f"{y:.1f}"

    def place(press: Press) -> tuple[str, str]:
        angle = angles_at(spec.geometry, press.by, np.array([press.place]))
        return point(float(geometry.wall_arc(jnp.asarray(angle))[0]), press.axial or 0.0)

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
