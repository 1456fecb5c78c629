"""Fewer readings of a test that remembers, with the corners of its history kept."""

import dataclasses
from typing import Any

import numpy as np

from fitting.material.experiments.history import HistoryTest, coordinates

# The history is followed by straight lines within this share of its span.
_CORNER = 0.01
_MOST_CORNERS = 400
# A decade of time in a hold counts as much as this share of the way through the test.
_DECADE = 0.15


def thinned_history(test: HistoryTest, most: int) -> HistoryTest:
    """Fewer readings, each the mean of a run of them that follow each other, with its weight.

    Runs are short where the strain changes and where a hold begins, and end at the corners of
    the strain's history. Times, strains and readings are averaged alike.

    `most`: tests with more readings are averaged to about half as many; zero keeps all.
    """
    if not 0 < most < test.size:
        return test
    label = np.zeros(test.size, dtype=int)
    count = 0
    ways = []
    for rows in test.paths():
        ways.append((rows, _way(test, rows)))
    whole = sum(float(way[-1]) for _, (way, _) in ways)
    for rows, (way, corners) in ways:
        share = max(1, round(0.5 * most * float(way[-1]) / max(whole, 1e-300)))
        bins = np.minimum((way / max(way[-1], 1e-300) * share).astype(int), share - 1)
        # A corner is a run of its own, and no run reaches across it.
        pieces = np.cumsum(corners) + np.cumsum(np.append(False, corners[:-1]))
        _, own = np.unique(np.stack([pieces, bins]), axis=1, return_inverse=True)
        label[rows] = count + own.ravel()
        count += int(own.max()) + 1
    size = np.bincount(label, test.weight, minlength=count)
    number = np.bincount(label, minlength=count)
    first = np.zeros(count, dtype=int)
    first[label[::-1]] = np.arange(test.size)[::-1]

    def mean(values: np.ndarray) -> np.ndarray:
        total = np.bincount(label, test.weight * values, minlength=count)
        return np.where(size > 0.0, total / np.where(size > 0.0, size, 1.0), values[first])

    changes: dict[str, Any] = {}
    for field in dataclasses.fields(test):
        values = getattr(test, field.name)
        if not isinstance(values, np.ndarray):
            continue
        if values.dtype.kind != "f":
            changes[field.name] = values[first]
        elif values.ndim == 2:
            changes[field.name] = np.stack([mean(row) for row in values])
        else:
            changes[field.name] = mean(values)
    changes["weight"] = np.where(size > 0.0, size, number)
    changes["sigma"] = np.sqrt(mean(test.sigma**2))
    return dataclasses.replace(test, **changes)


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
    """Rows between which straight lines in time follow a history (Douglas and Peucker).

    `clock`: times, shape [n]. `x`: the history over its span, shape [2, n].
    """
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
