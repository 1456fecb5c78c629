"""A law fitted by name, or all laws compared, with the report of the one that is chosen.

Volumetric tests give the bulk modulus beside the law, or alone.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.volumetric import VolumetricTest
from fitting.material.fit.bulk_modulus import (
    BulkModulus,
    compressibility_remark,
    fit_bulk_modulus,
)
from fitting.material.fit.comparison import Comparison, compare_laws
from fitting.material.fit.fit import fit_material
from fitting.material.fit.in_service import compare_with_scene
from fitting.material.fit.prony_terms import choose_prony_terms
from fitting.material.fit.result import MaterialFit
from fitting.material.laws.with_effects import MOST_PRONY_TERMS
from fitting.material.report.summary import material_report

COMPARE_ALL = "auto"
"""Name that stands for the best of all laws."""


class Calibration(NamedTuple):
    """A material's calibration.

    Attributes:
        fit: the law; None where all tests are volumetric.
        bulk: the bulk modulus; None where no test is volumetric.
        report: the JSON of `suas fit material`.
    """

    fit: MaterialFit | None
    bulk: BulkModulus | None
    report: dict[str, Any]


def calibrate(
    sets: Sequence[Dataset],
    law: str = "ogden",
    terms: int | None = None,
    *,
    progress: Callable[[str], None] = lambda title: None,
    scene: Path | None = None,
    prony: int | str = 0,
    **options: Any,
) -> Calibration:
    """Fit a law to data, or compare all laws, and the bulk modulus, and report.

    The law is isochoric and fitted as if the material were incompressible.

    Args:
        sets: the data.
        law: a value of `law` in [material], or "auto".
        terms: number of terms, if the law has any.
        progress: called with the name of the law that is fitted next.
        scene: of a skin in whose stretches a law that is chosen must be stable.
        prony: number of Prony terms, or "auto" for as many as the data determine.
        options: as for `fit_material`.

    Raises:
        ValueError: law, terms or an option are not allowed.
        NoFit: no constants were found.
    """
    volumetric = [data for data in sets if isinstance(data, VolumetricTest)]
    rest = [data for data in sets if not isinstance(data, VolumetricTest)]
    bulk, fit, report = None, None, _report_of_bulk_alone()
    if volumetric:
        bulk = fit_bulk_modulus(
            volumetric,
            options.get("residual", "relative"),
            branch=options.get("branch"),
            cycle=options.get("cycle", "all"),
            thin=options.get("thin", 0),
        )
    if rest or not volumetric:
        fit, report = _calibrated(
            rest, law, terms, progress=progress, scene=scene, prony=prony, **options
        )
    if bulk is not None:
        modulus = None if fit is None else fit.shear_modulus()[0]
        report |= bulk.report(modulus)
        report["modes"]["volumetric"] = bulk.mode_report()
        report["warnings"] += bulk.remarks
        if modulus is not None:
            report["warnings"] += compressibility_remark(bulk, modulus)
    return Calibration(fit, bulk, report)


def _report_of_bulk_alone() -> dict[str, Any]:
    """What every report has, where there is no law."""
    return {"law": None, "status": "converged", "modes": {}, "warnings": []}


def _calibrated(
    sets: Sequence[Dataset],
    law: str,
    terms: int | None,
    *,
    progress: Callable[[str], None],
    scene: Path | None,
    prony: int | str,
    **options: Any,
) -> tuple[MaterialFit, dict[str, Any]]:
    """The law and its report; see `calibrate`."""
    if isinstance(prony, str) or not 0 <= prony <= MOST_PRONY_TERMS:
        if prony != COMPARE_ALL:
            raise ValueError(f"--prony {prony}: allowed: auto, or 0 to {MOST_PRONY_TERMS}")
        if law == COMPARE_ALL:
            raise ValueError("--prony auto: name the law, or the number of terms")
        return _recommended(choose_prony_terms(sets, law, terms, progress, **options))
    options["prony"] = prony
    if law != COMPARE_ALL:
        progress(law)
        fit = fit_material(sets, law, terms, **options)
        return fit, material_report(fit)
    if terms is not None:
        raise ValueError("--terms: --law auto chooses the number of terms itself")
    if options.pop("bounds", None):
        raise ValueError("--bound: name the law whose constants are bounded")

    def refuses(fit: MaterialFit) -> str:
        assert scene is not None
        summary, _ = compare_with_scene(fit, scene)
        if summary["material_stable"] is False:
            return f"unstable in {scene}"
        return ""

    comparison = compare_laws(
        sets, progress=progress, refuses=None if scene is None else refuses, **options
    )
    return _recommended(comparison)


def _recommended(comparison: Comparison) -> tuple[MaterialFit, dict[str, Any]]:
    """The best of several fits, and its report with what was rejected and why."""
    best = comparison.best
    reasons = comparison.against(best)
    if reasons:
        text = f"no law is without objection; against {best.family.title}: {'; '.join(reasons)}"
        best = dataclasses.replace(best, remarks=(*best.remarks, text))
    report = material_report(best)
    report["candidates"] = comparison.table
    report["candidates_failed"] = comparison.failed
    report["effective_readings"] = comparison.effective_number
    return best, report
