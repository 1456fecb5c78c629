"""Known loads of an experiment: their place, and force or displacement."""

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class KnownLoads:
    """What is known of the loads, state by state.

    Attributes:
        angle: where they act, from the symmetry axis [load, state, rad].
        turn: of the force from the inward radial, counter-clockwise [load, state, rad].
        force: total over the width [load, state, N]; NaN where the displacement is known.
        displacement: of the material point under the load, along the load's direction
            [load, state, m]; NaN where the force is known.
        inner: whether the displacement is the inner face's; else the mid-surface's [load].
        axial: where they act, from the middle of a pad [load, state, m].
        diameter: of round contacts on a pad [load, state, m]; zero where it is not known.
    """

    angle: np.ndarray
    turn: np.ndarray
    force: np.ndarray
    displacement: np.ndarray
    inner: np.ndarray
    axial: np.ndarray
    diameter: np.ndarray

    @property
    def states(self) -> int:
        """Number of states."""
        return self.angle.shape[1]

    def take(self, index: np.ndarray) -> "KnownLoads":
        """Some of the states."""
        return KnownLoads(
            self.angle[:, index],
            self.turn[:, index],
            self.force[:, index],
            self.displacement[:, index],
            self.inner,
            self.axial[:, index],
            self.diameter[:, index],
        )

    def with_rest(self) -> "KnownLoads":
        """One more state, without loads."""
        zero = np.zeros((len(self.angle), 1))
        return KnownLoads(
            np.concatenate([self.angle, zero], 1),
            np.concatenate([self.turn, zero], 1),
            np.concatenate([self.force, zero], 1),
            np.concatenate([self.displacement, np.nan * zero], 1),
            self.inner,
            np.concatenate([self.axial, zero], 1),
            np.concatenate([self.diameter, zero], 1),
        )
