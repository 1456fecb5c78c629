"""The JSON of `suas fit material`, with warnings of what to doubt in a fit."""

import dataclasses
from typing import Any

import numpy as np

from fitting.material.experiments.free_zero import can_be_freed
from fitting.material.experiments.measurements import PATHS
from fitting.material.experiments.skin_readings import DISPLACEMENT, PRESSURE, SkinTest
from fitting.material.fit.result import MaterialFit
from fitting.material.fit.suspects import zero_in_units, zeros_of
from fitting.material.laws.blocks import TestZeros, block_of
from fitting.material.report.effects import effects_report

_EQUIBIAXIAL_TESTS = frozenset(["balloon", "bulge"])
_UNKNOWN = 0.3
# What a law becomes where a constant has no upper limit.
_LIMITS = {("gent", "Jm"): "neo-Hookean", ("arruda-boyce", "lambda_m"): "neo-Hookean"}


def material_report(fit: MaterialFit) -> dict[str, Any]:
    """The JSON of `suas fit material`."""
    family, judged = fit.family, fit.uncertainty
    aicc, bic = fit.criteria
    size = family.law_size
    stable = fit.stable
    unknown_modes, extrapolated = _extrapolations(fit)
    report: dict[str, Any] = {
        "law": family.law_name,
        "parameters": family.tree(map(float, fit.constants)),
        "units": family.tree(family.units),
        "standard_errors": family.tree(map(float, judged.standard_errors)),
        "covariance": judged.covariance[:size, :size].tolist(),
        "covariance_order": list(family.names[:size]),
        "correlation": judged.correlation[:size, :size].tolist(),
        "intervals": {
            name: family.tree(fit.intervals(level).T.tolist())
            for name, level in (("68", 0.6827), ("95", 0.95))
        },
        "interval_method": fit.interval_ends(0.95).method,
        "at_limits": at_limits(fit),
        "shear_modulus_Pa": dict(
            zip(("value", "low95", "high95"), fit.shear_modulus(), strict=True)
        ),
        "modes": _modes(fit),
        "residual": {
            "kind": fit.problem.kind,
            "cost": fit.cost,
            "noise": judged.noise,
            "model_error": fit.problem.model_error,
            "floor_Pa": {
                data.file: floor
                for data, floor in zip(fit.sets, fit.problem.floors, strict=True)
            },
        },
        "aicc": aicc,
        "bic": bic,
        "condition_number": judged.condition_number,
        "singular_values": judged.singular_values.tolist(),
        "unidentifiable": [*judged.unidentifiable, *_rivals(fit), *unknown_modes],
        "stable_range": {mode: list(ends) for mode, ends in stable.items()},
        "stable_range_open": {mode: list(ends) for mode, ends in fit.stable_open.items()},
        "misfit": fit.misfit.report,
        "noise_model": fit.noise.report(fit.sets) if fit.noise is not None else [],
        "suspects": [suspect.report for suspect in fit.suspects],
        "zeros": zeros_report(fit),
        "starts": fit.starts,
        "starts_converged": int(fit.minima.converged.sum()),
        "starts_agreeing": fit.minima.agreeing,
        "warnings": [*fit.remarks, *_doubts(fit), *extrapolated],
        "status": fit.status,
    }
    report |= effects_report(fit)
    if fit.specimens is not None:
        report["specimens"] = fit.specimens.report(fit.shear_modulus()[0])
    report |= family.settings
    if family.terms is not None:
        report["terms"] = family.terms
    if fit.bounded:
        report["at_bounds"] = list(fit.bounded)
    return report


def zeros_report(fit: MaterialFit) -> list[dict[str, Any]]:
    """Zeros of the tests that were found with the law, in the units of the tests."""
    block = block_of(fit.family, TestZeros)
    if block is None:
        return []
    zeros, place = block
    found = []
    tests = [data for data in fit.sets if can_be_freed(data)]
    wanted = tuple(dict.fromkeys(zeros.kinds))
    values, errors = fit.constants[place], fit.uncertainty.standard_errors[place]
    # In the order of `zeros_of`.
    for i, zero in enumerate(zeros_of(tests, wanted)):
        data = tests[zero.test]
        size = float(values[i]), float(errors[i])
        amount, accuracy, unit = zero_in_units(zero.kind, *size, data)
        found.append(
            {
                "name": zeros.names[i],
                "kind": zero.kind,
                "file": data.file,
                "value": amount,
                "standard_error": accuracy,
                "unit": unit,
            }
        )
    return found


def at_limits(fit: MaterialFit) -> list[str]:
    """Constants whose interval is open, in words: what the law is there."""
    found = fit.interval_ends(0.95)
    texts = []
    for i, (name, unit) in enumerate(zip(fit.family.names, fit.family.units, strict=True)):
        low, high = found.ends[:, i]
        at_low, at_high = found.is_open[:, i]
        shown = "" if unit == "1" else f" {unit}"
        limit = _LIMITS.get((fit.family.law_name, name.split(".")[0]))
        says = f": {fit.family.law_name} is {limit} here" if limit else ""
        if at_low and at_high:
            texts.append(f"{name}: the data exclude no value of it (95 %)")
        elif at_high:
            texts.append(f"{name} > {low:.3g}{shown} (95 %), with no upper limit{says}")
        elif at_low and fit.family.law_name == "ogden":
            texts.append(f"{name} < {high:.3g}{shown} in size (95 %): it may vanish")
        elif at_low:
            texts.append(f"{name} < {high:.3g}{shown} (95 %), with no lower limit")
    return texts


def _modes(fit: MaterialFit) -> dict[str, dict[str, Any]]:
    by_mode: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for data, error, floor in zip(fit.sets, fit.misfits(), fit.problem.floors, strict=True):
        size = np.maximum(data.own_size(), floor)
        size = np.where(size > 0.0, size, np.max(size) or 1.0)
        by_mode.setdefault(data.mode, []).append((error, error / size))
    report: dict[str, dict[str, Any]] = {
        mode: {
            "rms_MPa": 1e-6 * _rms(np.concatenate([e for e, _ in parts])),
            "relative_rms": _rms(np.concatenate([r for _, r in parts])),
            "n": sum(len(e) for e, _ in parts),
        }
        for mode, parts in by_mode.items()
    }
    if "skin" in report:
        del report["skin"]["rms_MPa"]
        channels = [
            (data.channel, error)
            for data, error in zip(fit.sets, fit.misfits(), strict=True)
            if isinstance(data, SkinTest)
        ]
        for channel, key in ((DISPLACEMENT, "rms_m"), (PRESSURE, "rms_Pa")):
            errors = np.concatenate([e[c == channel] for c, e in channels])
            if errors.size:
                report["skin"][key] = _rms(errors)
    return report


def _rivals(fit: MaterialFit) -> list[str]:
    others = fit.rivals
    if not others:
        return []
    everything = np.stack([fit.constants, *others])
    parts = [
        f"{name} from {low:.4g} to {high:.4g} {unit}".rstrip(" 1")
        for name, unit, low, high in zip(
            fit.family.names,
            fit.family.units,
            everything.min(axis=0),
            everything.max(axis=0),
            strict=True,
        )
    ]
    return [
        f"{len(others) + 1} different minima fit as well within the noise: " + ", ".join(parts)
    ]


def _doubts(fit: MaterialFit) -> list[str]:
    doubts = []
    if fit.status == "not_converged":
        doubts.append(
            "no start reached a minimum: constants may improve; use fewer terms, more "
            "--starts, or more data"
        )
    elif fit.status == "single_minimum":
        doubts.append("only one start reached the lowest minimum: use more --starts")
    if fit.misfit.description:
        doubts.append(fit.misfit.description)
    doubts += fit.instabilities()
    return doubts


def _extrapolations(fit: MaterialFit) -> tuple[list[str], list[str]]:
    """Modes that the data leave open, and a warning about all that were not measured.

    The prediction of a mode is as uncertain as its 95 % band, or as far as other
    minima that fit as well predict it, whichever is more.
    """
    modes = {data.mode for data in fit.sets}
    measured = modes & set(PATHS)
    if modes & _EQUIBIAXIAL_TESTS:
        measured.add("equibiaxial")
    missing = [mode for mode in PATHS if mode not in measured]
    if not missing or not all(data.is_curve for data in fit.sets):
        return [], []
    if fit.misfit.significant:
        # A band assumes that the law is right.
        return [
            f"{mode} stress: not measured, and not to be had from a law that does not follow "
            f"the data"
            for mode in missing
        ], [
            f"only {', '.join(sorted(modes))} was measured, and the law does not follow it: "
            f"what it says of {', '.join(missing)} has no known accuracy"
        ]
    largest = float(np.exp(np.asarray(fit.problem.residuals.scales.strain)))
    ends = {"uniaxial": largest, "equibiaxial": np.sqrt(largest), "pure_shear": largest}
    parts, unknown = [], []
    for mode in missing:
        stretch = np.linspace(1.0, ends[mode], 9)[1:]
        band = fit.predict(mode, stretch)
        half = band.half_width
        for other in fit.rivals:
            half = np.maximum(half, np.abs(_nominal(fit, mode, stretch, other) - band.nominal))
        ratio = float(np.max(half / np.maximum(np.abs(band.nominal), 1e-300)))
        amount = f"+-{100.0 * ratio:.2g} %" if ratio < 10.0 else "no useful accuracy"
        parts.append(f"{mode} to {amount} up to a stretch of {ends[mode]:.2f}")
        if not ratio < _UNKNOWN:
            unknown.append(
                f"{mode} stress: not measured, and known to {amount} only (95 %, up to "
                f"a stretch of {ends[mode]:.2f})"
            )
    advice = "measure it" if unknown else "the band assumes that the law itself is right"
    warning = (
        f"only {', '.join(sorted(modes))} was measured, other modes are extrapolated: "
        f"{', '.join(parts)}; {advice}"
    )
    return unknown, [warning]


def _nominal(
    fit: MaterialFit, mode: str, stretch: np.ndarray, constants: np.ndarray
) -> np.ndarray:
    """Nominal stress of a mode for other constants of the law [Pa]."""
    changed = dataclasses.replace(fit, constants=constants)
    return changed.predict(mode, stretch).nominal


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
