"""LoggedCounts of all frames with their noise, and what is taken out of every taxel's.

What drifts or is offset taxel by taxel is linear: its best value is subtracted from
residuals and derivatives alike (a projection), so it costs no unknowns.
"""

import dataclasses

import numpy as np

from fitting.sensor.logs.data import SensorData
from fitting.sensor.logs.known_inputs import permittivities
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.logs.shared_errors import SharedErrors, Whitening
from suas_jax.acquisition.baseline import FLUID as FLUID_KEY
from suas_jax.acquisition.baseline import Baseline, rest_of

ROUNDING = 1.0 / np.sqrt(12.0)
"""Standard deviation that whole counts have at least."""
_MANY, _FEW = 50, 10
_EVEN = 0.01  # of a force: what it may vary by while a press is held
_HELD = 1 / 3  # of the longest such stretch of a press: shorter ones are on the way to it


@dataclasses.dataclass(frozen=True)
class LoggedCounts:
    """Counts, what is known of their noise, and which of them are used."""

    so: np.ndarray  # counts [taxel, frame]; NaN where missing
    state: np.ndarray  # which known state a frame is in [frame]
    log: np.ndarray  # which log a frame is from, -1 for the baseline [frame]
    time: np.ndarray  # since the first frame of its log [frame, s]
    sigma: np.ndarray  # standard deviation of the noise [taxel, frame], counts
    present: np.ndarray  # what may be used [taxel, frame]
    used: np.ndarray  # what is used [taxel, frame]
    offsets: bool  # whether every taxel has an offset
    drifting: bool  # whether every taxel drifts steadily in every log
    logs: int  # how many logs there are
    input_errors: SharedErrors | None = None  # of known inputs; None where all are exact

    @property
    def extras(self) -> int:
        """How many numbers are taken out of every taxel's readings."""
        return int(self.offsets) + int(self.drifting) * self.logs

    def columns(self) -> np.ndarray:
        """What readings change by for each of these numbers [frame, column]."""
        found = [np.ones(len(self.time))] if self.offsets else []
        if self.drifting:
            found += [np.where(self.log == k, self.time, 0.0) for k in range(self.logs)]
        return np.stack(found, -1) if found else np.zeros((len(self.time), 0))

    def basis(self, sigma: np.ndarray) -> np.ndarray:
        """The same, orthonormal in units of the noise [taxel, frame, column]."""
        stack = self.columns()
        if not stack.shape[1]:
            return np.zeros((len(sigma), *stack.shape))
        size = np.abs(stack).max(0)
        stack = stack / np.where(size > 0, size, 1.0)
        weighed = stack * np.where(self.used, 1 / sigma, 0.0)[..., None]
        u, s, _ = np.linalg.svd(weighed, full_matrices=False)
        return np.where((s > 1e-9 * s.max(-1, initial=1e-300, keepdims=True))[:, None], u, 0.0)

    def taken_out(
        self, errors: np.ndarray, weight: np.ndarray | float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Least-squares offsets and drifts, from the readings that are used.

        Errors are measured less predicted counts [taxel, frame]; each reading has its weight
        beside its noise.
        Returns the numbers and their standard errors, each [taxel, column].
        """
        w = np.where(self.used, np.sqrt(weight) / self.sigma, 0.0)
        stack = self.columns() * w[..., None]
        errors = np.where(self.used, errors, 0.0) * w
        whitening = self.whitening(weight)
        if whitening is None:
            inverse = np.linalg.pinv(stack, rcond=1e-9)
            found = np.einsum("tkf,tf->tk", inverse, errors)
            return found, np.sqrt(np.einsum("tkf,tkf->tk", inverse, inverse))
        size = np.maximum(np.linalg.norm(stack, axis=1), 1e-300)  # [taxel, column]
        stack = stack / size[:, None]
        inverse = _inverse(whitening.gram(self.state, stack))
        own = whitening.inverse @ whitening.sums(self.state, errors)[..., None]
        errors = errors - np.einsum("ktf,fk->tf", whitening.columns, own[self.state, :, 0])
        found = inverse @ np.einsum("tfk,tf->tk", stack, errors).reshape(-1)
        spread = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        return found.reshape(size.shape) / size, spread.reshape(size.shape) / size

    def whitening(self, weight: np.ndarray | float = 1.0) -> Whitening | None:
        """What makes errors independent that readings share; None where they share none.

        Of the readings that are used, each with its weight beside its noise [taxel, frame].
        """
        if self.input_errors is None:
            return None
        inverse = np.where(self.used, np.sqrt(weight) / self.sigma, 0.0)
        return self.input_errors.whitening(self.state, inverse)

    def whitened(self, r: np.ndarray, weight: np.ndarray | float = 1.0) -> np.ndarray:
        """Residuals less what those of their state share [taxel, frame].

        They are in units of the noise, without the weights that they have beside it. What the
        used ones tell of the shared errors is taken off the others, too.
        """
        whitening = self.whitening(weight)
        if whitening is None or self.input_errors is None:
            return r
        root = np.sqrt(np.broadcast_to(weight, r.shape))
        shared = whitening.root @ whitening.sums(self.state, r * root)[..., None]
        size = (self.input_errors.slopes * self.input_errors.deviation[:, None])[
            ..., self.state
        ] / self.sigma
        return np.asarray(r - np.einsum("ktf,fk->tf", size, shared[self.state, :, 0]))

    def shared(self, r: np.ndarray) -> np.ndarray:
        """The most probable errors of what was told [load, state] [N] or [m].

        Of residuals in units of the noise, predicted less measured [taxel, frame].
        """
        whitening = self.whitening()
        if whitening is None or self.input_errors is None:
            return np.zeros((0, 0))
        found = whitening.inverse @ whitening.sums(self.state, r)[..., None]
        return np.asarray(self.input_errors.deviation * found[..., 0].T)

    def untangling(self, basis: np.ndarray, weight: np.ndarray | float = 1.0) -> np.ndarray:
        """(B^T W W B)^-1 of what is taken out, B the orthonormal `basis`."""
        whitening = self.whitening(weight)
        assert whitening is not None
        return _inverse(whitening.gram(self.state, basis))


def _inverse(gram: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.pinv(gram, rcond=1e-12, hermitian=True))


def held_presses(data: SensorData) -> SensorData:
    """The frames at rest and those of presses that are held, each with its mean force.

    A press is a stretch of frames of one log under one load at one place. It is held where its
    force is even to 1 %, for more than a third of its longest such stretch: frames on the way
    there and back would count as presses with place errors of their own.
    """
    loads, loaded = data.loads, data.loaded
    force = np.nan_to_num(loads.force).sum(0)
    kinds = loads.angle, loads.turn, loads.axial, loads.diameter, loads.depth, loads.radius
    where = np.concatenate([*kinds, [np.nan_to_num(data.permittivity)]]).T
    presses: list[list[list[int]]] = []  # frames of each even stretch of each press
    last = None
    for i, (log, k) in enumerate(zip(data.log, data.state, strict=True)):
        here = (log, *where[k]) if loaded[k] else None
        if here and here != last:
            presses.append([])
        if here:
            begin = force[data.state[presses[-1][-1][0]]] if presses[-1] else np.nan
            if not abs(force[k] - begin) <= _EVEN * abs(begin):
                presses[-1].append([])
            presses[-1][-1].append(i)
        last = here
    held = [s for own in presses for s in own if len(s) > _HELD * max(map(len, own))]
    idle = np.flatnonzero(~loaded)
    state = np.full(len(data.state), -1)
    for new, k in enumerate(idle):
        state[data.state == k] = new
    for new, frames in enumerate(held, len(idle)):
        state[frames] = new
    first = np.array([*idle, *(data.state[frames[0]] for frames in held)], int)
    told = loads.take(first)
    if held:
        mean = np.array([loads.force[:, data.state[frames]].mean(1) for frames in held]).T
        told.force[:, len(idle) :] = mean
    kept, left = state >= 0, int((state < 0).sum())
    said = f"{data.paths}: {left} frames left out in which a press comes or goes"
    return dataclasses.replace(
        data,
        so=data.so[:, kept],
        time=data.time[kept],
        log=data.log[kept],
        state=state[kept],
        loads=told,
        permittivity=data.permittivity[first],
        warnings=(*data.warnings, said) if left else data.warnings,
    )


def averaged(data: SensorData) -> tuple[SensorData, np.ndarray]:
    """Every known state of every log as one frame, and of how many it is the mean [frame].

    Raises ValueError: no state is at rest, or one has several loads, or a known displacement.
    """
    if np.isfinite(data.loads.displacement).any():
        raise ValueError(
            f"{data.paths}: --fit as-built takes known forces (load_0_force_N), which tell the "
            "stiffness; leave columns of displacements out"
        )
    if data.loaded[data.state].all():
        raise ValueError(
            f"{data.paths}: --fit as-built counts readings from rest; add a log, or frames, "
            "without load"
        )
    if (np.nan_to_num(data.loads.force) != 0).sum(0).max() > 1:
        raise ValueError(
            f"{data.paths}: --fit as-built takes one load at a time; leave frames with several "
            "out"
        )
    data = held_presses(data)
    keys, which, count = np.unique(
        np.stack([data.log, data.state]), axis=1, return_inverse=True, return_counts=True
    )
    which = which.reshape(-1)
    known = np.isfinite(data.so)
    sums = np.zeros((len(data.so), len(count)))
    found = np.zeros_like(sums)
    for row, (so, own) in enumerate(zip(data.so, known, strict=True)):
        sums[row] = np.bincount(which[own], so[own], len(count))
        found[row] = np.bincount(which[own], minlength=len(count))
    with np.errstate(invalid="ignore"):
        so = np.where(2 * found > count, sums / found, np.nan)
    time = np.bincount(which, data.time) / count
    return dataclasses.replace(data, so=so, time=time, log=keys[0], state=keys[1]), count


def with_model_error(
    readings: LoggedCounts, count: np.ndarray, loaded: np.ndarray, share: float
) -> LoggedCounts:
    """Means of frames with their noise, and with the model's error.

    The readings have frames at rest, the baseline's last. `count` says of how many frames each
    is the mean [frame], `loaded` which states have a load [state], both without the baseline's.
    `share` is the model's error, relative to a reading's change from rest.
    """
    more = len(readings.state) - len(count)  # a baseline states the noise of its own mean
    pressed = np.concatenate([loaded, np.zeros(more, bool)])[readings.state]
    change = readings.so - np.nanmean(readings.so[:, ~pressed], 1, keepdims=True)
    noise = readings.sigma / np.sqrt(np.concatenate([count, np.ones(more)]))
    return dataclasses.replace(readings, sigma=np.hypot(noise, share * np.nan_to_num(change)))


def gathered(
    data: SensorData, baseline: Baseline | None, offsets: bool
) -> tuple[LoggedCounts, KnownLoads, np.ndarray]:
    """LoggedCounts with the noise to start from, the baseline as one more frame.

    The baseline's counts at rest fix an offset of every taxel; `offsets` gives every taxel one
    without a baseline, too.
    Returns the readings, the known states, and the permittivity of the fluid in each.
    Raises ValueError: the baseline has no taxel of the skin.
    """
    so, state, log, time = data.so, data.state, data.log, data.time
    loads, permittivity = data.loads, data.permittivity
    start = np.stack([_first_noise(data, so[:, log == k]) for k in range(len(data.files))], 1)
    sigma = start[:, log]
    if baseline is not None:
        rest, spread = _at_rest(data, baseline)
        so = np.concatenate([so, rest[:, None]], 1)
        sigma = np.concatenate([sigma, spread[:, None]], 1)
        state = np.concatenate([state, [loads.states]])
        log, time = np.concatenate([log, [-1]]), np.concatenate([time, [0.0]])
        loads = loads.with_rest()
        fluid = np.array([baseline.header.get(FLUID_KEY, "")], object)
        own = permittivities(fluid, None, 1, "--baseline")
        permittivity = np.concatenate([permittivity, own])
    present = np.isfinite(so)
    readings = LoggedCounts(
        so,
        state,
        log,
        time,
        sigma,
        present,
        present,
        offsets or baseline is not None,
        False,
        len(data.files),
    )
    return readings, loads, permittivity


def _at_rest(data: SensorData, baseline: Baseline) -> tuple[np.ndarray, np.ndarray]:
    """Mean counts at rest and their standard errors, in the order of the taxels."""
    modules, numbers = (np.array(x) for x in data.spec.sensing.taxel_names)
    rows = np.unique(modules)
    empty = np.full((len(rows), int(numbers.max())), np.nan)
    like = Baseline(rows, empty, empty, 0, {})
    at = np.searchsorted(rows, modules), numbers - 1
    rest = rest_of(baseline, like)[at]
    spread = rest_of(dataclasses.replace(baseline, so=baseline.noise), like)[at]
    if not np.isfinite(rest).any():
        raise ValueError("--baseline: has no taxel in common with the skin")
    spread = np.sqrt(np.nan_to_num(spread, nan=1.0) ** 2 + ROUNDING**2)
    return rest, spread / np.sqrt(baseline.frames)


def _first_noise(data: SensorData, so: np.ndarray) -> np.ndarray:
    """Noise of every taxel to start from: the skin file's, or what neighbours show."""
    stated = data.spec.sensing.noise
    if stated > 0:
        return np.full(len(so), np.hypot(stated, ROUNDING))
    second = np.diff(so, 2, axis=1) if so.shape[1] > 2 else np.zeros((len(so), 1))
    second = second[np.isfinite(second)]
    spread = 1.4826 * np.median(np.abs(second)) / np.sqrt(6) if second.size else 0.0
    return np.full(len(so), np.hypot(spread, ROUNDING))


def measured_noise(readings: LoggedCounts, errors: np.ndarray, constants: int) -> np.ndarray:
    """Standard deviation of the noise of every taxel in every log [taxel, log], counts.

    Errors are the residuals, with offsets and drift taken out [taxel, frame], counts;
    `constants` says how many constants were fitted.
    """
    noise = np.full((len(errors), readings.logs), np.nan)
    for k in range(readings.logs):
        here = readings.log == k
        used, own = readings.used[:, here], errors[:, here]
        free = used.sum() - constants - readings.extras * np.sum(used.any(1))
        if free < _FEW:
            noise[:, k] = readings.sigma[:, here][:, 0]
            continue
        together = np.sqrt(np.sum(np.where(used, own, 0.0) ** 2) / free)
        squares = np.where(used, own, 0.0) ** 2
        count = used.sum(1) - readings.extras
        single = np.sqrt(squares.sum(1) / np.maximum(count, 1))
        # Taxels have the noise of all unless theirs is clearly another.
        other = (count >= _MANY) & ((single / together < 0.67) | (single / together > 1.5))
        noise[:, k] = np.maximum(np.where(other, single, together), _smallest(readings))
    return noise


def _smallest(readings: LoggedCounts) -> float:
    so = readings.so[readings.used]
    whole = np.all(so == np.rint(so))
    return float(ROUNDING) if whole else 1e-4 * float(np.median(so))
