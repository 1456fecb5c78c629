"""Figure of a solved solid: fields over the section, stretch through the thickness."""

import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.figures.outline import Outline, draw_bodies, draw_loads, draw_wall, outline
from suas_jax.figures.style import styled
from suas_jax.mechanics.solid.element import NODES
from suas_jax.mechanics.solid.fields import Fields, nodal_fields
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.scene.solve import Solution


def solid_fields(problem: Problem, state: State, shown: State) -> tuple[Fields, Array]:
    """Fields at the nodes, and the angles of the stations [rad]: for `Solution.read`."""
    del shown
    solid = problem.mechanics
    assert isinstance(solid, Solid)
    return nodal_fields(solid, state.q), solid.angles[:, 0]


_NO_FORCES = ("pressure", "body")  # loads that are no dead forces at a place
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
    drawn, report = outline(solution.scene), solution.report
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
        patches.set_edgecolor("face")
        # A point load and the clamps' corners are singular: they must not set the scale.
        patches.set_clim(*np.quantile(means, (0.001, 0.999)))
        axes.add_collection(patches)
        for curve in (drawn.inner, drawn.outer):
            axes.plot(*(1e3 * curve), color="0.7", lw=0.8, ls="--")
        draw_wall(axes, solution, drawn)
        draw_loads(axes, drawn, top.T, spread.ravel())
        draw_bodies(axes, solution, drawn, top.T, spread.ravel())
        figure.colorbar(patches, ax=axes, label=label, shrink=0.8)
        axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
        axes.autoscale_view()
    place = fields.position.reshape(*grid, 2)
    below = place[:, :1, [NODES.index((a, 0)) for a, _ in NODES]]
    depth = np.linalg.norm(place - below, axis=-1)
    across = np.stack([fields.hoop_stretch.reshape(grid), 1e3 * depth], -1)
    _across(panels[2], solution, drawn, across, spread)
    figure.suptitle(
        f"oil {1e-3 * report['oil_pressure_Pa']:.4g} kPa, "
        f"smallest gap {1e3 * report['min_gap_m']:.3g} mm ({report['status']})"
    )
    return figure


def _across(
    axes: Axes, solution: Solution, drawn: Outline, values: np.ndarray, spread: np.ndarray
) -> None:
    """Plot the hoop stretch through the thickness under every line load, or at the crown.

    `values` are hoop stretch and distance from the inner face [mm] at the nodes
    [element, layer, node, 2], `spread` angles of every element's ends and middle [rad].
    """
    kinds = [load for load in solution.report["loads"] if load["kind"] not in _NO_FORCES]
    loads = [load["angle_deg"] for load in kinds]
    places = drawn.load_angle if loads else np.zeros(1)
    for degrees, angle in zip(loads or [0.0], places, strict=True):
        near = np.abs(spread[:, [0, 2]] - angle)
        element, side = np.unravel_index(np.argmin(near), near.shape)
        nodes = [NODES.index((2 * int(side), b)) for b in range(3)]
        stretch, depth = values[element][:, nodes].reshape(-1, 2).T
        axes.plot(stretch, depth, ".-", label=f"{degrees:.4g}°")
    axes.set(xlabel="hoop stretch", ylabel="distance from the inner face [mm]")
    axes.locator_params(axis="x", nbins=4)
    axes.grid(alpha=0.3)
    axes.legend(title="at angle")
