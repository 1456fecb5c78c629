"""Stretches of a scene under a fitted law, against its data and its stability window."""

from pathlib import Path
from typing import Any

import numpy as np

from fitting.material.fit.result import MaterialFit
from suas_jax.config import SceneSpec, load_scene


def with_material(scene: SceneSpec, fit: MaterialFit) -> SceneSpec:
    """The scene with the fitted law as its membrane's.

    Raises:
        ValueError: the law is none of those that a skin can have.
    """
    fields = {key: getattr(scene, key) for key in type(scene).model_fields}
    return type(scene).model_construct(
        scene.model_fields_set, **{**fields, "material": fit.material()}
    )


def compare_with_scene(fit: MaterialFit, path: Path) -> tuple[dict[str, Any], list[str]]:
    """Solve a scene with the fitted law and compare its stretches with the fit's range.

    A skin is in plane strain, so its stretches are those of pure shear.

    Args:
        fit: the fitted law.
        path: scene file; its own material is replaced.

    Returns:
        The stretches reached, and warnings.
    """
    from suas_jax.scene.solve import solve

    report = solve(with_material(load_scene(path), fit)).report
    low, high = report["stretch_min"], report["stretch_max"]
    stable_low, stable_high = fit.stable["pure_shear"]
    summary = {
        "scene": str(path),
        "status": report["status"],
        "stretch_min": low,
        "stretch_max": high,
        "material_stable": report["material_stable"],
    }
    remarks = []
    if report["status"] != "converged":
        remarks.append(f"{path}: {report['message']}")
    if low is None or high is None:
        return summary, remarks
    if low < stable_low or high > stable_high:
        remarks.append(
            f"{path}: the skin stretches from {low:.3f} to {high:.3f}, the law is stable in "
            f"plane strain from {stable_low:.3f} to {stable_high:.3f}"
        )
    # A stretch and its inverse are the same state of plane strain, seen along the arc and
    # through the thickness.
    needed = max(high, 1.0 / low)
    measured = max(float(np.exp(np.max(np.abs(data.states[0])))) for data in fit.sets)
    if needed > measured:
        remarks.append(
            f"{path}: the skin stretches by up to {needed:.3f}, the data reach {measured:.3f}: "
            f"the law is extrapolated"
        )
    return summary, remarks
