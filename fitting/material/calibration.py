"""A law fitted by name, or all laws compared, with the report of the one that is chosen.

Volumetric tests give the bulk modulus beside the law, or alone.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.volumetric import VolumetricTest
from fitting.material.fit.bulk_modulus import (
    BulkModulus,
    compressibility_remark,
    fit_bulk_modulus,
)
from fitting.material.fit.comparison import Comparison, choose_prony_terms, compare_laws
from fitting.material.fit.fit import fit_material
from fitting.material.fit.result import MaterialFit
from fitting.material.laws.blocks import MOST_PRONY_TERMS
from fitting.material.report.summary import material_report
from suas_jax.config import SceneSpec, load_scene

COMPARE_ALL = "auto"
"""Name that stands for the best of all laws."""


class Calibration(NamedTuple):
    """A material's calibration."""

    fit: MaterialFit | None  # the law; None where all tests are volumetric
    bulk: BulkModulus | None  # the bulk modulus; None where no test is volumetric
    report: dict[str, Any]  # the JSON of `suas fit material`


def calibrate(
    sets: Sequence[Dataset],
    law: str = "ogden",  # a value of `law` in [material], or "auto"
    terms: int | None = None,
    *,
    progress: Callable[[str], None] = lambda title: None,
    scene: Path | None = None,
    up_to: float | None = None,
    prony: int | str = 0,  # number of Prony terms, or "auto" for as many as the data determine
    **options: Any,
) -> Calibration:
    """Fit a law to data, or compare all laws, and the bulk modulus, and report.

    The law is isochoric and fitted as if the material were incompressible.

    `progress`: called with the name of the law that is fitted next. `scene`: of a skin in whose
    stretches a law that is chosen must be stable; the prediction tells of them. `up_to`:
    largest stretch that the prediction tells of; None for that of the scene, or of the data.
    Raises ValueError: law, terms or an option are not allowed; NoFit: no constants were found.
    """
    if up_to is not None and not up_to > 1.0:
        raise ValueError(
            f"--up-to {up_to:g}: a stretch greater than 1 is expected, such as 1.2"
        )
    volumetric = [data for data in sets if isinstance(data, VolumetricTest)]
    rest = [data for data in sets if not isinstance(data, VolumetricTest)]
    bulk, fit = None, None
    # What every report has, where there is no law.
    report: dict[str, Any] = {"law": None, "status": "converged", "modes": {}, "warnings": []}
    if volumetric:
        bulk = fit_bulk_modulus(
            volumetric,
            options.get("residual", "relative"),
            branch=options.get("branch"),
            cycle=options.get("cycle", "all"),
            cut_spikes=options.get("cut_spikes", False),
            thin=options.get("thin") or 0,
        )
    if rest or not volumetric:
        choice = (prony, progress, scene, up_to)
        fit, comparison = _calibrated(rest, law, terms, *choice, **options)
        reached: dict[str, Any] | None = None
        remarks: list[str] = []
        if scene is not None:
            progress("solving the scene")
            reached, remarks = compare_with_scene(fit, scene)
            if up_to is None and reached["stretch_max"] is not None:
                up_to = max(reached["stretch_max"], 1.0 / reached["stretch_min"])
        fit = dataclasses.replace(fit, up_to=up_to)
        report = material_report(fit)
        if comparison is not None:
            report |= {
                "candidates": comparison.table,
                "candidates_failed": comparison.failed,
                "effective_readings": comparison.effective_number,
            }
        if reached is not None:
            report["scene"] = reached
            report["warnings"] += remarks
    if bulk is not None:
        modulus = None if fit is None else fit.shear_modulus()[0]
        report |= bulk.report(modulus)
        report["modes"]["volumetric"] = bulk.mode_report()
        report["warnings"] += bulk.remarks
        if modulus is not None:
            report["warnings"] += compressibility_remark(bulk, modulus)
    return Calibration(fit, bulk, report)


def _calibrated(
    sets: Sequence[Dataset],
    law: str,
    terms: int | None,
    prony: int | str,
    progress: Callable[[str], None],
    scene: Path | None,
    up_to: float | None,
    **options: Any,
) -> tuple[MaterialFit, Comparison | None]:
    """The law, and what it was chosen from; see `calibrate`."""
    if isinstance(prony, str) or not 0 <= prony <= MOST_PRONY_TERMS:
        if prony != COMPARE_ALL:
            raise ValueError(f"--prony {prony}: allowed: auto, or 0 to {MOST_PRONY_TERMS}")
        if law == COMPARE_ALL:
            raise ValueError("--prony auto: name the law, or the number of terms")
        return _recommended(choose_prony_terms(sets, law, terms, progress, **options))
    options["prony"] = prony
    if law != COMPARE_ALL:
        progress(law)
        return fit_material(sets, law, terms, **options), None
    if terms is not None:
        raise ValueError("--terms: --law auto chooses the number of terms itself")
    if options.pop("bounds", None):
        raise ValueError("--bound: name the law whose constants are bounded")

    def refuses(fit: MaterialFit) -> str:
        unstable = scene and compare_with_scene(fit, scene)[0]["material_stable"] is False
        return f"unstable in {scene}" if unstable else ""

    return _recommended(
        compare_laws(sets, None, progress, refuses if scene else None, up_to, **options)
    )


def _recommended(comparison: Comparison) -> tuple[MaterialFit, Comparison]:
    """The best of several fits, which the others are kept beside for its predictions."""
    best = comparison.best
    others = tuple(fit for fit in comparison.fits if fit is not best)
    remarks = best.remarks
    if reasons := comparison.against(best):
        against = f"{best.family.title}: {'; '.join(reasons)}"
        remarks = (*remarks, f"something speaks against every law; against {against}")
    return dataclasses.replace(best, remarks=remarks, others=others), comparison


def with_material(scene: SceneSpec, fit: MaterialFit) -> SceneSpec:
    """The scene with the fitted law as its membrane's."""
    fields = {key: getattr(scene, key) for key in type(scene).model_fields}
    fields["material"] = fit.material()
    return type(scene).model_construct(scene.model_fields_set, **fields)


def compare_with_scene(fit: MaterialFit, path: Path) -> tuple[dict[str, Any], list[str]]:
    """Solve a scene with the fitted law and compare its stretches with the fit's range.

    A skin is in plane strain, so its stretches are those of pure shear. Returns the stretches
    reached, and warnings.
    Raises ValueError: the law is none of those that a skin can have.
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
