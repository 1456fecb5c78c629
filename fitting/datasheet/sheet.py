"""The data sheet of a skin: its figures with their intervals, and what decides them."""

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.figures import (
    Accuracy,
    Cases,
    Figures,
    Measured,
    figures_at,
    told,
    two_point,
)
from fitting.datasheet.in_time import buckling_mismatch, creep, motion_figures
from fitting.datasheet.pad import measure_pad
from fitting.datasheet.section import measure_section
from fitting.datasheet.variants import DEEPER, WARMER, Variants, variants_of, why_constant
from fitting.datasheet.words import PLACED, READ_AT_RATED, WORDS, place_text
from fitting.inverse_load.readings import noise_of_readings
from suas_jax.config import SkinSpec
from suas_jax.config.inputs import given_inputs
from suas_jax.config.tolerance import deviation_of
from suas_jax.runtime.compiled import COMPILED
from suas_jax.skin.prestress import is_prestressed

_95 = 1.96
# Figures under the rated force, and why they have no value beyond first contact.
_OF_FORCE = ("force_accuracy", "force_per_kelvin", "force_per_metre_of_depth")
_AT_RATED = ("min_gap_m", *READ_AT_RATED, *_OF_FORCE)
_BEYOND = "the membrane reaches the wall before the rated force"
_STRESSED = (
    "as without the stress at rest that the file states; `suas sweep --history` counts it"
)


@dataclass(frozen=True)
class Figure:
    """One line of the sheet."""

    key: str  # as in `WORDS`, with its SI unit
    value: float  # NaN where there is none
    # one standard deviation by the skin's tolerances; NaN where unknown
    deviation: float = math.nan
    reason: str = ""  # why there is no value, or why it is what it is
    place: int | None = None  # index of the place that decides it; None where none does

    @property
    def interval(self) -> tuple[float, float]:
        """95 %; of a positive figure by its logarithm."""
        if self.value > 0:
            factor = float(np.exp(_95 * self.deviation / self.value))
            return self.value / factor, self.value * factor
        return self.value - _95 * self.deviation, self.value + _95 * self.deviation


@dataclass(frozen=True)
class DataSheet:
    """What a skin will measure, and how well."""

    spec: SkinSpec  # the skin
    variants: Variants  # its tolerances
    measured: Measured  # readings that the figures are made of
    figures: tuple[Figure, ...]  # one each of `WORDS`
    # figures of every place by their keys [place], with one standard deviation
    at: dict[str, tuple[Floats, Floats]]
    # of every tolerance of one standard deviation on the told force (a share), on the told
    # place [m] and on the range (a share) [change, 3]
    effects: Floats
    two_point: Floats  # distance from which on two contacts are told apart [place] [m]

    @property
    def order(self) -> list[int]:
        """Tolerances, the one that moves the force most first."""
        size = np.abs(np.nan_to_num(self.effects[: len(self.variants.errors), 0]))
        return np.argsort(-size, kind="stable").tolist()

    def assumed(self, i: int) -> bool:
        """Whether a tolerance is taken, because the skin file states none."""
        name = self.variants.changes[i]
        taken = name in given_inputs(self.variants.spec) and name not in self._stated
        return taken or name in self.variants.errors.assumed

    @property
    def _stated(self) -> set[str]:
        own = given_inputs(self.spec).items()
        return {path for path, value in own if deviation_of(value) is not None}

    @property
    def remarks(self) -> list[str]:
        """What else a reader should know."""
        told = self.variants.errors.text, self.spec.material.note
        found = [text for text in told if text]
        if self.measured.accuracy.noise == 0:
            found.append(
                "readings have no noise here but rounding: resolutions and the detection limit "
                "are too good for a real skin; state electrodes.noise (`suas health` finds it)"
            )
        own = {figure.key: figure.value for figure in self.figures}
        mounting = deviation_of(self.variants.spec.geometry.mounting) or 0.0
        if own["buckling_mismatch"] < 2 * mounting:
            found.append(
                f"the tolerance of geometry.mounting, {100 * mounting:.2g} %, is a large part "
                f"of the stability margin, {100 * own['buckling_mismatch']:.2g} %: a membrane "
                "that is longer by so much buckles, and intervals, which are linear, are too "
                "narrow; mount it under tension, or find its mismatch by `suas fit sensor "
                "--fit mounting`"
            )
        return found

    def report(self) -> dict[str, Any]:
        """What `suas datasheet --json` prints."""
        measured = self.measured
        shown = {**measured.coordinates, "arc_outer_m": measured.arc}
        columns = {key: values for key, (values, _) in self.at.items()}
        names = self.variants.changes
        sizes = [self.variants.size(i) for i in range(len(self.variants.errors))]
        return {
            "dimension": self.spec.geometry.dimension,
            "rated_force_N": measured.rated,
            "noise_counts": measured.accuracy.noise,
            "figures": {f.key: self._row(f) for f in self.figures},
            "places": [
                {
                    **{k: float(v[i]) for k, v in {**shown, **columns}.items()},
                    "two_point_m": float(self.two_point[i]),
                    "counted": bool(measured.region[i]),
                }
                for i in range(len(measured.arc))
            ],
            "tolerances": [
                {
                    "name": names[i],
                    **dict(zip(("deviation", "unit"), sizes[i] or (None, None), strict=True)),
                    "assumed": self.assumed(i),
                    "force_relative": float(self.effects[i, 0]),
                    "place_m": float(self.effects[i, 1]),
                    "range_relative": float(self.effects[i, 2]),
                }
                for i in self.order
            ],
            "remarks": self.remarks,
        }

    def _row(self, figure: Figure) -> dict[str, Any]:
        low, high = figure.interval
        at = {}
        if figure.place is not None:
            at = {k: float(v[figure.place]) for k, v in self.measured.coordinates.items()}
        return {
            "value": figure.value,
            "low95": low,
            "high95": high,
            **at,
            "reason": figure.reason or None,
        }


def data_sheet(
    spec: SkinSpec,
    places: tuple[int, int] = (17, 7),
    noise: float | None = None,
    force: float | None = None,
    progress: Callable[[str], None] = lambda text: None,
    workers: Executor | None = None,
    between: tuple[Floats, Floats] | None = None,
) -> DataSheet:
    """Make the data sheet of a skin.

    Args:
        spec: the skin, with electrodes.
        places: along the arc, and on a pad along the axis.
        noise: standard deviation of a reading [counts]; the skin file's if None.
        force: the rated force [N]; 30 % of the smallest first contact if None.
        progress: called with what is being done.
        workers: that solve a pad's table of states; None: this process.
        between: first and last place, the angle and on a pad the axial position [coordinate],
            see `measure_section` and `measure_pad`.

    Raises:
        ValueError: the skin has no electrodes, or an argument makes no sense.
    """
    deviation = noise_of_readings(spec, noise)
    if force is not None and not (np.isfinite(force) and force > 0):
        raise ValueError(f"force = {force}: a force above zero is needed")
    if min(places) < 4:
        raise ValueError(f"{min(places)} places: at least 4 are needed")
    variants = variants_of(spec)
    if spec.geometry.dimension == 3:
        measured = measure_pad(variants, places, deviation, force, progress, workers, between)
    elif workers is not None:
        raise ValueError("workers solve the tables of pads; a section takes seconds")
    else:
        angles = None if between is None else (float(between[0][0]), float(between[1][0]))
        measured = measure_section(variants, places[0], deviation, force, progress, angles)
    progress("figures")
    moved = variants.slopes(np.asarray(measured.cases.rated.so - measured.cases.rest.so), 1)
    figures, taken_for = jax.tree.map(
        np.asarray,
        COMPILED.run(
            _all_figures, measured.cases, measured.accuracy, measured.far, moved, once=True
        ),
    )
    failed = _failed(measured.cases)
    measured, beyond = _beyond_contact(measured, figures.first_contact[0])
    at: dict[str, tuple[Floats, Floats]] = {}
    for key, word in PLACED.items():
        lost = failed | beyond if key in _AT_RATED else failed
        values = np.where(lost, np.nan, getattr(figures, word.field))
        at[key] = values[0], _deviation(values, variants)
    contact = variants.slopes(figures.first_contact)
    effects = np.stack([taken_for[-1], np.sqrt((taken_for[:-1] ** 2).sum(0)), contact])
    effects[..., failed[0]] = effects[:2, :, beyond] = np.nan
    rows = np.arange(len(measured.arc)).reshape(measured.grid).T  # along the arc
    apart, variance = np.empty(len(measured.arc)), measured.accuracy.variance
    assert measured.light is not None
    arc, light = measured.light
    for k, row in enumerate(rows):
        middle = measured.arc[row]
        apart[row] = two_point(arc, light[:, k], measured.rated / 2, variance, middle)
    progress("creep, modes and buckling")
    found = [
        *(_worst(key, values, measured, spread) for key, (values, spread) in at.items()),
        _worst("two_point_m", apart, measured),
        *_coefficients(measured, variants, effects),
        *_in_time(variants.spec, stressed=is_prestressed(spec)),
    ]
    order = list(WORDS)
    return DataSheet(
        spec,
        variants,
        measured,
        tuple(sorted(found, key=lambda f: order.index(f.key))),
        at,
        _summed(effects, measured),
        apart,
    )


def _beyond_contact(measured: Measured, first_contact: Floats) -> tuple[Measured, np.ndarray]:
    """Find the places where the rated force is beyond first contact.

    Figures have no value there: readings are those of a membrane that passes through the wall.
    Returns what was measured, with that reason, and whether each place is one [place].
    """
    beyond = np.asarray(first_contact < measured.rated)
    if not beyond[measured.region].any():
        return measured, beyond
    reasons = dict.fromkeys(_AT_RATED, _BEYOND) | dict(measured.missing)
    return measured._replace(missing=reasons), beyond


def _failed(cases: Cases) -> np.ndarray:
    """Where a state was not found [skin, place]."""
    results = (cases.rest.result, cases.half.result, cases.rated.result)
    return np.asarray(sum(np.asarray(x) != 0 for x in results) > 0)


def _deviation(values: Floats, variants: Variants) -> Floats:
    """Of figures of every skin by the tolerances [skin, ...] -> [...]."""
    slopes = variants.slopes(values)[: len(variants.errors)]
    return np.asarray(np.sqrt((slopes**2).sum(0)))


def _worst(
    key: str, values: Floats, measured: Measured, deviation: Floats | None = None
) -> Figure:
    """The worst of a figure [place] over the region."""
    inside = np.where(measured.region, values, np.nan)
    if not np.isfinite(inside).any():
        return Figure(key, math.nan, reason=measured.missing.get(key, WORDS[key].missing))
    place = int(np.nanargmin(inside) if WORDS[key].least else np.nanargmax(np.abs(inside)))
    spread = math.nan if deviation is None else float(deviation[place])
    return Figure(key, float(inside[place]), spread, _left_out(key, inside, measured), place)


def _left_out(key: str, inside: Floats, measured: Measured) -> str:
    """Which places of the region have no value, and why; empty where all have one."""
    lost = np.flatnonzero(measured.region & np.isnan(inside))
    if not lost.size:
        return ""
    own = {name: float(v[lost[0]]) for name, v in measured.coordinates.items()}
    return (
        f"{lost.size} of {int(measured.region.sum())} places are left out, such as "
        f"{place_text(own)}: there {measured.missing.get(key, WORDS[key].missing)}"
    )


@eqx.filter_jit
def _all_figures(
    cases: Cases, accuracy: Accuracy, far: np.ndarray, moved: np.ndarray
) -> tuple[Figures, jax.Array]:
    """Figures of every skin [skin, place], and what the first one takes changes for."""
    own: Cases = jax.tree.map(lambda x: x[..., :1, :], cases)
    return figures_at(cases, accuracy, far), told(own, accuracy, moved)


def _summed(effects: Floats, measured: Measured) -> Floats:
    """Roots of mean squares over the region, force and range as shares [change, 3].

    The effects are on told force [N], told place [m] and first contact [N] [3, change, place].
    """
    share = effects[..., measured.region] / np.array([measured.rated, 1.0, 1.0])[:, None, None]
    share[2] /= np.asarray(measured.cases.force)[0, measured.region]
    known = np.isfinite(share)
    count = np.where(known.any(-1), known.sum(-1), np.nan)  # NaN where no place knows
    share = np.where(known, share, 0.0)
    sign = np.where((share.sum(-1) < 0) & (np.arange(3)[:, None] != 1), -1.0, 1.0)
    return np.asarray((sign * np.sqrt((share**2).sum(-1) / count)).T)


def _coefficients(measured: Measured, variants: Variants, effects: Floats) -> list[Figure]:
    """Accuracy by the tolerances, and what a kelvin and a metre of depth do."""
    count, share = len(variants.errors), effects[0] / measured.rated
    found = [_worst("force_accuracy", np.sqrt((share[:count] ** 2).sum(0)), measured)]
    at_rest = variants.slopes(np.asarray(measured.cases.rest.so)[..., 0], 1)
    for row, path, force, zero in (
        (count, WARMER, "force_per_kelvin", "zero_counts_per_kelvin"),
        (count + 1, DEEPER, "force_per_metre_of_depth", "zero_counts_per_metre_of_depth"),
    ):
        reason = why_constant(variants.spec, path)
        if reason:
            value = math.nan if path == WARMER else 0.0
            found += [Figure(key, value, reason=reason) for key in (force, zero)]
        else:
            drift = at_rest[:, row]
            most = float(drift[np.abs(drift).argmax()])
            found += [_worst(force, share[row], measured), Figure(zero, most)]
    return found


def _in_time(spec: SkinSpec, *, stressed: bool) -> list[Figure]:
    """Creep, motion and buckling; `stressed`: whether the file states a stress at rest."""
    relaxation = spec.material.relaxation
    times = {"creep_1min": 60.0, "creep_1h": 3600.0}
    if relaxation is None:
        why = "the skin file states no [material] relaxation; `suas fit material` finds it"
        found = [Figure(key, math.nan, reason=why) for key in times]
    else:
        why = _STRESSED if stressed else ""
        found = [Figure(key, creep(relaxation, t), reason=why) for key, t in times.items()]
    motion, reason = motion_figures(spec)
    for key in ("lowest_frequency_Hz", "damping_ratio", "bandwidth_Hz"):
        found.append(Figure(key, motion.get(key, math.nan), reason=reason))
    mismatch, reason = buckling_mismatch(spec)
    return [*found, Figure("buckling_mismatch", mismatch, reason=reason)]
