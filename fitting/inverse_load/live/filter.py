"""A constant-velocity Kalman filter on each contact's place and force.

State (angle, force, on a pad axial position, and their rates); white noise of acceleration
drives it::

    x' = A x + noise,   A = [1 dt; 0 1],   Q = q [dt^3/3 dt^2/2; dt^2/2 dt]

with the estimate and its covariance as the measurement. A contact is followed as long as
an estimate lies within what its prediction allows; others begin a track of their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate

_GATE = 25.0  # squared distance beyond which an estimate is another contact's
# What is followed, and the variance of its rate before it is known [rad^2/s^2 ...].
_FOLLOWED = {"angle": 1.0, "arc": 3.5e-3, "axial": 3.5e-3, "force": 400.0}


@dataclass
class _Track:
    mean: Floats  # what is followed, then the rates
    covariance: Floats
    time: float


@dataclass
class LoadFilter:
    """Follows contacts over time."""

    angle_density: float = 1.0  # spectral density of the angle's acceleration [rad^2/s^3]
    force_density: float = 400.0  # of the force's [N^2/s^3]
    axial_density: float = 3.5e-3  # of the axial position's [m^2/s^3]
    arc_density: float = 3.5e-3  # of the arc length's, where that is estimated [m^2/s^3]

    def __post_init__(self) -> None:
        self._tracks: list[_Track] = []

    def feed(self, time: float, estimate: LoadEstimate) -> list[Contact]:
        """Take a frame's time [s] and own estimate; return the filtered contacts."""
        if estimate.contact is None or estimate.status == "coarse":
            return []  # too little is known of this frame; tracks go on at the next
        free, tracks, filtered = list(self._tracks), [], []
        for contact in estimate.contacts:
            if contact.covariance is None or not np.isfinite(contact.covariance).all():
                continue
            names = [n for n in contact.names if n in _FOLLOWED]
            density = np.array([getattr(self, f"{name}_density") for name in names])
            seen = np.array([getattr(contact, name) for name in names])
            places = [contact.names.index(name) for name in names]
            rows = np.ix_(places, places)
            noise, size = contact.covariance[rows], len(names)
            # What a calibration leaves open is not noise: no filter makes it smaller.
            lasting = np.zeros((size, size))
            if contact.systematic is not None:
                lasting = contact.systematic[rows]
                noise = noise - lasting
            moved = [self._predict(track, time, density) for track in free]
            distance = [_distance(track, seen, noise) for track in moved]
            if distance and min(distance) < _GATE:
                best = int(np.argmin(distance))
                track = _update(moved[best], seen, noise)
                del free[best]
            else:
                rates = np.diag([_FOLLOWED[n] for n in names])
                zero = np.zeros((size, size))
                covariance = np.block([[noise, zero], [zero, rates]])
                track = _Track(np.concatenate([seen, np.zeros(size)]), covariance, time)
            tracks.append(track)
            mean = dict(zip(names, track.mean.tolist(), strict=False))
            covariance = track.covariance[:size, :size] + lasting
            filtered.append(
                Contact(
                    mean.get("angle", contact.angle),
                    mean["force"],
                    None,
                    covariance,
                    axial=mean.get("axial"),
                    arc=mean.get("arc"),
                    by_arc=contact.by_arc,
                )
            )
        self._tracks = tracks
        return filtered

    def _predict(self, track: _Track, time: float, densities: Floats) -> _Track:
        dt = max(time - track.time, 0.0)
        size, density = len(densities), np.diag(densities)
        move = np.eye(2 * size)
        move[:size, size:] = dt * np.eye(size)
        noise = np.block(
            [[density * dt**3 / 3, density * dt**2 / 2], [density * dt**2 / 2, density * dt]]
        )
        return _Track(move @ track.mean, move @ track.covariance @ move.T + noise, time)


def _distance(track: _Track, seen: NDArray, noise: NDArray) -> float:
    size = len(seen)
    innovation = seen - track.mean[:size]
    spread = track.covariance[:size, :size] + noise
    return float(innovation @ np.linalg.solve(spread, innovation))


def _update(track: _Track, seen: NDArray, noise: NDArray) -> _Track:
    size = len(seen)
    spread = track.covariance[:size, :size] + noise
    gain = np.linalg.solve(spread, track.covariance[:size]).T
    mean = track.mean + gain @ (seen - track.mean[:size])
    # Joseph's form stays symmetric and positive.
    keep = np.eye(2 * size)
    keep[:, :size] -= gain
    covariance = keep @ track.covariance @ keep.T + gain @ noise @ gain.T
    return _Track(mean, covariance, track.time)
