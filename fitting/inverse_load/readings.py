"""Readings of logs and baselines, taxel by taxel in the order of a skin's layout."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Flags, Floats
from fitting.surroundings import Surroundings, log_surroundings, numbers_of
from suas_jax.acquisition.baseline import Baseline
from suas_jax.acquisition.log.log_file import (
    Frames,
    SoLog,
    fluid_of,
    group_frames,
    sequence_notes,
)
from suas_jax.acquisition.taxel_faults import stuck_taxels
from suas_jax.config import SkinSpec
from suas_jax.config.oil import refuse_other_fluid

# Relative difference of scales that agree; of one that a calibration or a zero found, which is
# no longer the converter's own.
_SCALE_AGREES, _FOUND_AGREES = 1e-3, 1e-2
_FEWEST_STEPS = 8  # different counts of taxels beyond their lowest that tell a step
_MOVED = 32  # counts that differ from the frame before that tell a step of a stream


CountsOf = Callable[[int], Floats]
"""Readings [..., taxel] of a module, by its index among the modules that are there."""


class LayoutMismatchError(ValueError):
    """A log or baseline whose modules or taxels aren't the skin's."""


class EmptyLogError(ValueError):
    """A log without a frame."""


class _Places(NamedTuple):
    """Where the taxels of a layout stand in readings of some modules [module, taxel]."""

    # taxels that each module should have [module]; -1 for a foreign module
    sizes: NDArray[np.int64]
    row: NDArray[np.int64]  # of each taxel's module [taxel]; -1 where the module is absent
    column: NDArray[np.int64]  # of each taxel [taxel]


class Layout:
    """Where each taxel of a skin stands in a log."""

    def __init__(self, spec: SkinSpec) -> None:
        module, number = spec.sensing.taxel_names
        self.module, self.number = np.array(module), np.array(number)
        self._places: dict[tuple[int, ...], _Places] = {}

    def _in(self, modules: Sequence[int]) -> _Places:
        """Places in readings of some modules; found once for each list of modules."""
        key = tuple(modules)
        if key not in self._places:
            counts = np.array([np.sum(self.module == m) for m in key])
            where = {m: row for row, m in enumerate(key)}
            row = np.array([where.get(m, -1) for m in self.module.tolist()])
            self._places[key] = _Places(np.where(counts > 0, counts, -1), row, self.number - 1)
        return self._places[key]

    @property
    def taxels(self) -> int:
        """Number of taxels."""
        return len(self.module)

    def names(self, which: Flags) -> str:
        """Some taxels [taxel], by module and number, such as "0.3, 1.10"."""
        rows = np.flatnonzero(which)
        return ", ".join(f"{self.module[k]}.{self.number[k]}" for k in rows)

    def describe(self) -> str:
        """The layout in words."""
        sizes = {int(m): int((self.module == m).sum()) for m in np.unique(self.module)}
        if len(sizes) == 1:
            ((module, size),) = sizes.items()
            return f"module {module} with {size} taxels"
        return f"modules {min(sizes)} to {max(sizes)}, {self.taxels} taxels in all"

    def check(self, modules: Sequence[int], counts: CountsOf, source: str) -> None:
        """Refuse readings of another layout.

        Modules are given by number, counts are the readings of a module by its index in
        `modules`, and the source is where they are from, for the message.
        Raises LayoutMismatchError: modules or taxels that the skin doesn't have, or a log too
        narrow for its modules.
        """
        sizes = self._in(modules).sizes
        if (sizes < 0).any():
            foreign = min(m for m, size in zip(modules, sizes, strict=True) if size < 0)
            raise LayoutMismatchError(
                f"{source}: layout_mismatch: module {foreign} is none of the skin's, which "
                f"has {self.describe()}; is this the log's skin file?"
            )
        for k, (module, size) in enumerate(zip(modules, sizes.tolist(), strict=True)):
            so = counts(k)
            width = so.shape[-1]
            present = np.flatnonzero(np.isfinite(so).reshape(-1, width).any(0))
            most = int(present.max()) + 1 if present.size else 0
            if most > size or width < size:
                has = most if most > size else width
                raise LayoutMismatchError(
                    f"{source}: layout_mismatch: module {module} has {has} taxels here, but "
                    f"the skin has {self.describe()}; is this the log's skin file?"
                )

    def check_sent(self, sent: Mapping[int, int], source: str) -> None:
        """Refuse modules that send another number of counts than the skin has taxels.

        Fewer counts don't say which taxel is missing, so none of them can be placed.

        `sent` is the number of counts by module, and the source where they are from, for the
        message.
        Raises LayoutMismatchError: a number differs.
        """
        for module, count in sent.items():
            size = int(np.sum(self.module == module))
            if size and count != size:
                raise LayoutMismatchError(
                    f"{source}: layout_mismatch: module {module} sends {count} counts, but the "
                    f"skin has {size} taxels there ({self.describe()}); is this the log's skin "
                    "file?"
                )

    def pick(self, modules: Sequence[int], counts: CountsOf) -> Floats:
        """Readings [..., taxel] of the whole layout; NaN where a module is absent.

        Modules and counts are as for `check`.
        """
        _, row, column = self._in(modules)
        out: Floats | None = None
        for k in range(len(modules)):
            so = counts(k)
            if out is None:
                out = np.full((*so.shape[:-1], self.taxels), np.nan)
            here = row == k
            out[..., here] = so[..., column[here]]
        return np.full(self.taxels, np.nan) if out is None else out

    def baseline(self, baseline: Baseline, source: str) -> tuple[NDArray, NDArray]:
        """A baseline's readings at rest and their variance [taxel].

        Raises LayoutMismatchError: it belongs to another layout.
        """
        modules = baseline.modules.tolist()
        self.check(modules, baseline.so.__getitem__, source)
        rest = self.pick(modules, baseline.so.__getitem__)
        noise = np.nan_to_num(self.pick(modules, baseline.noise.__getitem__))
        return rest, (noise**2 + 1 / 12) / max(baseline.frames, 1)


@dataclass(frozen=True)
class LogReadings:
    """A log's frames as the estimator takes them."""

    time: Floats  # of the frames, on the device's clock if it has one [frame, s]
    seq: NDArray[np.int64]  # frame numbers [frame]
    so: Floats  # readings [frame, taxel]; NaN where missing
    stuck: Flags  # taxels that repeat one count beyond chance [frame, taxel]
    notes: tuple[str, ...]  # what a person should know
    # when the host read the frames, from the log's start [frame, s]; their `time` where the log
    # does not say
    host_time: Floats
    header: Mapping[str, str]  # of the log
    # measured of the oil [frame] [Pa]; NaN where missing, None without a column
    pressure: Floats | None = None
    force: Floats | None = None  # known of the one load of the log [frame] [N]; likewise
    surroundings: Surroundings = field(default_factory=Surroundings)  # of the skin [frame]
    # standard deviation of a reading, that of rounding to a count left out [counts]; None for
    # the estimator's own
    noise: float | None = None


def noise_of_readings(spec: SkinSpec, noise: float | None) -> float:
    """Standard deviation of a reading [counts]: the skin file's where none is given.

    Raises ValueError: it is not a number of counts.
    """
    stated = spec.sensing.noise
    found = stated if noise is None else noise
    if not (np.isfinite(found) and found >= 0):
        raise ValueError(f"noise = {found}: zero or more counts are needed")
    return float(found)


def counting_step(so: Floats) -> int:
    """The step in which counts come [frame, taxel]; 1 where they do not show another."""
    moved = (so - np.fmin.reduce(so, axis=0)).T
    found = np.concatenate([np.unique(own[own > 0]) for own in moved])
    if len(found) < _FEWEST_STEPS or (found != np.rint(found)).any():
        return 1
    return int(np.gcd.reduce(found.astype(np.int64)))


class StepWatch:
    """`counting_step` of a stream, by the differences of its frames."""

    def __init__(self) -> None:
        self._last: Floats | None = None
        self._step, self._moved = 0, 0  # that divides all differences so far; their number

    def feed(self, so: Floats) -> int:
        """Take a frame [taxel]; return the step, 1 until it is known."""
        if self._last is not None and self._step != 1:
            moved = np.abs(so - self._last)
            moved = moved[moved > 0]
            whole = bool((moved == np.rint(moved)).all())
            found = moved.astype(np.int64) if whole else np.ones(1, np.int64)
            self._step = int(np.gcd.reduce(np.append(found, self._step)))
            self._moved += len(moved)
        self._last = so.copy()
        return self._step if self._moved >= _MOVED else 1


def noise_in_steps(noise: float, step: int) -> float:
    """Standard deviation of a reading in steps, that of rounding to a count left out."""
    return float(np.sqrt(noise**2 + (step**2 - 1) / 12))


def readings_of(log: SoLog, spec: SkinSpec, noise: float | None) -> LogReadings:
    """Readings of a log.

    Args:
        log: the log.
        spec: the skin it was taken from.
        noise: standard deviation of a reading [counts]; the skin file's if None.

    Raises:
        EmptyLogError: no frame in it.
        LayoutMismatchError: it is another skin's.
        ValueError: the skin has no electrodes, the noise is not a number of counts, or the log
            names another fluid than the skin's oil.
    """
    layout = Layout(spec)
    refuse_other_fluid(fluid_of(log), spec.oil.relative_permittivity, str(log.path))
    frames: Frames = group_frames(log)
    if not len(frames):
        raise EmptyLogError(f"{log.path}: empty_log: no frame in it")
    modules = frames.modules.tolist()
    layout.check(modules, frames.of_module, str(log.path))
    so = layout.pick(modules, frames.of_module)
    time = np.where(np.isfinite(frames.t_device), frames.t_device, frames.t_host)
    stated, step = noise_of_readings(spec, noise), counting_step(so)
    deviation = noise_in_steps(stated, step)
    stuck = stuck_taxels(so, stated / step)
    notes = [*log.notes, *sequence_notes(log), *_scale_note(log.header, spec)]
    if step > 1:
        notes.append(
            f"counts come in steps of {step}, as of a converter with fewer bits: readings are "
            f"taken to be {deviation:.2g} counts off, not {stated:.2g}"
        )
    if stuck.any():
        names = layout.names(np.asarray(stuck.any(0)))
        notes.append(f"taxels {names} repeat one count and are left out meanwhile")
    silent = np.asarray(~np.isfinite(so).any(0))
    if silent.any():
        notes.append(
            f"taxels {layout.names(silent)} have no count in any frame; where a device sends "
            "fewer counts than a module has taxels, the others may be of other taxels: suas "
            "log --skin says so"
        )
    several = "load_1_force_N" in log.flags
    pressure, force = (
        frames.mean(numbers_of(log.flags[name], name, str(log.path)))
        if name in log.flags and used
        else None
        for name, used in (("oil_pressure_Pa", True), ("load_0_force_N", not several))
    )
    host_time = np.where(np.isfinite(frames.t_host), frames.t_host, time)
    around, said = log_surroundings(log.flags, log.header, spec, str(log.path))
    told = (*notes, *said)
    read = (time, frames.seq, so, stuck, told, host_time, log.header, pressure, force)
    return LogReadings(*read, around.by(frames.mean), deviation)


def _scale_note(header: Mapping[str, str], spec: SkinSpec) -> list[str]:
    from suas_jax.config.quantities import parse_quantity

    text = header.get("scale")
    try:
        scale = parse_quantity(text, "capacitance") if text else None
    except ValueError:
        return [f'scale "{text}" in the header is not a capacitance; the skin\'s lsb is used']
    lsb, record, agrees = spec.sensing.lsb, spec.calibration, _SCALE_AGREES
    names = record.parameters if record is not None else ()
    found = [i for i, name in enumerate(names) if name in ("lsb", "electrodes.lsb")]
    if record is not None and found:
        # What a few presses tell is less sure than a converter's scale.
        i, rows = found[0], record.covariance
        deviation = float(np.sqrt(rows[i][i])) / lsb if rows else 0.0
        agrees = max(_FOUND_AGREES, 3 * deviation)
    if scale is None or abs(scale / lsb - 1) < agrees:
        return []
    return [
        f"the header's scale, {text}, is not the skin's lsb, {1e15 * lsb:.6g} fF; the skin's "
        "is used"
    ]
