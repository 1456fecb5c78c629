"""The JSON of `suas fit sensor`."""

import dataclasses
from typing import Any

import numpy as np

from fitting.sensor.fit.result import SensorFit
from fitting.sensor.model.constants import PATHS
from suas_jax.sensing.taxels import taxel_names


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
