"""Relaxation and softening of a fitted material, as JSON."""

from typing import Any

import numpy as np

from fitting.material.fit.preparation import window_of
from fitting.material.fit.result import MaterialFit
from fitting.material.laws.blocks import Relaxation, Softening, block_of

_LEVELS = (("68", 0.6827), ("95", 0.95))


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

    stresses = np.array([unit == "Pa" for unit in family.units])
    instantaneous = np.where(stresses, fit.constants / share, fit.constants)
    return {
        "long_term_share": around(share, slope_of_share),
        "long_term_shear_modulus_Pa": {"value": long_term, "low95": low, "high95": high},
        "instantaneous_shear_modulus_Pa": around(long_term / share, slope_of_modulus),
        "instantaneous_parameters": family.tree(map(float, instantaneous)),
    }
