"""A material fit in words and tables, for a terminal and for a page."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from fitting.material.cards.card import card
from fitting.material.experiments.measurements import StressTest
from fitting.material.experiments.scatter import TIMES_SCATTER
from fitting.material.fit.result import MaterialFit
from fitting.material.report.skin_inputs import described_inputs
from fitting.report.description import (
    Headline,
    Part,
    Remark,
    ReportTable,
    percent_text,
    print_parts,
    quantity_text,
)
from suas_jax.acquisition.terminal import new_console
from suas_jax.config.schema_scene import LAWS


def print_report(report: dict[str, Any], fit: MaterialFit | None) -> None:
    """Print what was found, and the [material] table.

    `fit`: the fit it came from; None where only a bulk modulus was fitted.
    """
    console = new_console(highlight=False)
    print_parts(console, described(report, fit))
    if fit is not None and fit.family.law_name in LAWS:
        console.print("\n" + card(fit.material(), "toml"), markup=False, soft_wrap=True)


def described(report: dict[str, Any], fit: MaterialFit | None) -> list[Part]:
    """The report in parts; see `print_report`."""
    parts = [] if fit is None else [*_law(report, fit)]
    if "bulk_modulus_Pa" in report:
        parts += _bulk_modulus(report)
    return parts + [Remark(text, "warning") for text in report["warnings"]]


def _bulk_modulus(report: dict[str, Any]) -> Iterator[Part]:
    """The bulk modulus, its energy, and how closely it follows the tests."""
    found, about = report["bulk_modulus_Pa"], report["volumetric"]
    mode = report["modes"]["volumetric"]
    error = quantity_text(about["standard_error_Pa"], "Pa")
    yield Remark(
        f"bulk modulus K {quantity_text(found['value'], 'Pa')} +- {error} "
        f"(95 %: {_span((found['low95'], found['high95']), 'Pa')}), energy {about['energy']}, "
        f"{mode['n']} readings, relative RMS {100.0 * mode['relative_rms']:.3g} %"
    )
    if about["poisson_ratio"] is not None:
        yield Remark(
            f"Poisson's ratio {about['poisson_ratio']:.6f}; the law is fitted as if it were 1/2"
        )


def _law(report: dict[str, Any], fit: MaterialFit) -> Iterator[Part]:
    """The law: constants, modes, comparison, and what the data leave open."""
    yield Headline(
        fit.status,
        f"{fit.family.title}: {report['starts_agreeing']} of the best {len(fit.minima.cost)} "
        f"of {fit.starts} starts agree",
        fit.status == "converged",
    )
    yield _constants(fit)
    if relaxation := report.get("relaxation"):
        modulus = quantity_text(relaxation["instantaneous_shear_modulus_Pa"]["value"], "Pa")
        share = relaxation["long_term_share"]["value"]
        yield Remark(
            f"the law's constants are the long-term ones; the instantaneous shear modulus is "
            f"{modulus}, the long-term share {share:.4g}"
        )
    yield _modes(report)
    yield from described_inputs(report.get("skin_inputs", []))
    yield _prediction(report["prediction"])
    criteria = ""
    if "candidates" in report:
        yield _candidates(report)
    else:
        criteria = f"AICc {report['aicc']:.2f}, BIC {report['bic']:.2f}, "
    kind = report["residual"]["kind"]
    floor = f", {_floors(fit)}" if kind == "relative" else ""
    condition = f"condition number {report['condition_number']:.3g}"
    yield Remark(f"{criteria}residuals {kind}{floor}, {condition}")
    if "posterior" in report:
        yield from _posterior(report["posterior"], fit)
    if "specimens" in report:
        yield from _specimens(report["specimens"])
    for zero in report["zeros"]:
        error = f"{zero['standard_error']:.2g} {zero['unit']}"
        yield Remark(f"{zero['name']} of {zero['file']}: {zero['value']:.4g} +- {error}")
    for label, key in (("at a limit", "at_limits"), ("not determined", "unidentifiable")):
        for text in report[key]:
            yield Remark(text, label)


def _floors(fit: MaterialFit) -> str:
    """Sizes that relative residuals are compared with at least."""
    noisy = [
        f"{data.file}: {data.floor / 1e6:.2g} MPa"
        for data in fit.sets
        if isinstance(data, StressTest) and data.floor > data.least_floor
    ]
    least = "floor 1 % of each file's median"
    if not noisy:
        return least
    return f"{least}, or {TIMES_SCATTER:.0f} times its scatter near rest ({', '.join(noisy)})"


def _constants(fit: MaterialFit) -> ReportTable:
    ends, errors = fit.intervals(0.95).T, fit.uncertainty.standard_errors
    named = zip(fit.family.names, fit.family.units, fit.constants, errors, ends, strict=True)
    rows = [
        (name, quantity_text(value, unit), quantity_text(error, unit), _span(interval, unit))
        for name, unit, value, error, interval in named
    ]
    modulus, *interval = fit.shear_modulus()
    rows.append(("shear modulus", quantity_text(modulus, "Pa"), "", _span(interval, "Pa")))
    names = ("constant", "value", "standard error", "95 % interval")
    return ReportTable("Constants", names, rows)


def _modes(report: dict[str, Any]) -> ReportTable:
    """Misfit of each mode where it was measured, and the stretches of stability."""
    rows = []
    for mode in {**report["modes"], **report["stable_range"]}:
        found = report["modes"].get(mode, {})
        points = str(found.get("n", "not measured"))
        rms = quantity_text(1e6 * found["rms_MPa"], "Pa") if "rms_MPa" in found else ""
        relative = f"{100.0 * found['relative_rms']:.3g} %" if found else ""
        window = ""
        if mode in report["stable_range"]:
            low, high = (f"{end:.3f}" for end in report["stable_range"][mode])
            window = {
                (True, True): "all",
                (False, True): f"above {low}",
                (True, False): f"below {high}",
            }.get(tuple(report["stable_range_open"][mode]), f"{low} to {high}")
        rows.append((mode, points, rms, relative, window))
    names = ("mode", "points", "RMS", "relative RMS", "stable for stretches")
    return ReportTable("Modes and windows of stability", names, rows)


def _prediction(prediction: dict[str, Any]) -> ReportTable:
    """Nominal stress of each mode half the way and all the way that is asked for."""
    rows = []
    for mode, band in prediction["modes"].items():
        name = mode if band["measured"] else f"{mode} (not measured)"
        log = np.log(band["stretch"])
        for i in (int(np.argmin(np.abs(log - 0.5 * log[-1]))), len(log) - 1):
            middle, high = band["nominal_Pa"][i], band["high95_Pa"][i]
            share = (high - middle) / max(abs(middle), 1e-300)
            law = quantity_text(band["law_Pa"][i], "Pa")
            stress = f"{quantity_text(middle, 'Pa')} ± {percent_text(share)}"
            rows.append((name, f"{band['stretch'][i]:.4g}", stress, law))
            name = ""
    names = ("mode", "stretch", "nominal stress (95 %)", "law alone")
    return ReportTable("Prediction, averaged over laws", names, rows)


def _candidates(report: dict[str, Any]) -> ReportTable:
    rows = []
    for row in report["candidates"]:
        criteria = (f"{row[key]:.2f}" for key in ("aicc", "delta_aicc"))
        rows.append(
            (row["title"], str(row["constants"]), *criteria, "; ".join(row["rejected"]))
        )
    rows += [(name, "", "", "", why) for name, why in report["candidates_failed"].items()]
    names = ("law", "constants", "AICc", "above best", "rejected because")
    chosen = next(i for i, row in enumerate(report["candidates"]) if row["chosen"])
    return ReportTable("Comparison", names, rows, chosen)


def _specimens(found: dict[str, Any]) -> Iterator[Part]:
    """Stiffness of each specimen, and the scatter between them."""
    rows = []
    for one in found["specimens"]:
        name = f"{one['file']} {one['specimen']}".strip()
        modulus = quantity_text(one["shear_modulus_Pa"], "Pa")
        error = f"{100.0 * one['standard_error'] / one['factor']:.2g} %"
        rows.append((name, one["mode"], modulus, error))
    names = ("specimen", "mode", "shear modulus", "standard error")
    yield ReportTable("Specimens", names, rows)
    low, high = found["relative_scatter_95"]
    yield Remark(
        f"scatter between specimens {100.0 * found['relative_scatter']:.2g} % "
        f"({100.0 * low:.2g} to {100.0 * high:.2g} %); a further specimen has a shear modulus "
        f"of {_span(found['next_specimen_95_Pa'], 'Pa')} (95 %)"
    )


def _posterior(posterior: dict[str, Any], fit: MaterialFit) -> Iterator[Part]:
    """Quantiles of the samples, what was assumed, and whether to trust them."""
    yield Headline("posterior", posterior["message"], posterior["converged"])
    if "parameters" not in posterior:
        return
    columns = []  # values by constant, in the order of the family
    for tree in (posterior["parameters"], *posterior["intervals"].values()):
        paths = (name.partition(".") for name in fit.family.names)
        columns.append([tree[key][int(i)] if i else tree[key] for key, _, i in paths])
    rows = [
        (name, quantity_text(middle, unit), *(_span(ends, unit) for ends in intervals))
        for name, unit, middle, *intervals in zip(
            fit.family.names, fit.family.units, *columns, strict=True
        )
    ]
    modulus = posterior["shear_modulus_Pa"]
    spans = [_span((modulus[f"low{p}"], modulus[f"high{p}"]), "Pa") for p in ("68", "95")]
    rows.append(("shear modulus", quantity_text(modulus["median"], "Pa"), *spans))
    if "noise" in posterior:
        noise = posterior["noise"]
        spans = [f"{low:.3g} to {high:.3g}" for low, high in (noise["68"], noise["95"])]
        rows.append(("noise (of residuals)", f"{noise['median']:.3g}", *spans))
    names = ("constant", "median", "68 % interval", "95 % interval")
    yield ReportTable("Posterior", names, rows)
    for name, prior in posterior["priors"].items():
        yield Remark(f"prior of {name}: {prior}")
    for text in posterior["warnings"]:
        yield Remark(text, "warning")
    for text in posterior["prior_dominated"]:
        yield Remark(text, "prior, not data")
    yield Remark(posterior["agreement"]["message"])


def _span(ends: Iterable[float], unit: str) -> str:
    return " to ".join(quantity_text(end, unit) for end in ends)
