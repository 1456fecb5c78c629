"""Loads of a log whose skin warms and sinks: each frame in its own surroundings.

A frame is estimated by the estimators of the states around it. A share s of the way between two
of them forces are nearly exponential in the surroundings, and everything else nearly linear::

    F = F_a^(1-s) F_b^s,    x = (1 - s) x_a + s x_b

Readings at rest move by more than noise between two states, so that those of a frame in its
surroundings are taken off first, and those of the state put in their place.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.drift import PastOfFrames
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.estimator import FULL_SCALE, LoadEstimator
from fitting.inverse_load.log.skin_states import SkinStates
from fitting.inverse_load.model.evaluation import NoRestError
from fitting.inverse_load.readings import LogReadings
from suas_jax.config import SkinSpec

_LINEAR = [f.name for f in fields(Contact) if f.name not in ("force", "by_arc")]


class LogEstimator:
    """Estimates the loads of a log."""

    def __init__(
        self,
        readings: LogReadings,
        states: SkinStates,
        make: Callable[[SkinSpec, str], LoadEstimator],  # the estimator of a state, by its name
    ) -> None:
        found: list[LoadEstimator | None] = []
        for spec, name in zip(states.specs, states.names, strict=True):
            try:
                found.append(make(spec, name))
            except NoRestError:  # of some of the states, which others stand in for
                found.append(None)
        if not any(found):
            raise NoRestError
        self.readings, self.states = readings, states.without([x is None for x in found])
        self._of = [x for x in found if x is not None]
        self._rest = np.stack([one.model_rest for one in self._of])
        self._same = len(self._of) == 1 and bool(self.states.known.all())
        self._main = int(np.bincount(self.states.nearest[self.states.known]).argmax())

    @property
    def main(self) -> LoadEstimator:
        """That of the state which most frames are nearest to."""
        return self._of[self._main]

    def main_frames(self) -> tuple[Rows, Floats]:
        """Frames that are nearest to that state, and their readings there [frame, taxel]."""
        frames = np.flatnonzero(self.states.known & (self.states.nearest == self._main))
        return frames, self.so(self._main, frames)

    def near(self, frame: int) -> tuple[LoadEstimator, Floats]:
        """The estimator nearest to a frame, and its readings as of that state [taxel]."""
        state = int(self.states.nearest[frame])
        return self._of[state], self.so(state, np.array([frame]))[0]

    def so(self, state: int, frames: Rows) -> Floats:
        """Readings of frames as a skin in one of the states would have them [frame, taxel].

        What is missing or saturated stays as it is; NaN in frames without a state around them.
        """
        so = self.readings.so[frames]
        if self._same:
            return so
        # Readings count from a baseline that was taken as the log began.
        counted = self.main.rest is not None
        first = self.states.share[self.states.known.argmax()]
        here = first @ self._rest if counted else self._rest[state]
        moved = so - self.states.share[frames] @ self._rest + here
        moved = np.where((so > 0) & (so < FULL_SCALE), moved, so)
        return np.where(self.states.known[frames, None], moved, np.nan)

    def estimate(self, done: Callable[[int], None] = lambda frames: None) -> list[LoadEstimate]:
        """Estimate all frames; `done` is called with the number of frames estimated so far."""
        log, everything = self.readings, np.arange(len(self.readings.time))
        if self._same:
            return self.main.estimate(
                log.so, log.stuck, done, pressure=log.pressure, time=log.time
            )
        given = self.so(self._main, everything), log.stuck, log.time
        past = self.main.followed(*given)
        return self.main.in_course(self.of_frames(everything, past, done), *given, past)

    def of_frames(
        self,
        frames: Rows,
        past: PastOfFrames | None = None,  # that of these frames, where it is followed
        done: Callable[[int], None] = lambda frames: None,
    ) -> list[LoadEstimate]:
        """Estimate some frames; `done` is called with the number of frames so far."""
        log, past = self.readings, past or PastOfFrames()
        share = self.states.share[frames]
        found: list[list[tuple[float, LoadEstimate]]] = [[] for _ in frames]
        every, before = int(np.count_nonzero(share)), 0
        for k, estimator in enumerate(self._of):
            rows = np.flatnonzero(share[:, k])
            if not rows.size:
                continue
            own = frames[rows]

            def so_far(count: int, before: int = before) -> None:
                done((before + count) * len(frames) // every)

            estimates = estimator.estimate_frames(
                self.so(k, own),
                log.stuck[own],
                past.rows(rows),
                so_far,
                pressure=None if log.pressure is None else log.pressure[own],
            )
            before += len(rows)
            for row, estimate in zip(rows, estimates, strict=True):
                found[row].append((float(share[row, k]), estimate))
        nothing = LoadEstimate(None, status="model_mismatch")
        return [between(parts) if parts else nothing for parts in found]


def between(parts: Sequence[tuple[float, LoadEstimate]]) -> LoadEstimate:
    """One estimate of several in states around a frame, with their shares.

    It is that of the nearest state, its numbers those between all states that find as many
    contacts.
    """
    own = max(parts, key=lambda part: part[0])[1]
    alike = [(s, e) for s, e in parts if len(e.contacts) == len(own.contacts)]
    if len(alike) < 2 or not own.contacts:
        return own
    share = np.array([s for s, _ in alike]) / sum(s for s, _ in alike)
    groups = zip(*(e.contacts for _, e in alike), strict=True)
    bounds = [e.at_least for _, e in alike if e.at_least is not None]
    return replace(
        own,
        contacts=tuple(_contact(own.contacts[k], c, share) for k, c in enumerate(groups)),
        oil_pressure=float(share @ [e.oil_pressure for _, e in alike]),
        at_least=float(share @ bounds) if len(bounds) == len(alike) else own.at_least,
        latency=sum(e.latency for _, e in parts),
    )


def _plain(value: float | list[float]) -> float | tuple[float, ...]:
    return tuple(value) if isinstance(value, list) else value


def _contact(own: Contact, others: Sequence[Contact], share: Floats) -> Contact:
    values: dict[str, Any] = {}
    for name in _LINEAR:
        given = [getattr(c, name) for c in others]
        if all(x is not None for x in given):
            mean = np.tensordot(share, np.array(given), 1)
            values[name] = mean if isinstance(given[0], np.ndarray) else _plain(mean.tolist())
    force = np.array([c.force for c in others])
    even = bool((force > 0).all())
    values["force"] = float(np.exp(share @ np.log(force)) if even else share @ force)
    return replace(own, **values)
