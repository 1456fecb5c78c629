"""Contacts that fade where a stronger one has ended, as a membrane that relaxes leaves them.

After a load has gone, the dent of a membrane that relaxes goes too, but slowly. A frame by
itself shows it as a light contact, where the skin file states no relaxation or too little of
it. Its course tells it from a finger: the force falls to less than a quarter at once, and goes
on falling for many times as long, nearly in proportion to the logarithm of time::

    F(t) = a + b log((t - t_high) / (t_low - t_high)),   b < 0

t_high is the last time with more than half of the force, t_low the first with less than a
quarter. The film's oil leaves such a dent as well, for as long as it flows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate

_HIGH, _LOW = 0.5, 0.25  # shares of a force between which it ends
_NEAR = 5e-3  # between places that are one contact's [m]
_FEWEST = 5  # frames of a contact that fades
_LONG = 10.0  # times by which it lasts longer than the end of the force took
_LEAST = 0.5  # time that it lasts [s]: a finger that lifts may linger for less
_SURE = 6.0  # deviations of its fall
_FADED = 0.7  # share of the first force that may be left
_ALIKE = 1.5  # times the share once left that is taken for a dent again
_SINGLE = frozenset({"ok", "ok_drifted", "imprecise", "ambiguous", "poor_fit"})


class LeftBehind(NamedTuple):
    """What stayed where a contact had ended."""

    before: float  # force of the contact [N]
    ended: float  # time by which it had ended [s]
    first: float  # force that stayed [N]
    until: float  # time of the last frame that shows it [s]
    last: float  # force then [N]

    def text(self, *, remembers: bool) -> str:
        """In a sentence; whether the skin file states a relaxation."""
        why = "too little relaxation" if remembers else "no relaxation"
        return (
            f"after {self.before:.3g} N ended at {self.ended:.6g} s, {self.first:.2g} N stayed "
            f"and faded to {self.last:.2g} N by {self.until:.6g} s (status fading), as the "
            f"dent in a membrane that relaxes does; [material] states {why}"
        )


@dataclass
class _Fall:
    """The line F = a + b u through forces, u the logarithm of time."""

    # sums of w, w u, w u^2, w F, w u F, with w the inverse variances of the forces
    sums: Floats = field(default_factory=lambda: np.zeros(5))
    count: int = 0
    span: float = 0.0  # largest u

    def add(self, u: float, force: float, variance: float) -> None:
        self.sums = self.sums + np.array([1.0, u, u * u, force, u * force]) / variance
        self.count, self.span = self.count + 1, u

    def ends(self) -> tuple[float, float, float]:
        """Forces at the first and the last u, and deviations of the fall between them."""
        w, u, uu, f, uf = self.sums
        size = w * uu - u * u
        if size <= 0:
            return np.nan, np.nan, 0.0
        slope = (w * uf - u * f) / size
        first = (f - slope * u) / w
        return first, first + slope * self.span, -slope * float(np.sqrt(size / w))


@dataclass
class FadingWatch:
    """Finds contacts that fade in the frames of one skin, in order."""

    left: LeftBehind | None = None
    """The strongest so far."""
    _share: float = 0.0  # of a force that was left behind once, at most

    def __post_init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin with the next frame; what the skin has shown stays known."""
        self._contact: Contact | None = None  # where it was strongest
        self._high = -np.inf  # last time of more than half of its force
        # First time, and force then, of less than a quarter.
        self._low: tuple[float, float] | None = None
        self._fall, self._rows = _Fall(), list[int]()

    def told(self, time: Floats, estimates: Sequence[LoadEstimate]) -> list[LoadEstimate]:
        """Estimates of frames, those of contacts that fade by that name; times are in s."""
        found = list(estimates)
        self._rows = []
        for k, (now, estimate) in enumerate(zip(time.tolist(), estimates, strict=True)):
            if self._follow(now, estimate, k):
                for row in self._rows:
                    found[row] = replace(found[row], status="fading", contact=None)
                self._rows = []
        return found

    def _follow(self, now: float, estimate: LoadEstimate, row: int) -> bool:
        """Take a frame; return whether a contact fades in it."""
        if estimate.contact is False or not now > self._high:
            self.forget()
        if len(estimate.contacts) != 1 or not np.isfinite(now):
            return False
        contact, peak = estimate.contacts[0], self._contact
        if contact.force <= 0:
            self.forget()
            return False
        if peak is None or contact.force > peak.force or _apart(peak, contact):
            self.forget()
            self._contact, self._high = contact, now
            return False
        share = contact.force / peak.force
        if share > _LOW:
            self._low, self._fall, self._rows = None, _Fall(), []
            self._high = now if share > _HIGH else self._high
            return False
        deviation = np.sqrt(_variance(contact))
        if estimate.status not in _SINGLE or not 0 < deviation < np.inf:
            return False
        if self._low is None:
            self._low = now, contact.force
        elif contact.force > self._low[1] + _SURE * deviation:  # pressed anew
            self.forget()
            self._contact, self._high = contact, now
            return False
        self._rows.append(row)
        u = float(np.log((now - self._high) / (self._low[0] - self._high)))
        self._fall.add(u, contact.force, deviation**2)
        return self._fades(now, peak.force) or share < _ALIKE * self._share

    def _fades(self, now: float, before: float) -> bool:
        assert self._low is not None
        first, last, sigmas = self._fall.ends()
        fades = (
            self._fall.count >= _FEWEST
            and self._fall.span > np.log(_LONG)
            and now - self._low[0] > _LEAST
            and sigmas > _SURE
            and last < _FADED * first
        )
        if not fades:
            return False
        self._share = max(self._share, first / before)
        ended, force = self._low
        known = self.left
        if known is None or known.ended == ended or force > known.first:
            self.left = LeftBehind(before, ended, force, now, last)
        return True


def _apart(one: Contact, other: Contact) -> bool:
    pairs = ((one.arc_position, other.arc_position), (one.axial, other.axial))
    return any(abs(a - b) > _NEAR for a, b in pairs if a is not None and b is not None)


def _variance(contact: Contact) -> float:
    covariance = contact.noise_covariance
    if covariance is None:
        return float("nan")
    k = contact.names.index("force")
    return float(covariance[k, k])
