"""Solving the table of a pad.

Only a quarter of the places is solved: what the other quarters' contacts do to a taxel is what
this quarter's do to its mirror image.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.pad.columns import ACROSS, Column, Columns, largest_forces
from fitting.inverse_load.pad.facts import PadShape
from fitting.inverse_load.pad.rest import stray_counts
from fitting.inverse_load.pad.spline import TensorSpline
from fitting.inverse_load.pad.table import (
    FINE,
    LEVELS,
    PadResolution,
    PadTable,
    grid,
    reciprocal,
)
from suas_jax.scene.skin import Skin
from suas_jax.sensing.taxels import Taxels

_EVERY = 2  # of the places along arc and axis knows derivatives by tangential forces
_MOST = 0.05  # share of the force; a mesh that differs by more differs in shape, too


def build_pad_table(
    skin: Skin,  # the pad, with the resolution's elements
    diameter: float,  # of the contacts [m]
    resolution: PadResolution = FINE,  # of the table
    progress: Callable[[int, int], None] = lambda done, total: None,
    workers: Executor | None = None,  # that solve it; None: this process
) -> PadTable:
    """Solve all states of the table, on all cores or on workers.

    `progress` is called with the number of columns solved and their total.
    """
    images, where = mirror_images(skin)
    edge = PadShape.of(skin).edge(diameter)
    outer = float(skin.geometry.outer_size[0])
    sides = edge[0] * outer, edge[1]
    counts = [max(4, int(np.ceil(x / resolution.spacing)) + 1) for x in sides]
    angle, axial = (np.linspace(0, e, n) for e, n in zip(edge, counts, strict=True))
    places = grid(angle, axial)
    probes = tuple(np.linspace(0, e, n) for e, n in zip(edge, resolution.probes, strict=True))
    passes = 2 if resolution.finer is None else 4
    total = len(places) + passes * len(grid(*probes))
    columns = Columns(images, diameter, progress, total, workers)
    cap, touch = largest_forces(columns, probes)
    force = np.exp(_between(probes, np.log(cap), places))
    surplus = np.zeros((len(places), len(LEVELS)))
    if resolution.finer is not None:
        surplus = _between(probes, _surplus(columns, resolution.finer, probes, cap), places)
    along, axially = (np.unique([*range(0, n, _EVERY), n - 1]) for n in counts)
    across = np.zeros(counts, bool)
    across[np.ix_(along, axially)] = True
    shares = (LEVELS * (1 + surplus))[:, LEVELS != 0]
    across = across.reshape(-1)
    found = columns.solve(places, force, shares, across=across, line=counts[1])
    stray = stray_counts(skin)
    rest, pressure = columns.rest()
    return _unfolded(
        found,
        where,
        (angle, axial),
        force,
        reciprocal(_between(probes, reciprocal(touch), places)),
        surplus,
        (rest, stray_counts(images), pressure),
        (rest[where[0]], stray),
        (along, axially),
        diameter,
    )


def _surplus(
    columns: Columns, finer: tuple[int, int], probes: tuple[Floats, ...], cap: Floats
) -> Floats:
    """Share of force that the table's mesh needs more, of the probes [angle, axial, level]."""
    places, levels = grid(*probes), LEVELS[LEVELS != 0]
    meshes = None, finer
    coarse, fine = (columns.solve(places, cap.reshape(-1), levels, mesh) for mesh in meshes)
    surplus = force_surplus(coarse, fine, levels)
    rest = int(np.flatnonzero(LEVELS == 0)[0])
    return np.insert(surplus, rest, surplus[:, rest], axis=1).reshape(*cap.shape, -1)


def _between(axes: tuple[Floats, ...], values: NDArray, places: NDArray) -> Floats:
    """Values of the probes [angle, axial, ...] between them, even in both directions."""
    whole = [_on_both_sides(x) for x in axes]
    both = mirrored(values)
    spline = TensorSpline.through((whole[0], whole[1]), both.reshape(*both.shape[:2], -1))
    return spline(*places.T)[0].reshape(-1, *values.shape[2:])


def _unfolded(
    found: Column,
    where: Rows,
    axes: tuple[Floats, Floats],
    force: Floats,
    touch: Floats,
    surplus: Floats,
    of_images: tuple[Floats, Floats, float],  # at rest; stray; the oil's pressure at rest
    of_taxels: tuple[Floats, Floats],
    some: tuple[Rows, Rows],
    diameter: float,
) -> PadTable:
    """The whole pad's table from the quarter's states of all images."""
    angle, axial = axes
    rest, stray, at_rest = of_images
    u = 1 / (found.so - stray)
    # Where the membrane touches nothing parts it from the electrode.
    u = np.where(np.isfinite(u) & (u > 0), u, 0.0)
    level = int(np.flatnonzero(LEVELS == 0)[0])
    u = np.insert(u, level, 1 / (rest - stray), axis=1)
    pressure = np.insert(found.pressure, level, at_rest, axis=1)
    across = _across(found, u)
    u, pressure = _mended(u, found.found, level), _mended(pressure, found.found, level)
    shape = (len(angle), len(axial))
    u = u.reshape(*shape, len(LEVELS), -1)
    # A contact mirrored in the crown's plane does to a taxel what it does to its image; a force
    # along the arc is turned round by it.
    whole = _four_quarters([u[..., image] for image in where])
    across = across.reshape(*shape, *across.shape[1:])[np.ix_(*some)]
    turned = np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)])[:, :, None]
    channels = np.concatenate([where, np.full((4, 1), across.shape[-1] - 1)], 1)
    slopes = _four_quarters(
        [sign * across[..., image] for sign, image in zip(turned, channels, strict=True)]
    )

    def on_whole_pad(x: NDArray) -> NDArray:
        return mirrored(x.reshape(*shape, *x.shape[1:]))

    return PadTable(
        _on_both_sides(angle),
        _on_both_sides(axial),
        on_whole_pad(force),
        on_whole_pad(touch),
        whole,
        on_whole_pad(pressure),
        on_whole_pad(surplus),
        *of_taxels,
        slopes,
        _on_both_sides(angle[some[0]]),
        _on_both_sides(axial[some[1]]),
        diameter,
    )


def _on_both_sides(x: Floats) -> Floats:
    """Coordinates of a half with those of their mirror images before them."""
    return np.concatenate([-x[:0:-1], x])


def _four_quarters(quarters: list[NDArray]) -> NDArray:
    """The whole pad from a quarter as it is, mirrored at the crown, at the middle, at both."""
    here, crown, middle, both = (x.astype(np.float32) for x in quarters)
    upper = np.concatenate([middle[:, :0:-1], here], 1)
    lower = np.concatenate([both[:, :0:-1], crown], 1)
    return np.concatenate([lower[:0:-1], upper], 0)


def _across(found: Column, u: NDArray) -> Floats:
    """Derivatives of u and the pressure by tangential forces at all levels; lines join them.

    `found` are the solved states, `u` their reciprocal readings, with the state at rest among
    them [place, level, taxel].
    """
    known = [LEVELS[LEVELS != 0][k] for k in ACROSS]
    share = np.stack([np.interp(LEVELS, known, row) for row in np.eye(len(known))], 1)
    values = np.nan_to_num(np.where(found.found[..., None, None], found.across, np.nan))
    across = np.einsum("lk,pk...->pl...", share, values[:, list(ACROSS)])
    across[..., :-1] *= -(u[:, :, None] ** 2)
    return np.asarray(across)


def _mended(values: NDArray, found: Flags, level: int) -> NDArray:
    """Values with those of states that weren't found replaced by their neighbours' line."""
    good = np.insert(found, level, True, axis=1)
    values = values.copy()
    outwards = (*range(level + 1, len(LEVELS)), *range(level - 1, -1, -1))
    for k in np.flatnonzero(~good.all(1)):
        for j in outwards:
            if good[k, j]:
                continue
            one = j - 1 if j > level else j + 1
            two = 2 * one - j
            values[k, j] = values[k, level]
            if abs(j - level) > 1 or good[k, two]:
                share = (LEVELS[j] - LEVELS[one]) / (LEVELS[one] - LEVELS[two])
                values[k, j] = values[k, one] + share * (values[k, one] - values[k, two])
    return values


def force_surplus(coarse: Column, fine: Column, levels: Floats) -> Floats:
    """Share e of the force by which the coarse mesh has to be loaded more [place, level].

    It is too stiff, by 0.1 to 0.2 % on the default one, evenly enough over the taxels that a
    larger force makes up for it. The share is found where few places are solved on both meshes,
    from readings SO at the same force F, and is smooth in between::

        SO_coarse(F (1 + e)) = SO_fine(F),   e = s.(SO_fine - SO_coarse) / (F s.s), s = dSO/dF

    Readings are those on the table's mesh and on the finer one [place, level, taxel]; levels
    are shares of the largest force, none of them zero.
    Returns the share, 5 % at most; that of the next lighter load where a mesh has no solution,
    and zero where there is none.
    """
    slope = np.gradient(coarse.so, levels, axis=1)
    both = np.isfinite(slope) & np.isfinite(fine.so) & np.isfinite(coarse.so)
    slope = np.where(both, slope, 0.0)
    change = np.where(both, fine.so - coarse.so, 0.0)
    size = np.sum(slope**2, -1)
    good = coarse.found & fine.found & (size > 0)
    share = np.sum(slope * change, -1) / np.where(good, size, 1.0) / levels
    share = np.clip(share, -_MOST, _MOST)
    for k in range(share.shape[1]):
        before = share[:, k - 1] if k else 0.0
        share[:, k] = np.where(good[:, k], share[:, k], before)
    return np.asarray(share)


def mirror_images(skin: Skin) -> tuple[Skin, Rows]:
    """The pad with all distinct mirror images of its taxels.

    Returns the pad, and which of its taxels is the image of each own one: as it is, mirrored in
    the crown's plane, in the middle's and in both [image, taxel].
    """
    e = skin.electrodes
    taxels = len(e.taxels.angle)

    def column(x: Any) -> Floats:
        return np.broadcast_to(np.asarray(x, float).reshape(-1), (taxels,))

    own = [column(x) for x in (e.permittivity, e.stray, e.layers, e.lsb, e.height)]
    rows = []
    for first, second in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        place = (first * column(e.taxels.angle), second * column(e.taxels.axial))
        rows.append(np.stack([*place, column(e.taxels.diameter), *own], 1))
    every = np.concatenate(rows)
    scale = np.maximum(np.abs(every).max(0), 1e-300)
    _, first_of, inverse = np.unique(
        np.round(every / scale, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    chosen = [jnp.asarray(x[:, None]) for x in every[first_of].T]
    count = len(first_of)
    angle, axial, diameter = chosen[:3]
    numbers = tuple(range(1, count + 1))
    taxel = Taxels(angle, axial, diameter, (0,) * count, numbers)
    electrodes = replace(
        e,
        taxels=taxel,
        permittivity=chosen[3],
        stray=chosen[4],
        layers=chosen[5],
        lsb=chosen[6],
        height=chosen[7],
    )
    return replace(skin, electrodes=electrodes), inverse.reshape(4, taxels)


def mirrored(x: NDArray) -> NDArray:
    """Values of a quarter [angle, axial, ...] on the whole pad, the same on all quarters."""
    x = np.concatenate([x[:, :0:-1], x], 1)
    return np.concatenate([x[:0:-1], x], 0)
