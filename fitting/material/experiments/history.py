"""Tests of a material that remembers: relaxation, loading at several rates, loading cycles.

The readings are those of a `StressTest` in the order of time. A test without times is taken as
slow: its stress has relaxed at every reading, and only its order counts.
"""

import dataclasses
from collections.abc import Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from fitting.material.data.errors import DataError
from fitting.material.experiments.measurements import (
    Dataset,
    Predictor,
    StressTest,
    homogeneous,
    series_of,
)
from fitting.material.experiments.prediction import AbstractExperiment, padded, shear_factors
from fitting.material.experiments.selection import averaged, half_cycles
from suas_jax.constitutive import AbstractLaw
from suas_jax.constitutive.deformation import LogStretches
from suas_jax.constitutive.relaxation import Inelastic, largest_before
from suas_jax.constitutive.specimens.homogeneous import kirchhoff

# Longer than any relaxation: the stress of a test without times has relaxed.
_FOREVER = 1e30
# A strain is held where it changes by less than this share of the test's from row to row.
HELD = 2e-3
# A test begins at rest if its first reading is deformed by no more than this share.
_NEAR_REST = 0.02
# Thinning follows the history by straight lines within this share of its span.
_CORNER = 0.01
_MOST_CORNERS = 400
# A decade of time in a hold counts as much as this share of the way through the test.
_DECADE = 0.15
# Between two rows the strain is followed in steps of this logarithm, but no more than so many.
_STEP, _MOST_STEPS = 0.05, 64


@dataclasses.dataclass(frozen=True)
class HistoryTest(StressTest):
    """A stress test whose readings depend on what came before."""

    follows_history: ClassVar[bool] = True

    @property
    def is_timed(self) -> bool:
        """Whether the file states times."""
        return bool(np.all(np.isfinite(self.time)))

    @property
    def abscissa(self) -> np.ndarray:
        """Time of a test that holds its strain; else the coordinate."""
        return self.time if self.is_relaxation else super().abscissa

    @property
    def abscissa_label(self) -> str:
        """Name of the abscissa."""
        return "time [s]" if self.is_relaxation else super().abscissa_label

    @property
    def is_relaxation(self) -> bool:
        """Whether most readings are of a strain that is held."""
        if not self.is_timed:
            return False
        moved = np.abs(np.diff(coordinates(self)[0]))
        farthest = float(np.max(np.abs(self.coordinate - (self.mode != "simple_shear"))))
        return bool(np.mean(moved <= HELD * farthest) > 0.5) if moved.size else False

    @property
    def is_loaded_at_once(self) -> bool:
        """Whether a strain is held from the first reading on, and nothing tells its loading."""
        if not self.is_timed:
            return False
        series = [(coordinates(self)[:, rows], self.time[rows]) for rows in self.paths()]
        return any(not (_begins_at_rest(self, x) or _before(self, x, t)[0]) for x, t in series)

    @property
    def order(self) -> np.ndarray:
        """Position of each reading in its series, which orders neighbours, shape [n]."""
        return np.arange(self.size, dtype=float)

    def paths(self) -> list[np.ndarray]:
        """Readings of each specimen and direction in the order of time."""
        found = []
        for rows in series_of(self):
            for direction in np.unique(self.direction[rows]):
                own = rows[self.direction[rows] == direction]
                found.append(own[self._sequence(own)])
        return found

    def _sequence(self, rows: np.ndarray) -> np.ndarray:
        """Order of time of some rows: by the clock, else as they stand, if they can."""
        if self.is_timed:
            return np.argsort(self.time[rows], kind="stable")
        h = self.deformation[rows]
        shuffled = len(half_cycles(h)) == 1 and not np.all(np.diff(h) >= 0.0)
        return np.argsort(h, kind="stable") if shuffled else np.arange(len(rows))

    def predictor(self, *, estimate: bool) -> Predictor:
        """Histories; as a rough prediction, the elastic stress of every state."""
        return homogeneous if estimate else histories


def with_history(data: Dataset) -> HistoryTest:
    """A test that remembers.

    Raises DataError: the test is of another kind, or its times are not complete or negative.
    """
    if not isinstance(data, StressTest):
        raise DataError(
            f"{data.file}: relaxation and softening are found from homogeneous tests; "
            f"{data.mode} is none"
        )
    known = np.isfinite(data.time)
    if known.any() and not known.all():
        data = data.select(known)
    values = {field.name: getattr(data, field.name) for field in dataclasses.fields(data)}
    return HistoryTest(**values)


class History(AbstractExperiment):
    """Readings of tests that remember, Σ_k a_k S_k of pulled-back stresses with a history."""

    sized_by: ClassVar = "state"
    e1: Float[Array, " m"]  # log λ₁ of every state passed through
    e2: Float[Array, " m"]  # log λ₂
    # parts of τ₁ and τ₂ in the pulled-back stresses, shape [m, 3, 2]
    pull: Float[Array, "m 3 2"]
    elapsed: Float[Array, " m"]  # time since the state before [s]
    begins: Bool[Array, " m"]  # where another history begins
    state: Int[Array, " n"]  # state of each reading
    # a, the parts of the pulled-back stresses in the reading, shape [n, 3]
    push: Float[Array, "n 3"]

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings [Pa]; zero for padding."""
        inelastic = law if isinstance(law, Inelastic) else Inelastic(law)
        elastic, relaxation = inelastic.elastic, inelastic.relaxation
        share = 1.0 if relaxation is None else relaxation.long_term_share
        tau = jnp.stack(kirchhoff(elastic, self.e1, self.e2), axis=-1) / share
        if inelastic.softening is not None:
            energy = elastic.energy(LogStretches(self.e1, self.e2)) / share
            largest = largest_before(energy, self.begins)
            tau = tau * inelastic.softening.factor(energy, largest)[:, None]
        stress = jnp.einsum("mkj,mj->mk", self.pull, tau)
        if relaxation is not None:
            stress = relaxation.relaxed(self.elapsed, self.begins, stress)
        return jnp.sum(self.push * stress[self.state], axis=-1)


def histories(tests: Sequence[HistoryTest]) -> History:
    """Tests that remember, one after the other, as one evaluation."""
    states: list[tuple[np.ndarray, ...]] = []
    which, push = [], []
    count = 0
    for test in tests:
        position = np.zeros(test.size, dtype=int)
        for rows in test.paths():
            x, elapsed, begins, at = _states(test, rows)
            position[rows] = count + at
            count += len(elapsed)
            states.append((*_pulled(test, x), elapsed, begins))
        which.append(position)
        push.append(_pushed(test))
    e1, e2, pull, elapsed, begins = map(np.concatenate, zip(*states, strict=True))
    place, parts = np.concatenate(which), np.concatenate(push)
    room, spare = (len(padded(np.zeros(len(x)))) - len(x) for x in (e1, place))
    return History(
        padded(e1),
        padded(e2),
        jnp.asarray(np.pad(pull, ((0, room), (0, 0), (0, 0)))),
        padded(elapsed),
        jnp.asarray(np.pad(begins, (0, room), constant_values=True)),
        jnp.asarray(np.pad(place, (0, spare))),
        jnp.asarray(np.pad(parts, ((0, spare), (0, 0)))),
    )


def _states(
    test: HistoryTest, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """States that a series passes through: its readings, and those before and between.

    Returns coordinates [2, m], time since the state before [m], where the history begins [m],
    and the states of the readings [n].
    """
    x = coordinates(test)[:, rows]
    if not test.is_timed:
        count = len(rows)
        begins = np.arange(count) == 0
        return x, np.full(count, _FOREVER), begins, np.arange(count)
    clock = test.time[rows]
    before, earlier, held_for = _before(test, x, clock)
    knots, moments = [*before, *x.T], [*earlier, *clock.tolist()]
    points, times, at = [knots[0]], [moments[0]], [0]
    for now, moment in zip(knots[1:], moments[1:], strict=True):
        gap = float(np.max(np.abs(_distance(points[-1], now, test.mode))))
        steps = int(np.clip(np.ceil(gap / _STEP), 1, _MOST_STEPS))
        last, since = points[-1], times[-1]
        for share in np.arange(1, steps + 1) / steps:
            points.append(last + share * (now - last))
            times.append(since + share * (moment - since))
        at.append(len(points) - 1)
    elapsed = np.maximum(np.diff(times, prepend=times[0]), 0.0)
    elapsed[0] = held_for
    return np.array(points).T, elapsed, np.arange(len(points)) == 0, np.array(at[len(before) :])


def _before(
    test: HistoryTest, x: np.ndarray, clock: np.ndarray
) -> tuple[list[np.ndarray], list[float], float]:
    """What a series went through before its first reading.

    Returns states and times before it, and for how long the first state of all was held. A
    series that begins at rest has none. One that begins while it deforms came at that rate. One
    that begins with its strain held was loaded by the stated ramp; else at once, at time zero
    if that is not long before, or at its first reading.
    """
    if _begins_at_rest(test, x):
        return [], [], 0.0
    rest, away = _rest(test), _from_rest(test, x)
    begin, span = float(clock[0]), float(clock[-1] - clock[0])
    since_zero = 0.0 < begin <= span
    ramp = test.origin.ramp
    if ramp > 0.0:
        # Time zero is where the ramp begins if it fits in before the first reading; else where
        # it ends.
        end = begin if not since_zero else ramp if ramp <= begin else 0.0
        return [rest, x[:, 0]], [end - ramp, end], 0.0
    first = np.max(np.abs(_distance(x[:, 0], x[:, min(1, x.shape[1] - 1)], test.mode)))
    if first > HELD * away.max() and clock[1] > clock[0]:
        lasted = float(away[0] / first) * float(clock[1] - clock[0])
        return [rest], [float(clock[0]) - lasted], 0.0
    return [], [], begin if since_zero else 0.0


def _begins_at_rest(test: HistoryTest, x: np.ndarray) -> bool:
    away = _from_rest(test, x)
    return bool(away[0] <= _NEAR_REST * away.max())


def _from_rest(test: HistoryTest, x: np.ndarray) -> np.ndarray:
    """How far the states of a series are from rest [n]."""
    return np.asarray(np.max(np.abs(_distance(_rest(test)[:, None], x, test.mode)), 0))


def _rest(test: HistoryTest) -> np.ndarray:
    return np.zeros(2) if test.mode == "simple_shear" else np.ones(2)


def coordinates(test: StressTest) -> np.ndarray:
    """Both stretches, or the amount of shear and zero, shape [2, n]."""
    if test.mode == "simple_shear":
        return np.stack([test.coordinate, np.zeros(test.size)])
    return np.stack([test.stretch_1, test.stretch_2])


def _distance(a: np.ndarray, b: np.ndarray, mode: str) -> np.ndarray:
    """From one state to another: logarithms of stretches, or shear."""
    return b - a if mode == "simple_shear" else np.log(b / a)


def _pulled(test: StressTest, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Logarithms of the stretches, and the parts of τ₁, τ₂ in S = F⁻¹ dev τ F⁻ᵀ [m, 3, 2].

    Principal components of S; in simple shear S₁₂ and S₂₂, which the shear stress reads.
    """
    pull = np.zeros((x.shape[1], 3, 2))
    if test.mode == "simple_shear":
        shear = x[0]
        e1, e2, *_ = shear_factors(shear)
        turn = 0.5 * np.arctan2(2.0, shear)
        cos, sin = np.cos(turn), np.sin(turn)
        pull[:, 1] = np.stack([sin**2 - 1.0 / 3.0, cos**2 - 1.0 / 3.0], axis=-1)
        pull[:, 0] = np.stack([sin * cos, -sin * cos], axis=-1) - shear[:, None] * pull[:, 1]
        return e1, e2, pull
    parts = np.array([[2.0, -1.0], [-1.0, 2.0], [-1.0, -1.0]]) / 3.0
    squares = np.stack([x[0], x[1], 1.0 / (x[0] * x[1])]) ** 2
    pull[:] = parts / squares.T[:, :, None]
    return np.log(x[0]), np.log(x[1]), pull


def _pushed(test: StressTest) -> np.ndarray:
    """Parts of the pulled-back stresses in each reading, with the third stress free [n, 3]."""
    if test.mode == "simple_shear":
        one = np.ones(test.size)
        return np.stack([one, test.coordinate, 0.0 * one], axis=-1)
    e1, e2, c1, c2 = test.factors
    stretches = np.exp([2.0 * e1, 2.0 * e2, -2.0 * (e1 + e2)])
    return (np.stack([c1, c2, -(c1 + c2)]) * stretches).T


def thinned_history(test: HistoryTest, most: int) -> HistoryTest:
    """Fewer readings, each the mean of a run of them that follow each other, with its weight.

    Runs are short where the strain changes and where a hold begins, and end at the corners of
    the strain's history. Tests with more than `most` readings get about half as many; zero
    keeps all.
    """
    if not 0 < most < test.size:
        return test
    label = np.zeros(test.size, dtype=int)
    count = 0
    ways = [(rows, _way(test, rows)) for rows in test.paths()]
    whole = sum(float(way[-1]) for _, (way, _) in ways)
    for rows, (way, corners) in ways:
        share = max(1, round(0.5 * most * float(way[-1]) / max(whole, 1e-300)))
        bins = np.minimum((way / max(way[-1], 1e-300) * share).astype(int), share - 1)
        # A corner is a run of its own, and no run reaches across it.
        pieces = np.cumsum(corners) + np.cumsum(np.append(False, corners[:-1]))
        _, own = np.unique(np.stack([pieces, bins]), axis=1, return_inverse=True)
        label[rows] = count + own.ravel()
        count += int(own.max()) + 1
    return averaged(test, label)


def _way(test: HistoryTest, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far each row is along its series, and which rows are corners of its history."""
    x = coordinates(test)[:, rows]
    span = max(float(np.max(np.ptp(x, axis=1))), 1e-300)
    clock = test.time[rows] if test.is_timed else np.arange(len(rows), dtype=float)
    corners = _corners(clock, x / span)
    moved = np.max(np.abs(np.diff(x, axis=1, prepend=x[:, :1])), axis=0) / span
    # Scatter of a strain that is held is no way.
    since = clock - clock[np.maximum.accumulate(np.where(corners, np.arange(len(rows)), 0))]
    smallest = np.diff(clock)[np.diff(clock) > 0.0]
    least = float(np.median(smallest)) if smallest.size else 1.0
    decades = np.log10(1.0 + since / least)
    steps = np.maximum(np.diff(decades, prepend=decades[:1]), 0.0)
    if test.is_relaxation:
        moved = np.where(moved < 2.0 * _CORNER, 0.0, moved)
    return np.cumsum(moved + _DECADE * steps), corners


def _corners(clock: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rows between which lines in time follow a history [2, n] (Douglas and Peucker)."""
    found = np.zeros(len(clock), dtype=bool)
    found[[0, -1]] = True
    pieces = [(0, len(clock) - 1)]
    while pieces and found.sum() < _MOST_CORNERS:
        first, last = pieces.pop(0)
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        whole = max(float(clock[last] - clock[first]), 1e-300)
        share = (clock[inside] - clock[first]) / whole
        line = x[:, first, None] + share * (x[:, last] - x[:, first])[:, None]
        off = np.max(np.abs(x[:, inside] - line), axis=0)
        worst = int(np.argmax(off))
        if off[worst] > _CORNER:
            at = first + 1 + worst
            found[at] = True
            pieces += [(first, at), (at, last)]
    return found
