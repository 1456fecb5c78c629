"""Figures of solved sections: of the shell, and of the solid with all that it resolves."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.figures.outline import Outline, draw_bodies, draw_loads, draw_wall, outline
from suas_jax.figures.pad import plot_pad_surface
from suas_jax.figures.style import FILM, FIRST, SECOND, place_label, styled, written
from suas_jax.mechanics.base import Profile
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.mechanics.solid.element import NODES
from suas_jax.mechanics.solid.fields import Fields, nodal_fields
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.scene.solve import Solution

_SAMPLES = 12
_ROOM = 1.1  # of a scale, over its largest value
_WALL_POINTS = 3601  # among which the nearest to a place of the inner face is taken


def _profile(problem: Problem, state: State, shown: State) -> tuple[Profile, Array]:
    """The section around the equilibrium, as the report has it, and its energy density."""
    shell = problem.mechanics.around(state.q)
    assert isinstance(shell, Shell)
    return shell.profile(shown.q, _SAMPLES), shell.energy_density(shown.q, _SAMPLES)


class Deformed(NamedTuple):
    """A deformed membrane as curves."""

    angle: np.ndarray  # of their points on the undeformed section [rad]
    inner: np.ndarray  # face [2, point] [mm]
    outer: np.ndarray  # face [2, point] [mm]
    energy: np.ndarray  # strain energy per volume, mean over the thickness [J/m^3]


def deformed(solution: Solution, drawn: Outline) -> Deformed:
    """The faces of a section that was solved with the lumped shell."""
    shape, energy = solution.read(_profile)
    angle = np.asarray(shape.angle)[..., 0].T.ravel()

    def face(rest: np.ndarray, displacement: object) -> np.ndarray:
        moved = np.asarray(displacement)[..., 0].transpose(0, 2, 1).reshape(2, -1)
        at_rest = np.stack([np.interp(angle, drawn.angle, x) for x in rest])
        return np.asarray(1e3 * (at_rest + moved))

    return Deformed(
        angle,
        face(drawn.inner, shape.inner_displacement),
        face(drawn.outer, shape.outer_displacement),
        np.asarray(energy)[..., 0].T.ravel(),
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
    across.fill(
        *np.concatenate([inner, 1e3 * drawn.wall[:, ::-1]], 1), color=FILM, lw=0, zorder=0
    )
    corners = [inner[:, :-1], inner[:, 1:], outer[:, 1:], outer[:, :-1]]
    quads = np.stack(corners, 0).transpose(2, 0, 1)
    patches = PolyCollection(list(quads), array=5e-4 * (energy[1:] + energy[:-1]))
    _draw_section(across, solution, drawn, patches, outer, angle)
    label = "strain-energy density [kJ/m³]"
    figure.colorbar(patches, ax=across, label=label, location="bottom", shrink=0.6)
    across.autoscale_view()
    _draw_gap(along, solution.report["taxels"], drawn, inner)
    return _titled(figure, solution)


def _draw_section(
    axes: Axes,
    solution: Solution,
    drawn: Outline,
    patches: PolyCollection,
    outer: np.ndarray,
    angle: np.ndarray,
) -> None:
    """The membrane in colours over its outline at rest, with wall, loads and bodies."""
    patches.set_edgecolor("face")
    axes.add_collection(patches)
    for curve in (drawn.inner, drawn.outer):
        axes.plot(*(1e3 * curve), color="0.7", lw=0.8, ls="--")
    draw_wall(axes, solution, drawn)
    draw_loads(axes, drawn, outer, angle)
    draw_bodies(axes, solution, drawn, outer, angle)
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")


def _titled(figure: Figure, solution: Solution) -> Figure:
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


def solid_fields(problem: Problem, state: State, shown: State) -> tuple[Fields, Array]:
    """Fields at the nodes, and the angles of the stations [rad]: for `Solution.read`."""
    del shown
    solid = problem.mechanics
    assert isinstance(solid, Solid)
    return nodal_fields(solid, state.q), solid.angles[:, 0]


_NO_FORCES = ("pressure", "body")  # loads that are not dead forces at a place
# Four small quadrilaterals cover the nine nodes of an element.
_QUADS = [
    [NODES.index(node) for node in ((a, b), (a + 1, b), (a + 1, b + 1), (a, b + 1))]
    for a in range(2)
    for b in range(2)
]


@styled
def plot_solid(solution: Solution) -> Figure:
    """Draw energy and hoop stretch over the deformed section, and the stretch across it.

    The counterpart of the paper's Fig. 18, resolved through the thickness.
    """
    fields, bearings = solution.read(solid_fields)
    drawn = outline(solution.scene)
    moved = 1e3 * (fields.position + fields.displacement)
    grid = (*solution.plan.counts, len(NODES))
    top = moved.reshape(*grid, 2)[:, -1, [NODES.index((a, 2)) for a in range(3)]].reshape(-1, 2)
    spread = np.stack([bearings[:-1], (bearings[1:] + bearings[:-1]) / 2, bearings[1:]], 1)

    figure = Figure(figsize=(15, 4.6), layout="constrained")
    panels = figure.subplots(1, 3, width_ratios=(2, 2, 1.4))
    shown = (
        (1e-3 * fields.energy_density, "strain-energy density [kJ/m³]"),
        (fields.hoop_stretch, "hoop stretch"),
    )
    for axes, (values, label) in zip(panels, shown, strict=False):
        corners = np.concatenate([moved[:, quad] for quad in _QUADS])
        means = np.concatenate([values[:, quad].mean(1) for quad in _QUADS])
        patches = PolyCollection(list(corners), array=means)
        # A point load and the clamps' corners are singular: they must not set the scale.
        patches.set_clim(*np.quantile(means, (0.001, 0.999)))
        _draw_section(axes, solution, drawn, patches, top.T, spread.ravel())
        figure.colorbar(patches, ax=axes, label=label, shrink=0.8)
        axes.autoscale_view()
    place = fields.position.reshape(*grid, 2)
    below = place[:, :1, [NODES.index((a, 0)) for a, _ in NODES]]
    depth = np.linalg.norm(place - below, axis=-1)
    across = np.stack([fields.hoop_stretch.reshape(grid), 1e3 * depth], -1)
    _across(panels[2], solution, drawn, across, spread)
    return _titled(figure, solution)


def _across(
    axes: Axes, solution: Solution, drawn: Outline, values: np.ndarray, spread: np.ndarray
) -> None:
    """Plot the hoop stretch through the thickness under every line load, or at the crown.

    `values` are hoop stretch and distance from the inner face [mm] at the nodes
    [element, layer, node, 2], `spread` angles of every element's ends and middle [rad].
    """
    kinds = [load for load in solution.report["loads"] if load["kind"] not in _NO_FORCES]
    by_arc = not solution.scene.geometry.has_angle
    loads = [place_label(load, by_arc=by_arc) for load in kinds]
    places = drawn.load_angle if loads else np.zeros(1)
    for place, angle in zip(loads or ["the crown"], places, strict=True):
        near = np.abs(spread[:, [0, 2]] - angle)
        element, side = np.unravel_index(np.argmin(near), near.shape)
        nodes = [NODES.index((2 * int(side), b)) for b in range(3)]
        stretch, depth = values[element][:, nodes].reshape(-1, 2).T
        axes.plot(stretch, depth, ".-", label=place)
    axes.set(xlabel="hoop stretch", ylabel="distance from the inner face [mm]")
    axes.locator_params(axis="x", nbins=4)
    axes.grid(alpha=0.3)
    axes.legend(title="at")


FIGURES: dict[int, dict[str, Callable[[Solution], Figure]]] = {
    2: {"shell": plot_section, "solid": plot_solid},
    3: {"shell": plot_pad_surface, "solid": plot_pad_surface},
}
"""How solutions of each model are drawn, by dimension and by its name."""


def plot_solution(solution: Solution, file: Path | None = None) -> Figure:
    """Draw the deformed membrane; a file's ending chooses the format."""
    return written(FIGURES[solution.plan.dimension][solution.plan.model](solution), file)
