"""A log-probability in batches, and Laplace's approximation: the Gaussian at its maximum.

Compiled, a batch has half of an ensemble's size: emcee asks for the whole once, then for halves
or quarters, which are cut or padded to it. What is not finite is impossible, never an error.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.arrays import Floats
from suas_jax.runtime.compiled import OPTIONS

LogProbability = Callable[[Float[Array, "point p"]], Float[Array, " point"]]

_DIFFERENCE = 0.05
_NEWTON_STEPS = 20


class NumpyBatch:
    """A log-probability that NumPy evaluates, of any number of points.

    `evaluations` counts the points, `seconds` the time spent on them, compilation excluded.
    """

    def __init__(self, function: Callable[[Floats], Floats]) -> None:
        self._function = function
        self.evaluations, self.seconds = 0, 0.0

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Log-probability of points [n, p]; -inf where it is not finite."""
        begin = time.perf_counter()
        found, count = self._evaluated(np.asarray(points, float))
        self.seconds += time.perf_counter() - begin
        self.evaluations += count
        return np.where(np.isfinite(found), found, -np.inf)

    def _evaluated(self, points: Floats) -> tuple[Floats, int]:
        """Log-probabilities of points, and how many were computed for them."""
        return self._function(points), len(points)


class Batch(NumpyBatch):
    """A log-probability compiled for one number of points, `size`.

    Several JAX devices share the points evenly, each running the program on its own part:
    there is nothing to communicate.
    """

    def __init__(self, log_probability: LogProbability, parameters: int, size: int) -> None:
        devices = jax.devices()
        self.size = -(-size // len(devices)) * len(devices)
        function = log_probability
        if len(devices) > 1:
            mesh = jax.sharding.Mesh(np.array(devices), ("walker",))
            along = jax.sharding.PartitionSpec("walker")
            function = jax.shard_map(
                log_probability, mesh=mesh, in_specs=along, out_specs=along, check_vma=False
            )
        shape = jax.ShapeDtypeStruct((self.size, parameters), jnp.float64)
        options = OPTIONS if devices[0].platform == "cpu" else None
        super().__init__(jax.jit(function).lower(shape).compile(compiler_options=options))

    def _evaluated(self, points: Floats) -> tuple[Floats, int]:
        count = len(points)
        filled = np.resize(points, (-(-count // self.size) * self.size, points.shape[1]))
        filled[count:] = points[-1]
        parts = np.split(filled, len(filled) // self.size)
        values = [np.asarray(self._function(part)) for part in parts]
        return np.concatenate(values)[:count], len(filled)


class Gaussian(NamedTuple):
    """A normal distribution."""

    mean: np.ndarray  # shape [p]
    covariance: np.ndarray  # shape [p, p]

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviations, shape [p]."""
        return np.sqrt(np.diagonal(self.covariance))


def laplace(batch: Callable[[np.ndarray], np.ndarray], start: Gaussian) -> Gaussian | None:
    """Expand a log-probability at its maximum.

    Newton's method in the coordinates that make `start` a unit Gaussian, where one step
    length of central differences suits every parameter. The differences need no program but
    the batch's own; `jax.hessian` would need a second one, which takes longer to compile than
    the first (processor seconds to trace and compile, batch of 16 and Hessian: Yeoh's law on
    three tests 0.2 and 1.1, Ogden's with three terms 0.4 and 5.9, a skin's curve 5.6 and
    19.1), while an expansion of six parameters by differences takes three batches.

    `batch`: log-probability of points [n, p]. `start`: an approximation to begin with.
    Returns the Gaussian of the maximum and its curvature; None where none was found.
    """
    values, vectors = np.linalg.eigh(start.covariance)
    widest = float(np.max(values))
    root = vectors * np.sqrt(np.maximum(values, 1e-24 * widest))
    centre = np.array(start.mean, float)
    value = float(batch(centre[None])[0])
    for _ in range(_NEWTON_STEPS):
        if not np.isfinite(value):
            return None
        slope, curvature = _expansion(batch, centre, root, value)
        if not np.all(np.isfinite(curvature)):
            return None
        size, axes = np.linalg.eigh(-curvature)
        # Uphill even where the surface is not concave, never further than the coordinates
        # are good for.
        along = axes.T @ slope
        ascent = along / np.maximum(np.abs(size), 1e-3)
        step = axes @ np.clip(ascent, -3.0, 3.0)
        lengths = 0.5 ** np.arange(8)
        tried = centre + (lengths[:, None] * step) @ root.T
        found = batch(tried)
        best = int(np.argmax(found))
        if found[best] > value:
            centre, value = tried[best], float(found[best])
        if np.min(size) > 0.0:
            # The next expansion is taken in the coordinates of this one.
            root = root @ (axes / np.sqrt(size))
            if float(np.max(np.abs(along) / np.sqrt(size))) < 1e-2:
                return Gaussian(centre, root @ root.T)
        elif np.max(np.abs(step)) < 1e-6:
            return None
    return None


def _expansion(
    batch: Callable[[np.ndarray], np.ndarray],
    centre: np.ndarray,
    root: np.ndarray,
    value: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and Hessian in the coordinates of `root`, by central differences."""
    p, h = len(centre), _DIFFERENCE
    unit = np.eye(p)
    pairs = [(i, j) for i in range(p) for j in range(i)]
    places = [*(h * unit), *(-h * unit)]
    places += [h * (unit[i] + unit[j]) for i, j in pairs]
    places += [-h * (unit[i] + unit[j]) for i, j in pairs]
    found = batch(centre + np.array(places) @ root.T)
    up, down, both, neither = np.split(found, [p, 2 * p, 2 * p + len(pairs)])
    curvature = np.diag((up - 2.0 * value + down) / h**2)
    with np.errstate(invalid="ignore"):  # beyond a bound both are -inf: no curvature is known
        for k, (i, j) in enumerate(pairs):
            mixed = both[k] + neither[k] - up[i] - down[i] - up[j] - down[j] + 2.0 * value
            curvature[i, j] = curvature[j, i] = mixed / (2.0 * h**2)
        return (up - down) / (2.0 * h), curvature
