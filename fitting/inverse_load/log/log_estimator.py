"""Loads of a log whose skin warms and sinks: each frame in its own surroundings.

Where temperature or depth change by more than one state of a skin stands for, states lie on a
grid, and each frame has shares of those around it: bilinear in temperature and depth.

A frame is estimated by the estimators of the states around it. A share s of the way between two
of them forces are nearly exponential in the surroundings, and everything else nearly linear::

    F = F_a^(1-s) F_b^s,    x = (1 - s) x_a + s x_b

Readings at rest move by more than noise between two states, so that those of a frame in its
surroundings are taken off first, and those of the state put in their place.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.drift import PastOfFrames
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.estimator import FULL_SCALE, LoadEstimator
from fitting.inverse_load.model.evaluation import NoRestError
from fitting.inverse_load.readings import LogReadings
from fitting.inverse_load.zero.zero_file import aged
from fitting.surroundings import spec_at, spec_in, told_at_mean
from suas_jax.config import SkinSpec
from suas_jax.config.quantities import ZERO_CELSIUS

_APART = {"temperature": 5.0, "depth": 300.0}  # between states at most [K], [m]
_IN_WORDS: dict[str, Callable[[float], str]] = {
    "temperature": lambda kelvin: f"{kelvin - ZERO_CELSIUS:.3g} degC",
    "depth": lambda metres: f"{metres:.3g} m deep",
}
_LEAST = 1e-9  # share of a state that counts
_MOST = 0.5  # share of a frame's states that must be there
_LINEAR = [f.name for f in fields(Contact) if f.name not in ("force", "by_arc")]


@dataclass(frozen=True)
class SkinStates:
    """States of a skin that span a log, and where its frames lie between them."""

    specs: tuple[SkinSpec, ...]
    names: tuple[str, ...]  # in words
    # of each state in each frame; at most two along each of the surroundings are not zero
    share: Floats  # [frame, state]
    said: tuple[str, ...]  # what a person should know

    @property
    def nearest(self) -> Rows:
        """The state that each frame is nearest to."""
        return np.asarray(self.share.argmax(1))

    @property
    def known(self) -> Flags:
        """Frames that have states around them."""
        return np.asarray(self.share.any(1))

    def without(self, lost: Sequence[bool]) -> "SkinStates":
        """Those that there are: others stand in for lost ones, unless these have most of it."""
        kept = ~np.array(lost)
        if kept.all():
            return self
        share = self.share[:, kept]
        left = share.sum(1, keepdims=True)
        names = ", ".join(name for name, gone in zip(self.names, lost, strict=True) if gone)
        away = int((left < _MOST).sum())
        said = (
            f"at {names} the skin file's skin buckles without a load; {away} frames near that "
            "are not estimated (model_mismatch)"
        )
        return SkinStates(
            tuple(np.array(self.specs, object)[kept]),
            tuple(np.array(self.names, object)[kept]),
            np.where(left < _MOST, 0.0, share / np.where(left > 0, left, 1.0)),
            (*self.said, said),
        )


def skin_states(spec: SkinSpec, readings: LogReadings, where: str) -> SkinStates:
    """The states of a skin in a log's surroundings; one where these hardly change.

    A membrane that remembers is taken at their mean. `where` names the log, for messages.
    """
    around, frames = readings.surroundings, len(readings.time)
    mean, said = spec_at(spec, around, where)
    if around.temperature is None:
        mean, more = aged(mean, readings.header.get("start_time", ""), np.ptp(readings.time))
        said += more
    changing = {k: x for k, x in around.changing(spec)._asdict().items() if x is not None}
    if changing and spec.material.relaxation is not None:
        said += told_at_mean(around, spec)
        changing = {}
    if not changing:
        return SkinStates((mean,), ("",), np.ones((frames, 1)), tuple(said))
    axes, shares = [], []
    for name, column in changing.items():
        # By frames, not times: a device's clock may begin again.
        known = np.flatnonzero(np.isfinite(column.value))
        value = np.interp(np.arange(frames), known, column.value[known])
        low, high = column.ends
        nodes = np.linspace(low, high, 1 + int(np.ceil((high - low) / _APART[name] - 1e-9)))
        axes.append(nodes)
        place = (value - low) / (nodes[1] - nodes[0])
        shares.append(np.maximum(1 - np.abs(place[:, None] - np.arange(len(nodes))), 0.0))
    specs, names, share = [], [], []
    for rows in itertools.product(*(range(len(nodes)) for nodes in axes)):
        own = np.prod([s[:, k] for s, k in zip(shares, rows, strict=True)], 0)
        own = np.where(own < _LEAST, 0.0, own)
        if not own.any():
            continue
        at = {name: float(x[k]) for name, x, k in zip(changing, axes, rows, strict=True)}
        specs.append(spec_in(mean, **at))
        names.append(", ".join(_IN_WORDS[name](x) for name, x in at.items()))
        share.append(own)
    said.append(f"{where}: frames are estimated between {len(specs)} states of the skin")
    return SkinStates(tuple(specs), tuple(names), np.stack(share, 1), tuple(said))


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
