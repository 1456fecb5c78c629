"""Errors that all readings of a known state share: those of what was told of its loads.

A load cell tells a force f with an error e ~ N(0, t^2), and to first order all readings of the
frame are off by g e, with their derivatives g by the force. In units of the noise readings have
the covariance ::

    K = I + S S^T,    S = g t / sigma

state by state. W = K^(-1/2) makes errors independent: W r is what least squares makes small
(generalised least squares: errors in variables, with the errors integrated out).
"""

import dataclasses
from typing import NamedTuple, Self

import numpy as np

from fitting.arrays import Floats
from fitting.sensor.logs.data import SensorData


@dataclasses.dataclass(frozen=True)
class SharedErrors:
    """What is told of each load, and how exact it is."""

    slopes: Floats  # counts by the load's force, displacement or depth [load, taxel, state]
    deviation: Floats  # t, of the same [load, state] [N] or [m]; zero where it is exact

    def replace(self, deviation: Floats) -> Self:
        """The same, told as exactly as this."""
        return dataclasses.replace(self, deviation=deviation)

    def whitening(self, state: np.ndarray, weight: Floats) -> "Whitening":
        """W for frames of these states [frame], readings weighing w = 1 / sigma [taxel, frame].

        Readings that do not count weigh nothing.
        """
        columns = self.sizes[..., state] * weight
        gram = _by_state(np.einsum("ktf,ltf->klf", columns, columns), state, self.states)
        size, along = np.linalg.eigh(np.moveaxis(gram, -1, 0))
        size = np.maximum(size, 0.0)
        safe = np.where(size > 0.0, size, 1.0)

        def of(share: Floats) -> Floats:
            return np.einsum("jka,ja,jla->jkl", along, np.where(size > 0, share, 0), along)

        return Whitening(
            columns,
            of((1 - 1 / np.sqrt(1 + size)) / safe),
            of(1 / (1 + size)),
            float(np.log1p(size).sum()),
        )

    @property
    def sizes(self) -> Floats:
        """What errors of one deviation change, g t [load, taxel, state], counts."""
        return self.slopes * self.deviation[:, None]

    @property
    def states(self) -> int:
        """How many states there are."""
        return self.slopes.shape[-1]


class Whitening(NamedTuple):
    """W = I - S M S^T of all frames, M a small matrix for each state."""

    columns: Floats  # S [load, taxel, frame]
    root: Floats  # M [state, load, load]
    inverse: Floats  # (I + S^T S)^-1, so that K^-1 = I - S inverse S^T [state, load, load]
    log_determinant: float  # of K

    def sums(self, state: np.ndarray, r: Floats) -> Floats:
        """S^T r state by state [state, load], of residuals r [taxel, frame]."""
        along = np.einsum("ktf,tf->kf", self.columns, r)
        return np.asarray(_by_state(along, state, len(self.root)).T)

    def gram(self, state: np.ndarray, basis: Floats) -> Floats:
        """B^T K^-1 B for columns B of single taxels [taxel, frame, column].

        Returns a matrix over taxels and columns, the columns running faster.
        """
        taxels, _, count = basis.shape
        own = np.zeros((taxels, count, taxels, count))
        each = np.arange(taxels)
        own[each, :, each] = np.einsum("tfk,tfl->tkl", basis, basis)
        across = np.einsum("tfc,ktf->tckf", basis, self.columns)
        across = _by_state(across, state, len(self.root))
        own -= np.einsum("tckj,jkl,udlj->tcud", across, self.inverse, across, optimize=True)
        return own.reshape(taxels * count, taxels * count)


def _by_state(values: Floats, state: np.ndarray, states: int) -> Floats:
    """Sums over the frames of each state, of values [..., frame]."""
    found = np.zeros((states, *values.shape[:-1]))
    np.add.at(found, state, np.moveaxis(values, -1, 0))
    return np.moveaxis(found, 0, -1)


def apart(data: SensorData) -> SensorData:
    """The same with a state for every stretch of frames under one load.

    What a cell or a scale tells for some frames on end is one reading of it; the next one has
    another error, though it says the same. States at rest are exact and stay one.
    """
    new = np.diff(data.state, prepend=-1) != 0
    new |= np.diff(data.log, prepend=-1) != 0
    loaded = data.loaded[data.state]
    first = np.flatnonzero(new & loaded)
    idle = np.flatnonzero(~data.loaded)
    state = len(idle) - 1 + np.cumsum(new & loaded)
    at_rest = np.searchsorted(idle, data.state)
    kept = np.concatenate([idle, data.state[first]])
    return dataclasses.replace(
        data,
        state=np.where(loaded, state, at_rest),
        loads=data.loads.take(kept),
        permittivity=data.permittivity[kept],
        unused=None if data.unused is None else data.unused[:, kept],
    )
