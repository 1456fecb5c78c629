"""Taps: presses that are over before the film has followed, told by their impulse.

No frame of a tap shows its force. But a skin that is at rest before and after it has answered
as K u + C du/dt + M d2u/dt2 = f(t), and so ::

    integral f dt = integral K u dt

With g the gaps less those at rest, phi those of a light steady contact at the tap's place and
F(a) the steady force at the amplitude a = phi.g / phi.phi, the impulse is the integral of F(a)
over the motion. It is exact where the skin answers in proportion to loads. Where F bends, half
of what the bend adds is taken for the impulse's standard deviation, beside that of noise and
that of inputs at the force that gives most of it. The place is that of a steady contact
with the motion's mean gaps.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate, Tap
from fitting.inverse_load.estimate.parts import Film
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.steps import Budget, Search, Steps

LONGEST = 20.0
"""Fading times that a motion lasts at most to be a tap; longer ones show their forces."""
SHAPE = 0.05
"""Error of the mean gaps under a bent F, as a share of their change of readings."""
_REST = 32  # frames at rest whose mean counts


class Motion(NamedTuple):
    """Frames from rest to rest."""

    time: Floats  # [frame] [s]
    gap: Floats  # less that at rest [frame, taxel] [m]; NaN where a reading was missing
    rest_variance: float  # of the mean gaps at rest, over that of a frame

    @property
    def duration(self) -> float:
        """From the last frame at rest before it to the last of it [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def share(self) -> Floats:
        """Of the duration, by the trapezoidal rule: jitter and missing frames count [frame]."""
        step = np.diff(self.time)
        return np.asarray(np.append(step, 0) + np.append(0, step)) / (2 * self.duration)


@dataclass
class MotionWatch:
    """Gathers frames between those at rest.

    A swing passes its rest: a motion is over once nothing has touched for a fading time.
    """

    fading: float  # time in which free motions fade [s]
    _rest: tuple[float, Floats] | None = None  # time of the last frame, and mean gaps [taxel]
    _still: int = 0  # frames that the mean is of
    _variance: float = 1.0  # of the mean, over that of a frame
    _frames: list[tuple[float, Floats]] = field(default_factory=list)
    _untouched: float | None = None  # since when nothing has touched

    def forget(self) -> None:
        """Begin with the next frame at rest."""
        self._rest, self._still, self._frames, self._untouched = None, 0, [], None

    def follow(self, time: float, gap: Floats, *, touched: bool) -> Motion | None:
        """Take a frame's gaps [taxel] [m]; return the motion that it ends."""
        if self._rest is None:
            if not touched:
                self._rest, self._still, self._variance = (time, gap), 1, 1.0
            return None
        begin, rest = self._rest
        if not 0 < time - begin < LONGEST * self.fading:
            self.forget()
        elif touched or self._frames:
            self._frames.append((time, gap - rest))
            since = None if touched else self._untouched
            self._untouched = time if since is None and not touched else since
            if self._untouched is not None and time - self._untouched >= self.fading:
                times, gaps = (np.array(x) for x in zip(*self._frames, strict=True))
                self._rest, self._frames, self._untouched = (time, rest), [], None
                gaps = np.vstack([np.zeros_like(rest), gaps])
                return Motion(np.append(begin, times), gaps, self._variance)
        else:
            self._still = min(self._still + 1, _REST)
            own = 1 / self._still
            self._rest = time, rest + own * (gap - rest)
            self._variance = (1 - own) ** 2 * self._variance + own**2
        return None


class ForceCurve(NamedTuple):
    """Steady force at one place by the amplitude of the gaps."""

    shape: Floats  # change of gaps under the lightest force [taxel] [m]
    amplitude: Floats  # [level], of that shape; from zero
    force: Floats  # [level] [N]; from zero

    @classmethod
    def of(cls, force: Floats, gap: Floats) -> "ForceCurve":
        """Through forces [level] [N] and changes of gaps under them [level, taxel] [m]."""
        shape = gap[0]
        amplitude = gap @ shape / (shape @ shape)
        return cls(shape, np.append(0.0, amplitude), np.append(0.0, force))

    def amplitudes(self, gap: Floats, variance: Floats) -> tuple[Floats, Floats]:
        """Of changes of gaps [frame, taxel] [m], and standard deviations [frame].

        Variances are of a gap [taxel] [m^2]. Missing taxels count for nothing.
        """
        own = np.where(np.isfinite(gap), self.shape, 0.0)
        size = (own**2).sum(-1)
        return (np.nan_to_num(gap) * own).sum(-1) / size, np.sqrt(own**2 @ variance) / size

    def at(self, amplitude: Floats) -> Floats:
        """Force [N]; outwards as beside rest."""
        outwards = np.minimum(amplitude, 0.0) * self.force[1] / self.amplitude[1]
        return np.interp(amplitude, self.amplitude, self.force) + outwards


class TapFinder:
    """Finds taps in the frames of one skin."""

    def __init__(
        self,
        watch: MotionWatch,
        film: Film,
        nodes: AbstractNodeSearch,
        taxels: int,
        variance: float,  # of a reading [counts^2]
        # the estimate of one frame of readings with inverse variances [frame, channel], and its
        # parameters
        explain: Callable[[Floats, Floats], Steps[tuple[LoadEstimate, Floats]]],
        budget: Budget | None,  # of a frame; None where each takes the time that it takes
    ) -> None:
        self._watch, self._film, self._nodes = watch, film, nodes
        self.gaps = film.film
        self._taxels, self._variance, self._explain = taxels, variance, explain
        self.forget = watch.forget
        self._budget = budget or Budget(np.inf)
        self._searches: list[Search[Tap | None]] = []  # of motions that are over
        self._so = nodes.rest[:taxels]
        self._gap, closer = self.gaps(np.stack([self._so, self._so + 1]))
        self._slope = self._gap - closer  # of a count

    def follow(self, time: float, gap: Floats, *, touched: bool) -> Tap | None:
        """Take a frame's gaps [taxel] [m]; return the tap that is known from then on.

        It is the one that the frame ends, unless that one's budget asks for further frames.
        """
        motion = self._watch.follow(time, gap, touched=touched)
        if motion is not None:
            self._searches.append(Search(self._tap(motion), self._budget))
        if self._searches and self._searches[0].go_on():
            return self._searches.pop(0).found
        return None

    def _tap(self, motion: Motion) -> Steps[Tap | None]:
        """The tap of a motion; None where it shows no contact that presses, or no error."""
        share = motion.share
        so = self._film.readings(self._gap + share @ motion.gap)
        change = np.where(np.isfinite(so), so - self._so, np.nan)
        noise = self._variance * ((share**2).sum() + motion.rest_variance)
        told, parameters = yield from self._contact(change, noise)
        if told is None or not told.force > 0:
            return None
        rows = self._rows(int(self._nodes.nearest_to(parameters[None], 1)[0]))
        forces = self._nodes.loads[rows, -1]
        readings = self._nodes.readings[rows, : self._taxels]
        curve = ForceCurve.of(forces, self.gaps(readings) - self._gap)
        amplitude, of_reading = curve.amplitudes(motion.gap, self._slope**2 * self._variance)
        force = curve.at(amplitude)
        impulse = motion.duration * (share @ force)
        if not impulse > 0:
            return None
        bent = impulse - motion.duration * curve.at(share @ amplitude)
        rate = (curve.at(amplitude + 1e-6) - force) / 1e-6
        of_frames = share * rate * of_reading
        # An error of the readings at rest is in all of them.
        read = (of_frames**2).sum() + motion.rest_variance * of_frames.sum() ** 2
        # Errors of the inputs are a larger share of a lighter force; that of the frames which
        # give most of the impulse counts.
        most = np.abs(forces - (share @ force**2) / (share @ force)).argmin()
        pressed, _ = yield from self._contact(readings[most] - self._so, noise)
        known = pressed if pressed is not None and pressed.force > 0 else told
        inputs = known.deviation("force") / known.force * impulse
        error = np.sqrt(motion.duration**2 * read + (bent / 2) ** 2 + inputs**2)
        if not np.isfinite(error):
            return None
        return Tap(float(motion.time[0]), motion.duration, told, float(impulse), float(error))

    def _contact(self, change: Floats, noise: float) -> Steps[tuple[Contact | None, Floats]]:
        """The one contact that explains changes of readings, and its parameters.

        Changes are [taxel] [counts], NaN where missing, with a variance; None where there is
        no contact, no error of it, or several.
        """
        used, change = np.isfinite(change), np.nan_to_num(change)
        beside = (0, len(self._nodes.rest) - self._taxels)
        y = np.pad(used, beside) * self._nodes.rest + np.pad(change, beside)
        weight = np.pad(used / (noise + (SHAPE * change) ** 2), beside)
        found, parameters = yield from self._explain(y[None], weight[None])
        one = len(found.contacts) == 1 and found.contacts[0].covariance is not None
        return (found.contacts[0] if one else None), parameters

    def _rows(self, node: int) -> Rows:
        """Nodes that have a state, at the place of one."""
        rows = node // self._nodes.levels * self._nodes.levels + np.arange(self._nodes.levels)
        return np.asarray(rows[self._nodes.known[rows]])
