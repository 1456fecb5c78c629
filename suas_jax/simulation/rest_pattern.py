"""What a skin's model says its taxels read while nothing touches it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.baseline import Baseline


def rest_pattern(skin: Path, like: Baseline) -> NDArray[np.float64]:
    """Model counts at rest [module, taxel], arranged as in a baseline; NaN where unknown.

    The skin is that of a skin file, a scene or a load path; loads are left out.

    Raises:
        ConfigError: the file can't be used.
        ValueError: it has no electrodes.
    """
    from suas_jax.config.schema_scene import SceneSpec
    from suas_jax.runtime.settings import configure
    from suas_jax.scene.solve import solve
    from suas_jax.simulation.load_path import skin_behind

    configure()
    spec = skin_behind(skin)
    tables = {name: getattr(spec, name) for name in type(spec).model_fields}
    report = solve(SceneSpec(**{k: v for k, v in tables.items() if v is not None})).report
    rest = np.full_like(like.so, np.nan)
    if not report.get("taxels"):
        raise ValueError(f"{skin}: no [electrodes]: nothing to compare with")
    for taxel in report["taxels"]:
        row = np.flatnonzero(like.modules == taxel["module"])
        if row.size and taxel["taxel"] <= rest.shape[1]:
            rest[int(row[0]), taxel["taxel"] - 1] = taxel["so"]
    return rest
