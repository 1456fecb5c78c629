"""Logs of an experiment with known inputs, ready to be compared with the model.

Readings that carry no information are taken out here and listed with the reason: stuck
and saturated taxels, repeated frames, frames without known inputs.
"""

import dataclasses
import hashlib
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitting.known_inputs import Known, from_columns, from_file, from_header
from fitting.known_loads import KnownLoads
from suas_jax.acquisition.log_file import MAX_COUNT, SoLog, group_frames, read_log
from suas_jax.config import SkinSpec, format_quantity, parse_quantity
from suas_jax.config.schema_skin import FLUIDS
from suas_jax.taxel import taxel_names

OIL = "oil"
# A converter of fewer bits is full at one of these counts.
_FULL_SCALES = (255, 1023, 4095, 16383)
# A taxel that keeps its count this long while others change is stuck.
_STUCK_AFTER = 20
_SAME_SCALE = 0.01


@dataclasses.dataclass(frozen=True)
class Masked:
    """Readings of a taxel that are left out.

    Attributes:
        module: from 0.
        taxel: number in its module, from 1.
        reason: why, in words.
        frames: how many readings.
        whole: whether nothing of the taxel is left in this log.
        log: the file.
    """

    module: int
    taxel: int
    reason: str
    frames: int
    whole: bool
    log: str


@dataclasses.dataclass(frozen=True)
class LogFile:
    """Where readings came from.

    Attributes:
        path: as given.
        sha256: of the file's bytes.
        frames: how many are used.
        fluids: what filled the gap.
        inputs: the second file with its hash, or None.
    """

    path: str
    sha256: str
    frames: int
    fluids: tuple[str, ...]
    inputs: tuple[str, str] | None


@dataclasses.dataclass(frozen=True)
class SensorData:
    """Readings of all logs.

    Attributes:
        spec: the skin.
        so: raw counts [taxel, frame]; NaN where missing or masked.
        time: since the first frame of its log [frame, s].
        log: which log a frame is from [frame].
        state: which known state a frame is in [frame].
        loads: the distinct known states.
        permittivity: of the fluid, state by state; NaN where it is the oil [state].
        files: where the readings came from.
        masked: what was left out.
        warnings: what a person should know.
        simulated: whether `suas simulate` made all of them, which has the shell's shapes.
    """

    spec: SkinSpec
    so: np.ndarray
    time: np.ndarray
    log: np.ndarray
    state: np.ndarray
    loads: KnownLoads
    permittivity: np.ndarray
    files: tuple[LogFile, ...]
    masked: tuple[Masked, ...]
    warnings: tuple[str, ...]
    simulated: bool = False

    @property
    def displaced(self) -> bool:
        """Whether some displacements are known instead of forces."""
        return bool(np.isfinite(self.loads.displacement).any())

    @property
    def loaded(self) -> np.ndarray:
        """States in which something moves the membrane [state]."""
        force = np.nan_to_num(self.loads.force) != 0
        moved = np.nan_to_num(self.loads.displacement) != 0
        return np.asarray((force | moved).any(0))


@dataclasses.dataclass(frozen=True)
class _Part:
    """One log, aligned with the skin's taxels."""

    path: Path
    so: np.ndarray  # [taxel, frame]
    time: np.ndarray
    known: Known
    fluid: np.ndarray  # permittivity, NaN for the oil [frame]
    masked: list[Masked]
    warnings: list[str]
    inputs: tuple[str, str] | None
    simulated: bool


def load_sensor_data(
    spec: SkinSpec,
    logs: Sequence[Path],
    inputs: Sequence[Path] = (),
    fluids: Sequence[str] = (),
) -> SensorData:
    """Read the logs of an experiment.

    Args:
        spec: the skin that they were taken with.
        logs: SO logs.
        inputs: files of known inputs: one for each log, or one for all.
        fluids: likewise, what filled the gap.

    Raises:
        ValueError: a file can't be used; names file, column, value and what is allowed.
        OSError: it can't be read.
    """
    if spec.electrodes is None:
        raise ValueError("the skin has no [electrodes]: there is nothing to calibrate")
    if not logs:
        raise ValueError("no log: name at least one")
    for option, given in (("--inputs", inputs), ("--fluid", fluids)):
        if len(given) not in (0, 1, len(logs)):
            raise ValueError(
                f"{option}: given {len(given)} times for {len(logs)} logs; once for all logs, "
                "or once for each"
            )

    def of(given: Sequence, i: int) -> object:
        return None if not given else given[i if len(given) > 1 else 0]

    parts = [
        _read(spec, path, of(inputs, i), of(fluids, i))  # type: ignore[arg-type]
        for i, path in enumerate(logs)
    ]
    return _joined(spec, parts)


def _read(spec: SkinSpec, path: Path, inputs: Path | None, fluid: str | None) -> _Part:
    log = read_log(path)
    _check_header(spec, log)
    taxels = _place(spec, log)
    frames = group_frames(_without_repeats(log))
    if not len(frames):
        raise ValueError(f"{path}: the log is empty: it has no frames")
    modules, numbers = taxel_names(spec.electrodes)  # type: ignore[arg-type]
    so = np.full((len(modules), len(frames)), np.nan)
    for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
        row = np.flatnonzero(frames.modules == m)
        if row.size and taxels[m] >= k:
            so[i] = frames.so[:, row[0], k - 1]
    clock = "t_device_s" if np.isfinite(frames.t_device).all() else "t_host_s"
    time = frames.t_device if clock == "t_device_s" else frames.t_host
    if not np.isfinite(time).all():
        raise ValueError(f"{path}: both clocks have missing values: frames can't be placed")
    warnings = [f"{path}: {note}" for note in log.notes]
    known, kept = _known(log, frames.seq, frames.t_host, inputs, time, clock)
    permittivity = _permittivities(known.fluid, fluid, len(time), str(path))
    kept &= np.isfinite(permittivity) | np.isnan(permittivity)
    for (_load, quantity), values in known.values.items():
        if quantity in ("force", "displacement", "inner_displacement"):
            kept &= np.isfinite(values)
    if not kept.any():
        raise ValueError(f"{path}: no frame has known inputs: every row misses one")
    if not kept.all():
        warnings.append(f"{path}: {int((~kept).sum())} frames without known inputs left out")
    known = Known({k: v[kept] for k, v in known.values.items()}, None, known.names)
    _check_known(spec, known, str(path))
    if not known.values:
        warnings.append(
            f"{path}: no known loads or displacements (columns such as load_0_force_N): the "
            "skin is taken to be at rest"
        )
    so, time, permittivity = so[:, kept], time[kept], permittivity[kept]
    masked: list[Masked] = []
    so = _mask(so, log, modules, numbers, masked)
    used = (str(inputs), _sha256(inputs)) if inputs is not None else None
    return _Part(
        path,
        so,
        time - time[0],
        known,
        permittivity,
        masked,
        warnings,
        used,
        "simulated" in log.header,
    )


def _check_header(spec: SkinSpec, log: SoLog) -> None:
    """Refuse a log whose own header says that its counts are something else."""
    assert spec.electrodes is not None
    scale = log.header.get("scale", "").strip()
    if scale:
        try:
            lsb = parse_quantity(scale, "capacitance")
        except ValueError as error:
            raise ValueError(f'{log.path}, header scale "{scale}": {error}') from None
        own = spec.electrodes.lsb
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
    modules, numbers = taxel_names(spec.electrodes)  # type: ignore[arg-type]
    sizes = {
        m: max(k for n, k in zip(modules, numbers, strict=True) if n == m) for m in modules
    }
    if not len(log):
        raise ValueError(f"{log.path}: the log is empty: it has no rows")
    strangers = sorted(set(log.module.tolist()) - sizes.keys())
    if strangers:
        raise ValueError(
            f"{log.path}: module {strangers[0]}: the skin has no such module (it has "
            f"{_listed(sorted(sizes))}): a log of another layout, or the wrong skin file"
        )
    columns = log.so.shape[1]
    if columns != max(sizes[m] for m in sizes):
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
    bad = np.zeros(len(log), bool)
    for name in ("repeat", "suspect"):
        flag = log.flags.get(name)
        if flag is not None and flag.dtype.kind in "iu":
            bad |= flag.astype(bool)
    if not bad.any():
        return log
    return dataclasses.replace(log, so=np.where(bad[:, None], np.nan, log.so))


def _known(
    log: SoLog,
    seq: np.ndarray,
    t_host: np.ndarray,
    inputs: Path | None,
    time: np.ndarray,
    clock: str,
) -> tuple[Known, np.ndarray]:
    """Known inputs of every frame, and which frames have them."""
    where = str(log.path)
    # A frame's inputs stand in its first row.
    first = _first_rows(log, seq, t_host)
    columns = {name: np.asarray(values)[first] for name, values in log.flags.items()}
    known = from_columns(columns, where)
    head = from_header(log.header, len(seq), where)
    known = Known(head.values, head.fluid, head.names).merged(known)
    covered = np.ones(len(seq), bool)
    if inputs is not None:
        more, covered = from_file(inputs, time, clock)
        known = known.merged(more)
    return known, covered


def _first_rows(log: SoLog, seq: np.ndarray, t_host: np.ndarray) -> np.ndarray:
    rows, at = [], 0
    for number, t in zip(seq, t_host, strict=True):
        while log.seq[at] != number or not (log.t_host[at] == t or np.isnan(t)):
            at += 1
        rows.append(at)
    return np.array(rows, int)


def _permittivities(
    column: np.ndarray | None, option: str | None, rows: int, where: str
) -> np.ndarray:
    """Permittivity of the fluid of every frame; NaN where it is the oil to be fitted."""
    texts = np.full(rows, option or OIL, object) if column is None else column
    if column is not None and option is not None:
        raise ValueError(f"{where}: the log names its fluid itself; leave --fluid out")
    found = np.empty(rows)
    cache: dict[str, float] = {}
    for i, text in enumerate(texts):
        if text not in cache:
            cache[text] = _permittivity(str(text), where)
        found[i] = cache[text]
    return found


def _permittivity(text: str, where: str) -> float:
    name = text.strip().lower() or OIL
    if name == "air":
        return FLUIDS["air"]
    if name == OIL or name in FLUIDS:
        return np.nan
    try:
        value = float(name)
    except ValueError:
        value = 0.0
    if not value >= 1.0:
        raise ValueError(
            f'{where}, fluid "{text}": allowed: air, oil (its permittivity is fitted), '
            f"{', '.join(n for n in FLUIDS if n != 'air')} (likewise), or the fluid's known "
            "relative permittivity"
        )
    return value


def _check_known(spec: SkinSpec, known: Known, where: str) -> None:
    """Refuse values that the skin can't take: units mixed up, more often than not."""
    geometry = spec.geometry
    loads = sorted({load for load, _ in known.values})
    if loads != list(range(len(loads))):
        raise ValueError(f"{where}: loads are numbered from 0 without a hole; found {loads}")
    for load in loads:
        have = {q for k, q in known.values if k == load}
        pushed = have & {"force", "displacement", "inner_displacement"}
        if not pushed:
            raise ValueError(
                f"{where}: load {load} has no force and no displacement; add "
                f"load_{load}_force_N or load_{load}_displacement_mm"
            )
        if "angle" not in have:
            raise ValueError(
                f"{where}: load {load} has no angle; add a column load_{load}_angle_deg, or "
                f'a header line "# load_{load}_angle_deg: 0"'
            )
    limits: dict[str, tuple[float, str]] = {
        "angle": (geometry.half_angle, format_quantity(geometry.half_angle, "angle")),
        "displacement": (
            1.2 * geometry.oil_gap,
            f"the oil gap, {format_quantity(geometry.oil_gap, 'length')}",
        ),
    }
    limits["inner_displacement"] = limits["displacement"]
    dimensions = {"angle": "angle"}
    for (load, quantity), values in known.values.items():
        if quantity not in limits:
            continue
        limit, text = limits[quantity]
        worst = float(np.nanmax(np.abs(values), initial=0.0))
        if worst >= limit:
            shown = format_quantity(worst, dimensions.get(quantity, "length"))  # type: ignore[arg-type]
            raise ValueError(
                f"{where}, {known.names[load, quantity]}: {shown} is beyond what the skin "
                f"allows ({text}): check the unit in the column's name"
            )


def _mask(
    so: np.ndarray,
    log: SoLog,
    modules: Sequence[int],
    numbers: Sequence[int],
    masked: list[Masked],
) -> np.ndarray:
    """Take out what says nothing about the gap, and list it."""
    so = so.copy()
    full = _full_scale(so, log.header)
    runs = np.array([_longest_run(row) for row in so])
    usual = float(np.median(runs[np.isfinite(so).any(1)])) if np.isfinite(so).any() else 0.0
    for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
        row = so[i]
        present = np.isfinite(row)
        if not present.any():
            masked.append(Masked(m, k, "silent: no counts in the log", 0, True, str(log.path)))
            continue
        limits = (row >= full) | (row <= 0)
        stuck = _stuck(row, max(_STUCK_AFTER, 3 * usual)) & ~limits
        for found, reason in (
            (limits, f"saturated (0 or {full:.0f} counts)"),
            (stuck, "stuck: keeps its count while others change"),
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


def _full_scale(so: np.ndarray, header: Mapping[str, str]) -> float:
    """The count at which the converter is full."""
    largest = np.nanmax(so) if np.isfinite(so).any() else 0.0
    for full in _FULL_SCALES:
        # Many readings at the very end of a range, none beyond it.
        if largest == full and np.sum(so == full) >= 5:
            return float(full)
    return float(MAX_COUNT)


def _longest_run(row: np.ndarray) -> int:
    values = row[np.isfinite(row)]
    if not values.size:
        return 0
    change = np.flatnonzero(np.diff(values)) + 1
    return int(np.max(np.diff(np.concatenate([[0], change, [len(values)]]))))


def _stuck(row: np.ndarray, after: float) -> np.ndarray:
    """Readings in runs of equal counts that are longer than others' [frame]."""
    where = np.flatnonzero(np.isfinite(row))
    values = row[where]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    stuck = np.zeros(len(row), bool)
    for begin, end in itertools.pairwise(edges):
        if end - begin > after:
            stuck[where[begin:end]] = True
    return stuck


def _joined(spec: SkinSpec, parts: Sequence[_Part]) -> SensorData:
    count = max([1, *(1 + load for p in parts for load, _ in p.known.values)])
    frames = [len(p.time) for p in parts]
    table = np.zeros((4, count, sum(frames)))
    table[3] = np.nan
    inner = np.zeros(count, bool)
    begin = 0
    warnings = [w for p in parts for w in p.warnings]
    for p, n in zip(parts, frames, strict=True):
        for (load, quantity), values in p.known.values.items():
            here = slice(begin, begin + n)
            if quantity in ("angle", "direction"):
                table[0 if quantity == "angle" else 1, load, here] = np.nan_to_num(values)
            elif quantity == "force":
                table[2, load, here] = values
            else:
                table[3, load, here] = values
                inner[load] |= quantity == "inner_displacement"
        for load in range(count):
            both = {"displacement", "inner_displacement"} & {
                q for k, q in p.known.values if k == load
            }
            if both and (load, "force") in p.known.values:
                warnings.append(
                    f"{p.path}: load {load} has force and displacement: the displacement is "
                    "used, which needs no material"
                )
        begin += n
    table[2][np.isfinite(table[3])] = np.nan
    kinds = {
        (load, q)
        for p in parts
        for load, q in p.known.values
        if q in ("displacement", "inner_displacement")
    }
    for load in range(count):
        if {(load, "displacement"), (load, "inner_displacement")} <= kinds:
            raise ValueError(
                f"load {load}: displacements of the mid-surface and of the inner face are "
                "mixed; give one kind in all logs"
            )
    permittivity = np.concatenate([p.fluid for p in parts])
    rows = np.concatenate([table.reshape(4 * count, -1), permittivity[None]]).T
    # NaN is no value that rows could be told apart by; it stands for "not this kind".
    _, first, state = np.unique(
        np.nan_to_num(rows, nan=1e300), axis=0, return_index=True, return_inverse=True
    )
    angle, turn, force, displacement = table[..., first]
    masked = [m for p in parts for m in p.masked]
    log = np.repeat(np.arange(len(parts)), frames)
    files = tuple(
        LogFile(
            str(p.path),
            _sha256(p.path),
            len(p.time),
            tuple(sorted({_fluid_name(x) for x in p.fluid})),
            p.inputs,
        )
        for p in parts
    )
    return SensorData(
        spec,
        np.concatenate([p.so for p in parts], axis=1),
        np.concatenate([p.time for p in parts]),
        log,
        state.reshape(-1),
        KnownLoads(angle, turn, force, displacement, inner),
        permittivity[first],
        files,
        tuple(masked),
        tuple(warnings),
        all(p.simulated for p in parts),
    )


def _fluid_name(permittivity: float) -> str:
    if np.isnan(permittivity):
        return OIL
    return "air" if permittivity == FLUIDS["air"] else f"{permittivity:g}"


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:6])) + (", ..." if len(numbers) > 6 else "")
