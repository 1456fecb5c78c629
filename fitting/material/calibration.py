"""A law fitted by name, or all laws compared, with the report of the one that is chosen."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.comparison import Comparison, compare_laws
from fitting.material.fit.fit import fit_material
from fitting.material.fit.in_service import compare_with_scene
from fitting.material.fit.prony_terms import choose_prony_terms
from fitting.material.fit.result import MaterialFit
from fitting.material.laws.with_effects import MOST_PRONY_TERMS
from fitting.material.report.summary import material_report

COMPARE_ALL = "auto"
"""Name that stands for the best of all laws."""


def calibrate(
    sets: Sequence[Dataset],
    law: str = "ogden",
    terms: int | None = None,
    *,
    progress: Callable[[str], None] = lambda title: None,
    scene: Path | None = None,
    prony: int | str = 0,
    **options: Any,
) -> tuple[MaterialFit, dict[str, Any]]:
    """Fit a law to data, or compare all laws, and report.

    Args:
        sets: the data.
        law: a value of `law` in [material], or "auto".
        terms: number of terms, if the law has any.
        progress: called with the name of the law that is fitted next.
        scene: of a skin in whose stretches a law that is chosen must be stable.
        prony: number of Prony terms, or "auto" for as many as the data determine.
        options: as for `fit_material`.

    Returns:
        The fit, and the JSON of `suas fit material`.

    Raises:
        ValueError: law, terms or an option are not allowed.
        NoFit: no constants were found.
    """
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
