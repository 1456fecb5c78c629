"""One log of an experiment, checked against the skin and aligned with its taxels."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitting.sensor.logs.known_inputs import (
    FLUID,
    Known,
    check_known,
    from_columns,
    from_file,
    from_header,
    permittivities,
)
from fitting.surroundings import Surroundings, log_surroundings
from suas_jax.acquisition.log.log_file import (
    SoLog,
    flagged,
    group_frames,
    sequence_notes,
    without_other_taxels,
)
from suas_jax.acquisition.log.record import FLAG_COLUMNS
from suas_jax.acquisition.taxel_faults import full_scale, saturated, stuck_taxels, typical_noise
from suas_jax.config import SkinSpec, format_quantity, parse_quantity

_SAME_SCALE = 0.01


@dataclasses.dataclass(frozen=True)
class Masked:
    """Readings of a taxel that are left out."""

    module: int  # from 0
    taxel: int  # number in its module, from 1
    reason: str  # why, in words
    frames: int  # how many readings
    whole: bool  # whether nothing of the taxel is left in this log
    log: str  # the file


def without_faults(
    so: np.ndarray,
    log: SoLog,
    modules: Sequence[int],
    numbers: Sequence[int],
    masked: list[Masked],
) -> np.ndarray:
    """Take out what says nothing about the gap, and list it."""
    so = so.copy()
    full = full_scale(so)
    stuck = stuck_taxels(so.T, typical_noise(so.T)).T
    for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
        row = so[i]
        present = np.isfinite(row)
        if not present.any():
            masked.append(Masked(m, k, "silent: no counts in the log", 0, True, str(log.path)))
            continue
        limits = saturated(row, full)
        for found, reason in (
            (limits, f"saturated (0 or {full:.0f} counts)"),
            (stuck[i] & ~limits, "stuck: keeps its count while others change"),
        ):
            if found.any():
                so[i, found] = np.nan
                whole = not np.isfinite(so[i]).any()
                count = int(found.sum())
                masked.append(Masked(m, k, reason, count, whole, str(log.path)))
        # A few readings between saturated or stuck ones are no basis for anything.
        left = np.isfinite(so[i]).sum()
        if 0 < left < 0.02 * present.sum() and left < 5:
            so[i] = np.nan
    if not np.isfinite(so).any():
        reasons = sorted({m.reason.split(":")[0] for m in masked})
        raise ValueError(
            f"{log.path}: no reading is left: all {len(so)} taxels are {' or '.join(reasons)}"
        )
    return so


@dataclasses.dataclass(frozen=True)
class AlignedLog:
    """One log, aligned with the skin's taxels."""

    path: Path  # of the log
    so: np.ndarray  # raw counts [taxel, frame]; NaN where missing or left out
    time: np.ndarray  # since the first frame [frame, s]
    known: Known  # loads and displacements [frame]
    permittivity: np.ndarray  # of the fluid; NaN where it is the oil [frame]
    masked: list[Masked]  # what was left out
    warnings: list[str]  # what a person should know
    inputs: Path | None  # second file of known inputs, or None
    simulated: bool  # whether `suas simulate` made it
    began: str  # date and time, as its header says
    surroundings: Surroundings  # of the skin [frame]


def read_aligned(
    spec: SkinSpec, log: SoLog, inputs: Path | None, fluid: str | None
) -> AlignedLog:
    """A log and what is known of its frames.

    `spec` is the skin that the log was taken with, `inputs` a second file of known inputs,
    joined on time, and `fluid` what filled the gap, if the log doesn't say.
    Raises ValueError: the log can't be used; names file, column, value and what is allowed.
    Raises OSError: the second file can't be read.
    """
    if inputs is not None and not inputs.exists():
        raise FileNotFoundError(f"{inputs}: no such file")
    path = log.path
    warnings = [f"{path}: {note}" for note in (*log.notes, *sequence_notes(log))]
    log = without_other_taxels(log)
    _check_header(spec, log)
    taxels = _place(spec, log)
    frames = group_frames(_without_repeats(log))
    if not len(frames):
        raise ValueError(f"{path}: the log is empty: it has no frames")
    modules, numbers = spec.sensing.taxel_names
    so = np.full((len(modules), len(frames)), np.nan)
    for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
        row = np.flatnonzero(frames.modules == m)
        if row.size and taxels[m] >= k:
            so[i] = frames.of_module(int(row[0]))[:, k - 1]
    clock = "t_device_s" if np.isfinite(frames.t_device).all() else "t_host_s"
    time = frames.t_device if clock == "t_device_s" else frames.t_host
    if not np.isfinite(time).all():
        raise ValueError(f"{path}: both clocks have missing values: frames can't be placed")
    first = _first_rows(log, frames.seq, frames.t_host)
    columns = {name: np.asarray(values)[first] for name, values in log.flags.items()}
    around, said = log_surroundings(columns, log.header, spec, str(path))
    warnings += said
    if "oil_pressure_Pa" in columns:
        warnings.append(
            f"{path}: its column oil_pressure_Pa is not used: the fit is to the taxels alone; "
            "`suas invert --pressure-noise` uses it to find loads"
        )
    known, kept = _known(log, columns, inputs, time, clock)
    permittivity = permittivities(known.fluid, fluid, len(time), str(path))
    for (load, quantity), values in known.values.items():
        if quantity in ("force", "displacement", "inner_displacement", "depth"):
            kept &= np.isfinite(values)
            # At rest a load needs no place.
            for name in ("angle", "arc", "direction", "axial", "diameter"):
                placed = known.values.get((load, name), np.zeros(1))
                kept &= np.isfinite(placed) | (values == 0)
    if not kept.any():
        empty = [known.names[k] for k, x in known.values.items() if not np.isfinite(x).any()]
        wrong = f"{' and '.join(empty)} empty; leave out what is not known" if empty else ""
        raise ValueError(
            f"{path}: no frame has known inputs: {wrong or 'every row misses one'}"
        )
    if not kept.all():
        warnings.append(
            f"{path}: {int((~kept).sum())} frames without known inputs left out (an empty cell "
            "is unknown; at rest a force is 0)"
        )
    known = Known({k: v[kept] for k, v in known.values.items()}, None, known.names)
    check_known(spec, known, str(path))
    if not known.values:
        warnings.append(
            f"{path}: no known loads or displacements (columns such as load_0_force_N): the "
            "skin is taken to be at rest; where it was loaded, give what is known in a file of "
            "its own: --inputs FILE"
            + (
                f"; not understood: {', '.join(others)}"
                if (others := _unknown_columns(log))
                else ""
            )
        )
    so, time, permittivity = so[:, kept], time[kept], permittivity[kept]
    masked: list[Masked] = []
    so = without_faults(so, log, modules, numbers, masked)
    return AlignedLog(
        path,
        so,
        time - time[0],
        known,
        permittivity,
        masked,
        warnings,
        inputs,
        "simulated" in log.header,
        log.header.get("start_time", ""),
        around.by(lambda values: values[kept]),
    )


def _unknown_columns(log: SoLog) -> list[str]:
    """Columns that are neither known inputs nor flags of the logger."""
    own = {*FLAG_COLUMNS, FLUID}
    return [name for name in log.flags if name.strip().lower() not in own]


def _check_header(spec: SkinSpec, log: SoLog) -> None:
    """Refuse a log whose own header says that its counts are something else."""
    for scale in (source.get("scale", "").strip() for source in (log.header, log.restated)):
        if not scale:
            continue
        try:
            lsb = parse_quantity(scale, "capacitance")
        except ValueError as error:
            raise ValueError(f'{log.path}, header scale "{scale}": {error}') from None
        own = spec.sensing.lsb
        if abs(lsb / own - 1) > _SAME_SCALE:
            raise ValueError(
                f"{log.path}, header scale: one count is {format_quantity(lsb, 'capacitance')} "
                f"in this log, but electrodes.lsb is {format_quantity(own, 'capacitance')} in "
                "the skin file: the units are mixed up, or it is another skin; make them agree"
            )
    units = log.header.get("units", "")
    if "so_k" in units and "count" not in units.split("so_k", 1)[1]:
        raise ValueError(f'{log.path}, header units "{units}": so_k in raw counts is expected')


def _place(spec: SkinSpec, log: SoLog) -> dict[int, int]:
    """Number of taxels of the skin's modules, after a check that the log has the same."""
    modules, numbers = spec.sensing.taxel_names
    sizes = {
        m: max(k for n, k in zip(modules, numbers, strict=True) if n == m) for m in modules
    }
    if not len(log):
        raise ValueError(f"{log.path}: the log is empty: it has no rows")
    foreign = sorted(set(log.module.tolist()) - sizes.keys())
    if foreign:
        raise ValueError(
            f"{log.path}: module {foreign[0]}: the skin has no such module (it has "
            f"{_listed(sorted(sizes))}): a log of another layout, or the wrong skin file"
        )
    columns = log.so.shape[1]
    if columns < max(sizes.values()):
        raise ValueError(
            f"{log.path}: columns so_1 to so_{columns}, but the skin's modules have "
            f"{max(sizes.values())} taxels: a log of another layout, or the wrong skin file"
        )
    for m, size in sizes.items():
        if np.isfinite(log.so[log.module == m][:, size:]).any():
            raise ValueError(
                f"{log.path}: module {m} has counts beyond so_{size}, the skin's module has "
                f"{size} taxels: a log of another layout, or the wrong skin file"
            )
    return sizes


def _without_repeats(log: SoLog) -> SoLog:
    """The log without counts that an earlier row already had."""
    bad = flagged(log, "repeat") | flagged(log, "suspect")
    if not bad.any():
        return log
    return dataclasses.replace(log, so=np.where(bad[:, None], np.nan, log.so))


def _known(
    log: SoLog,
    columns: Mapping[str, np.ndarray],
    inputs: Path | None,
    time: np.ndarray,
    clock: str,
) -> tuple[Known, np.ndarray]:
    """Known inputs of every frame, which stand in its first row, and which frames have them."""
    where = str(log.path)
    known = from_columns(columns, where)
    head = from_header(log.header, len(time), where, log.restated)
    known = head.merged(known, where)
    covered = np.ones(len(time), bool)
    if inputs is not None:
        more, covered = from_file(inputs, time, clock)
        known = known.merged(more, where)
    return known, covered


def _first_rows(log: SoLog, seq: np.ndarray, t_host: np.ndarray) -> np.ndarray:
    rows, at = [], 0
    for number, t in zip(seq, t_host, strict=True):
        while log.seq[at] != number or not (log.t_host[at] == t or np.isnan(t)):
            at += 1
        rows.append(at)
    return np.array(rows, int)


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:6])) + (", ..." if len(numbers) > 6 else "")
