"""Logs of an experiment with known inputs, ready to be compared with the model.

Readings that carry no information are taken out and listed with the reason: stuck and
saturated taxels, repeated frames, frames without known inputs.
"""

import dataclasses
import functools
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fitting.sensor.logs.known_inputs import fluid_name
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.logs.log import AlignedLog, Masked, read_aligned
from fitting.surroundings import Surroundings, spec_at, told_at_mean
from suas_jax.acquisition.log.log_file import SoLog, read_log
from suas_jax.acquisition.log.reader import MOST_BYTES
from suas_jax.config import SkinSpec
from suas_jax.files.reading import sha256_of
from suas_jax.skin.plain import angles_at


class NoCalibration(ValueError):  # noqa: N818
    """The logs don't belong to the skin, or determine no constant."""


@dataclasses.dataclass(frozen=True)
class LogFile:
    """Where readings came from."""

    path: str  # as given
    sha256: str  # of the file's bytes
    frames: int  # how many are used
    fluids: tuple[str, ...]  # what filled the gap
    inputs: tuple[str, str] | None  # the second file with its hash, or None


@dataclasses.dataclass(frozen=True)
class SensorData:
    """Readings of all logs."""

    spec: SkinSpec
    so: np.ndarray  # raw counts [taxel, frame]; NaN where missing or masked
    time: np.ndarray  # since the first frame of its log [frame, s]
    log: np.ndarray  # which log a frame is from [frame]
    state: np.ndarray  # which known state a frame is in [frame]
    loads: KnownLoads  # the distinct known states
    permittivity: np.ndarray  # of the fluid, state by state; NaN where it is the oil [state]
    files: tuple[LogFile, ...]  # where the readings came from
    masked: tuple[Masked, ...]  # what was left out
    warnings: tuple[str, ...]  # what a person should know
    # whether `suas simulate` made all of them, which has the shell's shapes
    simulated: bool = False
    # of loads whose force and displacement are both known: the one that is not used, its mean
    # in each state; NaN elsewhere [load, state] [N] or [m]
    unused: np.ndarray | None = None

    @property
    def paths(self) -> str:
        """Names of the logs."""
        return ", ".join(file.path for file in self.files)

    @property
    def loaded(self) -> np.ndarray:
        """States in which something moves the membrane [state]."""
        force = np.nan_to_num(self.loads.force) != 0
        moved = np.nan_to_num(self.loads.displacement) != 0
        return np.asarray((force | moved | (self.loads.depth > 0)).any(0))


def load_sensor_data(
    spec: SkinSpec,
    logs: Sequence[Path],
    inputs: Sequence[Path] = (),
    fluids: Sequence[str] = (),
    *,
    joint: bool = False,
) -> SensorData:
    """Read the logs of an experiment.

    Args:
        spec: the skin that they were taken with.
        logs: SO logs.
        inputs: files of known inputs: one for each log, or one for all.
        fluids: what filled the gap: one for each log, or one for all.
        joint: the material is to be found, too: of a load whose force and displacement are
            both known the force is used, else the displacement.

    Raises:
        ValueError: a file can't be used; names file, column, value and what is allowed.
        OSError: it can't be read.
    """
    if spec.electrodes is None:
        raise ValueError("the skin has no [electrodes]: there is nothing to calibrate")
    if not logs:
        raise ValueError("no log: name at least one")
    if len(set(map(os.path.realpath, logs))) < len(logs):
        raise ValueError("a log is named twice: its noise would count as that of two")
    for option, given in (("--inputs", inputs), ("--fluid", fluids)):
        if len(given) not in (0, 1, len(logs)):
            raise ValueError(
                f"{option}: given {len(given)} times for {len(logs)} logs; once for all logs, "
                "or once for each"
            )

    def of(given: Sequence, i: int) -> object:
        return None if not given else given[i if len(given) > 1 else 0]

    def read(path: Path) -> SoLog:
        if not path.exists():
            raise FileNotFoundError(f"{path}: no such file")
        return read_log(path)

    parts = [
        read_aligned(spec, read(path), of(inputs, i), of(fluids, i))  # type: ignore[arg-type]
        for i, path in enumerate(logs)
    ]
    around = functools.reduce(
        Surroundings.and_then, [part.surroundings for part in parts], Surroundings()
    )
    said = [*told_at_mean(around, spec)]
    spec, more = spec_at(spec, around, ", ".join(map(str, logs)))
    data = _joined(spec, parts, joint)
    return dataclasses.replace(data, warnings=(*data.warnings, *more, *said))


Table = dict[
    str, np.ndarray
]  # what is known of the loads, as `KnownLoads` has it [load, frame]

_DISPLACEMENTS = ("displacement", "inner_displacement")
_FIELDS = {"arc": "angle", "direction": "turn", "inner_displacement": "displacement"}


def _column(spec: SkinSpec, quantity: str, values: np.ndarray) -> tuple[str, np.ndarray]:
    """The field of `KnownLoads` that a quantity belongs to, and its values there."""
    field = _FIELDS.get(quantity, quantity)
    if field in ("force", "displacement"):
        return field, values
    known = np.nan_to_num(values)
    return field, angles_at(spec.geometry, quantity, known) if field == "angle" else known


def _joined(spec: SkinSpec, parts: Sequence[AlignedLog], joint: bool) -> SensorData:
    count = max([1, *(1 + load for p in parts for load, _ in p.known.values)])
    frames = [len(p.time) for p in parts]
    fields = [field.name for field in dataclasses.fields(KnownLoads) if field.name != "inner"]
    table = {field: np.zeros((count, sum(frames))) for field in fields}
    for field in ("force", "displacement"):
        table[field][:] = np.nan
    inner = np.zeros(count, bool)
    begin = 0
    warnings = [w for p in parts for w in p.warnings]
    for p, n in zip(parts, frames, strict=True):
        for (load, quantity), values in p.known.values.items():
            here = slice(begin, begin + n)
            field, values = _column(spec, quantity, values)
            table[field][load, here] = values
            inner[load] |= quantity == "inner_displacement"
        for load in range(count):
            moved = any((load, q) in p.known.values for q in _DISPLACEMENTS)
            if moved and (load, "force") in p.known.values:
                warnings.append(
                    f"{p.path}: load {load} has force and displacement: the "
                    + (
                        "force is used, which tells the material"
                        if joint
                        else "displacement is used, which needs no material"
                    )
                )
        begin += n
    if table["radius"].any():
        _only_bodies(table, parts, warnings)
    force, displacement = table["force"], table["displacement"]
    both = np.isfinite(force) & np.isfinite(displacement)
    left_out = displacement if joint else force
    unused = np.where(both, left_out, np.nan)
    left_out[both] = np.nan
    force[np.isnan(force) & np.isnan(displacement)] = 0.0
    known = {key for p in parts for key in p.known.values}
    for load in range(count):
        if all((load, q) in known for q in _DISPLACEMENTS):
            raise ValueError(
                f"load {load}: displacements of the mid-surface and of the inner face are "
                "mixed; give one kind in all logs"
            )
    _forget_idle_places(table)
    permittivity = np.concatenate([p.permittivity for p in parts])
    rows = np.concatenate([*table.values(), permittivity[None]]).T
    # NaN is not a value that rows could be told apart by; it stands for "not this kind".
    _, first, state = np.unique(
        np.nan_to_num(rows, nan=1e300), axis=0, return_index=True, return_inverse=True
    )
    masked = [m for p in parts for m in p.masked]
    log = np.repeat(np.arange(len(parts)), frames)
    files = tuple(
        LogFile(
            str(p.path),
            sha256_of(p.path, MOST_BYTES),
            len(p.time),
            tuple(sorted({fluid_name(x) for x in p.permittivity})),
            None if p.inputs is None else (str(p.inputs), sha256_of(p.inputs, MOST_BYTES)),
        )
        for p in parts
    )
    return SensorData(
        spec,
        np.concatenate([p.so for p in parts], axis=1),
        np.concatenate([p.time for p in parts]),
        log,
        state.reshape(-1),
        KnownLoads(inner=inner, **{field: values[:, first] for field, values in table.items()}),
        permittivity[first],
        files,
        tuple(masked),
        tuple(warnings),
        all(p.simulated for p in parts),
        _means(unused, state.reshape(-1), len(first)) if both.any() else None,
    )


def _means(values: np.ndarray, state: np.ndarray, states: int) -> np.ndarray:
    """Means of values [load, frame] over the frames of each state; NaN where there are none."""
    known = np.isfinite(values)
    pairs = zip(values, known, strict=True)
    sums = np.array([np.bincount(state[k], row[k], states) for row, k in pairs])
    count = np.array([np.bincount(state[k], minlength=states) for k in known])
    return np.where(count > 0, sums / np.maximum(count, 1), np.nan)


def _forget_idle_places(table: Table) -> None:
    """Where nothing is pressed the place says nothing: one state at rest stands for all."""
    pushed = np.nan_to_num(table["force"]) != 0
    idle = ~pushed & np.isnan(table["displacement"]) & (table["depth"] <= 0)
    for field in ("angle", "turn", "axial", "diameter"):
        table[field][idle] = 0.0


def _only_bodies(table: Table, parts: Sequence[AlignedLog], warnings: list[str]) -> None:
    """Take the travels of bodies for all that is known, every body with its radius.

    Raises ValueError: other loads are known, too.
    """
    for p in parts:
        for load in {load for load, _ in p.known.values}:
            own = {q: values for (k, q), values in p.known.values.items() if k == load}
            have = own.keys() & {"force", *_DISPLACEMENTS}
            if "depth" not in own:
                if any(np.nan_to_num(own[q]).any() for q in have):
                    raise ValueError(
                        f"{p.path}: load {load} is a force or a displacement, other loads are "
                        "bodies (load_0_depth_mm); calibrate with one kind at a time"
                    )
            elif have:
                warnings.append(
                    f"{p.path}: of body {load} the depth is used, not its {', '.join(have)}, "
                    "which tells the material: suas fit material --data indentation=FILE"
                )
    table["force"][:] = table["displacement"][:] = np.nan
    table["turn"][:] = 0.0
    # Off the skin a body needs no radius of its own.
    radius = table["radius"]
    sizes = np.max(radius, axis=1, keepdims=True)
    table["radius"] = np.where(radius > 0, radius, np.where(sizes > 0, sizes, np.max(sizes)))
