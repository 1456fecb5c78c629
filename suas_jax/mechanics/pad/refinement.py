"""A pad's deformation on other elements, and on both sides of mirror planes.

On elements half as long it is exact, as the finer splines contain it; on elements that join
pairs it is the nearest one.

Mirror planes of a symmetric pad lie across the arc at the crown and across the axis at
mid-length; the modelled part lies at negative angles and axial positions. An image's
displacement across the plane has the other sign: the tangential one (x) at the crown, the axial
one (z) at mid-length.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from suas_jax.mechanics.pad.net import Net, NetTopology
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bspline import SplineAxis
from suas_jax.skin.loads import PadLoadPoints
from suas_jax.skin.section import AbstractSection

# Bernstein coefficients on the left half of an element from those on the whole.
_SPLIT = np.array([[8, 0, 0, 0], [4, 4, 0, 0], [2, 4, 2, 0], [1, 3, 3, 1]]) / 8
_SAMPLES = 5  # places of an element, its ends included, at which splines are compared
_SIGNS = np.array([[-1.0, 1.0, 1.0], [1.0, 1.0, -1.0]])  # [plane, direction]


def on_other_elements(
    net: Net, section: AbstractSection, q: Float[Array, "dof station"], *, finer: bool
) -> Float[Array, "dof station"]:
    """The same deformation on elements half or twice as long in both directions.

    `net`: one lane's control net. `section`: the undeformed membrane across the axis. `finer`:
    whether elements are halved; else pairs of halves are joined.
    """
    old, breaks = net.topology, (net.angles, net.axial)
    if finer:
        new = dataclasses.replace(old, arc=old.arc.halved(), axial=old.axial.halved())
        breaks = _halved(net.angles), _halved(net.axial)
    else:
        new = dataclasses.replace(old, arc=old.arc.joined(), axial=old.axial.joined())
        breaks = net.angles[::2], net.axial[::2]
    fine = Net.of(new, section, *(x[:, None] for x in breaks)).lane(0)
    # The two directions may change places in the order of elimination.
    mine, other = old.ordered(*net.matrices), new.ordered(*fine.matrices)
    signs = new.ordered(*new.parities)
    arc = _nearest(mine[0], other[0], new.arc, signs[0], finer=finer)
    axial = _nearest(mine[1], other[1], new.axial, signs[1], finer=finer)
    x = net.cartesian(q)  # [component, long, across]
    x = x if old.along_arc else jnp.swapaxes(x, 1, 2)
    y = jnp.einsum("cKk,ckm,cMm->cKM", arc, x, axial)
    return fine.local(y if new.along_arc else jnp.swapaxes(y, 1, 2))


def nearest_splines(
    values: Float[np.ndarray, "arc axial width"],  # control values on the given net
    given: NetTopology,
    wanted: NetTopology,
    breaks: tuple[np.ndarray, np.ndarray],  # of the given net, along the arc and the axis
    other_breaks: tuple[np.ndarray, np.ndarray],  # of the wanted one, within the former
) -> Float[np.ndarray, "dof station"]:
    """A deformation on a net with any other elements, as a start for Newton's method.

    Components are those of the columns, between which they turn a little.
    """
    axes = (given.arc, wanted.arc), (given.axial, wanted.axial)
    ways = zip(axes, zip(breaks, other_breaks, strict=True), strict=True)
    signs = [[*zip(p, wanted.held, strict=True)] for p in wanted.ordered(*wanted.parities)]
    maps = [_maps(*way, of) for way, of in zip(ways, signs, strict=True)]
    moved = np.einsum("cKk,cMm,kmc->KMc", *maps, values, optimize=True)
    return np.asarray(wanted.to_stations(jnp.asarray(moved))) * wanted.free


def _maps(
    axes: tuple[SplineAxis, SplineAxis],  # the given splines, and the wanted ones
    breaks: tuple[np.ndarray, np.ndarray],  # of both
    signs: list[tuple[int, bool]],  # parity of every component, and whether ends hold it
) -> Float[np.ndarray, "width wanted given"]:
    """Stations' values of splines from those of others, by least squares at places."""
    inside = np.linspace(0, 1, _SAMPLES)
    x = np.unique(breaks[1][:-1, None] + inside * np.diff(breaks[1])[:, None])
    by_sign = {}
    for sign in {*signs}:
        old, new = (a.shapes_at(b, x, *sign) for a, b in zip(axes, breaks, strict=True))
        by_sign[sign] = np.linalg.lstsq(new, old, rcond=None)[0]
    return np.stack([by_sign[sign] for sign in signs])


def _halved(x: Float[Array, " breakpoint"]) -> Array:
    middle = (x[1:] + x[:-1]) / 2
    woven = jnp.stack([x[:-1], middle], 1).reshape(-1)
    return jnp.concatenate([woven, x[-1:]])


def _nearest(
    # Bernstein coefficients by component from the stations' values
    given: Float[Array, "width 4 element station"],
    wanted: Float[Array, "width 4 element station"],  # coefficients on the other elements
    axis: SplineAxis,  # the splines on the other elements
    parities: tuple[int, ...],  # of the components
    *,
    finer: bool,  # whether the other elements are halves of the given ones; else pairs of them
) -> Float[Array, "width wanted given"]:
    """Stations' values on other elements from those on the given ones, by least squares."""
    halves = np.array([_SPLIT, _SPLIT[::-1, ::-1]])

    def split(x: Float[Array, "width 4 element station"]) -> Array:
        return jnp.einsum("hab,cbes->caehs", halves, x)

    # The finer splines contain the coarser ones: towards them there is no remainder.
    rows = (wanted, split(given)) if finer else (split(wanted), given)
    a, b = (x.reshape(len(parities), -1, x.shape[-1]) for x in rows)
    normal = jnp.einsum("crs,crt->cst", a, a) + np.stack([_held(axis, p) for p in parities])
    return jax.vmap(_solved_definite)(normal, jnp.einsum("crs,crt->cst", a, b))


def _solved_definite(
    matrix: Float[Array, "n n"], right: Float[Array, "n m"]
) -> Float[Array, "n m"]:
    """Solution of a symmetric positive definite system, unknown by unknown.

    Without LAPACK: its calls for stacks of matrices hand the work to XLA's threads and wait. On
    two cores, two such calls at once wait for each other for ever.
    """

    def eliminated(k: Int[Array, ""], rows: Array) -> Array:
        row = rows[k] / rows[k, k]
        return (rows - rows[:, k, None] * row).at[k].set(row)

    size = matrix.shape[0]
    rows = jax.lax.fori_loop(0, size, eliminated, jnp.concatenate([matrix, right], 1))
    return rows[:, size:]


def _held(axis: SplineAxis, parity: int) -> np.ndarray:
    """Unit entries for stations on mirror planes, which odd components don't have."""
    held = np.zeros(axis.stations)
    if parity < 0:
        held[0] = axis.left == "mirror"
        held[-1] = axis.right == "mirror"
    return np.diag(held)


def points_on_both_sides(points: PadLoadPoints, plane: int) -> PadLoadPoints:
    """Load points and their images in a plane, 0 at the crown, 1 at mid-length."""
    angle, axial = points.angle, points.axial
    images = (-angle, axial) if plane == 0 else (angle, -axial)
    force = jnp.concatenate([points.force, _SIGNS[plane][:, None, None] * points.force], 1)
    return PadLoadPoints(
        jnp.concatenate([angle, images[0]]), jnp.concatenate([axial, images[1]]), force
    )


def breaks_on_both_sides(breaks: Float[Array, "breakpoint #lane"]) -> Array:
    """Breakpoints up to a plane, and beyond it."""
    return jnp.concatenate([breaks, -breaks[-2::-1]])


def values_on_both_sides(
    values: Float[Array, "arc axial width lane"], plane: int, vectors: int
) -> Float[Array, "arc axial width lane"]:
    """Control values up to a plane, and beyond it: those of vectors, then of scalars."""
    part = values[-2::-1] if plane == 0 else values[:, -2::-1]
    signs = np.ones((values.shape[2], 1))
    signs[: 3 * vectors, 0] = np.tile(_SIGNS[plane], vectors)
    return jnp.concatenate([values, part * signs], plane)


def image_in_part(
    planes: tuple[bool, bool], angle: Lanes, axial: Lanes
) -> tuple[Float[Array, "3 lane"], Lanes, Lanes]:
    """The place of the modelled part that moves as a place of the whole pad does.

    Returns the signs of the displacement's components; angle [rad] and axial position [m].
    """
    sign = jnp.ones((3, *angle.shape))
    if planes[0]:
        sign = sign.at[0].set(jnp.where(angle > 0, -1.0, 1.0))
        angle = -jnp.abs(angle)
    if planes[1]:
        sign = sign.at[2].set(jnp.where(axial > 0, -1.0, 1.0))
        axial = -jnp.abs(axial)
    return sign, angle, axial
