"""Artefacts that a test's curve shows: break, cycles, slip, drift, spike, zero, percent."""

import dataclasses
from typing import Any

import numpy as np

from fitting.material.experiments.free_zero import CERTAIN, can_be_freed, idle, toe_end
from fitting.material.experiments.measurements import Dataset, StressTest, series_of
from fitting.material.experiments.selection import broken, half_cycles, loadings, spiked

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
# A slip: so many times what half of the other steps, or a tenth, scatter, and this share of
# the span.
_SLIPPED, _SLIPPED_RARELY, _SLIP_SHARE = 15.0, 3.0, 0.01
_SLIPS = 3  # more steps alike are how the test was made
_FEWEST_STEPS, _NEIGHBOURS = 12, 3
_FOLLOWED = 0.3  # of a jump, by the stress: the material was stretched
# Drift: a change of the stress at rest by this share of the largest, within this share of the
# largest strain.
_AT_REST, _DRIFTED = 0.01, 0.02
_SHOWN = 5  # lines that are named at most


@dataclasses.dataclass(frozen=True)
class Suspect:
    """An artefact that a file seems to have."""

    # "break", "preconditioning", "percent", "slack", "toe", "force offset", "slip", "drift",
    # "spike", "machine stiffness" or "tared preload"
    kind: str
    file: str
    evidence: str  # what shows it
    option: str  # what corrects it, for the command line
    size: float | None = None  # how large it is, in `unit`; None where it has no size
    unit: str = ""

    @property
    def text(self) -> str:
        """One sentence for people."""
        return f"{self.file}: suspect {self.kind}: {self.evidence}; mend it with {self.option}"

    @property
    def report(self) -> dict[str, Any]:
        """The attributes and the sentence, for JSON."""
        return {**dataclasses.asdict(self), "message": self.text}


def travel_of(data: Dataset, strain: float) -> tuple[float, str]:
    """A strain as travel of the machine where the specimen's length is known, and its unit."""
    if np.isfinite(data.origin.length):
        return 1e3 * strain * data.origin.length, "mm"
    return strain, "of the length"


def force_of(data: Dataset, stress: float) -> tuple[float, str]:
    """A stress [Pa] as force where the specimen's cross-section is known, and its unit."""
    if np.isfinite(data.origin.area):
        return stress * data.origin.area, "N"
    return stress / 1e6, "MPa"


def curve_suspects(data: Dataset) -> list[Suspect]:
    """Artefacts that the curve of a test shows by itself, whatever law is fitted."""
    if not isinstance(data, StressTest) or not data.is_curve or data.size < 4:
        return []
    if data.follows_history:
        return _too_long(data)
    found = _break(data) + _cycles(data) + _too_long(data) + _slips(data) + _drift(data)
    found += _spikes(data)
    if found or not can_be_freed(data):
        return found
    # The stress at rest that the readings near it point to, where it is not zero.
    return [suspect for rows in series_of(data) for suspect in _zero_of_series(data, rows)]


def _break(data: StressTest) -> list[Suspect]:
    after = broken(data)
    if not after.any():
        return []
    first = float(np.exp(np.min(data.deformation[after])))
    text = (
        f"the stress falls at a stretch of {first:.3g} and does not come back: "
        f"{int(after.sum())} readings from line {data.line[after].min()} on are of a broken "
        f"specimen"
    )
    return [Suspect("break", data.file, text, "--cut-break", first, "stretch")]


def _spikes(data: StressTest) -> list[Suspect]:
    """Readings that stand out from their neighbours: near rest one can spoil the law."""
    lines = data.line[spiked(data)]
    if not lines.size:
        return []
    many = f"{lines.size} readings stand" if lines.size > 1 else "a reading stands"
    where = ", ".join(str(line) for line in lines[:_SHOWN])
    where += ", ..." * (lines.size > _SHOWN)
    text = f"{many} out from the neighbours, on line {where}"
    return [Suspect("spike", data.file, text, "--cut-spikes", float(lines.size), "readings")]


def _cycles(data: StressTest) -> list[Suspect]:
    """Loadings of one specimen that lie on different curves."""
    for cycles in loadings(data):
        if len(cycles) < 2:
            continue
        first, last = cycles[0], cycles[-1]
        h, size = data.deformation, np.abs(data.value)
        inside = last[h[last] <= min(h[first].max(), h[last].max())]
        if inside.size < 3:
            continue
        order = first[np.argsort(h[first], kind="stable")]
        before = np.interp(h[inside], h[order], size[order])
        lower = before - size[inside]
        share = float(np.mean(lower) / np.max(before))
        if abs(share) > _SOFTENED:
            softer = 100.0 * float(np.sum(lower) / np.sum(before))
            text = (
                f"{len(cycles)} loadings of one specimen, of which the last is {softer:.0f} % "
                f"softer than the first: they are not one curve"
            )
            of_what = "of the largest stress"
            return [Suspect("preconditioning", data.file, text, "--cycle last", share, of_what)]
    return []


def _too_long(data: StressTest) -> list[Suspect]:
    origin = data.origin
    longest = float(np.max(np.maximum(data.stretch_1, 1.0 / data.stretch_1)))
    if origin.state not in ("strain", "stretch") or origin.unit or longest < _LONGEST:
        return []
    return [percent_suspect(data, f"it would stretch the specimen to {longest:.3g} times")]


def percent_suspect(data: StressTest, evidence: str) -> Suspect:
    """A column of strains whose unit is another than its name says."""
    column = data.origin.column
    what, option = "in percent, not a fraction", f'--columns "strain={column} %"'
    if data.origin.unit == "%":
        name = column.partition("%")[0].strip("_ [(")
        what = "not in percent"
        option = f'--columns "strain={column} 1" (or name it "{name}")'
    return Suspect("percent", data.file, f'column "{column}" is {what}: {evidence}', option)


def _slips(data: StressTest) -> list[Suspect]:
    """Jumps of the strain that the stress does not share."""
    found = []
    halves = (
        rows[half.rows]
        for rows in series_of(data)
        for half in half_cycles(data.deformation[rows])
    )
    for own in halves:
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
            text = (
                f"at line {line} the strain jumps by {size:.3g} {unit} and the stress does "
                f"not: the extensometer or the grips slipped"
            )
            option = (
                f"a column use that is 0 from line {line} on, or the machine's travel "
                f'(--columns "displacement=NAME mm")'
            )
            found.append(Suspect("slip", data.file, text, option, size, unit))
    return found


def _usual(steps: np.ndarray) -> np.ndarray:
    """Median of each step and of its neighbours."""
    around = np.pad(steps, _NEIGHBOURS, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(around, 2 * _NEIGHBOURS + 1)
    return np.asarray(np.median(windows, axis=1))


def _drift(data: StressTest) -> list[Suspect]:
    """A stress that is another when the specimen is back at rest."""
    for rows in series_of(data):
        x, y = np.log(data.stretch_1[rows]), data.value[rows]
        rest = np.flatnonzero(np.abs(x) <= _AT_REST * float(np.max(np.abs(x))))
        halves = half_cycles(data.deformation[rows])
        turn = halves[0].rows[-1]
        before, after = rest[rest < turn], rest[rest > turn]
        if len(halves) < 2 or not before.size or not after.size:
            continue
        change = float(y[after[-1]] - y[before[0]])
        if abs(change) <= _DRIFTED * float(np.max(np.abs(y))):
            continue
        size, unit = force_of(data, change)
        text = (
            f"back at rest the load cell reads {size:.3g} {unit} more than before: it drifts "
            f"(the loading keeps its part of that), or the specimen kept a set"
        )
        return [Suspect("drift", data.file, text, "--branch loading", size, unit)]
    return []


def _zero_of_series(data: StressTest, rows: np.ndarray) -> list[Suspect]:
    x, y = np.log(data.stretch_1[rows]), data.value[rows]
    side = 1.0 if np.sum(x) >= 0.0 else -1.0
    x, y = side * x, side * y
    largest, span = float(np.max(np.abs(y))), float(np.max(x))
    near = x <= _NEAR_REST * span
    if near.sum() < 8 or np.min(x) > 0.1 * span or largest <= 0.0:
        return []
    label = data.specimen[rows][0]
    where = f"specimen {label}: " if label and len(set(data.specimen)) > 1 else ""
    taut = idle(x, y, largest)
    if taut is not None:
        size, unit = travel_of(data, float(np.exp(taut) - 1.0))
        text = (
            f"{where}nothing is carried up to a stretch of {np.exp(taut):.4g}, then the stress "
            f"rises: the specimen was slack by about {size:.3g} {unit}"
        )
        return [Suspect("slack", data.file, text, "--zero slack", size, unit)]
    toe = toe_end(x, y)
    if toe is not None:
        end = float(np.exp(toe))
        text = (
            f"{where}the curve grows steeper up to a stretch of {end:.4g}, which rubber does "
            f"not: the specimen or its grips were taking up slack"
        )
        return [Suspect("toe", data.file, text, "--zero slack", end, "stretch")]
    return _off_at_rest(data, rows[near], where, float(np.min(y)), largest)


def _off_at_rest(
    data: StressTest, near: np.ndarray, where: str, lowest: float, largest: float
) -> list[Suspect]:
    """Slack or an offset of the force, by the stress at rest that readings near it point to.

    `lowest`, `largest`: of the specimen's stresses, positive away from rest [Pa].
    """
    # Neo-Hookean and Mooney's second term follow any rubber near rest, whatever the mode.
    part = data.select(np.isin(np.arange(data.size), near))
    e1, e2, c1, c2 = part.factors
    inverse = np.exp(2.0 * (e1 + e2))
    second = c1 * (inverse - np.exp(-2.0 * e1)) + c2 * (inverse - np.exp(-2.0 * e2))
    own = data.specimen == part.specimen[0]
    side = 1.0 if np.sum(np.log(data.stretch_1[own])) >= 0.0 else -1.0
    terms = [part.unit_stress, second][: 1 if data.mode == "pure_shear" else 2]  # I1 = I2 there
    fit = np.stack([np.ones(part.size), *(side * term for term in terms)], axis=1)
    sizes = np.linalg.norm(fit, axis=0)
    values = side * part.value
    solution, _, rank, _ = np.linalg.lstsq(fit / sizes, values, rcond=1e-8)
    spare = part.size - fit.shape[1]
    if rank < fit.shape[1] or spare < 3:
        return []
    solution = solution / sizes
    scatter = float(np.sum((values - fit @ solution) ** 2)) / spare
    error = float(np.sqrt(scatter * np.linalg.inv(fit.T @ fit)[0, 0]))
    at_rest = float(solution[0])
    # Slope at rest by log stretch, from the mode's: 3, 4 and 6 times the modulus.
    slope = {"uniaxial": 3.0, "pure_shear": 4.0, "equibiaxial": 6.0}[data.mode]
    slope *= float(np.sum(solution[1:]))
    if abs(at_rest) < max(CERTAIN * error, _NOTICEABLE * largest) or slope <= 0.0:
        return []
    below = lowest < -max(CERTAIN * np.sqrt(scatter), _NOTICEABLE * largest)
    found = _zeros_off(data, where, side * at_rest, side * slope)
    # Nothing pulls a specimen that hangs slack.
    return found[::-1] if at_rest < 0.0 and not below else found


def _zeros_off(data: StressTest, where: str, at_rest: float, slope: float) -> list[Suspect]:
    """Both zeros that a curve off by a stress [Pa] at rest may have.

    `slope`: of the stress by the strain away from rest, negative in compression.
    """
    size, unit = force_of(data, at_rest)
    lag, travel = travel_of(data, -at_rest / slope)
    preload = data.origin.preload
    near = abs(abs(size) - preload) < _AS_STATED * preload
    stated = unit == "N" and lag <= 0.0 and near
    is_off = f"the load cell is off by about {size:.3g} {unit}"
    if lag > 0.0:
        strain = f"a strain of {-at_rest / slope:.3g}, not at rest"
        is_slack = f"the specimen was slack by about {lag:.3g} {travel}"
        at_zero = f"{where}the curve meets zero stress at {strain}"
    else:
        is_slack = (
            f"the travel counts from where the specimen was stretched by {-lag:.3g} {travel}"
        )
        at_zero = f"{where}at rest the curve points to a stress of {at_rest / 1e6:.3g} MPa"
        if stated:
            is_slack += f", by the preload of {preload:.3g} N that the file states"
    text = f"{at_zero}: {is_off}, unless {is_slack} (--zero slack)"
    force = Suspect("force offset", data.file, text, "--zero force", size, unit)
    text = f"{at_zero}: {is_slack}, unless {is_off} (--zero force)"
    slack = Suspect("slack", data.file, text, "--zero slack", lag, travel)
    return [slack, force] if stated else [force, slack]
