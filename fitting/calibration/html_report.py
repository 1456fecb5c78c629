"""A calibration on one page: self-contained HTML, without scripts or links."""

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from fitting.calibration.plan import Press, Step
from fitting.calibration.verification import Verification
from suas_jax.acquisition.health import FAULTS, Health
from suas_jax.config import SkinSpec, format_quantity

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 52em; margin: 2em auto; }
table { border-collapse: collapse; margin: 0.5em 0 1.5em; }
th, td { border-bottom: 1px solid #ccc; padding: 0.25em 1em 0.25em 0; text-align: left; }
.bad { color: #b00020; } .good { color: #1b6e20; }
"""
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
    parts = [
        f"<h1>Calibration of {escape(str(report['skin']))}</h1>",
        f"<p class={'good' if verified and passed else 'bad'}>{escape(report['status'])}, "
        f"{verdict}; {escape(report['created'])}</p>",
        "<h2>Constants</h2>",
        _table(
            ("constant", "skin file", "calibrated", "standard error", "assumed"),
            (_constant(name, report) for name in report["parameters"]),
        ),
        *(f"<p>Not determined: {escape(text)}</p>" for text in report["unidentifiable"]),
        "<h2>Known loads</h2>",
        _drawing(spec, places, [step for step in steps if step.press is not None]),
    ]
    if verified:
        rows = (_check(check) for check in verified)
        names = ("load", "estimated", "status", "verdict")
        parts += ["<h2>Verification</h2>", _table(names, rows)]
    parts += ["<h2>Taxels at rest</h2>", _taxels(health)]
    if report["warnings"]:
        items = "".join(f"<li>{escape(text)}</li>" for text in report["warnings"])
        parts += ["<h2>Warnings</h2>", f"<ul>{items}</ul>"]
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>Calibration</title><style>{_STYLE}</style></head>\n<body>\n{body}\n"
        "</body></html>\n"
    )


def _table(names: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


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


def _taxels(health: Health) -> str:
    total = len(health.taxels)
    if not health.faulty:
        return f"<p>All {total} taxels are healthy.</p>"
    rows = (
        (f"{t.module}.{t.taxel}", ", ".join(t.faults), "; ".join(FAULTS[f] for f in t.faults))
        for t in health.faulty
    )
    return f"<p>{len(health.faulty)} of {total} taxels are faulty.</p>" + _table(
        ("taxel", "faults", "meaning"), rows
    )


def _drawing(spec: SkinSpec, places: Sequence[tuple[float, float]], steps: list[Step]) -> str:
    """The unrolled wall with taxels, and where it was pressed."""
    geometry = spec.geometry
    half = geometry.half_angle * (geometry.inner_radius - geometry.oil_gap)
    across = geometry.width / 2

    def point(arc: float, axial: float) -> str:
        x = _MARGIN + (arc / half + 1) / 2 * (_WIDTH - 2 * _MARGIN)
        y = _MARGIN + (1 - axial / across) / 2 * (_HEIGHT - 2 * _MARGIN)
        return f'cx="{x:.1f}" cy="{y:.1f}"'

    marks = [f'<circle {point(*place)} r="3" fill="#aaa"/>' for place in places]
    for step in steps:
        assert step.press is not None
        arc = half * step.press.angle / geometry.half_angle
        colour = "#1b6e20" if step.verifies else "#b00020"
        where = point(arc, step.press.axial or 0.0)
        title = f"<title>{escape(step.name)}: {escape(step.press.text)}</title>"
        marks.append(
            f'<circle {where} r="8" fill="none" stroke="{colour}" stroke-width="3">'
            f"{title}</circle>"
        )
    width, height = _WIDTH - 2 * _MARGIN, _HEIGHT - 2 * _MARGIN
    frame = (
        f'<rect x="{_MARGIN}" y="{_MARGIN}" width="{width}" height="{height}" fill="none" '
        'stroke="#888"/>'
    )
    loads = ((s.name, s.press.text) for s in steps if s.press is not None)
    return (
        f'<svg width="{_WIDTH}" height="{_HEIGHT}" role="img">{frame}{"".join(marks)}</svg>'
        "<p>The unrolled wall: taxels grey, loads that calibrate red, that verify green.</p>"
        + _table(("log", "load"), loads)
    )
