"""Figures of a solved section and of load-displacement curves."""

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from suas_jax.scene.solve import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from suas_jax.scene.sweep import Sweep

_SAMPLES = 12
WALL = "0.55"


def plot_solution(solution: Solution, file: Path | None = None) -> Figure:
    """Draw the deformed section over the undeformed one, by energy and by displacement.

    The counterpart of the paper's Fig. 18.

    Args:
        solution: what to draw.
        file: where to write the figure; its ending chooses the format.
    """
    if solution.plan.model == "solid":
        from suas_jax.figures.solid import plot_solid

        return written(plot_solid(solution), file)
    problem = solution.problem()
    shape = problem.mechanics.profile(solution.state.q, _SAMPLES)
    geometry = solution.scene.geometry
    angle = np.asarray(shape.angle)[..., 0].T.ravel()
    normal = np.stack([np.sin(angle), np.cos(angle)])
    thickness = geometry.thickness

    def face(radius: float, displacement: object) -> tuple[np.ndarray, np.ndarray]:
        rest = radius * normal
        moved = np.asarray(displacement)[..., 0].transpose(0, 2, 1).reshape(2, -1)
        return 1e3 * rest, 1e3 * (rest + moved)

    inner_rest, inner = face(geometry.inner_radius, shape.inner_displacement)
    outer_rest, outer = face(geometry.inner_radius + thickness, shape.outer_displacement)
    energy = np.asarray(shape.energy_density)[..., 0].T.ravel()
    size = 1e3 * np.linalg.norm(np.asarray(shape.mid_displacement)[..., 0], axis=0).T.ravel()
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    fields = ((1e-3 * energy, "strain-energy density [kJ/m³]"), (size, "displacement [mm]"))
    for axes, (values, label) in zip(figure.subplots(1, 2), fields, strict=True):
        for curve in (inner_rest, outer_rest):
            axes.plot(*curve, color="0.7", lw=0.8, ls="--")
        corners = [inner[:, :-1], inner[:, 1:], outer[:, 1:], outer[:, :-1]]
        quads = np.stack(corners, 0).transpose(2, 0, 1)
        patches = PolyCollection(list(quads), array=(values[1:] + values[:-1]) / 2)
        patches.set_edgecolor("face")
        axes.add_collection(patches)
        wall = 1e3 * (geometry.inner_radius - geometry.oil_gap) * normal
        axes.fill(*wall, color=WALL, lw=0, zorder=0)
        arrows(axes, solution, outer, angle)
        figure.colorbar(patches, ax=axes, label=label, shrink=0.8)
        axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
        axes.autoscale_view()
    report = solution.report
    figure.suptitle(
        f"oil {1e-3 * report['oil_pressure_Pa']:.4g} kPa, "
        f"smallest gap {1e3 * report['min_gap_m']:.3g} mm ({report['status']})"
    )
    return written(figure, file)


def arrows(axes: "Axes", solution: Solution, outer: np.ndarray, angle: np.ndarray) -> None:
    """Draw every line load as an arrow that ends at the outer face."""
    from suas_jax.config import continuous_inputs
    from suas_jax.scene.parts import scene_parts

    parts = scene_parts(solution.scene, continuous_inputs(solution.scene))
    length = 0.18 * np.ptp(outer[0])
    for load in parts.lines:
        at = outer[:, int(np.argmin(np.abs(angle - float(load.angle[0]))))]
        push = np.asarray(load.direction)[:, 0] * np.sign(float(load.force[0]))
        axes.annotate(
            "",
            xy=tuple(at),
            xytext=tuple(at - length * push),
            arrowprops={"arrowstyle": "-|>", "color": "C3", "lw": 1.5},
        )
        axes.update_datalim([at - length * push])


def plot_sweep(sweep: "Sweep", file: Path | None = None) -> Figure:
    """Draw force over displacement and oil pressure over force.

    The counterpart of the paper's Fig. 19.

    Args:
        sweep: the curve.
        file: where to write the figure; its ending chooses the format.
    """
    points = [p for p in sweep.points if p["status"] == "converged"]
    lines = [i for i, load in enumerate(sweep.scene.loads) if load.kind == "line"]
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
    contact = sweep.first_contact
    if contact is not None:
        at = (contact["force_N"], 1e-3 * contact["oil_pressure_Pa"])
        right.plot(*at, "x", color="C3", ms=9, label=f"first wall contact, {at[0]:.4g} N")
        right.legend()
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return written(figure, file)


def check_figure_file(file: Path) -> None:
    """Make sure that a figure can be written, before any work is done for it.

    Args:
        file: where the figure is to go; its ending chooses the format.

    Raises:
        ValueError: the ending is no figure format, or the folder does not exist.
    """
    formats = Figure().canvas.get_supported_filetypes()
    ending = file.suffix.removeprefix(".").lower()
    if ending not in formats:
        raise ValueError(
            f'{file}: "{ending}" is no figure format; use one of {", ".join(sorted(formats))}'
        )
    if not file.absolute().parent.is_dir():
        raise ValueError(f"{file}: the folder {file.parent} does not exist")


def written(figure: Figure, file: Path | None) -> Figure:
    """Write a figure where a file is given, and return it."""
    if file is not None:
        check_figure_file(file)
        with mpl.rc_context({"savefig.dpi": 150}):
            figure.savefig(file)
    return figure
