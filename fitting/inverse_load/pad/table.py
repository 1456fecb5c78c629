"""A table of solved states of one round contact on a pad: where every estimate begins.

Readings are tabulated as reciprocals u = 1 / (SO - stray), which are nearly the gaps and
change smoothly with the load. Places are even over the pad, forces are shares of the force
that leaves little of the gap there. Only a quarter of the places is solved: what the other
quarters' contacts do to a taxel is what this quarter's do to its mirror image.
"""

import functools
import io
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import platformdirs
from numpy.typing import NDArray

from fitting.inverse_load.pad.spline import TensorSpline
from suas_jax.config import SkinSpec, continuous_inputs, structure
from suas_jax.files.cache_folder import CacheFolder
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import content_key, source_digest
from suas_jax.scene.pad_forward import ELEMENTS, PadSkin, Patches, pad_skin_of
from suas_jax.scene.pad_levels import extrapolation, readings_along
from suas_jax.sensing.taxels import Taxels

LEVELS = np.array([-0.15, 0.0, 0.12, 0.28, 0.46, 0.64, 0.82, 1.0])
"""Forces as shares of the largest, rest among them."""
_SPACING = 5.3e-3  # between places [m]
_PROBES = (4, 3)  # places along arc and axis at which the largest force is sought
_GAP_LEFT = 0.05  # smallest gap in the table in terms of the film's
_MOST_FORCE = 3.0  # largest force in terms of the smallest of the largest forces
_PASSES = 3  # attempts to find the largest force
_FEW = 20  # columns that aren't worth the compiler's own optimisation
_READ = eqx.filter_jit(readings_along)


@dataclass(frozen=True)
class PadTable:
    """States under one radial contact of a given diameter.

    Attributes:
        angle: of the contact [angle, rad].
        axial: of the contact [axial, m].
        cap: largest force of the table [angle, axial] [N].
        first_contact: force at which the membrane reaches the wall [angle, axial] [N];
            infinite where that is far beyond the table.
        u: reciprocal readings [angle, axial, level, taxel] [1/counts].
        pressure: of the oil [angle, axial, level] [Pa].
        rest: readings at rest [taxel] [counts].
        stray: part of the readings that no gap changes [taxel] [counts].
        diameter: of the contact [m].
    """

    angle: NDArray[np.float64]
    axial: NDArray[np.float64]
    cap: NDArray[np.float64]
    first_contact: NDArray[np.float64]
    u: NDArray[np.float64]
    pressure: NDArray[np.float64]
    rest: NDArray[np.float64]
    stray: NDArray[np.float64]
    diameter: float

    @functools.cached_property
    def spline(self) -> TensorSpline:
        """Of the changes of u from rest and, as the last channel, the oil's pressure."""
        change = self.u - 1 / (self.rest - self.stray)
        both = np.concatenate([change, self.pressure[..., None]], -1)
        return TensorSpline.through((self.angle, self.axial, LEVELS), both)

    @functools.cached_property
    def largest(self) -> TensorSpline:
        """Of the logarithm of the largest force."""
        return TensorSpline.through((self.angle, self.axial), np.log(self.cap)[..., None])

    @functools.cached_property
    def places(self) -> NDArray[np.float64]:
        """Angle and axial position of every place [place, 2]."""
        return _grid(self.angle, self.axial)

    @functools.cached_property
    def signatures(self) -> NDArray[np.float64]:
        """Change of channels per newton of a light contact [place, channel]."""
        rest = 1 / (self.rest - self.stray)
        level = int(np.flatnonzero(LEVELS > 0)[0])
        so = -(self.u[:, :, level] - rest) / rest**2
        both = np.concatenate([so, self.pressure[:, :, level, None]], -1)
        slope = both / (LEVELS[level] * self.cap)[..., None]
        return np.asarray(slope.reshape(-1, slope.shape[-1]))

    def thinned(self, every: int) -> "PadTable":
        """The table at some of its places only, the outermost among them."""
        i, j = (
            np.unique(np.append(np.arange(0, len(x), every), len(x) - 1))
            for x in (self.angle, self.axial)
        )
        at = np.ix_(i, j)
        return replace(
            self,
            angle=self.angle[i],
            axial=self.axial[j],
            cap=self.cap[at],
            first_contact=self.first_contact[at],
            u=self.u[at],
            pressure=self.pressure[at],
        )

    @functools.cached_property
    def nodes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Loads (angle, axial, force) and channels of all states that press.

        Returns:
            Loads [node, 3]; readings and, last, the oil's pressure [node, channel].
        """
        used = LEVELS > 0
        so = np.minimum(self.stray + 1 / np.maximum(self.u[:, :, used], 1e-12), 1e6)
        both = np.concatenate([so, self.pressure[:, :, used, None]], -1)
        force = self.cap[..., None] * LEVELS[used]
        place = np.repeat(self.places, used.sum(), 0)
        loads = np.concatenate([place, force.reshape(-1, 1)], 1)
        return loads, both.reshape(-1, both.shape[-1])


def pad_table_of(
    spec: SkinSpec,
    diameter: float,
    *,
    spacing: float = _SPACING,
    elements: tuple[int, int] = ELEMENTS,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> PadTable:
    """The table of a pad, from the cache where it is there.

    Args:
        spec: the pad, with electrodes.
        diameter: of the contacts [m].
        spacing: of the table's places [m].
        elements: of the meshes.
        progress: called with the number of columns solved and their total.
    """
    skin = pad_skin_of(spec, elements=elements, contact=False)
    folder = CacheFolder(platformdirs.user_cache_path("suas_jax") / "tables")
    name = content_key(
        {
            "structure": structure(spec),
            "inputs": continuous_inputs(spec),
            "electrodes": repr(spec.electrodes),
            "diameter": diameter,
            "spacing": spacing,
            "elements": skin.elements,
            "source": source_digest(),
        }
    )
    content = folder.get(name)
    if content is not None:
        with np.load(io.BytesIO(content)) as data:
            found = {key: data[key] for key in PadTable.__dataclass_fields__}
        return PadTable(**{**found, "diameter": float(found["diameter"])})
    table = build_pad_table(skin, diameter, spacing, progress)
    stream = io.BytesIO()
    np.savez(stream, **{key: getattr(table, key) for key in table.__dataclass_fields__})
    folder.put(name, stream.getvalue())
    return table


def build_pad_table(
    skin: PadSkin,
    diameter: float,
    spacing: float = _SPACING,
    progress: Callable[[int, int], None] = lambda done, total: None,
    probes_at: tuple[int, int] = _PROBES,
) -> PadTable:
    """Solve all states of the table, on all cores.

    Args:
        skin: the pad.
        diameter: of the contacts [m].
        spacing: between places [m].
        progress: called with the number of columns solved and their total.
        probes_at: places along arc and axis at which the largest force is sought.
    """
    images, where = mirror_images(skin)
    edge = edge_of(skin, diameter)
    outer = float(skin.geometry.outer_radius[0])
    counts = [max(4, int(np.ceil(x / spacing)) + 1) for x in (edge[0] * outer, edge[1])]
    angle, axial = (np.linspace(0, e, n) for e, n in zip(edge, counts, strict=True))
    places = _grid(angle, axial)
    probes = tuple(np.linspace(0, e, n) for e, n in zip(edge, probes_at, strict=True))
    total = len(places) + 2 * len(_grid(*probes))
    columns = Columns(images, diameter, progress, total)
    cap, touch = largest_forces(columns, probes)
    force = np.exp(_over(probes, np.log(cap), places))
    found = columns.solve(places, force, LEVELS[LEVELS != 0])
    stray = stray_counts(skin)
    rest = rest_readings(images)
    return _unfolded(
        found,
        where,
        (angle, axial),
        force,
        _inverse(_over(probes, _inverse(touch), places)),
        (rest, stray_counts(images)),
        (rest[where[0]], stray),
        diameter,
    )


def edge_of(skin: PadSkin, diameter: float) -> tuple[float, float]:
    """Largest angle [rad] and axial position [m] of a contact that stays on the pad."""
    g = skin.geometry
    margin = diameter / 2 + float(g.thickness[0]) / 4
    return (
        float(g.half_angle[0]) - margin / float(g.outer_radius[0]),
        float(g.width[0]) / 2 - margin,
    )


def mirror_images(skin: PadSkin) -> tuple[PadSkin, NDArray[np.intp]]:
    """The pad with all distinct mirror images of its taxels.

    Returns:
        The pad, and which of its taxels is the image of each own one: as it is, mirrored in
        the crown's plane, in the middle's and in both [image, taxel].
    """
    e = skin.electrodes
    taxels = len(e.taxels.angle)

    def column(x: Any) -> NDArray[np.float64]:
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


class Column(NamedTuple):
    """Readings of one place, or of many with a leading axis; see `PadReadings`."""

    so: NDArray[np.float64]
    pressure: NDArray[np.float64]
    min_gap: NDArray[np.float64]
    found: NDArray[np.bool_]


class Columns:
    """Solves columns of the table: one place, all forces."""

    def __init__(
        self, skin: PadSkin, diameter: float, progress: Callable[[int, int], None], total: int
    ) -> None:
        self.skin, self._diameter = skin, diameter
        self._progress, self._total, self._done = progress, total, 0

    def solve(
        self, places: NDArray[np.float64], force: NDArray[np.float64], levels: NDArray
    ) -> Column:
        """Readings [place, level, ...] of places [place, 2] under shares of forces."""
        weights = extrapolation(levels)

        def column(k: int) -> Column:
            values = (*places[k], force[k], self._diameter)
            patches = Patches(*(jnp.array([float(x)]) for x in values))
            plan = self.skin.plan(patches)
            found = COMPILED.run(
                _READ, self.skin, patches, plan, levels, weights, once=self._total < _FEW
            )
            self._done += 1
            self._progress(min(self._done, self._total), self._total)
            return Column(*(np.asarray(x) for x in found))

        rows = [column(0)]  # compiles
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            rows += pool.map(column, range(1, len(places)))
        return Column(*(np.stack(x) for x in zip(*rows, strict=True)))


def largest_forces(
    columns: Columns, probes: tuple[NDArray[np.float64], ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Forces that leave little of the gap, and those that leave none [angle, axial] [N].

    From the linear response at the crown a path of forces is guessed that reaches the wall,
    and raised until it does, or until it ends.
    """
    skin = columns.skin
    places, levels = _grid(*probes), LEVELS[LEVELS != 0]
    g = skin.geometry
    gap = float(g.oil_gap[0])
    tiny = 1e-7 * float(skin.law.shear_modulus[0]) * float(g.thickness[0]) ** 2
    light = columns.solve(places[:1], np.array([tiny]), levels)
    linear = tiny * gap / max(gap - float(light.min_gap[0, -1]), 1e-12 * gap)
    top = np.full(len(places), 1.2 * linear)
    cap, touch = np.full(len(places), np.nan), np.full(len(places), np.inf)
    open_ = np.arange(len(places))
    for _ in range(_PASSES):
        found = columns.solve(places[open_], top[open_], levels)
        for row, k in enumerate(open_):
            share, closes = _reach(found, row, levels, _GAP_LEFT * gap)
            cap[k], touch[k] = share * top[k], closes * top[k]
        again = np.isinf(touch[open_]) & (cap[open_] >= top[open_])
        open_ = open_[again & (top[open_] < _MOST_FORCE * np.nanmin(cap))]
        if not open_.size:
            break
        top[open_] *= 2.5
    cap = np.minimum(cap, _MOST_FORCE * cap.min())
    shape = tuple(len(x) for x in probes)
    return cap.reshape(shape), touch.reshape(shape)


def _reach(
    found: Column, row: int, levels: NDArray[np.float64], left: float
) -> tuple[float, float]:
    """Shares of the force at which little of the gap is left, and none."""
    good = found.found[row] & (levels > 0) & np.isfinite(found.min_gap[row])
    ends = np.flatnonzero((levels > 0) & ~good)
    if ends.size:
        good[ends[0] :] = False
    share, gap = levels[good], found.min_gap[row][good]
    if not share.size:
        return float(levels[levels > 0][0]), np.inf

    def crossing(wanted: float) -> float:
        below = np.flatnonzero(gap <= wanted)
        if not below.size:
            return np.inf
        k = max(int(below[0]), 1)
        near = slice(max(k - 2, 0), k + 1)
        return float(np.interp(-wanted, -gap[near], share[near]))

    return min(crossing(left), float(share[-1])), crossing(0.0)


def rest_readings(skin: PadSkin) -> NDArray[np.float64]:
    """Readings of the undeformed pad [taxel] [counts]."""
    so = skin.electrodes.read_even_film(skin.geometry.oil_gap)
    return np.broadcast_to(np.asarray(so)[:, 0], (len(skin.electrodes.taxels.angle),)).copy()


def _inverse(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reciprocals of forces, infinite for those that aren't above zero, and back."""
    finite = np.isfinite(force) & (force > 1e-9)
    return np.where(
        np.isinf(force), 0.0, np.where(finite, 1 / np.where(finite, force, 1.0), np.inf)
    )


def stray_counts(skin: PadSkin) -> NDArray[np.float64]:
    """Part of the readings that no gap changes [taxel] [counts]."""
    taxels = len(skin.electrodes.taxels.angle)
    counts = np.asarray(skin.electrodes.stray / skin.electrodes.lsb, float).reshape(-1)
    return np.broadcast_to(counts, (taxels,)).copy()


def _grid(*axes: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([x.reshape(-1) for x in np.meshgrid(*axes, indexing="ij")], 1)


def _mirrored(x: NDArray) -> NDArray:
    """Values of a quarter [angle, axial, ...] on the whole pad, the same on all quarters."""
    x = np.concatenate([x[:, :0:-1], x], 1)
    return np.concatenate([x[:0:-1], x], 0)


def _over(
    axes: tuple[NDArray[np.float64], ...], values: NDArray, places: NDArray
) -> NDArray[np.float64]:
    """Values of the probes between them, even in both directions."""
    whole = [np.concatenate([-x[:0:-1], x]) for x in axes]
    both = _mirrored(values)
    spline = TensorSpline.through((whole[0], whole[1]), both[..., None])
    return spline(*places.T)[0][:, 0]


def _unfolded(
    found: Column,
    where: NDArray[np.intp],
    axes: tuple[NDArray[np.float64], NDArray[np.float64]],
    force: NDArray[np.float64],
    touch: NDArray[np.float64],
    of_images: tuple[NDArray[np.float64], NDArray[np.float64]],
    of_taxels: tuple[NDArray[np.float64], NDArray[np.float64]],
    diameter: float,
) -> PadTable:
    """The whole pad's table from the quarter's states of all images."""
    angle, axial = axes
    rest, stray = of_images
    u = 1 / (found.so - stray)
    # Where the membrane touches nothing parts it from the electrode.
    u = np.where(np.isfinite(u) & (u > 0), u, 0.0)
    level = int(np.flatnonzero(LEVELS == 0)[0])
    u = np.insert(u, level, 1 / (rest - stray), axis=1)
    pressure = np.insert(found.pressure, level, 0.0, axis=1)
    u, pressure = _mended(u, found.found, level), _mended(pressure, found.found, level)
    shape = (len(angle), len(axial))
    u = u.reshape(*shape, len(LEVELS), -1)
    quarters = [u[..., image].astype(np.float32) for image in where]
    # A contact mirrored in the crown's plane does to a taxel what it does to its image.
    here, crown, middle, both = quarters
    upper = np.concatenate([middle[:, :0:-1], here], 1)
    lower = np.concatenate([both[:, :0:-1], crown], 1)
    whole = np.concatenate([lower[:0:-1], upper], 0)

    def on_whole_pad(x: NDArray) -> NDArray:
        return _mirrored(x.reshape(*shape, *x.shape[1:]))

    return PadTable(
        np.concatenate([-angle[:0:-1], angle]),
        np.concatenate([-axial[:0:-1], axial]),
        on_whole_pad(force),
        on_whole_pad(touch),
        whole,
        on_whole_pad(pressure),
        *of_taxels,
        diameter,
    )


def _mended(values: NDArray, found: NDArray[np.bool_], level: int) -> NDArray:
    """Values with those of states that weren't found replaced by their neighbours' line."""
    good = np.insert(found, level, True, axis=1)
    values = values.copy()
    for k in np.flatnonzero(~good.all(1)):
        for j in np.flatnonzero(~good[k]):
            if j >= 2 and j > level:
                share = (LEVELS[j] - LEVELS[j - 1]) / (LEVELS[j - 1] - LEVELS[j - 2])
                values[k, j] = values[k, j - 1] + share * (values[k, j - 1] - values[k, j - 2])
            else:
                values[k, j] = values[k, level]
    return values
