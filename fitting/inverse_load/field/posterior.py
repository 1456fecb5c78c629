"""What readings say of forces at many nodes: a linear model, forces of zero or more.

With readings scaled by their noise, b = A f + e. Forces at nodes are a Gaussian field of one
size s and one length l along the face::

    f ~ N(0, s^2 K),  K_ij = exp(-|x_i - x_j| / l),    b ~ N(0, 1 + s^2 A K A^T)

The second is the evidence of s and l, which weighs them. Samples of the forces are the ends
of fits to disturbed data (randomise, then optimise), over f >= 0::

    |A f - b - e|^2 + |f - z|^2 / (s^2 K) + 2 r 1.f / s,    e ~ N(0, 1)

Oil that can't be compressed hides a pressure that is even all over the skin, so that readings
hardly tell what presses where little moves. Half of the samples expect as little as readings
ask for (z = 0, r = 2), half a field that goes on everywhere (z ~ N(0, s^2 K), r = 0).
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.distance import cdist

from fitting.arrays import Floats

_LENGTHS = (8e-3, 16e-3, 32e-3, 64e-3, 128e-3)  # l [m]
_PRESSURES = np.geomspace(6.0, 6e5, 24)  # s over a node's part of the face [Pa]
_SPARSE = 2.0  # r of samples that expect little
_JITTER = 1e-9


class LinearReadings(NamedTuple):
    """Readings as a linear model of the nodes' forces, scaled by their noise."""

    design: Floats  # A [channel, node]
    target: Floats  # b [channel]


class Scale(NamedTuple):
    """One size and length of a field."""

    length: int  # its index
    size: float  # of a node's force [N]


class Scales(NamedTuple):
    """Sizes and lengths of a field, and how well each explains some readings."""

    each: list[Scale]
    log_evidence: Floats  # of each, but for a constant of the readings

    @property
    def best(self) -> Scale:
        """The one that explains them best."""
        return self.each[int(self.log_evidence.argmax())]

    @property
    def weights(self) -> Floats:
        """Probabilities of each, all being as likely before."""
        own = np.exp(self.log_evidence - self.log_evidence.max())
        return np.asarray(own / own.sum())


class FieldPosterior:
    """The posterior of forces at nodes of one skin.

    Nodes have places on the unrolled face [node, coordinate] [m], each a part of it [m^2].
    """

    def __init__(self, metres: Floats, area: float) -> None:
        self._distance = cdist(metres, metres)
        self._sizes = (_PRESSURES * area).tolist()

    @cached_property
    def _kernels(self) -> list[Floats]:
        eye = _JITTER * np.eye(len(self._distance))
        return [np.exp(-self._distance / length) + eye for length in _LENGTHS]

    @cached_property
    def _inverses(self) -> list[Floats]:
        return [np.asarray(np.linalg.inv(kernel), float) for kernel in self._kernels]

    @cached_property
    def _roots(self) -> list[Floats]:
        return [np.asarray(np.linalg.cholesky(x), float) for x in self._kernels]

    def scales(self, linear: LinearReadings) -> Scales:
        """Evidence of all sizes and lengths, forces of either sign."""
        each, found = [], []
        for length, kernel in enumerate(self._kernels):
            value, way = np.linalg.eigh(linear.design @ kernel @ linear.design.T)
            along = (way.T @ linear.target) ** 2
            for size in self._sizes:
                variance = 1 + size**2 * np.maximum(value, 0.0)
                found.append(-(along / variance + np.log(variance)).sum() / 2)
                each.append(Scale(length, size))
        return Scales(each, np.array(found))

    def likeliest(self, linear: LinearReadings, scale: Scale, rate: float = 1.0) -> Floats:
        """The likeliest forces of zero or more [node]; r is `rate`."""
        return self._least(linear.design, linear.target, scale, 0.0, rate)

    def samples(
        self,
        linear: LinearReadings,
        scales: Scales,
        errors: Floats,  # of the skin's inputs, what each does to b [error, channel]
        count: int,
        random: np.random.Generator,
    ) -> Floats:
        """Forces that the readings allow [sample, node]."""
        chosen = random.choice(len(scales.each), count, p=scales.weights)
        found = []
        for k, i in enumerate(chosen.tolist()):
            scale, sparse = scales.each[i], bool(k % 2)
            noise = random.normal(size=len(linear.target))
            target = linear.target + noise + random.normal(size=len(errors)) @ errors
            drawn = (
                scale.size * self._roots[scale.length] @ random.normal(size=len(self._distance))
            )
            how = (0.0, _SPARSE) if sparse else (drawn, 0.0)
            found.append(self._least(linear.design, target, scale, *how))
        return np.array(found)

    def _least(
        self, design: Floats, target: Floats, scale: Scale, expected: Any, rate: float
    ) -> Floats:
        """Forces of zero or more at the least of the objective; z is `expected` [node]."""
        precision = self._inverses[scale.length] / scale.size**2
        normal = design.T @ design + precision
        right = design.T @ target - rate / scale.size
        right = right + precision @ np.broadcast_to(expected, right.shape)
        root = np.linalg.cholesky(normal)
        return np.asarray(nnls(root.T, np.linalg.solve(root, right))[0])
