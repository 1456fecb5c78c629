"""Health of the taxels in a log: noise, stuck, saturation, drift, loss, what neighbours do."""

import math
from collections.abc import Collection
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.log.data import Frames, SoLog, flagged, group_frames, sequence_notes
from suas_jax.acquisition.taxel_faults import (
    deviation,
    full_scale,
    mean,
    median,
    noise_by_taxel,
    saturated,
    stuck_taxels,
    typical_noise,
)

_NEIGHBOURS = 4
_NAMED = 6  # taxels of another layout that are named
_SMOOTHED = 10  # frames averaged to see signals below the noise of one
_STILL = 4.0  # standard deviations of noise, beyond which a second difference is a load's
_MOVED = 10.0  # standard errors by which neighbours must move to be followed


def neighbours(
    names: list[tuple[int, int]], places: dict[tuple[int, int], tuple[float, float]] | None
) -> list[list[int]]:
    """Indices of every taxel's neighbours.

    `names`: module and number of the taxels. `places`: of the taxels on the wall [m], whose
    nearest are neighbours; where one is unknown, those of a module with the nearest numbers.
    """
    if places is not None and all(name in places for name in names):
        at = np.array([places[name] for name in names])
        distance = np.linalg.norm(at[:, None] - at[None], axis=-1)
        np.fill_diagonal(distance, np.inf)
        nearest = np.argsort(distance, axis=1)[:, :_NEIGHBOURS]
        return [[k for k in row if k != i] for i, row in enumerate(nearest.tolist())]
    by_module: dict[int, list[int]] = {}
    for k, (module, _) in enumerate(names):
        by_module.setdefault(module, []).append(k)
    groups = []
    for k, (module, _) in enumerate(names):
        others = sorted((abs(i - k), i) for i in by_module[module] if i != k)
        groups.append([i for _, i in others[:_NEIGHBOURS]])
    return groups


def correlations(
    so: NDArray[np.float64], noise: NDArray[np.float64], groups: list[list[int]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of every taxel's slow changes with its neighbours', and the largest of its noise.

    A load moves neighbours together, each with noise of its own. A taxel that stays while those
    around it move says nothing of the load; one whose noise is a neighbour's is connected to
    it, or its counts were sent twice. Counts are [frame, taxel], NaN where missing.
    """
    taxels = so.shape[1]
    size = len(so) // _SMOOTHED
    parts = so[: size * _SMOOTHED].reshape(size, _SMOOTHED, taxels)
    slow = mean(parts.swapaxes(0, 1))
    slow = slow - median(slow)
    spread = np.nan_to_num(deviation(slow))
    # Of second differences those that noise explains: a press moves neighbours together.
    quick = np.diff(so, 2, axis=0)
    usual = math.sqrt(6) * np.hypot(noise, 1 / math.sqrt(12))
    quick = np.where(np.abs(quick) < _STILL * usual, quick, np.nan)
    follows, coupling = np.full(taxels, np.nan), np.full(taxels, np.nan)
    for k, others in enumerate(groups):
        if not others:
            continue
        error = np.hypot(noise[others], 1 / math.sqrt(12)) / math.sqrt(_SMOOTHED)
        moved = [i for i, e in zip(others, error, strict=True) if spread[i] > _MOVED * e]
        if len(moved) > len(others) / 2:
            # Outside a contact taxels move the other way: what counts is that they move.
            follows[k] = max(abs(_correlation(slow[:, k], slow[:, i])) for i in moved)
        found = [_correlation(quick[:, k], quick[:, i]) for i in others]
        coupling[k] = max((c for c in found if not math.isnan(c)), default=math.nan)
    return follows, coupling


def _correlation(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Pearson's, of what both have; 0 where one doesn't change, NaN where too few are left."""
    both = np.isfinite(x) & np.isfinite(y)
    if both.sum() < 3:
        return math.nan
    a, b = x[both] - x[both].mean(), y[both] - y[both].mean()
    size = math.sqrt(float((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0 else 0.0


FAULTS = {
    "silent": "no counts at all",
    "stuck": "keeps its count while others change: is left out meanwhile",
    "saturated": "at zero or full scale: is left out meanwhile",
    "lossy": "more than 5 % of its counts are missing",
    "noisy": "more than three times the noise of the others",
    "drifting": "moves steadily, by more than its noise explains",
    "unresponsive": "does not follow its neighbours, which move",
    "coupled": "its noise is a neighbour's: a short circuit, or counts sent twice",
}
"""Faults of a taxel and what they mean."""

MIN_FRAMES = 50
_MOST_VALUES = 50_000_000  # counts looked at: the last frames of a longer log
_SHARE = 0.05  # of the frames, beyond which a taxel is lossy, stuck or saturated
_NOISY = 3.0  # times the others' noise, and a count more
_PARTS = 20  # of the log, whose medians show a drift
_SIGNIFICANT, _LEAST_DRIFT = 6.0, 2.0  # standard errors, counts
_UNSTEADY = 0.15  # of the whole change, what may be left beside a line
_FOLLOWS = 0.3  # correlation with its neighbours below which a taxel does not follow
_COUPLED = 0.9  # correlation of its noise with a neighbour's that noise never has


@dataclass(frozen=True)
class TaxelHealth:
    """What a log says about one taxel."""

    module: int  # number of its module
    taxel: int  # number in it, from 1
    mean: float  # of its counts; NaN where it is silent
    noise: float  # standard deviation from frame to frame [counts]
    stuck: float  # share of the frames in which it is stuck
    saturated: float  # share at zero or at full scale
    lost: float  # share of the device's frames without a count of it
    drift: float  # steady change [counts/min]
    # correlation of its slow changes with those of its neighbours; NaN where those don't move
    follows: float
    coupling: float  # largest correlation of its noise with a neighbour's
    faults: tuple[str, ...]  # among `FAULTS`


@dataclass(frozen=True)
class Health:
    """What a log says about its taxels."""

    frames: int  # how many were looked at
    duration: float  # from the first to the last [s]
    taxels: tuple[TaxelHealth, ...]  # by module and number
    notes: tuple[str, ...] = field(default=())  # what a person should know of the log

    @property
    def faulty(self) -> tuple[TaxelHealth, ...]:
        """The taxels with a fault."""
        return tuple(taxel for taxel in self.taxels if taxel.faults)


def log_health(
    log: SoLog, places: dict[tuple[int, int], tuple[float, float]] | None = None
) -> Health:
    """Judge every taxel of a log of some seconds or more, ValueError where frames are too few.

    At rest it shows noise and drift best, pressed here and there also which taxels don't
    follow. Places of the taxels (module, number) on the wall [m] tell which are neighbours;
    without them, the taxels of a module are one another's.
    """
    frames = group_frames(log)
    if len(frames) < MIN_FRAMES:
        raise ValueError(
            f"{log.path}: {len(frames)} frames; to judge taxels {MIN_FRAMES} are needed"
        )
    notes = [*log.notes, *sequence_notes(log)]
    so, names = _counts(frames)
    notes += _layout_notes(names, places or dict.fromkeys(names))
    time = np.where(np.isfinite(frames.t_device), frames.t_device, frames.t_host)
    most = max(_MOST_VALUES // max(so.shape[1], 1), MIN_FRAMES)
    if len(so) > most:
        notes.append(f"only the last {most} of {len(so)} frames are looked at")
        so, time = so[-most:], time[-most:]
    noise = noise_by_taxel(so)
    full = full_scale(so)
    at_limits = saturated(so, full)
    stuck = stuck_taxels(so, typical_noise(so)) & ~at_limits
    usable = np.where(stuck | at_limits, np.nan, so)
    drift, drifts = _drift(usable, time, noise)
    groups = neighbours(names, places)
    follows, coupling = correlations(usable, noise, groups)
    lost = _lost(log, frames, so, names)
    usual, level = typical_noise(so), mean(so)
    kept, full_or_zero = stuck.mean(0), at_limits.mean(0)  # shares of the frames
    rows = (level, noise, kept, full_or_zero, lost, drift, follows, coupling)
    checks: dict[str, np.ndarray] = {
        "stuck": kept > 0,
        "saturated": full_or_zero > _SHARE,
        "lossy": lost > _SHARE,
        "noisy": noise > _NOISY * usual + 1.0,
        "drifting": drifts,
        "unresponsive": follows < _FOLLOWS,
        "coupled": coupling > _COUPLED,
    }
    silent = np.all(~np.isfinite(so), 0)
    found = []
    for k, (name, row) in enumerate(zip(names, np.stack(rows, 1).tolist(), strict=True)):
        faults = tuple(fault for fault, bad in checks.items() if bad[k])
        fields: list[Any] = [*name, *row, ("silent",) if silent[k] else faults]
        found.append(TaxelHealth(*fields))
    duration = float(time[-1] - time[0])
    return Health(len(so), duration, tuple(found), tuple(notes))


def health_json(health: Health) -> dict[str, Any]:
    """Health as `suas health --json` prints it; NaN stands for what is unknown."""
    return {
        "status": "faults" if health.faulty else "healthy",
        "frames": health.frames,
        "duration_s": health.duration,
        "faulty": len(health.faulty),
        "taxels": [
            {_JSON_KEYS.get(key, key): value for key, value in asdict(taxel).items()}
            for taxel in health.taxels
        ],
        "notes": list(health.notes),
    }


_JSON_KEYS = {
    "mean": "mean_counts",
    "noise": "noise_counts",
    "stuck": "stuck_share",
    "saturated": "saturated_share",
    "lost": "lost_share",
    "drift": "drift_counts_per_min",
    "follows": "follows_neighbours",
    "coupling": "noise_coupling",
}


def _layout_notes(
    names: list[tuple[int, int]], known: Collection[tuple[int, int]]
) -> list[str]:
    """What a person should know where a skin file's taxels are others than a log's."""
    found = []
    for which, others, words in (
        (known, set(names), "the skin file has, but the log has not"),
        (names, set(known), "the log has, but the skin file has not"),
    ):
        own = [f"{module}.{taxel}" for module, taxel in which if (module, taxel) not in others]
        if own:
            text = ", ".join(own[:_NAMED]) + ", ..." * (len(own) > _NAMED)
            found.append(f"taxels that {words}: {text}: another skin, or columns are missing")
    return found


def _counts(frames: Frames) -> tuple[NDArray[np.float64], list[tuple[int, int]]]:
    """Counts [frame, taxel] of all modules, and which taxels they are of."""
    parts = [frames.of_module(k) for k in range(len(frames.modules))]
    # Columns that only wider modules have; a taxel between others that is silent stays.
    widths = [
        int(np.flatnonzero(np.isfinite(so).any(0)).max(initial=0)) + 1 if so.size else 0
        for so in parts
    ]
    if len(set(frames.modules.tolist())) == 1:
        widths = [parts[0].shape[1]]
    names = [
        (int(module), k + 1)
        for module, width in zip(frames.modules, widths, strict=True)
        for k in range(width)
    ]
    so = [part[:, :width] for part, width in zip(parts, widths, strict=True)]
    return np.concatenate(so, axis=1), names


def _lost(
    log: SoLog, frames: Frames, so: NDArray[np.float64], names: list[tuple[int, int]]
) -> NDArray[np.float64]:
    """Share of the device's frames without a count [taxel]."""
    gone = dict.fromkeys(frames.modules.tolist(), 0)
    flag = log.flags.get("lost")
    if flag is not None and flag.dtype.kind in "iu":
        for module in gone:
            own = (log.module == module) & ~flagged(log, "duplicate")
            gone[module] = int(flag[own].sum())
    total = np.array([len(so) + gone[module] for module, _ in names])
    return 1.0 - np.isfinite(so).sum(0) / np.maximum(total, 1)


def _drift(
    so: NDArray[np.float64], time: NDArray[np.float64], noise: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Steady change of every taxel [counts/min], and whether noise doesn't explain it."""
    size = len(so) // _PARTS
    taxels = so.shape[1]
    if size < 1 or not time[-1] > time[0]:
        return np.full(taxels, np.nan), np.zeros(taxels, bool)
    parts = so[: size * _PARTS].reshape(_PARTS, size, taxels)
    at = time[: size * _PARTS].reshape(_PARTS, size).mean(1) / 60.0
    means = mean(parts.swapaxes(0, 1))  # [part, taxel]
    i, k = np.triu_indices(_PARTS, 1)
    apart = np.maximum(at[k] - at[i], 1e-12)[:, None]
    slope = median((means[k] - means[i]) / apart)  # Theil and Sen's
    line = slope * (at - at.mean())[:, None]
    left = deviation(means - line)
    sigma = np.hypot(noise, 1 / math.sqrt(12))
    change = np.abs(slope) * (at[-1] - at[0])
    # The standard error of a line's rise over so many frames.
    error = sigma * math.sqrt(12 / (size * _PARTS))
    significant = change > np.maximum(_SIGNIFICANT * error, _LEAST_DRIFT)
    steady = left < np.maximum(2 * sigma / math.sqrt(size), _UNSTEADY * change)
    return slope, steady & significant
