"""What readings do beyond a fitted model, learned over place and force of presses.

Readings of a press of force F at the angle a, less the fitted model's, are taken for ::

    r_k = delta_k(a, F) + p_k e + f_k z + noise,    e, z ~ N(0, 1)

p_k is what one standard deviation of the place does, f_k what one of the force does. delta
is a Gaussian process of mean zero that taxels share by their angle d from the press; c is the
model's change of a reading from rest, m the largest of a press ::

    cov = (g^2 c c' + s^2 (c c' + f^2 m m') exp(-(d - d')^2 / 2 l_d^2))
          exp(-(a - a')^2 / 2 l_a^2 - log(F / F')^2 / 2 l_F^2)

g is an error of all readings of a press, like one of its force, s one of their pattern. The
numbers are the most probable ones under log-normal priors (C. E. Rasmussen and C. K. I.
Williams, Gaussian Processes for Machine Learning, 2006, chapters 2 and 5). No model is exact,
so there is a process before presses show one: its covariance is what keeps estimates far from
all presses as unsure as they are.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from fitting.arrays import Floats

# Readings of presses that values are learned from, and before that the numbers of the process:
# further ones tell little, and cost as their cube.
_MOST_READINGS, _TELLING = 2400, 480
_FLOOR = 0.05  # f: a taxel's own error where its reading hardly changes
# Most probable numbers before any press, and deviations of their logarithms. Tables of five
# nodes leave a sixth of a field's 3 % open between nodes, which changes readings by about 1 %.
# Constants that were fitted to the same readings hide a part of sizes, so these move little.
_USUAL, _WIDTHS = (0.005, 0.01, 0.35, 0.5, 1.0), np.array([0.25, 0.25, 0.5, 0.7, 0.7])
_BOUNDS = ((5e-4, 0.3), (5e-4, 0.3), (0.08, 2.0), (0.1, 4.0), (0.2, 6.0))


class Presses(NamedTuple):
    """Presses, and what the fitted model leaves of their readings."""

    angle: Floats  # [press] [rad]
    force: Floats  # [press] [N]
    change: Floats  # of the model's readings from rest [press, taxel] [counts]
    left: Floats  # readings less the model's [press, taxel] [counts]; NaN where not used
    noise: Floats  # standard deviation of a reading [press, taxel] [counts]
    place: Floats  # readings by one standard deviation of a place [press, taxel] [counts]
    push: Floats  # readings by one standard deviation of a force [press, taxel] [counts]

    def rows(self, readings: int) -> "Presses":
        """Those of at most so many readings, evenly; ten at least."""
        count, taxels = self.left.shape
        most = max(10, readings // taxels)
        index = np.linspace(0, count - 1, min(count, most)).round().astype(int)
        return Presses(*(x[index] for x in self))


class Numbers(NamedTuple):
    """The numbers of a discrepancy."""

    common: float  # g, relative
    pattern: float  # s, relative
    apart: float  # l_d [rad]
    along: float  # l_a [rad]
    force: float  # l_F, of the logarithm of a force


class Discrepancy:
    """A Gaussian process given presses."""

    def __init__(self, presses: Presses, numbers: Numbers, taxels: Floats) -> None:
        """`taxels`: their angles [taxel] [rad]. Raises LinAlgError: numbers of no process."""
        self.presses, self.numbers, self.taxels = presses, numbers, taxels
        used = np.isfinite(presses.left)
        keep = used.reshape(-1)
        inputs = self._inputs(presses.angle, presses.force, presses.change)
        self._points = inputs[0][keep], inputs[1][keep]
        press = np.nonzero(used)[0]
        p, f = presses.place[used], presses.push[used]
        same = press[:, None] == press
        own = np.where(same, np.outer(p, p) + np.outer(f, f), 0.0)
        own[np.diag_indices_from(own)] += presses.noise[used] ** 2
        own += self._kernel(self._points, self._points)
        self._factor = cho_factor(own, lower=True, check_finite=False)
        self._left = presses.left[used]
        self._weights = cho_solve(self._factor, self._left)

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the marginal likelihood, up to a constant."""
        spread = np.log(np.diag(self._factor[0])).sum()
        return float(-0.5 * self._left @ self._weights - spread)

    def at(self, angle: Floats, force: Floats, change: Floats) -> tuple[Floats, Floats]:
        """Mean [press, taxel] and covariance [press, taxel, taxel] under other presses.

        They have angles [press, rad], forces [press, N], and changes of the model's readings
        from rest [press, taxel].
        """
        points, sizes = self._inputs(angle, force, change)
        cross = self._kernel((points, sizes), self._points)
        half = solve_triangular(self._factor[0], cross.T, lower=True, check_finite=False)
        half = half.reshape(-1, *change.shape)
        pairs = zip(
            points.reshape(*change.shape, 3), sizes.reshape(*change.shape, 2), strict=True
        )
        before = np.stack([self._kernel(own, own) for own in pairs])
        mean = (cross @ self._weights).reshape(change.shape)
        return mean, before - np.einsum("npk,npl->pkl", half, half)

    def _inputs(self, angle: Floats, force: Floats, change: Floats) -> tuple[Floats, Floats]:
        """d, a and log F [reading, 3], and sizes c and f m [reading, 2]."""
        d = self.taxels - angle[:, None]
        columns = np.broadcast_arrays(d, angle[:, None], np.log(force)[:, None])
        most = np.broadcast_to(np.abs(change).max(1, keepdims=True), change.shape)
        sizes = np.stack([change, _FLOOR * most], -1)
        return np.stack(columns, -1).reshape(-1, 3), sizes.reshape(-1, 2)

    def _kernel(self, one: tuple[Floats, Floats], other: tuple[Floats, Floats]) -> Floats:
        n = self.numbers
        (x, a), (y, b) = one, other
        scale = np.array([n.apart, n.along, n.force])
        x, y = x / scale, y / scale

        def near(x: Floats, y: Floats) -> Floats:
            square = (x**2).sum(1)[:, None] + (y**2).sum(1) - 2 * x @ y.T
            return np.asarray(np.exp(-np.maximum(square, 0.0) / 2))

        pattern = n.pattern**2 * (a @ b.T) * near(x[:, :1], y[:, :1])
        whole = pattern + n.common**2 * np.outer(a[:, 0], b[:, 0])
        return np.asarray(whole * near(x[:, 1:], y[:, 1:]))


def learned(presses: Presses, taxels: Floats) -> Discrepancy:
    """The discrepancy that presses show. `taxels`: their angles [taxel] [rad]."""
    told, usual = presses.rows(_TELLING), np.log(_USUAL)

    def cost(p: Floats) -> float:
        try:
            value = -Discrepancy(told, _numbers(p), taxels).log_likelihood
        except np.linalg.LinAlgError:
            return 1e10
        return value + 0.5 * float((((p - usual) / _WIDTHS) ** 2).sum())

    bounds = [tuple(np.log(pair)) for pair in _BOUNDS]
    found = minimize(cost, usual, method="L-BFGS-B", bounds=bounds)
    return Discrepancy(presses.rows(_MOST_READINGS), _numbers(found.x), taxels)


def _numbers(p: Floats) -> Numbers:
    """From their logarithms."""
    return Numbers(*map(float, np.exp(p)))
