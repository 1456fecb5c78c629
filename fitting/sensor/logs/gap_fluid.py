"""Fluid in the gap: the oil that is calibrated, or one of known permittivity."""

import numpy as np

from suas_jax.config.oil import FLUIDS

OIL = "oil"


def permittivities(
    column: np.ndarray | None, option: str | None, rows: int, where: str
) -> np.ndarray:
    """Permittivity of the fluid of every frame; NaN where it is the oil to be fitted."""
    texts = np.full(rows, option or OIL, object) if column is None else column
    if column is not None and option is not None:
        raise ValueError(f"{where}: the log names its fluid itself; leave --fluid out")
    found = np.empty(rows)
    cache: dict[str, float] = {}
    for i, text in enumerate(texts):
        if text not in cache:
            cache[text] = _permittivity(str(text), where)
        found[i] = cache[text]
    return found


def _permittivity(text: str, where: str) -> float:
    name = text.strip().lower() or OIL
    if name == "air":
        return FLUIDS["air"]
    if name == OIL or name in FLUIDS:
        return np.nan
    try:
        value = float(name)
    except ValueError:
        value = 0.0
    if not value >= 1.0:
        raise ValueError(
            f'{where}, fluid "{text}": allowed: air, oil (its permittivity is fitted), '
            f"{', '.join(n for n in FLUIDS if n != 'air')} (likewise), or the fluid's known "
            "relative permittivity"
        )
    return value


def fluid_name(permittivity: float) -> str:
    """Name of the fluid of a permittivity; NaN is the oil."""
    if np.isnan(permittivity):
        return OIL
    return "air" if permittivity == FLUIDS["air"] else f"{permittivity:g}"
