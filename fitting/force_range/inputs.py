"""What the errors of a skin file's inputs do to the force of first contact.

At a force shortly before it, the smallest gap is as uncertain as the inputs leave it; over its
slope by the force, that is the uncertainty of the force at which it closes.
"""

import math

from suas_jax.config import SceneSpec, SkinSpec, input_errors
from suas_jax.config.schema_load import LineLoadSpec
from suas_jax.scene.solve import solve
from suas_jax.scene.uncertainty import uncertainty

_BEFORE, _STEP = 0.9, 0.05  # of the force of first contact


def contact_deviation(spec: SkinSpec, angle: float, force: float) -> float:
    """Standard deviation of the force of first contact, relative; NaN where it is unknown.

    Args:
        spec: the skin.
        angle: of a radial line load [rad].
        force: of first contact [N].
    """
    if not math.isfinite(force):
        return math.nan

    def at(share: float) -> SceneSpec:
        load = LineLoadSpec(kind="line", angle=angle, force=share * force)
        given = {name: getattr(spec, name) for name in spec.model_fields_set}
        return SceneSpec(**given, load=(load,))

    solution, lower = solve(at(_BEFORE)), solve(at(_BEFORE - _STEP))
    if not (solution.converged and lower.converged):
        return math.nan
    sigma = uncertainty(solution, input_errors(solution.scene))["min_gap_m"]
    slope = (solution.report["min_gap_m"] - lower.report["min_gap_m"]) / (_STEP * force)
    return abs(sigma / slope) / force if slope else math.nan
