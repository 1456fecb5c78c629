"""What the posterior of a frame looks like: JSON, or lines for a person."""

from typing import Any

import numpy as np

from fitting.inverse_load.posterior import LoadMode


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
    for (name, scale), row in zip(
        (("angle_deg", 180 / np.pi), ("force_N", 1.0), ("direction_deg", 180 / np.pi)),
        rows,
        strict=False,
    ):
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
            for name, value in _load(mode, k).items():
                unit = {"angle_deg": "°", "force_N": " N", "direction_deg": "° off radial"}[
                    name
                ]
                if "interval_95" in value:
                    low, high = value["interval_95"]
                    parts.append(f"{value['mean']:.4g} ({low:.4g} to {high:.4g}){unit}")
                else:
                    parts.append(f"{value['mean']:.4g}{unit}")
            loads.append(", ".join(parts))
        lines.append(f"  {100 * mode.probability:.1f} % ({mode.kind}): " + "; ".join(loads))
        lines.append(f"    {mode.message}")
    return lines
