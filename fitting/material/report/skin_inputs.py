"""What an indentation curve says of the skin's other inputs, beside its material."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from fitting.material.experiments.indentation_curve import STEPS, ZERO
from fitting.material.experiments.skin_readings import SkinTest
from fitting.material.fit.problem import Residuals
from fitting.material.fit.result import MaterialFit
from fitting.report.description import Part, Remark, ReportTable
from fitting.statistics.residuals import sensitivity

_SHOWN = {"oil.fill": "0.01 %", "geometry.mounting": "0.001 %", ZERO: "0.01 mm"}
_NOTHING = 1e-9


class Effect(NamedTuple):
    """What an error of an input does to the modulus that is fitted without it."""

    modulus_change: float  # of the modulus, relative, by a step of the input
    correlation: float  # of the readings' changes by both
    # standard error of the input in steps, were it free beside the modulus; None where the
    # readings do not feel it
    joint_error: float | None


def effect_of(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"], noise: float) -> Effect:
    """Least squares' answer to an input that is wrong by a step.

    The modulus moves by -(a.b)/(a.a). Were both free, the input would have the standard error
    s / |b - (a.b)/(a.a) a|.

    `a`: change of the weighed residuals by the modulus, relative. `b`: their change by a step
    of the input. `noise`: s, standard deviation of a residual.
    """
    share, size = float(a @ b) / float(a @ a), float(np.linalg.norm(b))
    apart = float(np.linalg.norm(b - share * a))
    whole = float(np.linalg.norm(a))
    if size <= _NOTHING * whole:
        return Effect(0.0, 0.0, None)
    return Effect(-share, float(a @ b) / (whole * size), noise / apart if apart > 0 else None)


def weighed_change(
    residuals: Residuals, place: np.ndarray, slope: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Change of the weighed residuals of one test, at `place` among all, by its readings'."""
    change = np.zeros(len(residuals.value))
    change[place] = slope
    return np.asarray(residuals.weighed(jnp.asarray(change)))[place]


def inputs_report(fit: MaterialFit) -> list[dict[str, Any]]:
    """For every indentation curve and input: what an error of it does to the modulus.

    Returns per entry `file`, `input`, `step` (of filling and mounting as they are, of the
    travel's zero in metres, else relative) and the keys of `Effect`.
    """
    found = []
    constants = jnp.asarray(fit.constants)
    _, J = (np.asarray(x) for x in sensitivity(fit.problem.residuals, constants))
    by_modulus = J @ np.where(fit.family.stresses, fit.constants, 0.0)
    noise = fit.uncertainty.noise * fit.uncertainty.inflation
    for data, place in fit.problem.tests:
        if not isinstance(data, SkinTest):
            continue
        a = by_modulus[place]
        for name, slope in zip(data.as_specimen.inputs, data.as_specimen.slopes.T, strict=True):
            step = STEPS[name]
            b = step * weighed_change(fit.problem.residuals, place, slope)
            effect = effect_of(a, b, noise)
            found.append({"file": data.file, "input": name, "step": step, **effect._asdict()})
    return found


def described_inputs(rows: list[dict[str, Any]]) -> list[Part]:
    """The same in words and as a table."""
    if not rows:
        return []
    table = []
    for row in rows:
        alone = "no effect"
        if row["joint_error"] is not None:
            size = row["joint_error"] * row["step"]
            alone = f"{1e3 * size:.2g} mm" if row["input"] == ZERO else f"{100 * size:.2g} %"
        moved = f"{100 * row['modulus_change']:+.2g} %"
        step = _SHOWN.get(row["input"], "1 %")
        table.append((row["input"], step, moved, f"{row['correlation']:+.3f}", alone))
    names = ("taken as exact", "an error of", "moves the modulus", "correlation", "curve alone")
    return [
        ReportTable("What the modulus of the indentation curve rests on", names, table),
        Remark("the intervals of the constants do not include errors of these inputs"),
    ]
