"""Where the stations go along the arc, and which element carries which load.

Solutions have boundary layers at clamps and loads, where the membrane's bending stiffness
meets its tension: stations gather there. A plan is made once from plain numbers. It states
every station as a fixed combination of the *breakpoints* (clamps, load points, ends of
loaded arcs), so stations move smoothly with the inputs and derivatives by a load's angle
are those of the same discrete problem.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mesh.grading import Density, distinct, rounded, stations_between
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad, LoadPoints
from suas_jax.skin.section import AbstractSection

_LOAD_GAUSS = 4  # points per element under a spread load; exact for cubic displacement
_FEWEST_POINTS = 16  # under spread loads together, see `_filled`


class MeshPlan(eqx.Module):
    """A mesh as arrays of plain numbers; its shapes alone decide what is compiled.

    Breakpoints are ordered: left clamp, right clamp, then those of each load in turn, then
    those of bodies, then those of the section.
    """

    # weights of the breakpoints in each station's angle [station, breakpoint]
    stations: np.ndarray
    select: np.ndarray  # element of each load point [element, point]
    # weights of the breakpoints in each load point's angle [point, breakpoint]
    position: np.ndarray
    share: np.ndarray  # share of its load that a point carries, for line loads [point]
    # weights of the breakpoints in the arc that a point stands for
    # [point, breakpoint], zero for line loads
    span: np.ndarray
    load: np.ndarray  # which load a point belongs to [load, point], one or zero
    values: np.ndarray  # the breakpoints when the plan was made [rad]
    # how far each of them lies from where `breakpoints` has it: a body's where it touches
    # material that has slid beneath it [rad]
    slid: np.ndarray
    # whether the loads are their own mirror image
    mirror: bool = eqx.field(static=True, default=False)
    # whether the plan covers the left half of a symmetric skin
    symmetric: bool = eqx.field(static=True, default=False)

    @property
    def elements(self) -> int:
        """Number of elements."""
        return self.stations.shape[0] - 1

    @property
    def loaded(self) -> np.ndarray:
        """Which points carry a part of their load [point]; the others fill up their number."""
        return (self.share != 0) | (self.span != 0).any(1)

    @property
    def mirrors_itself(self) -> bool:
        """Whether stations and loads are their own mirror image."""
        angles = self.stations @ self.values
        points = np.sort((self.position @ self.values)[self.loaded])
        return bool(
            self.mirror
            and self.elements % 2 == 0
            and np.allclose(angles, -angles[::-1], atol=1e-12)
            and np.allclose(points, -points[::-1], atol=1e-12)
        )

    def half(self) -> "MeshPlan":
        """The left half of a plan whose stations and loads are symmetric."""
        n = self.elements // 2
        element = np.argmax(self.select, 0)
        crown = np.isclose(self.position @ self.values, 0, atol=1e-12)
        keep = self.loaded & ((element < n) | (crown & (element == n)))
        shared = crown[keep] & (self.share[keep] > 0)
        element = np.minimum(element[keep], n - 1)
        half = MeshPlan(
            self.stations[: n + 1],
            np.eye(n)[:, element],
            self.position[keep],
            np.where(shared, self.share[keep] / 2, self.share[keep]),
            self.span[keep],
            self.load[:, keep],
            self.values,
            self.slid,
            mirror=True,
            symmetric=True,
        )
        return half._filled()

    def refined(self, elements: int | None = None) -> "MeshPlan":
        """Elements of a plan of the whole arc divided in two.

        `elements`: how many there shall be; the last one stays whole if they are odd.
        """
        whole = 2 * self.elements - (elements or 2 * self.elements)
        divided = self.stations[: self.elements + 1 - whole]
        stations = np.empty((2 * len(divided) - 1, self.stations.shape[1]))
        stations[::2] = divided
        stations[1::2] = (divided[1:] + divided[:-1]) / 2
        stations = np.concatenate([stations, self.stations[self.elements + 1 - whole :]])
        return self._on(stations)

    def coarsened(self) -> "MeshPlan":
        """Pairs of elements of a plan of the whole arc joined; a last one may be left."""
        pairs = self.elements // 2 * 2
        stations = np.concatenate([self.stations[: pairs + 1 : 2], self.stations[pairs + 1 :]])
        return self._on(stations)

    def _on(self, stations: np.ndarray) -> "MeshPlan":
        """The same loads on other elements."""
        spread = (self.span != 0).any(1) @ self.load.T > 0
        return _with_loads(stations, (self.values, self.slid), spread.tolist(), self.mirror)

    def _filled(self) -> "MeshPlan":
        """Points without force behind those of spread loads, up to a power of two.

        How many elements a spread load covers depends on where it is; programs depend on the
        number of points, and meshes that differ in nothing else share one.
        """
        spread = int(np.sum((self.span != 0).any(1)))
        if not spread:
            return self
        none = max(_FEWEST_POINTS, 1 << (spread - 1).bit_length()) - spread

        def behind(x: np.ndarray, filling: np.ndarray, axis: int) -> np.ndarray:
            return np.concatenate([x, np.repeat(filling, none, axis)], axis)

        first = np.eye(self.elements)[:, :1]
        return dataclasses.replace(
            self,
            select=behind(self.select, first, 1),
            position=behind(self.position, self.stations[:1], 0),
            share=behind(self.share, np.zeros(1), 0),
            span=behind(self.span, np.zeros((1, len(self.values))), 0),
            load=behind(self.load, self.load[:, -1:], 1),
        )


def breakpoints(
    section: AbstractSection, loads: Sequence[LineLoad], touched: Sequence[Lanes] = ()
) -> list[Lanes]:
    """Angles of clamps, loads, bodies and kinks, in the order of the plan's weights [rad].

    `touched`: where bodies come in [rad].
    """
    angles = [-section.half_angle, section.half_angle]
    for load in loads:
        angles += load.breakpoints(section)
    angles += touched
    angles += section.breakpoints
    return angles


def plan_mesh(
    numbers: Sequence[float],  # values of the breakpoints [rad], in the order of `breakpoints`
    spread: Sequence[bool],
    elements: int,  # along the whole arc
    layer: float,  # decay length of the boundary layers as an angle [rad]
    *,
    symmetric: bool = False,
    local: tuple[float, float] | None = None,
    slid: Sequence[float] = (),
) -> MeshPlan:
    """Place stations: one at each breakpoint, graded towards the layers.

    `spread`: for each load, whether it has an arc (two breakpoints) or not (one). `symmetric`:
    whether the loads are symmetric; stations then are, too, when the number of elements is
    even. `local`: in a continuum, decay length of what breakpoints cause in their neighbourhood
    besides, and the smallest length of elements [rad]. `slid`: how far material has slid that
    lies at a breakpoint when it is touched [rad]; none for nowhere.
    """
    density = Density((rounded(layer),))
    if local is not None:
        density = Density((*density.decays, rounded(local[0])), rounded(local[1]))
    away = np.asarray(slid, float) if len(slid) else np.zeros(len(numbers))
    values = np.asarray(numbers, float) + away
    identity = np.eye(len(values))
    clamps, crown = identity[:2], (identity[0] + identity[1]) / 2
    inner = list(identity[2:])
    mirrored = symmetric and elements % 2 == 0
    if mirrored:
        inner = [w for w in inner if w @ values < -1e-12]
        ends, count = [clamps[0], *inner, crown], elements // 2
    else:
        ends, count = [clamps[0], *inner, clamps[1]], elements
    kept = distinct(ends, values, count)
    stations = stations_between(kept, values, count, density)
    if mirrored:
        swap = _mirror(values)
        stations = np.concatenate([stations, stations[-2::-1][:, swap]])
    return _with_loads(stations, (values, away), spread, symmetric)


def _mirror(values: np.ndarray) -> np.ndarray:
    """For each breakpoint one at the opposite angle; of those that coincide one for each."""
    index = np.arange(len(values))
    rising, falling = (np.lexsort((index, np.round(x, 12))) for x in (values, -values))
    swap = np.empty_like(index)
    swap[rising] = falling
    return swap


def _with_loads(
    stations: np.ndarray,
    breaks: tuple[np.ndarray, np.ndarray],
    spread: Sequence[bool],
    mirror: bool,
) -> MeshPlan:
    """Put every load on elements: as one point, or as quadrature points of its arc."""
    values = breaks[0]
    angles = stations @ values
    elements = len(angles) - 1
    select, position, share, span, owner = [], [], [], [], []

    def add(element: int, where: np.ndarray, part: float, arc: np.ndarray, k: int) -> None:
        select.append(element)
        position.append(where)
        share.append(part)
        span.append(arc)
        owner.append(k)

    identity, none = np.eye(len(values)), np.zeros(len(values))
    at = 2
    for k, has_arc in enumerate(spread):
        if not has_arc:
            where, value = identity[at], values[at]
            near = int(np.argmin(np.abs(angles - value)))
            on_station = abs(angles[near] - value) < 1e-12
            if on_station and np.array_equal(stations[near], where):
                add(near, where, 1.0, none, k)  # the station moves with the load
            elif on_station and 0 < near < elements:
                # The station belongs to another load: a one-sided derivative by this
                # one's angle would be biased, so either element takes half.
                add(near - 1, where, 0.5, none, k)
                add(near, where, 0.5, none, k)
            else:
                inside = int(np.clip(np.searchsorted(angles, value) - 1, 0, elements - 1))
                add(inside, where, 1.0, none, k)
            at += 1
            continue
        left, right = identity[at], identity[at + 1]
        points, weights = gauss_legendre(_LOAD_GAUSS)
        for e in range(elements):
            a = left if angles[e] <= left @ values + 1e-12 else stations[e]
            b = right if angles[e + 1] >= right @ values - 1e-12 else stations[e + 1]
            if (b - a) @ values <= 1e-12:
                continue
            for x, w in zip(points, weights, strict=True):
                add(e, (1 - x) * a + x * b, 0.0, w * (b - a), k)
        at += 2
    n = len(select)
    plan = MeshPlan(
        stations,
        np.eye(elements)[:, select] if n else np.zeros((elements, 0)),
        np.array(position).reshape(n, len(values)),
        np.array(share),
        np.array(span).reshape(n, len(values)),
        np.eye(len(spread))[:, owner] if n else np.zeros((len(spread), 0)),
        *breaks,
        mirror=mirror,
    )
    return plan._filled()


def load_points(
    plan: MeshPlan,
    geometry: SkinGeometry,  # dimensions, with a lane axis
    loads: Sequence[LineLoad],  # line loads, in the order of the plan
    touched: Sequence[Lanes] = (),  # where bodies come in [rad], likewise
) -> tuple[Float[Array, "station lane"], LoadPoints]:
    """Stations and load points of a plan for the inputs at hand."""
    section = geometry.section
    values = jnp.stack(jnp.broadcast_arrays(*breakpoints(section, loads, touched)))
    values = values + jnp.asarray(plan.slid)[:, None]
    angles = jnp.asarray(plan.stations) @ values
    if not loads or plan.select.shape[1] == 0:
        empty = jnp.zeros((plan.select.shape[0], 0, 1))
        return angles, LoadPoints(empty, jnp.zeros((0, 1)), jnp.zeros((2, 0, 1)))
    where = jnp.asarray(plan.position) @ values
    element = jnp.asarray(plan.select)[:, :, None]
    start = jnp.sum(element * angles[:-1, None], 0)
    end = jnp.sum(element * angles[1:, None], 0)
    widths: list[Lanes] = []
    for load in loads:
        ends = load.breakpoints(section)
        widths.append(ends[1] - ends[0] if load.spread is not None else jnp.ones_like(ends[0]))
    of_load = jnp.asarray(plan.load)
    per_width = jnp.stack(
        jnp.broadcast_arrays(
            *(load.force * load.direction(section) / geometry.width for load in loads)
        ),
        1,
    )  # [2, load, lane]
    force = jnp.einsum("kp,ckl->cpl", of_load, per_width)
    arc = jnp.einsum("kp,kl->pl", of_load, jnp.stack(jnp.broadcast_arrays(*widths)))
    part = plan.share[:, None] + (plan.span @ values) / arc
    return angles, LoadPoints(element, (where - start) / (end - start), force * part)
