"""Figure of a solved pad: its gap unrolled, and the deformed membrane in space."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle
from mpl_toolkits.mplot3d import Axes3D

from suas_jax.config import continuous_inputs
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mechanics.pad.faces import Faces
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.scene.parts import SceneParts, scene_parts
from suas_jax.scene.solve import Solution
from suas_jax.skin.pad_loads import PadLoad

_SAMPLES = 3  # intervals along either side of an element


def _grid(problem: Problem, state: State, shown: State) -> Faces:
    """The faces on a grid."""
    del state
    pad = problem.mechanics
    assert isinstance(pad, Pad)
    return pad.sampled(shown.q, _SAMPLES)


def plot_pad_surface(solution: Solution) -> Figure:
    """Draw the gap and the displacement of a pad over the unrolled wall, and its shape.

    Args:
        solution: a solution in three dimensions.
    """
    grid = solution.read(_grid)
    inner, outer, angle, axial = (
        np.asarray(x)[..., 0]
        for x in (grid.inner_displacement, grid.outer_displacement, grid.angle, grid.axial)
    )
    geometry = solution.scene.geometry
    normal = np.stack([np.sin(angle), np.cos(angle), 0 * angle])
    along = np.stack([0 * angle, 0 * angle, axial])
    face = geometry.inner_radius * normal + along + inner
    radius = np.hypot(face[0], face[1])
    gap = 1e3 * (radius - geometry.inner_radius + geometry.oil_gap)
    place = np.rad2deg(np.arctan2(face[0], face[1])), 1e3 * face[2]

    figure = Figure(figsize=(13, 5.2), layout="constrained")
    panels = figure.add_gridspec(1, 2, width_ratios=(1, 1.1))
    flat = figure.add_subplot(panels[0])
    gap_scale = _around(gap, 1e3 * geometry.oil_gap)
    mesh = flat.pcolormesh(*place, gap, cmap="RdBu", norm=gap_scale, shading="gouraud")
    flat.contour(*place, gap, levels=11, colors="0.3", linewidths=0.4)
    figure.colorbar(mesh, ax=flat, label="gap to the wall [mm]", shrink=0.9)
    parts = scene_parts(solution.scene, continuous_inputs(solution.scene))
    _draw_taxels(flat, parts)
    for load in parts.forces:
        assert isinstance(load, PadLoad)
        _draw_load(flat, load, geometry.inner_radius + geometry.thickness)
    flat.set(xlabel="angle [deg]", ylabel="position along the axis [mm]")

    space = figure.add_subplot(panels[1], projection="3d")
    assert isinstance(space, Axes3D)
    top = 1e3 * ((geometry.inner_radius + geometry.thickness) * normal + along + outer)
    colours = mesh.cmap(gap_scale(gap))
    space.plot_surface(top[0], top[2], top[1], facecolors=colours, linewidth=0, shade=True,
                       rcount=200, ccount=200)  # fmt: skip
    spans = [float(np.ptp(top[k])) for k in (0, 2, 1)]
    space.set_box_aspect(spans)
    space.set(xlabel="x [mm]", ylabel="axis [mm]", zlabel="y [mm]")
    space.view_init(elev=38, azim=-58)
    report = solution.report
    figure.suptitle(
        f"oil {1e-3 * report['oil_pressure_Pa']:.4g} kPa, "
        f"smallest gap {1e3 * report['min_gap_m']:.3g} mm, "
        f"bulge {1e3 * report['bulge_m']:.3g} mm ({report['status']})"
    )
    return figure


def _around(values: np.ndarray, rest: float) -> Normalize:
    """A scale with the gap at rest in its middle."""
    reach = max(float(np.abs(values - rest).max()), 1e-9)
    return Normalize(rest - reach, rest + reach)


def _draw_taxels(axes: Axes, parts: SceneParts) -> None:
    """Outline the electrodes on the wall."""
    electrodes = parts.skin.electrodes
    if electrodes is None:
        return
    taxels = electrodes.taxels
    angle, axial, diameter = (
        np.asarray(x)[:, 0] for x in (taxels.angle, taxels.axial, taxels.diameter)
    )
    wide = np.rad2deg(diameter / float(parts.skin.geometry.wall_radius[0]))
    places = np.stack([np.rad2deg(angle), 1e3 * axial], 1)
    discs = EllipseCollection(
        wide, 1e3 * diameter, np.zeros_like(wide), units="xy", offsets=places,
        offset_transform=axes.transData, facecolors="none", edgecolors="0.25", linewidths=0.5,
    )  # fmt: skip
    axes.add_collection(discs)


def _draw_load(axes: Axes, load: PadLoad, outer_radius: float) -> None:
    """Outline a load's part of the outer face, with its force."""
    arc, length = (float(np.asarray(x)[0]) for x in load.extent())
    x, y = np.rad2deg(float(load.angle[0])), 1e3 * float(load.axial[0])
    half, reach = np.rad2deg(arc / outer_radius), 1e3 * length
    outline: Ellipse | Rectangle = Ellipse((x, y), 2 * half, 2 * reach)
    if load.diameter is None:
        outline = Rectangle((x - half, y - reach), 2 * half, 2 * reach)
    outline.set(fill=False, edgecolor="C1", linewidth=1.8, zorder=3)
    axes.add_patch(outline)
    axes.annotate(
        f"{float(load.force[0]):.3g} N", (x + half, y + reach), xytext=(3, 3),
        textcoords="offset points", color="k", fontsize=9,
    )  # fmt: skip
