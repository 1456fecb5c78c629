"""Plausibility limits of known inputs, which catch mixed-up units."""

import numpy as np

from fitting.sensor.logs.known_inputs import Known
from suas_jax.config import SkinSpec, format_quantity


def check_known(spec: SkinSpec, known: Known, where: str) -> None:
    """Refuse values that the skin can't take: units mixed up, more often than not."""
    geometry = spec.geometry
    loads = sorted({load for load, _ in known.values})
    if loads != list(range(len(loads))):
        raise ValueError(f"{where}: loads are numbered from 0 without a hole; found {loads}")
    for load in loads:
        have = {q for k, q in known.values if k == load}
        pushed = have & {"force", "displacement", "inner_displacement"}
        if not pushed:
            raise ValueError(
                f"{where}: load {load} has no force and no displacement; add "
                f"load_{load}_force_N or load_{load}_displacement_mm"
            )
        if "angle" not in have:
            raise ValueError(
                f"{where}: load {load} has no angle; add a column load_{load}_angle_deg, or "
                f'a header line "# load_{load}_angle_deg: 0"'
            )
    limits: dict[str, tuple[float, str]] = {
        "angle": (geometry.half_angle, format_quantity(geometry.half_angle, "angle")),
        "displacement": (
            1.2 * geometry.oil_gap,
            f"the oil gap, {format_quantity(geometry.oil_gap, 'length')}",
        ),
    }
    limits["inner_displacement"] = limits["displacement"]
    dimensions = {"angle": "angle"}
    for (load, quantity), values in known.values.items():
        if quantity not in limits:
            continue
        limit, text = limits[quantity]
        worst = float(np.nanmax(np.abs(values), initial=0.0))
        if worst >= limit:
            shown = format_quantity(worst, dimensions.get(quantity, "length"))  # type: ignore[arg-type]
            raise ValueError(
                f"{where}, {known.names[load, quantity]}: {shown} is beyond what the skin "
                f"allows ({text}): check the unit in the column's name"
            )
