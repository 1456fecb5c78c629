"""Pictures of the pad: a value a taxel on the unrolled wall, and the deformed surface."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Rectangle
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.figures.style import CONTACT, SECOND, styled, written
from suas_jax.mechanics.pad.faces import PadShape
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.scene.parts import SceneParts, scene_parts, skin_parts
from suas_jax.scene.solve import Solution
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import thickness_beyond_mean
from suas_jax.skin.loads import PadLoad


@styled
def plot_pad(
    skin: SkinSpec,
    values: Sequence[float],
    file: Path | None = None,
    *,
    label: str = "sensor output [counts]",
) -> Figure:
    """Draw every taxel as the disc it is, in the colour of its value.

    Taxels without a value (NaN: the membrane touches them) are crossed out.

    Args:
        skin: a skin, or a scene, with [electrodes].
        values: one a taxel, in the order of the report's `taxels`.
        file: where to write the figure; its ending chooses the format.
        label: of the colour bar, with the unit.

    Raises:
        ValueError: the skin has no electrodes, or values don't match its taxels.
    """
    parts = skin_parts(skin, continuous_inputs(skin))
    geometry, taxels = parts.geometry, parts.sensing().taxels
    value = np.asarray(values, float)
    if value.shape != (len(taxels.number),):
        raise ValueError(f"{value.size} values for {len(taxels.number)} taxels")
    x = 1e3 * np.asarray(geometry.wall_arc(taxels.angle))[:, 0]
    y, radius = 1e3 * np.asarray(taxels.axial)[:, 0], 5e2 * np.asarray(taxels.diameter)[:, 0]
    width = 1e3 * skin.geometry.width / 2
    fine = jnp.linspace(-1, 1, _FINE)[:, None] * geometry.half_angle
    along = 1e3 * np.asarray(geometry.wall_arc(fine))[:, 0]
    length = float(np.abs(along).max())
    figure = Figure(figsize=(9, 1.2 + 8 * min(1.0, width / length)), layout="constrained")
    axes = figure.subplots()
    discs = [Circle((a, b), r) for a, b, r in zip(x, y, radius, strict=True)]
    patches = PatchCollection(discs, array=np.ma.masked_invalid(value), ec="0.3", lw=0.4)
    patches.set_cmap(patches.get_cmap().with_extremes(bad="0.9"))
    axes.add_collection(patches)
    axes.plot(*[c[np.isnan(value)] for c in (x, y)], "x", color=CONTACT, ms=6)
    axes.set(
        xlim=(along[0], along[-1]),
        ylim=(-width, width),
        aspect="equal",
        xlabel="along the unrolled wall [mm]",
        ylabel="along the axis [mm]",
    )
    if skin.geometry.has_angle:
        told = np.rad2deg(np.asarray(geometry.section.given_angle(fine))[:, 0])
        # Ticks beyond the clamps shall lie beyond them, not on them.
        mm, deg = (np.concatenate([[x[0] - 1e3], x, [x[-1] + 1e3]]) for x in (along, told))
        ways = (lambda x: np.interp(x, mm, deg)), (lambda x: np.interp(x, deg, mm))
        degrees = axes.secondary_xaxis("top", functions=ways)
        degrees.set_xlabel("angle from the symmetry axis [deg]")
    figure.colorbar(patches, ax=axes, label=label, shrink=0.8)
    return written(figure, file)


_FINE = 2001  # places along the arc between which the angle is interpolated
_SAMPLES = 3  # intervals along either side of an element
_LABEL = {"boxstyle": "round,pad=0.15", "facecolor": "w", "edgecolor": "none", "alpha": 0.85}


class _Grid(NamedTuple):
    """The deformed pad on a grid [arc, axial, 1]; positions have components first [m]."""

    inner: Array  # face
    outer: Array  # face
    height: Array  # of the inner face over the undeformed one [m]
    angle: Array  # of the normal through it [rad]


def _grid(problem: Problem, state: State, shown: State) -> _Grid:
    """The faces on a grid."""
    del state
    pad = problem.mechanics
    assert isinstance(pad, Pad)
    faces, section = pad.sampled(shown.q, _SAMPLES), pad.section
    rest = section.inner_face(faces.angle)
    beyond = thickness_beyond_mean(section, pad.relief, faces.angle, faces.axial)
    thick = section.thickness(faces.angle) + beyond
    above = rest + thick * section.inner_normal(faces.angle)
    inner, outer = (
        jnp.concatenate([x, faces.axial[None]]) + moved
        for x, moved in ((rest, faces.inner_displacement), (above, faces.outer_displacement))
    )
    height, angle, _ = PadShape(faces).inner_face(section)
    return _Grid(inner, outer, height, angle)


@styled
def plot_pad_surface(solution: Solution) -> Figure:
    """Draw the gap and the displacement of a pad over the unrolled wall, and its shape.

    `solution`: a solution in three dimensions.
    """
    face, outer, height, angle = (np.asarray(x)[..., 0] for x in solution.read(_grid))
    parts = scene_parts(solution.scene, solution.inputs)
    geometry = parts.skin.geometry
    at = jnp.asarray(angle)[..., None]
    wall = geometry.gap(at, jnp.asarray(face[2])[..., None])
    gap = 1e3 * (height + np.asarray(wall)[..., 0])
    place = _told(parts, at)[..., 0], 1e3 * face[2]

    figure = Figure(figsize=(13, 5.2), layout="constrained")
    panels = figure.add_gridspec(1, 2, width_ratios=(1, 1.1))
    flat = figure.add_subplot(panels[0])
    gap_scale = _around(gap, 1e3 * float(geometry.oil_gap[0]))
    mesh = flat.pcolormesh(*place, gap, cmap="RdBu", norm=gap_scale, shading="gouraud")
    figure.colorbar(mesh, ax=flat, label="gap to the wall [mm]", shrink=0.9)
    _draw_taxels(flat, parts, solution.report["taxels"])
    for load in parts.forces:
        assert isinstance(load, PadLoad)
        _draw_load(flat, load, parts)
    touching = [x for x in solution.report["loads"] if x["kind"] == "body"]
    for entry, body in zip(touching, parts.bodies, strict=True):
        _draw_contact(flat, entry, body, parts)
    what = "angle [deg]" if parts.scene.geometry.has_angle else "arc from the middle [mm]"
    flat.set(xlabel=what, ylabel="position along the axis [mm]")

    space = figure.add_subplot(panels[1], projection="3d")
    assert isinstance(space, Axes3D)
    top = 1e3 * outer
    colours = mesh.cmap(gap_scale(gap))
    space.plot_surface(top[0], top[2], top[1], facecolors=colours, linewidth=0, shade=True,
                       antialiased=False, rcount=200, ccount=200)  # fmt: skip
    spans = [float(np.ptp(top[k])) for k in (0, 2, 1)]
    space.set_box_aspect(spans, zoom=0.92)
    for axis, span in zip((space.xaxis, space.yaxis, space.zaxis), spans, strict=True):
        axis.set_major_locator(MaxNLocator(max(2, round(7 * span / max(spans)))))
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


def _told(parts: SceneParts, angle: Array) -> np.ndarray:
    """Places along the arc as scenes tell them: angles [deg], or arc lengths [mm]."""
    section = parts.skin.geometry.section
    if parts.scene.geometry.has_angle:
        return np.asarray(jnp.rad2deg(section.given_angle(angle)))
    return 1e3 * np.asarray(section.arc(angle))


def _span(parts: SceneParts, angle: Array, half: Any, height: Any) -> tuple[Any, Any]:
    """Middle and extent, as `_told`, of what reaches so far along a line beside the mid-line.

    `half`: to either side [m]. `height`: of the line over the mid-line [m].
    """
    section = parts.skin.geometry.section
    low, high = (_told(parts, section.moved(angle, x, height))[:, 0] for x in (-half, half))
    return (low + high) / 2, high - low


def _draw_taxels(axes: Axes, parts: SceneParts, readings: list[dict[str, Any]]) -> None:
    """Draw the electrodes on the wall in the colours of their counts, white without one."""
    electrodes = parts.skin.electrodes
    if electrodes is None:
        return
    taxels = electrodes.taxels
    axial, diameter = (np.asarray(x)[:, 0] for x in (taxels.axial, taxels.diameter))
    geometry = parts.skin.geometry
    depth = geometry.thickness / 2 + geometry.oil_gap
    place, wide = _span(parts, taxels.angle, taxels.diameter / 2, -depth)
    places = np.stack([place, 1e3 * axial], 1)
    discs = EllipseCollection(
        wide, 1e3 * diameter, np.zeros_like(wide), units="xy", offsets=places,
        offset_transform=axes.transData, edgecolors="0.25", linewidths=0.5,
    )  # fmt: skip
    counts = np.array([taxel["so"] for taxel in readings], float)
    discs.set(array=np.ma.masked_invalid(counts), cmap="viridis")
    discs.set_cmap(discs.get_cmap().with_extremes(bad="w"))
    axes.add_collection(discs)
    axes.figure.colorbar(discs, ax=axes, label="sensor output [counts]", shrink=0.9)


def _draw_contact(axes: Axes, load: dict[str, Any], body: Body, parts: SceneParts) -> None:
    """Mark where a body comes in, as large as what it touches, with its force."""
    above = parts.skin.geometry.thickness / 2
    ends = _span(parts, body.angle[None], load["contact_half_width_m"], above)
    (x,), (wide,) = ends
    y, reach = 1e3 * load["axial_m"], 1e3 * load["contact_half_width_axial_m"]
    axes.plot(x, y, "+", color=SECOND, ms=10, zorder=3)
    axes.add_patch(
        Ellipse((x, y), wide, 2 * reach, fill=False, edgecolor=SECOND, lw=1.8, zorder=3)
    )
    axes.annotate(
        f"body, {load['force_N']:.3g} N", (x + wide / 2, y + reach), xytext=(5, 5),
        textcoords="offset points", fontsize=9, zorder=4, bbox=_LABEL,
    )  # fmt: skip


def _draw_load(axes: Axes, load: PadLoad, parts: SceneParts) -> None:
    """Outline a load's part of the outer face, with its force."""
    arc, length = (float(np.asarray(x)[0]) for x in load.extent())
    (x,), (wide,) = _span(parts, load.angle[None], arc, parts.skin.geometry.thickness / 2)
    y, reach = 1e3 * float(load.axial[0]), 1e3 * length
    outline: Ellipse | Rectangle = Ellipse((x, y), wide, 2 * reach)
    if load.diameter is None:
        outline = Rectangle((x - wide / 2, y - reach), wide, 2 * reach)
    outline.set(fill=False, edgecolor=SECOND, linewidth=1.8, zorder=3)
    axes.add_patch(outline)
    axes.annotate(
        f"{float(load.force[0]):.3g} N", (x + wide / 2, y + reach), xytext=(3, 3),
        textcoords="offset points", fontsize=9, zorder=4, bbox=_LABEL,
    )  # fmt: skip
