"""A sensor calibration as JSON, and for people: tables, what is not known, and warnings."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from fitting.report.description import Headline, Part, Remark, ReportTable, quantity_text
from fitting.sensor.fit.result import SensorFit
from fitting.sensor.model.as_built import is_gain, places_of_shifts
from fitting.sensor.model.constants import PATHS, is_press_error
from suas_jax.skin.plain import plain_geometry

_MANY = 10  # channels whose gains are told together, constants whose priors have one reason


def sensor_report(fit: SensorFit) -> dict[str, Any]:
    """Everything that is known after a calibration, SI units."""
    family, judged = fit.family, fit.uncertainty
    names = family.names

    def by_name(values: Any) -> dict[str, Any]:
        return dict(zip(names, values, strict=True))

    modules, numbers = fit.data.spec.sensing.taxel_names
    errors = fit.errors
    rms = float(np.sqrt(np.nanmean(errors**2)))
    held = {
        name: float(fit.problem.model.inputs[path])
        for name, path in PATHS.items()
        if name not in names and path in fit.problem.model.inputs
    }
    report: dict[str, Any] = {
        "parameters": by_name(map(float, fit.constants)),
        "units": by_name(family.units),
        "standard_errors": by_name(map(float, judged.standard_errors)),
        "intervals": {
            name: by_name(
                [
                    [max(float(c - q * e), float(floor)), float(c + q * e)]
                    for c, e, floor in zip(
                        fit.constants, judged.standard_errors, family.floors, strict=True
                    )
                ]
            )
            for name, q in (("68", judged.quantile(0.6827)), ("95", judged.quantile(0.95)))
        },
        "covariance": judged.covariance.tolist(),
        "covariance_order": list(names),
        "correlation": judged.correlation.tolist(),
        "standard_errors_without_priors": by_name(
            [float(x) if np.isfinite(x) else None for x in fit.alone]
        ),
        "held": held,
        "at_bound": list(fit.held),
        "priors": {
            name: {"mean": prior.mean, "sd": prior.sd, "reason": prior.reason}
            for name, prior in fit.priors.items()
        },
        "condition_number": judged.condition_number,
        "singular_values": judged.singular_values.tolist(),
        "unidentifiable": list(fit.findings),
        "what_the_logs_tell": list(fit.contributions),
        "residual": {
            "rms_counts": rms,
            "n": int(np.isfinite(errors).sum()),
            "noise_counts": float(np.nanmedian(fit.noise)),
            "cost": fit.cost,
            "outliers": fit.outliers,
        },
        "misfit": fit.misfit.report,
        "taxels": _taxels(fit, modules, numbers, errors),
        "masked": [dataclasses.asdict(m) for m in fit.masked],
        "logs": [dataclasses.asdict(file) for file in fit.data.files],
        "warnings": list(fit.warnings),
        "status": fit.status,
    }
    if (shift := _place_shift(fit)) is not None:
        report["place_shift"] = shift
    if any(fit.input_errors.noise.deviation.values()):
        report["input_noise"] = fit.input_errors.noise._asdict()
    if fit.force_scatter is not None:
        report["force_scatter"] = fit.force_scatter
    if fit.discrepancy is not None:
        report["discrepancy"] = fit.discrepancy.numbers._asdict()
    if fit.ratio is not None:
        report["permittivity_per_gap"] = {
            "value": fit.ratio[0],
            "standard_error": fit.ratio[1],
            "unit": "1/m",
        }
    return report


def _place_shift(fit: SensorFit) -> dict[str, Any] | None:
    """What presses share of their places, at angles along the arc [rad]; None of other fits."""
    geometry = fit.data.spec.geometry
    nodes = places_of_shifts(geometry)
    shared = fit.place_shift(nodes)
    if shared is None:
        return None
    size = float(plain_geometry(geometry).section.size[0])
    return {
        "angles": nodes.tolist(),
        "value": (size * shared[0]).tolist(),
        "standard_error": (size * np.sqrt(np.diag(shared[1]))).tolist(),
        "unit": "m",
    }


def _taxels(
    fit: SensorFit, modules: tuple[int, ...], numbers: tuple[int, ...], errors: np.ndarray
) -> list[dict[str, Any]]:
    rows = []
    for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
        own = errors[i][np.isfinite(errors[i])]
        row: dict[str, Any] = {
            "module": m,
            "taxel": k,
            "n": len(own),
            "mean_residual_counts": float(own.mean()) if len(own) else None,
            "rms_counts": float(np.sqrt(np.mean(own**2))) if len(own) else None,
            "noise_counts": float(np.nanmedian(fit.noise[i])),
        }
        if fit.offsets is not None:
            row["offset_counts"], row["offset_standard_error"] = map(float, fit.offsets[:, i])
        if fit.drift is not None:
            row["drift_counts_per_s"] = list(map(float, fit.drift[i]))
        rows.append(row)
    return rows


def described(report: dict[str, Any], fit: SensorFit) -> Iterator[Part]:
    """The report in parts."""
    residual = report["residual"]
    yield Headline(
        fit.status,
        f"{residual['n']} readings of {sum(1 for t in report['taxels'] if t['n'])} taxels, RMS "
        f"residual {residual['rms_counts']:.3g} counts, condition number "
        f"{report['condition_number']:.3g}",
        fit.status == "converged",
    )
    rows = []
    # The report has the errors of single presses; a person looks for the skin.
    skin = {k: v for k, v in report["parameters"].items() if not is_press_error(k)}
    gains = [name for name in skin if is_gain(name)]
    if len(gains) > _MANY:
        values = [skin.pop(name) for name in gains]
        typical = float(np.median([report["standard_errors"][name] for name in gains]))
        yield Remark(
            f"gains of {len(gains)} channels: {min(values):.4g} to {max(values):.4g}, median "
            f"standard error {typical:.2g}"
        )
    reasons = {report["priors"].get(name, {}).get("reason") for name in skin}
    alike = reasons.pop() if len(reasons) == 1 and len(skin) > _MANY else None
    for name, value in skin.items():
        unit, error = report["units"][name], report["standard_errors"][name]
        known = report["priors"].get(name)
        numbers = [value, error, *report["intervals"]["95"][name]]
        numbers += [known["mean"], known["sd"]] if known else []
        found, sigma, low, high, *prior = (quantity_text(x, unit, 6) for x in numbers)
        assumed = f"{prior[0]} +- {prior[1]}" if known else "none"
        if known and not alike:
            assumed += f": {known['reason']}"
        rows.append((name, found, sigma, f"{low} to {high}", assumed))
    names = ("constant", "value", "standard error", "95 % interval", "prior")
    yield ReportTable("Constants", names, rows)
    if alike:
        yield Remark(f"all priors are {alike}")
    if ratio := report.get("permittivity_per_gap"):
        error = f"{ratio['standard_error']:.2g}"
        yield Remark(f"permittivity / gap: {ratio['value']:.6g} +- {error} 1/m")
    if shift := report.get("place_shift"):
        value, error = (1e3 * np.array(shift[key]) for key in ("value", "standard_error"))
        yield Remark(
            f"presses were felt {value.min():.2f} to {value.max():.2f} mm further along the "
            f"arc than told (+- {np.median(error):.2f} mm); suas invert takes half of it off "
            "places, and counts half as their error"
        )
    if scatter := report.get("force_scatter"):
        yield Remark(f"forces scatter by {100 * scatter:.2g} % from press to press")
    if lacking := report.get("discrepancy"):
        together, alone = (f"{100 * lacking[key]:.2g} %" for key in ("common", "pattern"))
        yield Remark(
            f"beyond the model: readings err by {together} together and by {alone} one by one; "
            "suas invert takes off what presses show of it"
        )
    if posterior := report.get("posterior"):
        good = posterior["status"] == "converged"
        yield Headline(f"posterior {posterior['status']}", posterior["message"], good)
        for name, value in posterior.get("parameters", {}).items():
            numbers = [value, *posterior["intervals"]["95"][name]]
            middle, low, high = (quantity_text(x, report["units"][name], 6) for x in numbers)
            yield Remark(f"  {name}: {middle}, 95 % from {low} to {high}")
    for text in report["unidentifiable"]:
        yield Remark(text, "not determined")
    left_out: dict[tuple[str, int], list[str]] = {}
    for row in report["masked"]:
        taxel = f"module {row['module']}, taxel {row['taxel']}, {row['frames']} readings"
        left_out.setdefault((row["reason"], row["frames"]), []).append(taxel)
    for (reason, frames), taxels in left_out.items():
        if len(taxels) == len(report["taxels"]):
            taxels = [f"all taxels, {frames} readings each"]
        for taxel in taxels:
            yield Remark(f"left out: {taxel}: {reason}")
    for text in report["warnings"]:
        yield Remark(text, "warning")
