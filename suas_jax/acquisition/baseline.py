"""Baselines: what each taxel reads while nothing touches the skin.

They are refused unless the skin was at rest: a log shows that a taxel drifts or jumps, an
earlier baseline or the skin's model that a load was on from the first frame to the last.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.log.log_file import Frames, SoLog, fluid_of, group_frames
from suas_jax.acquisition.taxel_faults import deviation, mean, saturated
from suas_jax.files.reading import MEGABYTE, read_bytes
from suas_jax.files.writing import write_text

FORMAT = "suas-baseline"
FLUID = "fluid"
"""Key of what filled the gap, where the log names it."""
_MOST_BYTES = 16 * MEGABYTE
# Fewer frames say nothing about drift.
MIN_FRAMES = 20
# The log is compared part by part: with this many standard errors, which the noise of some
# hundred taxels doesn't reach, and a floor, because a count is all that can be resolved.
_PARTS = 10
_SIGNIFICANT = 6.0
_FLOOR = 1.0
_ROUNDING = 1e-9  # of a mean [counts]
# Factors between the counts of a skin and those of its model: permittivity and gap that nobody
# has calibrated leave the first open, nothing leaves the second.
_DOUBTFUL, _ANOTHER = 1.5, 4.0


class NotAtRestError(ValueError):
    """The skin was loaded or drifting while the log was taken."""


@dataclass(frozen=True)
class Baseline:
    """Rest values."""

    modules: NDArray[np.int64]  # module numbers, ascending [module]
    # mean raw counts [module, taxel]; NaN where there is no taxel or it was silent
    so: NDArray[np.float64]
    noise: NDArray[np.float64]  # standard deviation of one frame [module, taxel], counts
    frames: int  # number of frames averaged
    header: Mapping[str, str]  # skin, scale and start time of the log


def take_baseline(log: SoLog, *, tolerance: float | None = None) -> Baseline:
    """Average a log of some seconds that was recorded at rest.

    The mean of a tenth of it may be off the mean of all by a tolerance [counts]; by default by
    what the taxel's own noise explains (6 standard errors), and at least one count. Raises
    NotAtRestError: the counts drift or jump; names the taxel and by how much; ValueError: too
    few frames, or no taxel that says anything.
    """
    frames = group_frames(log)
    if len(frames) < MIN_FRAMES:
        raise ValueError(
            f"{log.path}: {len(frames)} frames; a baseline needs at least {MIN_FRAMES}, "
            "better a few seconds"
        )
    found = [_statistics(frames.of_module(k)) for k in range(len(frames.modules))]
    means, steps, so, noise = (np.stack(x, axis=-2) for x in zip(*found, strict=True))
    if not np.isfinite(so).any():
        raise ValueError(f"{log.path}: every taxel is silent or saturated; check the cable")
    _refuse_moving(log, frames, means, steps, tolerance)
    kept = ("skin", "scale", "start_time")
    header = {key: log.header[key] for key in kept if key in log.header}
    if fluid := fluid_of(log):
        header[FLUID] = fluid
    return Baseline(frames.modules, so, noise, len(frames), header)


def refuse_loaded(
    baseline: Baseline,  # as taken
    rest: NDArray[np.float64],  # counts at rest [module, taxel], NaN where unknown
    *,
    tolerance: float,  # allowed deviation, relative to `rest`; a count is always allowed
    source: str,  # where `rest` is from, for the message
    # of all taxels over `rest`, see `common_factor`; where `rest` gives the pattern only
    factor: float = 1.0,
) -> None:
    """Refuse a baseline whose taxels don't read what they read at rest.

    Raises NotAtRestError: the taxels deviate; ValueError: no taxel can be compared.
    """
    ratio = _ratio(baseline, rest, source) / (factor or 1.0)
    known = np.isfinite(ratio)
    allowed = np.full(rest.shape, tolerance)
    allowed[known] += _FLOOR / rest[known]
    excess = np.nan_to_num(np.abs(ratio - 1) / allowed)
    if excess.max() <= 1.0:
        return
    module, taxel = np.unravel_index(excess.argmax(), excess.shape)
    raise NotAtRestError(
        f"the skin was loaded: module {baseline.modules[module]}, so_{taxel + 1} reads "
        f"{100 * (ratio[module, taxel] - 1):+.1f} % of its value at rest in {source}, "
        f"{100 * allowed[module, taxel]:.1f} % are allowed ({int((excess > 1).sum())} taxels "
        "deviate); take the load off and record again"
    )


def common_factor(baseline: Baseline, rest: NDArray[np.float64], source: str) -> float:
    """By which most taxels of a baseline read more than at rest [module, taxel].

    A model whose permittivity or gap nobody has calibrated gives the pattern up to a factor.
    Raises ValueError: no taxel can be compared.
    """
    return float(np.nanmedian(_ratio(baseline, rest, source)))


def doubt_of_factor(factor: float, source: str) -> str:
    """A doubt about a factor on all counts, or nothing.

    Raises ValueError: no skin of this pattern has the factor.
    """
    off = max(factor, 1 / factor) if factor > 0 else math.inf
    if off <= _DOUBTFUL:
        return ""
    text = (
        f"all taxels read {factor:.3g} times what they read at rest in {source}: check that "
        "the log is of this skin (--skin names another), electrodes.lsb, the electrodes' "
        "diameters and oil.relative_permittivity"
    )
    if off > _ANOTHER:
        raise ValueError(f"{text}; factors from {1 / _ANOTHER:g} to {_ANOTHER:g} are allowed")
    return text


def _ratio(baseline: Baseline, rest: NDArray[np.float64], source: str) -> NDArray[np.float64]:
    """Counts over those at rest [module, taxel], NaN where either is unknown."""
    known = np.isfinite(rest) & np.isfinite(baseline.so) & (rest > 0)
    if not known.any():
        raise ValueError(f"{source}: has no taxel in common with this log")
    ratio = np.full(rest.shape, np.nan)
    ratio[known] = baseline.so[known] / rest[known]
    return ratio


def write_baseline(baseline: Baseline, path: Path) -> None:
    """Write a baseline as JSON; see `baseline_json`."""
    write_text(path, baseline_json(baseline))


def baseline_json(baseline: Baseline) -> str:
    """A baseline as JSON: header, then counts and noise by module."""
    modules = [
        {"module": int(module), "so": _jsonable(so), "noise": _jsonable(noise)}
        for module, so, noise in zip(baseline.modules, baseline.so, baseline.noise, strict=True)
    ]
    content = {
        "format": FORMAT,
        "format_version": 1,
        **baseline.header,
        "units": "so and noise (standard deviation of one frame) in raw counts",
        "frames": baseline.frames,
        "modules": modules,
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def read_baseline(path: Path) -> Baseline:
    """Read a baseline. Raises ValueError: it is none; names the key."""
    try:
        content: Any = json.loads(read_bytes(path, _MOST_BYTES))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: no baseline file: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ValueError(f'{path}: no baseline file: "format" must be "{FORMAT}"')
    try:
        entries = sorted(content["modules"], key=lambda entry: entry["module"])
        width = max(len(entry["so"]) for entry in entries)
        so, noise = (
            np.array([_padded(entry[key], width) for entry in entries])
            for key in ("so", "noise")
        )
        modules = np.array([entry["module"] for entry in entries], np.int64)
        frames = int(content["frames"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: the baseline is incomplete or damaged: {error}") from None
    header = {key: value for key, value in content.items() if isinstance(value, str)}
    return Baseline(modules, so, noise, frames, header)


def rest_of(baseline: Baseline, like: Baseline) -> NDArray[np.float64]:
    """The counts of a baseline, arranged as in another; NaN where it has none."""
    rest = np.full_like(like.so, np.nan)
    width = min(rest.shape[1], baseline.so.shape[1])
    for row, module in enumerate(like.modules):
        at = np.flatnonzero(baseline.modules == module)
        if at.size:
            rest[row, :width] = baseline.so[at[0], :width]
    return rest


def _statistics(so: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Of one module's counts [frame, taxel]: what a baseline is judged by and made of.

    A taxel that is saturated throughout is silent: a cable or a converter has failed.
    Means of the parts [part, taxel]; standard deviation of the differences of neighbouring
    frames, mean and standard deviation, each [taxel].
    """
    so = np.where((saturated(so) | np.isnan(so)).all(0), np.nan, so)
    size = len(so) // _PARTS
    means = np.stack([mean(so[k * size : (k + 1) * size]) for k in range(_PARTS)])
    return means, deviation(np.diff(so, axis=0)), mean(so), deviation(so)


def _refuse_moving(
    log: SoLog,
    frames: Frames,
    means: NDArray[np.float64],  # of the parts [part, module, taxel]
    # standard deviation of the differences of neighbouring frames [module, taxel]
    steps: NDArray[np.float64],
    tolerance: float | None,  # allowed difference to the mean of all parts [counts]
) -> None:
    """Refuse a log whose parts differ by more than its noise explains."""
    size = len(frames) // _PARTS
    # The part's noise from differences of neighbouring frames, which a drift hardly touches;
    # rounding to whole counts is noise, too.
    noise = np.fmax(steps / math.sqrt(2), 1 / math.sqrt(12))
    change = np.abs(means - mean(means))
    allowed = np.maximum(_SIGNIFICANT * noise / math.sqrt(size), _FLOOR)
    if tolerance is not None:
        allowed = np.full_like(allowed, tolerance)
    excess = np.nan_to_num(change / np.maximum(allowed, _ROUNDING))
    if excess.max(initial=0.0) <= 1.0:
        return
    _, module, taxel = np.unravel_index(excess.argmax(), excess.shape)
    series = means[:, module, taxel]
    series = series[np.isfinite(series)]
    drifts = abs(series[-1] - series[0]) > 0.8 * np.ptp(series)
    what = "drifting, or its load changed" if drifts else "loaded or touched meanwhile"
    moved = int((excess.max(axis=0) > 1.0).sum())
    raise NotAtRestError(
        f"{log.path}: the skin was {what}: module {frames.modules[module]}, so_{taxel + 1} "
        f"moved by {np.ptp(series):.1f} counts within "
        f"{frames.t_host[-1] - frames.t_host[0]:.1f} s, "
        f"{allowed[module, taxel]:.1f} from its mean are allowed ({moved} taxels moved); take "
        "the load off, wait until nothing changes and record again, or allow more with "
        "--tolerance"
    )


def _jsonable(values: NDArray[np.float64]) -> list[float | None]:
    return [None if math.isnan(v) else round(v, 4) for v in values.tolist()]


def _padded(values: list[float | None], width: int) -> list[float]:
    filled = [math.nan if v is None else float(v) for v in values]
    return filled + [math.nan] * (width - len(filled))
