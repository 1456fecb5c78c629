"""Estimates, and the posterior of a frame, as JSON and as text for a person."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import BESIDE, STATUS, Contact, LoadEstimate, Tap
from fitting.inverse_load.estimate.load_field import (
    FIELD_QUANTITIES,
    Interval,
    LoadField,
    interval_key,
)
from suas_jax.acquisition.terminal import new_console

if TYPE_CHECKING:
    from fitting.inverse_load.frame_posterior import LoadMode

_DEGREES = 180 / np.pi
# A quantity's key in JSON and its factor from SI units, then the text's from JSON, its unit and
# its decimals beside a standard deviation.
_SHOWN = {
    "angle": ("angle_deg", _DEGREES, 1.0, "°", 2),
    "arc": ("arc_m", 1.0, 1e3, " mm along the arc", 2),
    "axial": ("axial_m", 1.0, 1e3, " mm", 2),
    "force": ("force_N", 1.0, 1.0, " N", 3),
    "diameter": ("diameter_m", 1.0, 1e3, " mm wide", 1),
    "direction": ("direction_deg", _DEGREES, 1.0, "° off radial", 1),
    "tilt": ("tilt_deg", _DEGREES, 1.0, "° along the axis", 1),
}


def contact_json(contact: Contact) -> dict[str, Any]:
    """One contact: degrees, metres, newtons; covariance of `Contact.names`, SI, radians."""
    entry: dict[str, Any] = {
        "angle_deg": float(np.rad2deg(contact.angle)),
        "force_N": contact.force,
    }
    if contact.arc is not None:
        entry["arc_m"] = contact.arc
    if contact.by_arc:
        entry["covariance_of"] = list(contact.names)
    if contact.axial is not None:
        entry["axial_m"] = contact.axial
    if contact.diameter is not None:
        entry["diameter_m"] = contact.diameter
    for name, keys in BESIDE.items():
        value = getattr(contact, name)
        if value is not None:
            entry |= dict(zip(keys, value, strict=True))
        elif contact.axial is not None and name != "spread":
            entry |= dict.fromkeys(keys)  # the taxels can't tell
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
    if estimate.field is not None:
        line["field"] = field_json(estimate.field)
    if estimate.tap is not None:
        line["tap"] = _tap_json(estimate.tap)
    if filtered is not None:
        line["filtered"] = [contact_json(contact) for contact in filtered]
    return line | more


def field_json(field: LoadField) -> dict[str, Any]:
    """A load field: values, and intervals that hold them in 95 of 100 cases."""
    entry: dict[str, Any] = {}
    for name, (key, scale) in FIELD_QUANTITIES.items():
        known = getattr(field, name)
        if known is not None:
            entry[key] = scale * known.value
            entry[interval_key(key)] = [scale * known.low, scale * known.high]
    return entry | {"preferred_by": field.preferred_by}


def field_text(field: LoadField) -> str:
    """A load field for a person."""

    def told(name: str, known: Interval, scale: float, unit: str) -> str:
        value, low, high = (f"{scale * x:.3g}" for x in known)
        return f"{name}{value} ({low} to {high}){unit}"

    place = told("about ", field.angle, _DEGREES, "°")
    if field.arc is not None:
        place = told("about ", field.arc, 1e3, " mm along the arc")
    parts = [told("load field of ", field.force, 1.0, " N"), place]
    if field.axial is not None:
        parts.append(told("", field.axial, 1e3, " mm"))
    extents = [x for x in (field.arc_extent, field.axial_extent) if x is not None]
    return ", ".join([*parts, *(told("over ", x, 1e3, " mm") for x in extents)])


def _tap_json(tap: Tap) -> dict[str, Any]:
    """A tap: when, where and with which impulse."""
    place = contact_json(tap.place)
    keys = "angle_deg", "arc_m", "axial_m"
    kept: dict[str, Any] = {key: place[key] for key in keys if key in place}
    for name in tap.place.names:
        key, scale, *_ = _SHOWN[name]
        if key in kept:
            quantity, unit = key.split("_")
            kept[f"{quantity}_deviation_{unit}"] = scale * tap.place.deviation(name)
    told = {"impulse_Ns": tap.impulse, "impulse_deviation_Ns": tap.deviation}
    return {"t_s": tap.time, "duration_s": tap.duration, **kept, **told}


def tap_text(tap: Tap) -> str:
    """A tap for a person."""
    impulse = f"{1e3 * tap.impulse:.3g} ± {1e3 * tap.deviation:.2g} mN s"
    return f"tap after {tap.time:.3f} s: {', '.join(place_texts(tap.place))}, {impulse}"


def contact_text(contact: Contact) -> str:
    """A contact with its standard deviations."""
    if contact.covariance is None:
        axial = "" if contact.axial is None else f"{1e3 * contact.axial:.1f} mm, "
        place = f"{np.rad2deg(contact.angle):.1f}°"
        if contact.by_arc and contact.arc is not None:
            place = f"{1e3 * contact.arc:.1f} mm along the arc"
        return f"{place}, {axial}{contact.force:.2f} N (no error known)"
    parts = [*place_texts(contact), _told(contact, "force")]
    if contact.diameter is not None:
        parts.append("⌀ " + _told(contact, "diameter").removesuffix(" wide"))
    if contact.spread is not None:
        length, error = contact.spread
        parts.append(f"over {1e3 * length:.1f} ± {1e3 * error:.1f} mm")
    extents = contact.arc_extent, contact.axial_extent
    if any(extents):
        told = ["?" if x is None else f"{1e3 * x[0]:.0f} ± {1e3 * x[1]:.0f}" for x in extents]
        parts.append(f"over {told[0]} by {told[1]} mm")
    if contact.direction is None:
        for way, pull in (("arc", contact.arc_force), ("axis", contact.axial_force)):
            if pull is not None:
                parts.append(f"{pull[0]:.2f} ± {pull[1]:.2f} N along the {way}")
    parts += [_told(contact, name) for name in contact.names if name in ("direction", "tilt")]
    return ", ".join(parts)


def place_texts(contact: Contact) -> list[str]:
    """Coordinates of a contact with their standard deviations."""
    names = ("angle", "arc", "axial")
    return [_told(contact, name) for name in contact.names if name in names]


def _told(contact: Contact, name: str) -> str:
    """A quantity with its standard deviation and its unit."""
    _, to_json, to_text, unit, digits = _SHOWN[name]
    value, sigma = (
        to_json * to_text * x for x in (getattr(contact, name), contact.deviation(name))
    )
    return f"{value:.{digits}f} ± {sigma:.{digits}f}{unit}"


def print_table(time: Floats, estimates: Sequence[LoadEstimate]) -> None:
    """Print what a person wants to see of a log: a line a frame, then the statuses."""
    from rich.table import Table

    console = new_console(markup=False)  # which would swallow the units in brackets
    table = Table("t [s]", "loads", "oil [kPa]", "χ²/dof", "status")
    for t, e in zip(time.tolist(), estimates, strict=True):
        lines = [contact_text(contact) for contact in e.contacts]
        lines += [field_text(e.field)] if e.field is not None else []
        loads = "\n".join(lines) or "–"
        pressure = "–" if np.isnan(e.oil_pressure) else f"{1e-3 * e.oil_pressure:.2f}"
        table.add_row(f"{t:.3f}", loads, pressure, f"{e.chi2_per_dof:.2f}", e.status_text)
    console.print(table)
    for e in estimates:
        if e.tap is not None:
            console.print(tap_text(e.tap), highlight=False)
    names = [e.status for e in estimates]
    for status in sorted(set(names), key=names.count, reverse=True):
        console.print(
            f"{names.count(status)} x {status}: {STATUS.get(status, '')}", highlight=False
        )


def posterior_json(modes: "list[LoadMode]") -> dict[str, Any]:
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


def _load(mode: "LoadMode", contact: int) -> dict[str, Any]:
    """Mean, standard deviation and 95 % interval of one contact's quantities."""
    rows = range(contact, len(mode.parameters), mode.contacts)
    load: dict[str, Any] = {}
    for quantity, row in zip(mode.names, rows, strict=True):
        name, scale, *_ = _SHOWN[quantity]
        if mode.chain is None:
            load[name] = {"mean": scale * float(mode.told(quantity, mode.parameters[row]))}
            continue
        values = scale * mode.told(quantity, mode.chain.samples[:, row])
        load[name] = {
            "mean": float(values.mean()),
            "standard_deviation": float(values.std()),
            "interval_95": [float(x) for x in np.percentile(values, [2.5, 97.5])],
        }
    return load


def posterior_lines(modes: "list[LoadMode]") -> list[str]:
    """A line or two a mode."""
    lines = [f"posterior: {len(modes)} modes" if len(modes) > 1 else "posterior: a single mode"]
    for mode in modes:
        loads = []
        for k in range(mode.contacts):
            parts = []
            for quantity, value in zip(mode.names, _load(mode, k).values(), strict=True):
                _, _, scale, unit, _ = _SHOWN[quantity]
                text = f"{scale * value['mean']:.4g}"
                if "interval_95" in value:
                    low, high = (scale * x for x in value["interval_95"])
                    text += f" ({low:.4g} to {high:.4g})"
                parts.append(text + unit)
            loads.append(", ".join(parts))
        lines.append(f"  {100 * mode.probability:.1f} % ({mode.kind}): " + "; ".join(loads))
        lines.append(f"    {mode.message}")
    return lines
