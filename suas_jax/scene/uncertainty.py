"""Standard deviations of reported quantities, from those of a scene's inputs.

To first order, with D the change of the inputs by independent errors, one standard deviation
each, and J the derivatives of a report: sigma^2 = diag(J^T D^T D J). Derivatives along D are
differences of a program that the solution had compiled, on the smallest mesh that it tried:
central, one-sided on pads. A standard deviation is wanted to two digits. The place of an
extreme may jump to another one as large, on the mirrored side of a symmetric skin: the side
of the difference that does is left out.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from suas_jax.config import InputErrors, continuous_inputs
from suas_jax.scene.solve import Solution, report_with

_STEP = 0.01  # of a standard deviation
# What tells how well the solve went, or is not a smooth quantity.
_NO_OUTPUT = frozenset(
    {"volume_residual", "discretisation_error", "model_error", "key_quantities"}
)
_SCALE = "electrodes.lsb"
# Inputs themselves, left out where they are exact.
_PLACES = (".angle_deg", ".arc_m", ".axial_m")
# Places of extremes, and how far a step moves one that has jumped [deg or m].
_EXTREMES = {"_angle_deg": 1.0, "_axial_m": 1e-3, "_arc_m": 1e-3}


def uncertainty(solution: Solution, errors: InputErrors) -> dict[str, float]:
    """Standard deviations of what a converged solution reports, by its inputs' errors.

    Returns values in the units of the keys, by path of the quantity in the report, such as
    ``oil_pressure_Pa`` or ``taxels.3.so``; NaN where a changed skin has no solution.
    """
    known = continuous_inputs(solution.scene)
    own = dict(_quantities(report_with(solution, {}) or {}))
    variance = dict.fromkeys(own, 0.0)
    for direction in errors.directions:
        change = dict(zip(errors.paths, direction.tolist(), strict=True))
        high = _moved(solution, known, change, own, _STEP)
        central = solution.scene.geometry.dimension == 2 or any(
            _jumped(path, high.get(path, math.nan) - value) for path, value in own.items()
        )
        low = _moved(solution, known, change, own, -_STEP) if central else {}
        for path, value in own.items():
            step = up = high.get(path, math.nan) - value
            if central:
                down = value - low.get(path, math.nan)
                jumped = _jumped(path, up) or _jumped(path, down)
                step = min(up, down, key=abs) if jumped else (up + down) / 2
            slope = step / _STEP
            variance[path] += slope**2 + _by_scale(solution, known, change, own, path) ** 2
    return {
        path: math.sqrt(value)
        for path, value in variance.items()
        if value or not path.endswith(_PLACES)
    }


def _jumped(path: str, step: float) -> bool:
    """Whether the place of an extreme is another one after a small step."""
    return any(path.endswith(end) and abs(step) > far for end, far in _EXTREMES.items())


def _moved(
    solution: Solution,
    known: Mapping[str, float],
    change: Mapping[str, float],
    own: dict[str, float],
    size: float,
) -> dict[str, float]:
    """Quantities with the inputs moved along an error."""
    inputs = {path: known[path] + size * by for path, by in change.items() if path in known}
    if not any(inputs[path] != known[path] for path in inputs):
        return own
    return dict(_quantities(report_with(solution, inputs) or {}))


def _by_scale(
    solution: Solution,
    known: Mapping[str, float],
    change: Mapping[str, float],
    own: Mapping[str, float],
    path: str,
) -> float:
    """Change of a reading by the converter's scale, where the file doesn't give it."""
    electrodes = solution.scene.electrodes
    if _SCALE in known or electrodes is None or not path.endswith(".so"):
        return 0.0
    return own[path] * change.get(_SCALE, 0.0) / electrodes.lsb


def _quantities(report: Any, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Paths and values of the numbers of a report; columns over the taxels taxel by taxel."""
    if isinstance(report, Mapping):
        for key, value in report.items():
            if key == "taxels" and not prefix:
                for name, column in value.items():
                    for i, number in enumerate(column):
                        yield f"taxels.{i}.{name}", float(number)
            elif key not in _NO_OUTPUT:
                yield from _quantities(value, f"{prefix}{key}.")
    elif isinstance(report, list | tuple):
        for i, value in enumerate(report):
            yield from _quantities(value, f"{prefix}{i}.")
    elif isinstance(report, float | np.floating) and not isinstance(report, bool):
        yield prefix.removesuffix("."), float(report)
