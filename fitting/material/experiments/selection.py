"""Selection of the readings that are fitted: one cycle, up to the break, not too many."""

import dataclasses
import itertools
from typing import Any, TypeVar

import numpy as np

from fitting.material.experiments.measurements import Dataset, StressTest, series_of
from fitting.material.experiments.scatter import spikes

# A turn back counts where it undoes this share of the test; less is noise.
_TURN = 0.05
_SHORTEST = 3
# A specimen has failed where its stress falls below this share of the largest before, and
# the readings up to this share of it are still whole.
_FAILED, _WHOLE = 0.6, 0.97


AnyTest = TypeVar("AnyTest", bound=StressTest)


@dataclasses.dataclass(frozen=True)
class HalfCycle:
    """Rows between two turning points of one specimen."""

    rows: np.ndarray  # positions, in the order of time
    outward: bool  # away from rest


def half_cycles(h: np.ndarray) -> list[HalfCycle]:
    """Loading and unloading of a series in the order of time, by how far it is from rest [n].

    One that goes outward where the rows are in no order of time.
    """
    everything = [HalfCycle(np.arange(len(h)), True)]
    span = np.ptp(h) if len(h) else 0.0
    if len(h) < 2 * _SHORTEST or span <= 0.0:
        return everything
    turns = _turning_points(h, _TURN * span)
    if len(turns) - 2 > max(2, len(h) // 5):
        return everything  # shuffled rows
    found = [
        HalfCycle(np.arange(a + (k > 0), b + 1), bool(h[b] > h[a]))
        for k, (a, b) in enumerate(itertools.pairwise(turns))
    ]
    return found or everything


def _turning_points(h: np.ndarray, least: float) -> list[int]:
    """First, last, and every extreme from which the series returns by `least`."""
    turns = [0]
    high = low = 0
    direction = 0
    for i, value in enumerate(h):
        if value > h[high]:
            high = i
        if value < h[low]:
            low = i
        if direction >= 0 and h[high] - value > least:
            if direction > 0 or high > 0:
                turns.append(high)
            direction, low = -1, i
            high = i
        elif direction <= 0 and value - h[low] > least:
            if direction < 0 or low > 0:
                turns.append(low)
            direction, high = 1, i
            low = i
    if turns[-1] != len(h) - 1:
        turns.append(len(h) - 1)
    return turns


def loadings(data: Dataset) -> list[list[np.ndarray]]:
    """Rows of every loading of each specimen, in the order of time."""
    if not isinstance(data, StressTest) or not data.is_curve:
        return [[rows] for rows in series_of(data)]
    found = []
    for rows in series_of(data):
        halves = half_cycles(data.deformation[rows])
        outward = [rows[half.rows] for half in halves if half.outward]
        found.append([part for part in outward if len(part) >= _SHORTEST] or [rows])
    return found


def in_cycle(data: Dataset, which: str) -> Dataset:
    """The loading of one cycle: "first", "last", "all", or its number from one.

    Raises ValueError: there is no such cycle.
    """
    if which == "all":
        return data
    keep = np.zeros(data.size, dtype=bool)
    for cycles in loadings(data):
        if which in ("first", "last"):
            chosen = cycles[-1 if which == "last" else 0]
        elif which.isdigit() and int(which) >= 1:
            if int(which) > len(cycles):
                raise ValueError(
                    f"--cycle {which}: {data.file} has {len(cycles)} loadings of a specimen"
                )
            chosen = cycles[int(which) - 1]
        else:
            raise ValueError(f"--cycle {which}: allowed: all, first, last or a number from 1")
        keep[chosen] = True
    return data.select(keep)


def broken(data: Dataset) -> np.ndarray:
    """Readings after the specimen failed, shape [n]."""
    after = np.zeros(data.size, dtype=bool)
    if not isinstance(data, StressTest) or not data.is_curve or data.measure == "pressure":
        return after
    for rows in series_of(data):
        h, size = data.deformation[rows], np.abs(data.value[rows])
        if len(rows) < 2 * _SHORTEST:
            continue
        halves = half_cycles(h)
        # One way alone may be listed from its end.
        inside = np.argsort(h, kind="stable")
        if len(halves) > 1:
            outward = (half.rows for half in halves if half.outward)
            inside = max(outward, key=lambda own: h[own].max())
        end = _failure(size[inside])
        if end is not None:
            after[rows[inside[end:]]] = True
            if len(halves) > 1:  # whatever the machine did afterwards
                after[rows[inside[-1] + 1 :]] = True
    return after


def _failure(size: np.ndarray) -> int | None:
    """Position of the first reading after the largest that is no longer whole."""
    largest = np.maximum.accumulate(size)
    fallen = size < _FAILED * largest
    # Near rest noise may fall as much; and a specimen that failed does not recover.
    fallen &= largest > 0.2 * np.max(size)
    if not fallen[-1]:
        return None
    first = len(size) - int(np.argmin(fallen[::-1]))
    peak = int(np.flatnonzero(size[:first] >= _WHOLE * largest[first - 1])[-1])
    return peak + 1


def before_break(data: Dataset) -> Dataset:
    """The readings up to the failure of each specimen."""
    after = broken(data)
    return data.select(~after) if after.any() else data


def spiked(data: Dataset) -> np.ndarray:
    """Readings of a curve that stand out from their neighbours [n]; see `scatter.spikes`."""
    found = np.zeros(data.size, dtype=bool)
    if isinstance(data, StressTest) and data.is_curve:
        for rows in series_of(data):
            found[rows] = spikes(data.coordinate[rows], data.value[rows], data.least_floor)
    return found


def without_spikes(data: Dataset) -> Dataset:
    """The readings that follow their neighbours."""
    out = spiked(data)
    return data.select(~out) if out.any() else data


def thinned(data: Dataset, most: int) -> Dataset:
    """Fewer readings, each the mean of a run of them, with its weight.

    Runs hold readings that follow each other along the test and differ by little, so that means
    lie on the curve; each counts as often as it has readings, so that nothing shifts. Curves
    with more than `most` readings get half as many; zero keeps all.
    """
    if not isinstance(data, StressTest) or not data.is_curve or not 0 < most < data.size:
        return data
    most = max(most // 2, 1)
    halves = []
    for rows in series_of(data):
        h = data.deformation[rows]
        halves += [rows[half.rows[np.argsort(h[half.rows])]] for half in half_cycles(h)]
    label = np.zeros(data.size, dtype=int)
    count = 0
    # Way from reading to reading along the stretch, over that of the whole test.
    span = max(float(np.ptp(data.deformation)), 1e-300)
    steps = [np.diff(h, prepend=h[:1]) / span for h in (data.deformation[r] for r in halves)]
    whole = sum(float(np.sum(step)) for step in steps)
    for rows, step in zip(halves, steps, strict=True):
        share = max(1, round(most * float(np.sum(step)) / max(whole, 1e-300)))
        way = np.cumsum(step)
        along = way / way[-1] if way[-1] > 0.0 else np.linspace(0.0, 1.0, len(rows))
        bins = np.minimum((along * share).astype(int), share - 1)
        label[rows] = count + bins
        count += share
    # In the order of the file.
    _, first, label = np.unique(label, return_index=True, return_inverse=True)
    return averaged(data, np.argsort(np.argsort(first, kind="stable"))[label])


def averaged(test: AnyTest, label: np.ndarray) -> AnyTest:
    """Means of the readings of each label, with their weights; words are the first one's."""
    first = np.unique(label, return_index=True)[1]
    size = np.bincount(label, test.weight)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(label, test.weight * values) / size

    changes: dict[str, Any] = {
        key: np.apply_along_axis(mean, -1, x) if x.dtype.kind == "f" else x[first]
        for key, x in test.arrays().items()
    }
    changes |= {"weight": size, "sigma": np.sqrt(mean(test.sigma**2))}
    return dataclasses.replace(test, **changes)
