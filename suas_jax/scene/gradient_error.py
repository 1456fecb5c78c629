"""How far a gradient is from that of the exact solution.

The errors that are estimated of oil pressure and displacements are quantities of the solve like
any other, so their derivatives by the inputs are the errors of the gradients, which need not be
as small: an error that grows with the load is small where it starts. With D the inputs
themselves as their scales, a random vector r of signs and d/dr the derivative along D r::

    |D grad e|^2 = E[(de/dr)^2],    estimate = |D grad e| / |D grad y|

Derivatives along r are central differences of the program that the solution had compiled, from
the solution's own state: a program of second derivatives would take longer to compile than
all of them to run. On a pad, whose solves take longest, the differences are one-sided.
"""

import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from suas_jax.config import continuous_inputs
from suas_jax.scene.program import unloaded
from suas_jax.scene.solve import Solution, report_with

_DIRECTIONS = 4
_STEP = 1e-3  # of the inputs


def gradient_error_estimate(solution: Solution, path: str) -> float | None:
    """Estimate the relative error of a gradient, in the norm of D grad, by mesh and model.

    Oil pressure and displacement under a line or patch have estimates of their own; the
    gradients of others take the largest of these. None where it is unknown, as under bodies,
    whose errors are told by another solve.
    """
    if unloaded(solution.scene) or solution.scene.bodies:
        return None
    known = continuous_inputs(solution.scene)
    random = np.random.default_rng(0)
    slopes, errors, floor = [], [], 0.0
    one_sided = solution.scene.geometry.dimension == 3
    here = _moved(solution, known, dict.fromkeys(known, 0.0)) if one_sided else None
    for _ in range(_DIRECTIONS):
        steps = dict(zip(known, random.choice([-_STEP, _STEP], len(known)), strict=True))
        back = {path: -step for path, step in steps.items()}
        high = _moved(solution, known, steps)
        low = here if one_sided else _moved(solution, known, back)
        if low is None or high is None:
            return None
        distance = _STEP if one_sided else 2 * _STEP
        slopes.append((high.values - low.values) / distance)
        errors.append(np.abs(high.errors - low.errors).sum(0) / distance)
        floor = high.floor
    size = np.sqrt(np.square(slopes).mean(0))
    error = np.sqrt(np.square(errors).mean(0))
    own = _position(solution, path)
    if own is None:
        size[1:] = size[1:].max()
    share = np.divide(error, size, out=np.zeros_like(error), where=size > 0)
    found = floor + float(share.max() if own is None else share[own])
    return found if math.isfinite(found) else None


class _KeyQuantities(NamedTuple):
    """What errors are judged by."""

    values: NDArray[np.float64]  # of the quantities [quantity]
    # by each mesh compared, the correction's and the model [cause, quantity]
    errors: NDArray[np.float64]
    floor: float  # relative error that no input changes


def _moved(
    solution: Solution, known: dict[str, float], shares: dict[str, float]
) -> _KeyQuantities | None:
    """Key quantities where every input has moved by a share of itself."""
    inputs = {path: value * (1 + shares[path]) for path, value in known.items()}
    report = report_with(solution, inputs, judged=True)
    if report is None:
        return None
    found = report["key_quantities"]
    return _KeyQuantities(np.array(found["values"]), np.array(found["errors"]), found["floor"])


def _position(solution: Solution, path: str) -> int | None:
    """Which of the key quantities a path is."""
    if path == "oil_pressure_Pa":
        return 0
    match = re.fullmatch(r"loads\.(\d+)\.displacement_m", path)
    if match is None:
        return None
    kinds = [load.kind for load in solution.scene.loads]
    if kinds[int(match[1])] == "pressure":
        return None
    return 1 + sum(kind != "pressure" for kind in kinds[: int(match[1])])
