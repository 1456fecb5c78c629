"""Figure of a solved section."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.figures.outline import Outline, draw_bodies, draw_loads, draw_wall, outline
from suas_jax.figures.style import FILM, FIRST, SECOND, styled
from suas_jax.mechanics.base import Profile
from suas_jax.mechanics.section import section_of
from suas_jax.scene.solve import Solution

_SAMPLES = 12
_ROOM = 1.1  # of a scale, over its largest value
_WALL_POINTS = 3601  # among which the nearest to a place of the inner face is taken


def _profile(problem: Problem, state: State, shown: State) -> Profile:
    """The section around the equilibrium, as the report has it."""
    return section_of(problem.mechanics.around(state.q)).profile(shown.q, _SAMPLES)


class Deformed(NamedTuple):
    """A deformed membrane as curves."""

    angle: np.ndarray  # of their points on the undeformed section [rad]
    inner: np.ndarray  # face [2, point] [mm]
    outer: np.ndarray  # face [2, point] [mm]
    energy: np.ndarray  # strain energy per volume, mean over the thickness [J/m^3]


def deformed(solution: Solution, drawn: Outline) -> Deformed:
    """The faces of a section that was solved with the lumped shell."""
    shape = solution.read(_profile)
    angle = np.asarray(shape.angle)[..., 0].T.ravel()

    def face(rest: np.ndarray, displacement: object) -> np.ndarray:
        moved = np.asarray(displacement)[..., 0].transpose(0, 2, 1).reshape(2, -1)
        at_rest = np.stack([np.interp(angle, drawn.angle, x) for x in rest])
        return np.asarray(1e3 * (at_rest + moved))

    return Deformed(
        angle,
        face(drawn.inner, shape.inner_displacement),
        face(drawn.outer, shape.outer_displacement),
        np.asarray(shape.energy_density)[..., 0].T.ravel(),
    )


@styled
def plot_section(solution: Solution) -> Figure:
    """Draw the deformed section over the undeformed one, and its gap with the taxels' counts.

    The membrane has the colours of its strain energy, as in the paper's Fig. 18.
    """
    drawn = outline(solution.scene)
    angle, inner, outer, energy = deformed(solution, drawn)
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    across, along = figure.subplots(1, 2, width_ratios=(1.25, 1))
    for curve in (drawn.inner, drawn.outer):
        across.plot(*(1e3 * curve), color="0.7", lw=0.8, ls="--")
    across.fill(
        *np.concatenate([inner, 1e3 * drawn.wall[:, ::-1]], 1), color=FILM, lw=0, zorder=0
    )
    corners = [inner[:, :-1], inner[:, 1:], outer[:, 1:], outer[:, :-1]]
    quads = np.stack(corners, 0).transpose(2, 0, 1)
    patches = PolyCollection(list(quads), array=5e-4 * (energy[1:] + energy[:-1]))
    patches.set_edgecolor("face")
    across.add_collection(patches)
    draw_wall(across, solution, drawn)
    draw_loads(across, drawn, outer, angle)
    draw_bodies(across, solution, drawn, outer, angle)
    label = "strain-energy density [kJ/m³]"
    figure.colorbar(patches, ax=across, label=label, location="bottom", shrink=0.6)
    across.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    across.autoscale_view()
    _draw_gap(along, solution.report["taxels"], drawn, inner)
    report = solution.report
    figure.suptitle(
        f"oil {1e-3 * report['oil_pressure_Pa']:.4g} kPa, "
        f"smallest gap {1e3 * report['min_gap_m']:.3g} mm ({report['status']})"
    )
    return figure


def _draw_gap(
    axes: Axes, taxels: list[dict[str, Any]], drawn: Outline, inner: np.ndarray
) -> None:
    """The gap along the wall, from it to the inner face [2, point] [mm], and the counts."""
    fine = np.linspace(drawn.angle[0], drawn.angle[-1], _WALL_POINTS)
    wall = np.stack([np.interp(fine, drawn.angle, 1e3 * x) for x in drawn.wall])
    distance = np.linalg.norm(inner[:, :, None] - wall[:, None], axis=0)
    nearest = distance.argmin(1)
    by_arc = np.isnan(drawn.given).any() or any("arc_m" in taxel for taxel in taxels)
    places = np.interp(fine, drawn.angle, 1e3 * drawn.arc if by_arc else drawn.given)
    axes.plot(places[nearest], distance.min(1), color=FIRST, label="gap")
    rest = 1e3 * np.linalg.norm(drawn.inner - drawn.wall, axis=0)
    at_rest = 1e3 * drawn.arc if by_arc else drawn.given
    axes.plot(at_rest, rest, color="0.7", lw=0.8, ls="--", label="gap at rest")
    what = "arc from the middle [mm]" if by_arc else "angle [deg]"
    axes.set(xlabel=what, ylabel="gap to the wall [mm]")
    axes.set_ylim(0, _ROOM * max(distance.min(1).max(), rest.max()))
    handles = list(axes.lines)
    if taxels:
        scale = axes.twinx()
        at = [1e3 * taxel["arc_m"] if by_arc else taxel["angle_deg"] for taxel in taxels]
        counts = np.array([taxel["so"] for taxel in taxels], float)
        handles += scale.plot(at, counts, "o", color=SECOND, ms=5, label="taxels (right)")
        scale.set(ylabel="sensor output [counts]")
        scale.set_ylim(0, _ROOM * max(np.nanmax(counts, initial=0.0), 1.0))
    axes.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
