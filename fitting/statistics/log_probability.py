"""A log-probability compiled once, for a whole batch of points.

The batch has one shape, half of an ensemble: emcee asks for the whole once, then for halves
or quarters, which are cut or padded to it. A point whose log-probability is not finite is
impossible, never an error.
"""

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from suas_jax.runtime.compiled import OPTIONS

LogProbability = Callable[[Float[Array, "point p"]], Float[Array, " point"]]


class NumpyBatch:
    """A log-probability that NumPy evaluates, of any number of points.

    Args:
        function: log-probability of points [n, p].

    Attributes:
        evaluations: how many there were.
        seconds: spent in them.
    """

    def __init__(self, function: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> None:
        self._function = function
        self.evaluations, self.seconds = 0, 0.0

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Log-probability of points [n, p]; -inf where it is not finite."""
        begin = time.perf_counter()
        found = self._function(np.asarray(points, float))
        self.seconds += time.perf_counter() - begin
        self.evaluations += len(points)
        return np.where(np.isfinite(found), found, -np.inf)


class Batch:
    """A log-probability compiled for one number of points.

    Several JAX devices share the points evenly, each running the program on its own part:
    there is nothing to communicate.

    Attributes:
        size: points of one evaluation.
        evaluations: how many there were.
        seconds: spent in them, compilation excluded.
    """

    def __init__(self, log_probability: LogProbability, parameters: int, size: int) -> None:
        devices = jax.devices()
        self.size = -(-size // len(devices)) * len(devices)
        self.evaluations, self.seconds = 0, 0.0
        function = log_probability
        if len(devices) > 1:
            mesh = jax.sharding.Mesh(np.array(devices), ("walker",))
            along = jax.sharding.PartitionSpec("walker")
            function = jax.shard_map(
                log_probability, mesh=mesh, in_specs=along, out_specs=along, check_vma=False
            )
        shape = jax.ShapeDtypeStruct((self.size, parameters), jnp.float64)
        options = OPTIONS if devices[0].platform == "cpu" else None
        self._program = jax.jit(function).lower(shape).compile(compiler_options=options)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Log-probability of any number of points [n, p]; -inf where it is not finite."""
        count = len(points)
        filled = np.resize(points, (-(-count // self.size) * self.size, points.shape[1]))
        filled[count:] = points[-1]
        begin = time.perf_counter()
        values = [
            np.asarray(self._program(filled[i : i + self.size]))
            for i in range(0, len(filled), self.size)
        ]
        self.seconds += time.perf_counter() - begin
        self.evaluations += len(filled)
        found = np.concatenate(values)[:count]
        return np.where(np.isfinite(found), found, -np.inf)
