"""Artefacts of a test that its curve alone shows: break, cycles, zeros, mistaken percent."""

import numpy as np

from fitting.material.experiments.free_zero import can_be_freed
from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.selection import broken, loadings, series_of
from fitting.material.experiments.slip_and_drift import drift, slips
from fitting.material.experiments.stress_tests import StressTest
from fitting.material.experiments.suspect import Suspect, travel_of
from fitting.material.experiments.toe import CERTAIN, idle, toe_end

# No rubber stretches to this many times its length; the softest silicones reach 17.
_LONGEST = 20.0
# Loadings that differ by more than this share of the largest stress are not one curve.
_SOFTENED = 0.03
# A curve that misses zero stress at rest, by what is certain and by this share of its largest
# stress, has another zero.
_NOTICEABLE = 0.015
_NEAR_REST = 0.35
# Of a stated preload: how closely the force at rest agrees with it.
_AS_STATED = 0.5


def curve_suspects(data: Dataset) -> list[Suspect]:
    """Artefacts that the curve of a test shows by itself, whatever law is fitted."""
    if not isinstance(data, StressTest) or not data.is_curve or data.size < 4:
        return []
    if data.follows_history:
        return _too_long(data)
    found = []
    after = broken(data)
    if after.any():
        found.append(_break(data, after))
    found += _cycles(data)
    found += _too_long(data)
    found += slips(data)
    found += drift(data)
    if not found:
        found += _missed_zero(data)
    return found


def _break(data: StressTest, after: np.ndarray) -> Suspect:
    lines = data.line[after]
    first = float(np.min(data.deformation[after]))
    return Suspect(
        "break",
        data.file,
        f"the stress falls at a stretch of {np.exp(first):.3g} and does not come back: "
        f"{int(after.sum())} readings from line {lines.min()} on are of a broken specimen",
        "--cut-break",
        float(np.exp(first)),
        "stretch",
    )


def _cycles(data: StressTest) -> list[Suspect]:
    """Loadings of one specimen that lie on different curves."""
    for cycles in loadings(data):
        if len(cycles) < 2:
            continue
        first, last = cycles[0], cycles[-1]
        h = data.deformation
        common = min(h[first].max(), h[last].max())
        inside = h[last] <= common
        if inside.sum() < 3:
            continue
        order = np.argsort(h[first], kind="stable")
        size = np.abs(data.value)
        before = np.interp(h[last][inside], h[first][order], size[first][order])
        lower = before - size[last][inside]
        share = float(np.mean(lower) / np.max(before))
        if abs(share) > _SOFTENED:
            return [
                Suspect(
                    "preconditioning",
                    data.file,
                    f"{len(cycles)} loadings of one specimen, of which the last is "
                    f"{100.0 * float(np.sum(lower) / np.sum(before)):.0f} % softer than the "
                    f"first: they are not one curve",
                    "--cycle last",
                    share,
                    "of the largest stress",
                )
            ]
    return []


def _too_long(data: StressTest) -> list[Suspect]:
    origin = data.origin
    longest = float(np.max(np.maximum(data.stretch_1, 1.0 / data.stretch_1)))
    if origin.state not in ("strain", "stretch") or origin.unit or longest < _LONGEST:
        return []
    return [percent_suspect(data, f"it would stretch the specimen to {longest:.3g} times")]


def percent_suspect(data: StressTest, evidence: str) -> Suspect:
    """A column of strains whose unit is another than its name says."""
    origin = data.origin
    quantity = "strain"
    if origin.unit == "%":
        name = origin.column.partition("%")[0].strip("_ [(")
        return Suspect(
            "percent",
            data.file,
            f'column "{origin.column}" is not in percent: {evidence}',
            f'--columns "{quantity}={origin.column} 1" (or name it "{name}")',
        )
    return Suspect(
        "percent",
        data.file,
        f'column "{origin.column}" is in percent, not a fraction: {evidence}',
        f'--columns "{quantity}={origin.column} %"',
    )


def _missed_zero(data: StressTest) -> list[Suspect]:
    """The stress at rest that the readings near it point to, where it is not zero."""
    if not can_be_freed(data):
        return []
    found = []
    for rows in series_of(data):
        x = np.log(data.stretch_1[rows])
        y = data.value[rows]
        side = 1.0 if np.sum(x) >= 0.0 else -1.0
        x, y = side * x, side * y
        found += _zero_of_series(data, rows, x, y)
    return found


def _zero_of_series(
    data: StressTest, rows: np.ndarray, x: np.ndarray, y: np.ndarray
) -> list[Suspect]:
    largest, span = float(np.max(np.abs(y))), float(np.max(x))
    near = x <= _NEAR_REST * span
    if near.sum() < 8 or np.min(x) > 0.1 * span or largest <= 0.0:
        return []
    label = data.specimen[rows][0]
    where = f"specimen {label}: " if label and len(set(data.specimen)) > 1 else ""
    taut = idle(x, y, largest)
    if taut is not None:
        stretch = float(np.exp(taut) - 1.0)
        size, unit = travel_of(data, stretch)
        return [
            Suspect(
                "slack",
                data.file,
                f"{where}nothing is carried up to a stretch of {np.exp(taut):.4g}, then the "
                f"stress rises: the specimen was slack by about {size:.3g} {unit}",
                "--zero slack",
                size,
                unit,
            )
        ]
    toe = toe_end(x, y)
    if toe is not None:
        return [
            Suspect(
                "toe",
                data.file,
                f"{where}the curve grows steeper up to a stretch of {np.exp(toe):.4g}, which "
                f"rubber does not: the specimen or its grips were taking up slack",
                "--zero slack",
                float(np.exp(toe)),
                "stretch",
            )
        ]
    return _off_at_rest(data, rows[near], where, float(np.min(y)), largest)


def _off_at_rest(
    data: StressTest, near: np.ndarray, where: str, lowest: float, largest: float
) -> list[Suspect]:
    """Slack or an offset of the force, by the stress at rest that readings near it point to.

    `near`: positions of the readings of a specimen near rest. `lowest`: of its stresses,
    positive away from rest [Pa]. `largest`: size of its largest stress [Pa].
    """
    # Neo-Hookean and Mooney's second term follow any rubber near rest, whatever the mode.
    part = data.select(np.isin(np.arange(data.size), near))
    e1, e2, c1, c2 = part.factors
    inverse = np.exp(2.0 * (e1 + e2))
    second = c1 * (inverse - np.exp(-2.0 * e1)) + c2 * (inverse - np.exp(-2.0 * e2))
    own = data.specimen == part.specimen[0]
    side = 1.0 if np.sum(np.log(data.stretch_1[own])) >= 0.0 else -1.0
    fit = np.stack([np.ones(part.size), side * part.unit_stress, side * second], axis=1)
    sizes = np.linalg.norm(fit, axis=0)
    values = side * part.value
    solution, _, rank, _ = np.linalg.lstsq(fit / sizes, values, rcond=1e-8)
    spare = part.size - 3
    if rank < 3 or spare < 3:
        return []
    solution = solution / sizes
    scatter = float(np.sum((values - fit @ solution) ** 2)) / spare
    error = float(np.sqrt(scatter * np.linalg.inv(fit.T @ fit)[0, 0]))
    at_rest = float(solution[0])
    # Slope at rest by log stretch, from the mode's: 3, 4 and 6 times the modulus.
    slope = {"uniaxial": 3.0, "pure_shear": 4.0, "equibiaxial": 6.0}[data.mode]
    slope *= float(solution[1] + solution[2])
    if abs(at_rest) < max(CERTAIN * error, _NOTICEABLE * largest) or slope <= 0.0:
        return []
    below = lowest < -max(CERTAIN * np.sqrt(scatter), _NOTICEABLE * largest)
    found = _zeros_off(data, where, at_rest, slope)
    # Nothing pulls a specimen that hangs slack.
    return found[::-1] if at_rest < 0.0 and not below else found


def _zeros_off(data: StressTest, where: str, at_rest: float, slope: float) -> list[Suspect]:
    """Both zeros that a curve off at rest may have: no curve tells them apart.

    `at_rest`: stress at a stretch of one [Pa]. `slope`: of the stress there, by the strain
    [Pa].
    """
    size, unit = at_rest / 1e6, "MPa"
    if np.isfinite(data.origin.area):
        size, unit = at_rest * data.origin.area, "N"
    lag, travel = travel_of(data, -at_rest / slope)
    preload = data.origin.preload
    stated = unit == "N" and abs(size - preload) < _AS_STATED * preload
    is_off = f"the load cell is off by about {size:.3g} {unit}"
    if lag > 0.0:
        is_slack = f"the specimen was slack by about {lag:.3g} {travel}"
        at_zero = (
            f"the curve meets zero stress at a strain of {-at_rest / slope:.3g}, not at rest"
        )
    else:
        is_slack = (
            f"the travel counts from where the specimen was stretched by {-lag:.3g} {travel}"
        )
        at_zero = f"at rest the curve points to a stress of {at_rest / 1e6:.3g} MPa"
        if stated:
            is_slack += f", by the preload of {preload:.3g} N that the file states"
    force = Suspect(
        "force offset",
        data.file,
        f"{where}{at_zero}: {is_off}, unless {is_slack} (--zero slack)",
        "--zero force",
        size,
        unit,
    )
    slack = Suspect(
        "slack",
        data.file,
        f"{where}{at_zero}: {is_slack}, unless {is_off} (--zero force)",
        "--zero slack",
        lag,
        travel,
    )
    return [slack, force] if stated else [force, slack]
