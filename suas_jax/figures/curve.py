"""Figure of a load-displacement curve."""

from pathlib import Path

from matplotlib.figure import Figure

from suas_jax.figures.style import CONTACT, written
from suas_jax.scene.sweep import Sweep


def plot_sweep(sweep: Sweep, file: Path | None = None) -> Figure:
    """Draw force over displacement and oil pressure over force.

    The counterpart of the paper's Fig. 19.

    Args:
        sweep: the curve.
        file: where to write the figure; its ending chooses the format.
    """
    points = [p for p in sweep.points if p["status"] == "converged"]
    lines = [i for i, load in enumerate(sweep.scene.loads) if load.kind != "pressure"]
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    total = [sum(abs(p["loads"][i]["force_N"]) for i in lines) for p in points]
    pressure = [1e-3 * p["oil_pressure_Pa"] for p in points]
    for i in lines:
        moved = [1e3 * p["loads"][i]["displacement_m"] for p in points]
        force = [p["loads"][i]["force_N"] for p in points]
        degrees = points[0]["loads"][i]["angle_deg"] if points else 0.0
        left.plot(moved, force, "o-", ms=3, label=f"load at {degrees:.4g}°")
    left.set(xlabel="displacement of the mid-surface along the load [mm]", ylabel="force [N]")
    left.legend()
    right.plot(total, pressure, "o-", ms=3)
    right.set(xlabel="total force [N]", ylabel="oil pressure [kPa]")
    wall = [p["wall"]["force_N"] if p["wall"] else 0.0 for p in points]
    if any(wall):
        carried = right.twinx()
        carried.plot(total, wall, "s--", ms=3, color=CONTACT, label="carried by the wall")
        carried.set(ylabel="force on the wall [N]")
        carried.legend(loc="lower right")
    contact = sweep.first_contact
    if contact is not None:
        at = (contact["force_N"], 1e-3 * contact["oil_pressure_Pa"])
        right.plot(*at, "x", color="C3", ms=9, label=f"first wall contact, {at[0]:.4g} N")
        right.legend()
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return written(figure, file)
