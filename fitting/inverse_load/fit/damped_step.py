"""The step of Levenberg-Marquardt inside bounds, of many fits at once.

With J^T W J the information of a fit and g half the steepest descent of chi2, scaled by the
information's diagonal S^2::

    (S^-1 J^T W J S^-1 + damping) S dx = S^-1 g

A parameter that presses against its bound stays there, and counts for nothing in the decrease
that the step predicts. Lanes of a section share a compiled equilibrium, frames of a pad one
evaluation of the interpolant; SciPy takes frame by frame, 41 times longer for many
(`python -m benchmarks.inverse_load_speed`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

FIRST_DAMPING, GIVEN_UP = 1e-3, 1e8
"""Damping of the first step, and that beyond which a fit is given up."""
_RAISED = 1e-1


class Descent(NamedTuple):
    """Where fits are, and what lies ahead; of NumPy or JAX, fits along the last axis."""

    parameters: Any  # [parameter, fit]
    gradient: Any  # of minus half of chi2 [parameter, fit]
    information: Any  # J^T W J [parameter, parameter, fit]
    low: Any  # lower bounds [parameter, fit]
    high: Any  # upper bounds [parameter, fit]


def damped_step(
    here: Descent,  # where they begin
    damping: Any,  # of each fit [fit]
    solve: Callable[[Any, Any], Any],  # solves matrices [n, n, fit] for right sides [n, fit]
    *,
    ridge: float,  # added to the damping, in units of the scaled diagonal
    xp: Any = np,  # NumPy, or `jax.numpy` inside of a program
) -> tuple[Any, Any]:
    """Damped Gauss-Newton steps [parameter, fit]; decreases of chi2 they predict [fit]."""
    x, gradient, information, low, high = here
    tiny = 1e-12 * (1 + xp.abs(x))
    stuck = ((x <= low + tiny) & (gradient < 0)) | ((x >= high - tiny) & (gradient > 0))
    gradient = xp.where(stuck, 0.0, gradient)
    diagonal = xp.stack([row[i] for i, row in enumerate(information)])
    scale = xp.sqrt(xp.where(stuck | (diagonal <= 0), 1.0, diagonal))
    free = ~(stuck[:, None] | stuck[None])
    matrix = xp.where(free, information, 0.0) / (scale[:, None] * scale[None])
    unit = xp.eye(len(gradient))[..., None] > 0
    matrix = xp.where(unit, 1.0 + damping + ridge, matrix)
    solution = solve(matrix, gradient / scale)
    return solution / scale, xp.sum(solution * gradient / scale, 0)


def next_damping(damping: Any, better: Any, xp: Any = np) -> Any:
    """Damping after a step that did or did not lower chi2 [fit]."""
    return xp.where(better, damping / 10, xp.maximum(10 * damping, _RAISED))
