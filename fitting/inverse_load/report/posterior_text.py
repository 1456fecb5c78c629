"""What the posterior of a frame looks like: JSON, or lines for a person."""

from typing import Any

import numpy as np

from fitting.inverse_load.frame_posterior import LoadMode

_DEGREES = 180 / np.pi
# A quantity's key in JSON and its factor from SI units, then the text's from JSON and unit.
_SHOWN = {
    "angle": ("angle_deg", _DEGREES, 1.0, "°"),
    "axial": ("axial_m", 1.0, 1e3, " mm"),
    "force": ("force_N", 1.0, 1.0, " N"),
    "diameter": ("diameter_m", 1.0, 1e3, " mm wide"),
    "direction": ("direction_deg", _DEGREES, 1.0, "° off radial"),
    "tilt": ("tilt_deg", _DEGREES, 1.0, "° along the axis"),
}


def posterior_json(modes: list[LoadMode]) -> dict[str, Any]:
    """What `suas invert --posterior --json` prints."""
    return {
        "multimodal": len(modes) > 1,
        "modes": [
            {
                "contacts": mode.contacts,
                "probability": mode.probability,
                "kind": mode.kind,
                "chi2": mode.chi2,
                "loads": [_load(mode, k) for k in range(mode.contacts)],
                "converged": mode.chain is not None and mode.chain.converged,
                "agreement": None if mode.chain is None else mode.chain.agreement["message"],
                "message": mode.message,
            }
            for mode in modes
        ],
    }


def _load(mode: LoadMode, contact: int) -> dict[str, Any]:
    """Mean, standard deviation and 95 % interval of one contact's quantities."""
    rows = range(contact, len(mode.parameters), mode.contacts)
    load: dict[str, Any] = {}
    for quantity, row in zip(mode.names, rows, strict=True):
        name, scale, _, _ = _SHOWN[quantity]
        if mode.chain is None:
            load[name] = {"mean": scale * float(mode.parameters[row])}
            continue
        values = scale * mode.chain.samples[:, row]
        load[name] = {
            "mean": float(values.mean()),
            "standard_deviation": float(values.std()),
            "interval_95": [float(x) for x in np.percentile(values, [2.5, 97.5])],
        }
    return load


def posterior_lines(modes: list[LoadMode]) -> list[str]:
    """A line or two a mode."""
    lines = [f"posterior: {len(modes)} modes" if len(modes) > 1 else "posterior: a single mode"]
    for mode in modes:
        loads = []
        for k in range(mode.contacts):
            parts = []
            for quantity, value in zip(mode.names, _load(mode, k).values(), strict=True):
                _, _, scale, unit = _SHOWN[quantity]
                text = f"{scale * value['mean']:.4g}"
                if "interval_95" in value:
                    low, high = (scale * x for x in value["interval_95"])
                    text += f" ({low:.4g} to {high:.4g})"
                parts.append(text + unit)
            loads.append(", ".join(parts))
        lines.append(f"  {100 * mode.probability:.1f} % ({mode.kind}): " + "; ".join(loads))
        lines.append(f"    {mode.message}")
    return lines
