"""The JSON of `suas fit material`, with warnings of what to doubt in a fit."""

from typing import Any

import numpy as np

from fitting.material.experiments.free_zero import can_be_freed
from fitting.material.experiments.history import HistoryTest
from fitting.material.experiments.measurements import PATHS
from fitting.material.experiments.skin_readings import SkinTest
from fitting.material.fit.band import asked_stretches
from fitting.material.fit.preparation import window_of
from fitting.material.fit.result import MaterialFit
from fitting.material.fit.suspects import zero_in_units, zeros_of
from fitting.material.laws.blocks import Relaxation, Softening, TestZeros
from fitting.material.laws.parameters import block_of
from fitting.material.report.skin_inputs import inputs_report
from fitting.report.description import percent_text

_FAR = 0.3  # of the logarithm of the largest stretch
_UNKNOWN = 0.3
_LEVELS = (("68", 0.6827), ("95", 0.95))
# What a law becomes where a constant has no upper limit.
_LIMITS = {("gent", "Jm"): "neo-Hookean", ("arruda-boyce", "lambda_m"): "neo-Hookean"}


def material_report(fit: MaterialFit) -> dict[str, Any]:
    """The JSON of `suas fit material`."""
    family, judged = fit.family, fit.uncertainty
    aicc, bic = fit.criteria
    size = family.law_size
    stable = fit.stable
    prediction = prediction_report(fit)
    unknown_modes, extrapolated = _doubts_about_modes(prediction, compared=bool(fit.others))
    report: dict[str, Any] = {
        "law": family.law_name,
        "parameters": family.tree(map(float, fit.constants)),
        "units": family.tree(family.units),
        "standard_errors": family.tree(map(float, judged.standard_errors)),
        "covariance": judged.covariance[:size, :size].tolist(),
        "covariance_order": list(family.names[:size]),
        "correlation": judged.correlation[:size, :size].tolist(),
        "intervals": {
            name: family.tree(fit.intervals(level).T.tolist()) for name, level in _LEVELS
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
        "prediction": prediction,
        "starts": fit.starts,
        "starts_converged": int(fit.minima.converged.sum()),
        "starts_agreeing": fit.minima.agreeing,
        "warnings": [*fit.remarks, *_doubts(fit), *extrapolated],
        "status": fit.status,
    }
    report |= effects_report(fit)
    if fit.specimens is not None:
        report["specimens"] = fit.specimens.report(fit.shear_modulus()[0])
    report |= dict(family.settings)
    if inputs := inputs_report(fit):
        report["skin_inputs"] = inputs
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
    tests = [data for data in fit.sets if can_be_freed(data)]
    found = []
    values, errors = fit.constants[place], fit.uncertainty.standard_errors[place]
    # In the order of `zeros_of`.
    order = zeros_of(tests, tuple(dict.fromkeys(zeros.kinds)))
    for zero, name, value, error in zip(order, zeros.labels, values, errors, strict=True):
        data = tests[zero.test]
        amount, accuracy, unit = zero_in_units(zero.kind, float(value), float(error), data)
        named = {"name": name, "kind": zero.kind, "file": data.file}
        found.append({**named, "value": amount, "standard_error": accuracy, "unit": unit})
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
    """Misfit of each mode; of a skin's tests that of each quantity that was read."""
    report: dict[str, dict[str, Any]] = {}
    triples = list(zip(fit.sets, fit.misfits(), fit.problem.floors, strict=True))
    for mode in dict.fromkeys(data.mode for data in fit.sets):
        own = [(data, error, floor) for data, error, floor in triples if data.mode == mode]
        errors, relative = [], []
        for data, error, floor in own:
            size = np.maximum(data.own_size(), floor)
            errors.append(error)
            relative.append(error / np.where(size > 0.0, size, np.max(size) or 1.0))
        whole = np.concatenate(errors)
        report[mode] = {
            "rms_MPa": 1e-6 * _rms(whole),
            "relative_rms": _rms(np.concatenate(relative)),
            "n": len(whole),
        }
        skins = [(data, error) for data, error, _ in own if isinstance(data, SkinTest)]
        for channel, _, _, key in skins[0][0].READS if skins else ():
            report[mode].pop("rms_MPa", None)
            read = np.concatenate([error[data.channel == channel] for data, error in skins])
            if read.size:
                report[mode][key] = _rms(read)
    return report


def _rivals(fit: MaterialFit) -> list[str]:
    if not fit.rivals:
        return []
    everything = np.stack([fit.constants, *fit.rivals])
    ends = zip(everything.min(axis=0), everything.max(axis=0), strict=True)
    named = zip(fit.family.names, fit.family.units, ends, strict=True)
    parts = [
        f"{name} from {low:.4g} to {high:.4g} {unit}".rstrip(" 1")
        for name, unit, (low, high) in named
    ]
    return [
        f"{len(everything)} different minima fit as well within the noise: " + ", ".join(parts)
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
    return doubts + _doubts_about_loading(fit) + fit.instabilities()


def _doubts_about_loading(fit: MaterialFit) -> list[str]:
    """Tests that do not show how their strain was reached, where that bears on relaxation."""
    series = block_of(fit.family, Relaxation)
    held = (x for x in fit.sets if isinstance(x, HistoryTest) and x.is_loaded_at_once)
    files = ", ".join(dict.fromkeys(test.file for test in held))
    if series is None or not files:
        return []
    fastest = float(fit.constants[series[1]][series[0].count :].min())
    return [
        f"{files}: the strain is held from the first reading on, and taken as reached at once; "
        f"a loading of {fastest / 10:.2g} s makes the share of tau = {fastest:.3g} s 5 % too "
        f'small: say how long it took (--specimen "ramp={fastest / 10:.2g} s")'
    ]


def prediction_report(fit: MaterialFit) -> dict[str, Any]:
    """The 95 % band of every mode, measured or not, averaged over the laws."""
    found: dict[str, Any] = {"laws": fit.belief.weights(), "modes": {}}
    for mode in PATHS:
        band = fit.predict(mode, asked_stretches(fit, mode, fit.up_to))
        found["modes"][mode] = {
            "measured": mode in fit.belief.measured,
            "stretch": band.stretch.tolist(),
            "nominal_Pa": band.nominal.tolist(),
            "low95_Pa": (band.nominal - band.half_width).tolist(),
            "high95_Pa": (band.nominal + band.half_width).tolist(),
            "law_Pa": band.law.tolist(),
        }
    return found


def _doubts_about_modes(
    prediction: dict[str, Any], *, compared: bool
) -> tuple[list[str], list[str]]:
    """Modes of which little is known, and warnings about those that were not measured.

    `compared`: the law is the best of several.
    """
    unknown, parts, off = [], [], []
    for mode, band in prediction["modes"].items():
        if band["measured"]:
            continue
        rows = np.array([band[x] for x in ("stretch", "nominal_Pa", "high95_Pa", "law_Pa")])
        # Nearer to rest where a test begins is most of its reading, and tells of no rubber.
        far = np.abs(np.log(rows[0]))
        stretch, middle, high, law = rows[:, far > _FAR * far.max()]
        half = (high - middle) / np.maximum(np.abs(middle), 1e-300)
        worst, at = float(np.max(half)), float(stretch[int(np.argmax(half))])
        amount = f"+-{percent_text(worst)}" if worst < 10.0 else "no useful accuracy"
        parts.append(f"{mode} to {amount} (at a stretch of {at:.4g})")
        if not worst < _UNKNOWN:
            unknown.append(
                f"{mode} stress: not measured, and known to {amount} only (95 %, at a stretch "
                f"of {at:.4g})"
            )
        outside = np.abs(law - middle) > high - middle
        if outside.any():
            ratio = law[outside] / middle[outside]
            most = float(ratio[int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-12)))))])
            off.append(f"{most:.3g} times the middle of the band of {mode}")
    warnings = []
    if parts:
        done = [mode for mode, band in prediction["modes"].items() if band["measured"]]
        warnings.append(
            f"{', '.join(parts)}: not measured, predicted from "
            f"{', '.join(done) or 'other tests'} (95 %){'; measure it' if unknown else ''}"
        )
    if off:
        hint = "; for a skin take a law that stays within the band (--law auto)"
        warnings.append(
            f"the law itself leaves the 95 % band: up to {', '.join(off)}"
            f"{'' if compared else hint}"
        )
    return unknown, warnings


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def effects_report(fit: MaterialFit) -> dict[str, Any]:
    """What is beside the law's constants, with uncertainty; nothing for an elastic law.

    Constants of the law itself are the long-term ones; `instantaneous_parameters` are those of
    a load that is faster than all relaxation.
    """
    report: dict[str, Any] = {}
    if (series := block_of(fit.family, Relaxation)) is not None:
        relaxation, place = series
        first, count = place.start, relaxation.count
        report["relaxation"] = {
            **_block(fit, {"g": (first, count), "tau_s": (first + count, count)}),
            **_ends_of_relaxation(fit, slice(first, first + count)),
            "window_s": list(window_of(fit.sets, count)),
        }
    if (softening := block_of(fit.family, Softening)) is not None:
        start = softening[1].start
        names = {"r": (start, 0), "m_Pa": (start + 1, 0), "beta": (start + 2, 0)}
        report["softening"] = _block(fit, names)
    return report


def _block(fit: MaterialFit, places: dict[str, tuple[int, int]]) -> dict[str, Any]:
    """Values, standard errors and intervals of some constants: lists, or numbers for none."""

    def chosen(values: np.ndarray) -> dict[str, Any]:
        return {
            key: values[at : at + count].tolist() if count else values[at].tolist()
            for key, (at, count) in places.items()
        }

    return {
        **chosen(fit.constants),
        "standard_errors": chosen(fit.uncertainty.standard_errors),
        "intervals": {name: chosen(fit.intervals(level).T) for name, level in _LEVELS},
    }


def _ends_of_relaxation(fit: MaterialFit, place: slice) -> dict[str, Any]:
    """Long-term share and instantaneous modulus, with 95 % intervals normal in logarithms.

    `place`: of the shares among its constants.
    """
    family = fit.family
    shares = np.zeros(family.size, dtype=bool)
    shares[place] = True
    share = 1.0 - float(fit.constants[shares].sum())
    long_term, low, high = fit.shear_modulus()
    slope_of_share = np.where(shares, -1.0 / share, 0.0)
    slope_of_modulus = fit.modulus_slope() / long_term - slope_of_share
    quantile = fit.uncertainty.quantile(0.95)

    def around(value: float, slope: np.ndarray) -> dict[str, float]:
        half = float(fit.uncertainty.spread_of(slope)) * quantile
        factor = float(np.exp(min(half, 700.0)))
        return {"value": value, "low95": value / factor, "high95": value * factor}

    instantaneous = np.where(family.stresses, fit.constants / share, fit.constants)
    return {
        "long_term_share": around(share, slope_of_share),
        "long_term_shear_modulus_Pa": {"value": long_term, "low95": low, "high95": high},
        "instantaneous_shear_modulus_Pa": around(long_term / share, slope_of_modulus),
        "instantaneous_parameters": family.tree(map(float, instantaneous)),
    }
