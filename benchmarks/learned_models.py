"""Models that know nothing of the skin: readings in, place and force out.

A Gaussian process and a small network, both on the same inputs: the pattern of the readings'
change from rest, y / |y|, and log |y|; and the same outputs: place and log force. Kept free of
a library, as what is compared is the number of presses that such models need.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

Predictor = Callable[[np.ndarray], np.ndarray]


class Scaled(NamedTuple):
    """Inputs and outputs of mean zero and deviation one, and the way back."""

    x: np.ndarray
    y: np.ndarray
    inputs: Callable[[np.ndarray], np.ndarray]
    outputs: Callable[[np.ndarray], np.ndarray]


def _inputs(change: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(change, axis=1, keepdims=True)
    return np.concatenate([change / size, np.log(size)], 1)


def _scaled(change: np.ndarray, place: np.ndarray, force: np.ndarray) -> Scaled:
    x, y = _inputs(change), np.column_stack([place, np.log(force)])
    (a, b), (c, d) = ((v.mean(0), v.std(0) + 1e-12) for v in (x, y))

    def outputs(z: np.ndarray) -> np.ndarray:
        found = c + d * z
        return np.column_stack([found[:, :-1], np.exp(found[:, -1])])

    return Scaled((x - a) / b, (y - c) / d, lambda new: (_inputs(new) - a) / b, outputs)


def gaussian_process(
    change: np.ndarray,  # of the readings from rest [press, taxel]
    place: np.ndarray,  # of the presses [press], on a pad [press, 2]
    force: np.ndarray,  # of the presses [press]
) -> Predictor:
    """One process an output: squared exponential, its numbers by the marginal likelihood.

    It finds place and, last, force [press, ...] from changes of readings.
    """
    data = _scaled(change, place, force)
    taxels = change.shape[1]

    def kernel(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        scale = np.exp(-np.repeat(p[:2], [taxels, 1]))
        a, b = a * scale, b * scale
        square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
        return np.exp(2 * p[2] - np.maximum(square, 0.0) / 2)

    def fitted(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        def cost(p: np.ndarray) -> float:
            k = kernel(p, data.x, data.x) + (np.exp(2 * p[3]) + 1e-8) * np.eye(len(y))
            try:
                factor = cho_factor(k, lower=True)
            except np.linalg.LinAlgError:
                return 1e10
            own = y @ cho_solve(factor, y) / 2 + np.log(np.diag(factor[0])).sum()
            return float(own + 0.05 * (p[:3] - [1, 1, 0]) @ (p[:3] - [1, 1, 0]))

        starts = ([1.0, 1.0, 0.0, -3.0], [2.0, 1.0, 1.0, -4.0])
        bounds = [(-3, 6), (-3, 6), (-3, 5), (-8, 1)]
        tried = (minimize(cost, s, method="L-BFGS-B", bounds=bounds) for s in starts)
        best = min(tried, key=lambda found: found.fun)
        k = kernel(best.x, data.x, data.x) + (np.exp(2 * best.x[3]) + 1e-8) * np.eye(len(y))
        return best.x, np.linalg.solve(k, y)

    found = [fitted(y) for y in data.y.T]

    def predict(new: np.ndarray) -> np.ndarray:
        x = data.inputs(new)
        return data.outputs(np.stack([kernel(p, x, data.x) @ a for p, a in found], 1))

    return predict


def network(
    change: np.ndarray,  # of the readings from rest [press, taxel]
    place: np.ndarray,  # of the presses [press], on a pad [press, 2]
    force: np.ndarray,  # of the presses [press]
    hidden: int = 20,  # units of a layer
    nets: int = 2,  # how many networks
) -> Predictor:
    """The mean of a few networks of two hidden layers, with weight decay, by L-BFGS."""
    data = _scaled(change, place, force)
    shapes = [(data.x.shape[1], hidden), (hidden, hidden), (hidden, data.y.shape[1])]
    ends = np.cumsum([a * b + b for a, b in shapes])

    def layers(w: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        parts = np.split(w, ends[:-1])
        return [
            (p[: a * b].reshape(a, b), p[a * b :])
            for p, (a, b) in zip(parts, shapes, strict=True)
        ]

    def through(w: np.ndarray, x: np.ndarray) -> list[np.ndarray]:
        kept = [x]
        for i, (matrix, shift) in enumerate(layers(w)):
            z = kept[-1] @ matrix + shift
            kept.append(np.tanh(z) if i < 2 else z)
        return kept

    def cost(w: np.ndarray, decay: float) -> tuple[float, np.ndarray]:
        kept, parts = through(w, data.x), layers(w)
        error = (kept[-1] - data.y) / len(data.y)
        total = 0.5 * len(data.y) * float((error**2).sum()) + 0.5 * decay * float(w @ w)
        slopes = []
        for i in (2, 1, 0):
            slopes.append(np.concatenate([(kept[i].T @ error).ravel(), error.sum(0)]))
            if i:
                error = (error @ parts[i][0].T) * (1 - kept[i] ** 2)
        return total, np.concatenate(slopes[::-1]) + decay * w

    random = np.random.default_rng(0)
    found = []
    for _ in range(nets):
        start = np.concatenate([random.normal(size=a * b + b) * a**-0.5 for a, b in shapes])
        decay = 0.02 / len(data.y)
        kept = minimize(
            cost, start, args=(decay,), jac=True, method="L-BFGS-B", options={"maxiter": 400}
        )
        found.append(kept.x)

    def predict(new: np.ndarray) -> np.ndarray:
        x = data.inputs(new)
        return data.outputs(np.mean([through(w, x)[-1] for w in found], 0))

    return predict
