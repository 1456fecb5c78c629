"""Figure of a load-displacement curve."""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from suas_jax.figures.style import CONTACT, place_label, styled, written
from suas_jax.scene.curve import total_force
from suas_jax.scene.sweep import Sweep

_ABOVE = (0.5, 1.0)  # the place of a legend, off the data


@styled
def plot_sweep(sweep: Sweep, file: Path | None = None) -> Figure:
    """Draw force over displacement and oil pressure over force, the paper's Fig. 19.

    A file's ending chooses the format.
    """
    points = [p for p in sweep.points if p["status"] == "converged"]
    by_arc = not sweep.scene.geometry.has_angle
    if points and "t_s" in points[0]:
        return written(_over_time(points, by_arc=by_arc), file)
    lines = [i for i, load in enumerate(sweep.scene.loads) if load.kind != "pressure"]
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    total = [sum(abs(p["loads"][i]["force_N"]) for i in lines) for p in points]
    pressure = [1e-3 * p["oil_pressure_Pa"] for p in points]
    for i in lines:
        moved = [1e3 * p["loads"][i]["displacement_m"] for p in points]
        force = [p["loads"][i]["force_N"] for p in points]
        place = f" at {place_label(points[0]['loads'][i], by_arc=by_arc)}" if points else ""
        left.plot(moved, force, "o-", ms=3, label="load" + place)
    left.set(xlabel="displacement of the mid-surface along the load [mm]", ylabel="force [N]")
    handles = right.plot(total, pressure, "o-", ms=3, label="oil pressure")
    right.set(xlabel="total force [N]", ylabel="oil pressure [kPa]")
    wall = [p["wall"]["force_N"] if p["wall"] else 0.0 for p in points]
    if any(wall):
        carried = right.twinx()
        label = "carried by the wall (right)"
        handles += carried.plot(total, wall, "s--", ms=3, color=CONTACT, label=label)
        carried.set(ylabel="force on the wall [N]")
    contact = sweep.first_contact
    if contact is not None:
        at = (contact["force_N"], 1e-3 * contact["oil_pressure_Pa"])
        label = f"first contact, {at[0]:.4g} N"
        handles += right.plot(*at, "x", color=CONTACT, ms=9, label=label)
    left.legend(loc="lower center", bbox_to_anchor=_ABOVE, ncols=3)
    if len(handles) > 1:
        right.legend(handles=handles, loc="lower center", bbox_to_anchor=_ABOVE, ncols=3)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return written(figure, file)


@styled
def _over_time(points: list[dict[str, Any]], *, by_arc: bool) -> Figure:
    """Displacement under the loads, oil pressure and force over time."""
    time = [p["t_s"] for p in points]
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for i, load in enumerate(points[0]["loads"]):
        if load["kind"] != "pressure":
            moved = [1e3 * p["loads"][i]["displacement_m"] for p in points]
            place = place_label(load, by_arc=by_arc)
            left.plot(time, moved, "o-", ms=3, label=f"load at {place}")
    left.set(xlabel="time [s]", ylabel="displacement of the mid-surface along the load [mm]")
    pressure = [1e-3 * p["oil_pressure_Pa"] for p in points]
    lines = right.plot(time, pressure, "o-", ms=3, label="oil pressure")
    right.set(xlabel="time [s]", ylabel="oil pressure [kPa]")
    force = right.twinx()
    label = "total force (right)"
    lines += force.plot(
        time, [total_force(p) for p in points], "s--", ms=3, color="0.5", label=label
    )
    left.legend(loc="lower center", bbox_to_anchor=_ABOVE, ncols=3)
    right.legend(handles=lines, loc="lower center", bbox_to_anchor=_ABOVE, ncols=2)
    force.set(ylabel="total force [N]")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return figure
