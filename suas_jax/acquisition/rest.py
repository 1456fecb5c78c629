"""What a skin's model says its taxels read while nothing touches it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.baseline import Baseline


def rest_pattern(skin: Path, like: Baseline) -> NDArray[np.float64]:
    """Model counts at rest [module, taxel], arranged as in a baseline; NaN where unknown.

    Raises:
        ConfigError: the skin file can't be used.
        ValueError: it has no electrodes.
    """
    from suas_jax.config import scene_from_dict
    from suas_jax.runtime import configure
    from suas_jax.solve import solve

    configure()
    report = solve(scene_from_dict({"skin": str(skin.resolve())})).report
    rest = np.full_like(like.so, np.nan)
    if not report.get("taxels"):
        raise ValueError(f"{skin}: no [electrodes]: nothing to compare with")
    for taxel in report["taxels"]:
        row = np.flatnonzero(like.modules == taxel["module"])
        if row.size and taxel["taxel"] <= rest.shape[1]:
            rest[int(row[0]), taxel["taxel"] - 1] = taxel["so"]
    return rest
