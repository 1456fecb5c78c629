"""A constant-velocity Kalman filter on each contact's angle and force.

State (angle, force, their rates); white noise of acceleration drives it::

    x' = A x + noise,   A = [1 dt; 0 1],   Q = q [dt^3/3 dt^2/2; dt^2/2 dt]

with the estimate and its covariance as the measurement. A contact is followed as long as
an estimate lies within what its prediction allows; others begin a track of their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate

_GATE = 25.0  # squared distance beyond which an estimate is another contact's


@dataclass
class _Track:
    mean: NDArray[np.float64]  # angle, force, angle rate, force rate
    covariance: NDArray[np.float64]
    time: float


@dataclass
class LoadFilter:
    """Follows contacts over time.

    Args:
        angle_density: spectral density of the angle's acceleration [rad^2/s^3].
        force_density: of the force's [N^2/s^3].
    """

    angle_density: float = 1.0
    force_density: float = 400.0

    def __post_init__(self) -> None:
        self._tracks: list[_Track] = []

    def feed(self, time: float, estimate: LoadEstimate) -> list[Contact]:
        """Take a frame's estimate, return the filtered contacts.

        Args:
            time: of the frame [s].
            estimate: what was estimated from it alone.
        """
        if estimate.contact is None:
            return []  # nothing is known of this frame; tracks go on at the next
        free, tracks, filtered = list(self._tracks), [], []
        for contact in estimate.contacts:
            if contact.covariance is None or not np.isfinite(contact.covariance).all():
                continue
            seen = np.array([contact.angle, contact.force])
            noise = contact.covariance[:2, :2]
            # What a calibration leaves open is no noise: no filter makes it smaller.
            lasting = np.zeros((2, 2))
            if contact.systematic is not None:
                lasting = contact.systematic[:2, :2]
                noise = noise - lasting
            moved = [self._predict(track, time) for track in free]
            distance = [_distance(track, seen, noise) for track in moved]
            if distance and min(distance) < _GATE:
                best = int(np.argmin(distance))
                track = _update(moved[best], seen, noise)
                del free[best]
            else:
                rates = np.diag([noise[0, 0], noise[1, 1]]) + np.diag([1.0, 400.0])
                covariance = np.block([[noise, np.zeros((2, 2))], [np.zeros((2, 2)), rates]])
                track = _Track(np.concatenate([seen, [0.0, 0.0]]), covariance, time)
            tracks.append(track)
            mean, covariance = track.mean, track.covariance[:2, :2] + lasting
            filtered.append(Contact(float(mean[0]), float(mean[1]), None, covariance))
        self._tracks = tracks
        return filtered

    def _predict(self, track: _Track, time: float) -> _Track:
        dt = max(time - track.time, 0.0)
        move = np.eye(4)
        move[0, 2] = move[1, 3] = dt
        density = np.diag([self.angle_density, self.force_density])
        noise = np.block(
            [[density * dt**3 / 3, density * dt**2 / 2], [density * dt**2 / 2, density * dt]]
        )
        return _Track(move @ track.mean, move @ track.covariance @ move.T + noise, time)


def _distance(track: _Track, seen: NDArray, noise: NDArray) -> float:
    innovation = seen - track.mean[:2]
    return float(innovation @ np.linalg.solve(track.covariance[:2, :2] + noise, innovation))


def _update(track: _Track, seen: NDArray, noise: NDArray) -> _Track:
    spread = track.covariance[:2, :2] + noise
    gain = np.linalg.solve(spread, track.covariance[:2]).T
    mean = track.mean + gain @ (seen - track.mean[:2])
    # Joseph's form stays symmetric and positive.
    keep = np.eye(4)
    keep[:, :2] -= gain
    covariance = keep @ track.covariance @ keep.T + gain @ noise @ gain.T
    return _Track(mean, covariance, track.time)
