"""Figure of a solved section."""

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.figures.load_arrows import draw_bodies, draw_loads
from suas_jax.figures.outline import outline
from suas_jax.figures.wall import draw_wall
from suas_jax.mechanics.base import Profile
from suas_jax.mechanics.section import section_of
from suas_jax.scene.solve import Solution

_SAMPLES = 12


def _profile(problem: Problem, state: State, shown: State) -> Profile:
    """The section around the equilibrium, as the report has it."""
    return section_of(problem.mechanics.around(state.q)).profile(shown.q, _SAMPLES)


def plot_section(solution: Solution) -> Figure:
    """Draw the deformed section over the undeformed one, by energy and by displacement.

    The counterpart of the paper's Fig. 18.

    Args:
        solution: a solution with the lumped shell.
    """
    shape = solution.read(_profile)
    drawn = outline(solution.scene)
    angle = np.asarray(shape.angle)[..., 0].T.ravel()

    def face(rest: np.ndarray, displacement: object) -> np.ndarray:
        moved = np.asarray(displacement)[..., 0].transpose(0, 2, 1).reshape(2, -1)
        at_rest = np.stack([np.interp(angle, drawn.angle, x) for x in rest])
        return np.asarray(1e3 * (at_rest + moved))

    inner, outer = (
        face(rest, moved)
        for rest, moved in (
            (drawn.inner, shape.inner_displacement),
            (drawn.outer, shape.outer_displacement),
        )
    )
    energy = np.asarray(shape.energy_density)[..., 0].T.ravel()
    size = 1e3 * np.linalg.norm(np.asarray(shape.mid_displacement)[..., 0], axis=0).T.ravel()
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    fields = ((1e-3 * energy, "strain-energy density [kJ/m³]"), (size, "displacement [mm]"))
    for axes, (values, label) in zip(figure.subplots(1, 2), fields, strict=True):
        for curve in (drawn.inner, drawn.outer):
            axes.plot(*(1e3 * curve), color="0.7", lw=0.8, ls="--")
        corners = [inner[:, :-1], inner[:, 1:], outer[:, 1:], outer[:, :-1]]
        quads = np.stack(corners, 0).transpose(2, 0, 1)
        patches = PolyCollection(list(quads), array=(values[1:] + values[:-1]) / 2)
        patches.set_edgecolor("face")
        axes.add_collection(patches)
        draw_wall(axes, solution, drawn)
        draw_loads(axes, drawn, outer, angle)
        draw_bodies(axes, solution, drawn, outer, angle)
        figure.colorbar(patches, ax=axes, label=label, shrink=0.8)
        axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
        axes.autoscale_view()
    report = solution.report
    figure.suptitle(
        f"oil {1e-3 * report['oil_pressure_Pa']:.4g} kPa, "
        f"smallest gap {1e3 * report['min_gap_m']:.3g} mm ({report['status']})"
    )
    return figure
