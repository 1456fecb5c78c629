"""A sensor calibration as JSON, and for people: tables, what is not known, and warnings."""

import dataclasses
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from fitting.sensor.fit.result import SensorFit
from fitting.sensor.model.constants import PATHS
from suas_jax.acquisition.terminal import new_console
from suas_jax.config.quantities import format_quantity
from suas_jax.sensing.taxels import taxel_names

_DIMENSIONS = {"m": "length", "F": "capacitance", "Pa": "stress"}


def sensor_report(fit: SensorFit) -> dict[str, Any]:
    """Everything that is known after a calibration, SI units."""
    family, judged = fit.family, fit.uncertainty
    names = family.names

    def by_name(values: Any) -> dict[str, Any]:
        return dict(zip(names, values, strict=True))

    electrodes = fit.data.spec.electrodes
    assert electrodes is not None
    modules, numbers = taxel_names(electrodes)
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
    if fit.ratio is not None:
        report["permittivity_per_gap"] = {
            "value": fit.ratio[0],
            "standard_error": fit.ratio[1],
            "unit": "1/m",
        }
    return report


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


def print_report(report: dict[str, Any], fit: SensorFit) -> None:
    """Print what was found."""
    console = new_console(highlight=False)
    colour = "green" if fit.status == "converged" else "yellow"
    residual = report["residual"]
    console.print(
        f"[{colour}]{fit.status}[/] {residual['n']} readings of "
        f"{sum(1 for t in report['taxels'] if t['n'])} taxels, RMS residual "
        f"{residual['rms_counts']:.3g} counts, condition number "
        f"{report['condition_number']:.3g}"
    )
    table = Table()
    table.add_column("constant", no_wrap=True)
    for heading in ("value", "standard error", "95 % interval"):
        table.add_column(heading, overflow="fold")
    table.add_column("prior")
    for name, value in report["parameters"].items():
        unit = report["units"][name]
        low, high = report["intervals"]["95"][name]
        prior = report["priors"].get(name)
        table.add_row(
            name,
            _text(value, unit),
            _text(report["standard_errors"][name], unit),
            f"{_text(low, unit)} to {_text(high, unit)}",
            f"{_text(prior['mean'], unit)} +- {_text(prior['sd'], unit)}: {prior['reason']}"
            if prior
            else "none",
        )
    console.print(table)
    ratio = report.get("permittivity_per_gap")
    if ratio:
        console.print(
            f"permittivity / gap: {ratio['value']:.6g} +- {ratio['standard_error']:.2g} 1/m"
        )
    posterior = report.get("posterior")
    if posterior:
        _print_posterior(console, posterior, report["units"])
    for text in report["unidentifiable"]:
        console.print(f"[yellow]not determined:[/] {escape(text)}")
    for row in report["masked"]:
        console.print(
            f"left out: module {row['module']}, taxel {row['taxel']}, {row['frames']} "
            f"readings: {row['reason']}"
        )
    for text in report["warnings"]:
        console.print(f"[yellow]warning:[/] {escape(text)}")


def _print_posterior(
    console: Console, posterior: dict[str, Any], units: dict[str, str]
) -> None:
    colour = "green" if posterior["status"] == "converged" else "yellow"
    console.print(f"posterior: [{colour}]{posterior['status']}[/] {posterior['message']}")
    for name, value in posterior.get("parameters", {}).items():
        low, high = posterior["intervals"]["95"][name]
        unit = units[name]
        console.print(
            f"  {name}: {_text(value, unit)}, 95 % from {_text(low, unit)} to "
            f"{_text(high, unit)}"
        )


def _text(value: float, unit: str) -> str:
    if unit in _DIMENSIONS and abs(value) > 0:
        return format_quantity(value, _DIMENSIONS[unit])  # type: ignore[arg-type]
    return f"{value:.6g}"
