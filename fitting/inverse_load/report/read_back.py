"""Estimates read back from the JSON lines of `suas invert --json`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import BESIDE, STATUS, Contact, LoadEstimate, Tap
from fitting.inverse_load.estimate.load_field import (
    FIELD_QUANTITIES,
    Interval,
    LoadField,
    interval_key,
)
from suas_jax.files.reading import MEGABYTE, read_bytes

_MOST_BYTES = 512 * MEGABYTE
_MOST_CONTACTS = 16
_AT_THE_WALL = "saturated by wall contact"  # as `LoadEstimate.status_text` begins


def read_estimates(path: Path, seq: NDArray[np.int64]) -> list[LoadEstimate]:
    """Read the estimates of a log's frames.

    The file has what `suas invert LOG --json` printed for the log; `seq` are the numbers of the
    log's frames, in their order.
    Raises ValueError: a line is none of `suas invert`, or the frames are not the log's.
    Raises OSError: the file can't be read.
    """
    lines = read_bytes(path, _MOST_BYTES).decode("utf-8", "replace").splitlines()
    found = [_line(path, k, text) for k, text in enumerate(lines, 1) if text.strip()]
    numbers = [number for number, _ in found]
    if numbers != seq.tolist():
        raise ValueError(
            f"{path}: holds {len(numbers)} frames, which are not the log's {len(seq)}; make it "
            "with `suas invert SKIN LOG --json`"
        )
    return [estimate for _, estimate in found]


def _line(path: Path, k: int, text: str) -> tuple[int, LoadEstimate]:
    try:
        line = json.loads(text)
        loads, others = line["loads"], line.get("alternatives", ())
        if max(len(loads), len(others)) > _MOST_CONTACTS:
            raise ValueError
        drift, tap, field = (line.get(key) for key in ("drift_counts", "tap", "field"))
        status = str(line["status"])
        if status.startswith(_AT_THE_WALL):
            status = "wall_contact"
        if status not in STATUS:
            raise ValueError
        estimate = LoadEstimate(
            _answer(line["contact"]),
            tuple(_contact(load) for load in loads),
            _number(line["oil_pressure_Pa"]),
            _answer(line["wall_contact"]),
            _number(line["chi2_per_dof"]),
            status,
            tuple(int(taxel) for taxel in line["left_out"]),
            tuple(_contact(load) for load in others),
            _number(line["latency_s"]),
            _optional(line, "force_at_least_N"),
            None if drift is None else (float(drift["mean"]), float(drift["largest"])),
            None if tap is None else _tap(tap),
            None if field is None else _field(field),
        )
        return int(line["seq"]), estimate
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise ValueError(
            f'{path}, line {k}: "{text[:60]}": is not a frame of `suas invert --json`'
        ) from None


def _contact(load: dict[str, Any]) -> Contact:
    turns = (_optional(load, key) for key in ("direction_deg", "tilt_deg"))
    direction, tilt = (None if x is None else float(np.deg2rad(x)) for x in turns)
    return Contact(
        float(np.deg2rad(float(load["angle_deg"]))),
        float(load["force_N"]),
        direction,
        _matrix(load.get("covariance")),
        _optional(load, "arc_position_m"),
        _matrix(load.get("systematic_covariance")),
        _optional(load, "axial_m"),
        _optional(load, "diameter_m"),
        tilt=tilt,
        arc=_optional(load, "arc_m"),
        by_arc="arc" in load.get("covariance_of", ()),
        **{
            name: (float(load[keys[0]]), float(load[keys[1]]))
            for name, keys in BESIDE.items()
            if load.get(keys[0]) is not None
        },
    )


def _tap(told: dict[str, Any]) -> Tap:
    place = _contact({**told, "force_N": "nan"})
    keys = "t_s", "duration_s", "impulse_Ns", "impulse_deviation_Ns"
    time, duration, impulse, deviation = (float(told[key]) for key in keys)
    return Tap(time, duration, place, impulse, deviation)


def _field(told: dict[str, Any]) -> LoadField:
    known: dict[str, Interval] = {}
    for name, (key, scale) in FIELD_QUANTITIES.items():
        if key in told:
            low, high = told[interval_key(key)]
            known[name] = Interval(*(float(x) / scale for x in (told[key], low, high)))
    return LoadField(**known, preferred_by=float(told["preferred_by"]))


def _matrix(rows: Any) -> Floats | None:
    if rows is None:
        return None
    matrix = np.array(rows, float)
    if matrix.ndim != 2 or len(matrix) != matrix.shape[1] or len(matrix) > _MOST_CONTACTS:
        raise ValueError
    return matrix


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _optional(table: dict[str, Any], key: str) -> float | None:
    return None if table.get(key) is None else float(table[key])


def _answer(value: Any) -> bool | None:
    if value not in (True, False, None):
        raise ValueError
    return None if value is None else bool(value)
