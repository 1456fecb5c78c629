"""What an estimate looks like: one JSON object a frame, or a table for a person."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.estimate.estimate import STATUS, Contact, LoadEstimate
from suas_jax.acquisition.terminal import new_console


def contact_json(contact: Contact) -> dict[str, Any]:
    """One contact: degrees, metres, newtons; covariance of `Contact.names`, SI, radians."""
    entry: dict[str, Any] = {
        "angle_deg": float(np.rad2deg(contact.angle)),
        "force_N": contact.force,
    }
    if contact.axial is not None:
        entry["axial_m"] = contact.axial
    if contact.diameter is not None:
        entry["diameter_m"] = contact.diameter
    if contact.spread is not None:
        entry["spread_m"], entry["spread_deviation_m"] = contact.spread
    if contact.direction is not None:
        entry["direction_deg"] = float(np.rad2deg(contact.direction))
    if contact.tilt is not None:
        entry["tilt_deg"] = float(np.rad2deg(contact.tilt))
    known = contact.covariance is not None
    entry["covariance"] = contact.covariance.tolist() if known else None  # type: ignore[union-attr]
    if contact.systematic is not None:
        entry["systematic_covariance"] = contact.systematic.tolist()
        noise = contact.noise_covariance
        entry["covariance_noise"] = None if noise is None else noise.tolist()
    if contact.arc_position is not None:
        entry["arc_position_m"] = contact.arc_position
    return entry


def frame_json(
    time: float,
    seq: int | None,
    estimate: LoadEstimate,
    filtered: Sequence[Contact] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """A frame as `suas invert --json` prints it, the contract's keys first."""
    line: dict[str, Any] = {
        "t_s": time,
        "contact": estimate.contact,
        "loads": [contact_json(contact) for contact in estimate.contacts],
        "oil_pressure_Pa": estimate.oil_pressure,
        "wall_contact": estimate.wall_contact,
        "chi2_per_dof": estimate.chi2_per_dof,
        "latency_s": estimate.latency,
        "status": estimate.status_text,
        "seq": seq,
        "left_out": list(estimate.left_out),
    }
    if estimate.at_least is not None:
        line["force_at_least_N"] = estimate.at_least
    if estimate.drift is not None:
        mean, largest = estimate.drift
        line["drift_counts"] = {"mean": mean, "largest": largest}
    if estimate.alternatives:
        line["alternatives"] = [contact_json(contact) for contact in estimate.alternatives]
    if filtered is not None:
        line["filtered"] = [contact_json(contact) for contact in filtered]
    return line | more


def contact_text(contact: Contact) -> str:
    """A contact with its standard deviations."""
    if contact.covariance is None:
        axial = "" if contact.axial is None else f"{1e3 * contact.axial:.1f} mm, "
        angle = np.rad2deg(contact.angle)
        return f"{angle:.1f}°, {axial}{contact.force:.2f} N (no error known)"
    sigma = dict(zip(contact.names, np.sqrt(np.diag(contact.covariance)), strict=True))
    parts = [f"{np.rad2deg(contact.angle):.2f} ± {np.rad2deg(sigma['angle']):.2f}°"]
    if contact.axial is not None:
        parts.append(f"{1e3 * contact.axial:.2f} ± {1e3 * sigma['axial']:.2f} mm")
    parts.append(f"{contact.force:.3f} ± {sigma['force']:.3f} N")
    if contact.diameter is not None:
        parts.append(f"⌀ {1e3 * contact.diameter:.1f} ± {1e3 * sigma['diameter']:.1f} mm")
    if contact.spread is not None:
        length, error = contact.spread
        parts.append(f"over {1e3 * length:.1f} ± {1e3 * error:.1f} mm")
    if contact.direction is not None:
        turn, error = np.rad2deg(contact.direction), np.rad2deg(sigma["direction"])
        parts.append(f"{turn:.1f} ± {error:.1f}° off radial")
    if contact.tilt is not None:
        turn, error = np.rad2deg(contact.tilt), np.rad2deg(sigma["tilt"])
        parts.append(f"{turn:.1f} ± {error:.1f}° along the axis")
    return ", ".join(parts)


def print_table(time: NDArray[np.float64], estimates: Sequence[LoadEstimate]) -> None:
    """Print what a person wants to see of a log: a line a frame, then the statuses."""
    from rich.table import Table

    console = new_console(markup=False)  # which would swallow the units in brackets
    table = Table("t [s]", "loads", "oil [kPa]", "χ²/dof", "status")
    for t, e in zip(time.tolist(), estimates, strict=True):
        loads = "\n".join(contact_text(contact) for contact in e.contacts) or "–"
        pressure = "–" if np.isnan(e.oil_pressure) else f"{1e-3 * e.oil_pressure:.2f}"
        table.add_row(f"{t:.3f}", loads, pressure, f"{e.chi2_per_dof:.2f}", e.status_text)
    console.print(table)
    names = [e.status for e in estimates]
    for status in sorted(set(names), key=names.count, reverse=True):
        console.print(
            f"{names.count(status)} x {status}: {STATUS.get(status, '')}", highlight=False
        )
