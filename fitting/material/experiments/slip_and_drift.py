"""Artefacts of a record in order of time: an extensometer that slips, a cell that drifts."""

import numpy as np

from fitting.material.experiments.selection import half_cycles, series_of
from fitting.material.experiments.stress_tests import StressTest
from fitting.material.experiments.suspect import Suspect, travel_of

# A slip: so many times what half of the other steps, or a tenth, scatter, and this share of
# the span.
_SLIPPED, _SLIPPED_RARELY, _SLIP_SHARE = 15.0, 3.0, 0.01
_SLIPS = 3  # more steps alike are how the test was made
_FEWEST_STEPS, _NEIGHBOURS = 12, 3
_FOLLOWED = 0.3  # of a jump, by the stress: the material was stretched
# Drift: a change of the stress at rest by this share of the largest, within this share of the
# largest strain.
_AT_REST, _DRIFTED = 0.01, 0.02


def slips(data: StressTest) -> list[Suspect]:
    """Jumps of the strain that the stress does not share."""
    found = []
    for rows in series_of(data):
        for half in half_cycles(data.deformation[rows]):
            own = rows[half.rows]
            if len(own) < _FEWEST_STEPS:
                continue
            stretch, value = data.stretch_1[own], data.value[own]
            step, rise = np.diff(stretch), np.diff(value)
            jump, off = step - _usual(step), rise - _usual(rise)
            # Most steps are alike, but for the jump; readings at chosen places are not.
            least = max(
                _SLIPPED * float(np.median(np.abs(jump))),
                _SLIPPED_RARELY * float(np.quantile(np.abs(jump), 0.9)),
                _SLIP_SHARE * float(np.ptp(stretch)),
            )
            with np.errstate(divide="ignore", invalid="ignore"):
                stiffness = np.abs(_usual(rise) / _usual(step))
            followed = np.sign(jump) * off > _FOLLOWED * stiffness * np.abs(jump)
            places = np.flatnonzero((np.abs(jump) > least) & ~followed)
            if 0 < len(places) <= _SLIPS:
                line = int(data.line[own[places[0] + 1]])
                size, unit = travel_of(data, float(jump[places[0]]))
                found.append(_slip(data.file, line, size, unit))
    return found


def _usual(steps: np.ndarray) -> np.ndarray:
    """Median of each step and of its neighbours."""
    around = np.pad(steps, _NEIGHBOURS, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(around, 2 * _NEIGHBOURS + 1)
    return np.asarray(np.median(windows, axis=1))


def _slip(file: str, line: int, size: float, unit: str) -> Suspect:
    return Suspect(
        "slip",
        file,
        f"at line {line} the strain jumps by {size:.3g} {unit} and the stress does not: the "
        f"extensometer or the grips slipped",
        f"a column use that is 0 from line {line} on, or the machine's travel "
        f'(--columns "displacement=NAME mm")',
        size,
        unit,
    )


def drift(data: StressTest) -> list[Suspect]:
    """A stress that is another when the specimen is back at rest."""
    for rows in series_of(data):
        x, y = np.log(data.stretch_1[rows]), data.value[rows]
        farthest, largest = float(np.max(np.abs(x))), float(np.max(np.abs(y)))
        rest = np.flatnonzero(np.abs(x) <= _AT_REST * farthest)
        halves = half_cycles(data.deformation[rows])
        turn = halves[0].rows[-1]
        before, after = rest[rest < turn], rest[rest > turn]
        if len(halves) < 2 or not before.size or not after.size:
            continue
        change = float(y[after[-1]] - y[before[0]])
        if abs(change) <= _DRIFTED * largest:
            continue
        size, unit = change / 1e6, "MPa"
        if np.isfinite(data.origin.area):
            size, unit = change * data.origin.area, "N"
        text = (
            f"back at rest the load cell reads {size:.3g} {unit} more than before: it drifts, "
            f"or the specimen kept a set"
        )
        return [Suspect("drift", data.file, text, "--branch loading", size, unit)]
    return []
