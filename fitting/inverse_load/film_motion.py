"""Frames in which the film moves: readings then show more, or less, than the load.

The estimate takes every frame for an equilibrium. After a load has changed the oil has to
flow, and the membrane swings about its new equilibrium, or creeps towards it. Free motions
fade as exp(-t/T), T the longest time of the lowest modes (`suas_jax.dynamics.modes`). What the
readings c have lately changed by, as far as it has not faded, may therefore be motion::

    d(t) = (c(t) - c(t')) exp(-(t - t') / T)

with the earlier time t' that makes it largest in terms of the readings' noise. The load that
explains d, G d with G = (J^T W J)^-1 J^T W, is one deviation of what motion does to the
estimate: G d d^T G^T adds to its covariance.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.drift import Drift, ReadingWeights
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.fit.covariance import inverse
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.model.kept_key import kept_key
from fitting.inverse_load.taps import TapFinder
from suas_jax.config import SkinSpec
from suas_jax.files.cache_folder import kept_arrays
from suas_jax.runtime.start import before_computing

MATTERS = 0.05
"""Share of a frame's change of readings that may be motion before its status says so."""
_MOSTLY = 0.5
"""Share beyond which a frame shows motion more than it shows loads."""
_MODES = 3  # the lowest, which taxels see
_KEPT, _WINDOW = 16, 4.0  # frames kept in a fading time, and fading times looked back
_BEYOND_NOISE = 6.0  # deviations of chi2 beyond which a change is not noise
_FELT = 2.0  # deviations of a force that is there
# What motion makes no less true.
_STANDING = frozenset({"no_contact", "saturated", "too_few_taxels"})


def fading_time(spec: SkinSpec) -> float | None:
    """Longest time in which low modes of a skin at rest fade to 1/e [s].

    An uneven pad counts as the even one. None where the file does not say how the film moves:
    it lacks a density or the oil's viscosity, or the oil is vented.
    """
    stated = (spec.oil.density, spec.oil.viscosity, spec.material.density)
    if None in stated or not spec.oil.trapped:
        return None
    name = kept_key(spec, modes=_MODES)
    found = float(kept_arrays(name, lambda: {"time": _slowest(spec)})["time"])
    return found if np.isfinite(found) else None


def _slowest(spec: SkinSpec) -> float:
    """Time of the slowest low mode of a skin [s]; NaN where none fades."""
    before_computing()
    from suas_jax.dynamics.modes import modes

    if spec.geometry.sheets:
        from fitting.inverse_load.pad.uneven import even_spec

        spec = even_spec(spec)
    found = modes(spec.unloaded, _MODES).modes
    times = (row["time_s"] for row in found if row["time_s"] is not None)
    return float(max(times, default=np.nan))


class FilmMotion:
    """What may be motion of one skin's film, frame by frame."""

    def __init__(self, fading: float, variance: float) -> None:
        """Free motions fade in a time [s]; readings have a variance [counts^2]."""
        self.fading, self._variance = fading, variance
        self.forget()

    def forget(self) -> None:
        """Begin with the next frame."""
        self._before: deque[tuple[float, Floats]] = deque()

    def follow(self, time: Floats, change: Floats) -> Floats:
        """Take frames; return what of their readings may be motion [frame, taxel] [counts].

        Times are [frame] [s]; changes are readings less those at rest [frame, taxel] [counts],
        NaN where missing. Zero where readings have changed by no more than noise.
        """
        return np.array([self._next(*frame) for frame in zip(time, change, strict=True)])

    def _next(self, now: float, change: Floats) -> Floats:
        before = self._before
        while before and not now - _WINDOW * self.fading <= before[0][0] < now:
            before.popleft()  # too old, or of a clock that was set back
        found = np.zeros(len(change))
        if before:
            times, changes = (np.array(x) for x in zip(*before, strict=True))
            moved = np.nan_to_num(change - changes)
            count = (moved != 0).sum(1)
            chi2 = (moved**2 / (2 * self._variance)).sum(1)
            told = chi2 > count + _BEYOND_NOISE * np.sqrt(2 * count)
            left = np.exp((times - now) / self.fading)
            at = int((told * chi2 * left**2).argmax())
            found = moved[at] * left[at] * told[at]
        if not before or now - before[-1][0] >= self.fading / _KEPT:
            before.append((now, change))
        return found


def covariance_by_motion(best: Explanations, moved: Floats, per_contact: int) -> Floats:
    """Covariances of loads by motion [frame, taxel], padded as the information is."""
    covariance = np.full(best.information.shape, np.nan)
    moved = np.pad(moved, ((0, 0), (0, best.weight.shape[1] - moved.shape[1])))
    for count in np.unique(best.contacts):
        frames, width = best.contacts == count, per_contact * int(count)
        pull = best.jacobian[frames, :width] @ (best.weight * moved)[frames, :, None]
        gain = inverse(best.information[frames, :width, :width])
        # What nothing determines has an infinite variance already.
        loads = np.where(np.isfinite(gain), gain, 0.0) @ pull
        covariance[frames, :width, :width] = loads @ loads.transpose(0, 2, 1)
    return covariance


def mostly_motion(moved: Floats, change: Floats) -> Flags:
    """Frames that show motion more than loads: no number of contacts is told by them.

    Motion and changes of readings from rest are [frame, taxel] [counts].
    """
    return np.asarray(_share(moved, change) > _MOSTLY)


def _share(moved: Floats, change: Floats) -> Floats:
    """Of changes of readings, that may be motion [frame]."""
    size, whole = (np.linalg.norm(np.nan_to_num(x), axis=1) for x in (moved, change))
    return np.asarray(size / np.maximum(whole, 1e-300))


def told_moving(
    estimates: Sequence[LoadEstimate], moved: Floats, change: Floats
) -> list[LoadEstimate]:
    """Estimates whose status says where motion matters.

    Motion and changes of readings from rest are [frame, taxel] [counts]. A force that is less
    than twice its deviation may then be motion alone, and one without a deviation is not told.
    """
    matters = _share(moved, change) > MATTERS
    return [_moving(e) if m else e for e, m in zip(estimates, matters, strict=True)]


def _moving(estimate: LoadEstimate) -> LoadEstimate:
    if estimate.status in _STANDING:
        return estimate
    told = tuple(c for c in estimate.contacts if np.isfinite(c.deviation("force")))
    felt = any(abs(c.force) > _FELT * c.deviation("force") for c in told)
    contact = felt or None
    return replace(estimate, contact=contact, contacts=told, status="moving", at_least=None)


@dataclass(frozen=True)
class FilmFollower:
    """Follows the film in the frames of one skin: what may be motion, and taps."""

    motion: FilmMotion
    taps: TapFinder
    weights: ReadingWeights  # what turns readings into the model's

    def forget(self) -> None:
        """Begin with the next frame."""
        self.motion.forget()
        self.taps.forget()

    def moved(self, so: Floats, faulty: Flags, time: Floats) -> Floats:
        """What of the readings of frames may be motion [frame, taxel] [counts].

        Readings are [frame, taxel] [counts], NaN where missing, times [frame] [s].
        """
        return self.motion.follow(time, self.weights.change_from_rest(so, faulty))

    def with_taps(
        self,
        found: Sequence[LoadEstimate],
        so: Floats,
        faulty: Flags,
        time: Floats,
        drift: Drift | None,  # of the readings at rest
    ) -> list[LoadEstimate]:
        """Estimates of frames, those that end a tap with it."""
        readings = self.weights.model_rest + self.weights.change_from_rest(so, faulty)
        if drift is not None:
            readings = readings - drift.offset
        gaps = self.taps.gaps(readings)
        return [
            replace(e, tap=self.taps.follow(t, gap, touched=e.contact is not False))
            for e, t, gap in zip(found, time.tolist(), gaps, strict=True)
        ]
