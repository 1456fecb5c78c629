"""Where the pad's elements go.

Elements gather along clamped edges and around loads, in both directions: the mesh is a
tensor product. A plan is made once from plain numbers. It states breakpoints as fractions of
the pad's extent, which stay where they are when loads move: load points slide over the mesh.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mesh.grading import rounded
from suas_jax.numerics.bspline import End, SplineAxis
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import PadLoad

Ends = Literal["clamped", "sliding"]


class ElementSizes(NamedTuple):
    """Sizes of elements in decay lengths of bending, sqrt(R t)."""

    edge: float  # along clamped edges
    load: float  # under a load
    largest: float  # far away
    growth: float  # how fast they grow with the distance


SHELL_SIZES = ElementSizes(1.2, 0.32, 1.2, 0.2)
_FINE = 32  # rounded lengths a doubling, two per cent apart
# Places that loads may have between the middle and an edge, as far as the mesh knows.
_PLACES = 48


class Footprint(NamedTuple):
    """A load's place as plain numbers."""

    angle: float  # of its centre [rad]
    axial: float  # of its centre [m]
    arc: float  # half its extent along the arc [rad]
    length: float  # half its extent along the axis [m]
    disc: bool  # whether it is round


class PadPlan(eqx.Module):
    """A mesh as plain numbers; array shapes and static fields decide what is compiled."""

    arc: np.ndarray  # breakpoints along the arc as fractions of the half angle, from -1
    axial: np.ndarray  # breakpoints along the axis as fractions of half the length, from -1
    # whether the plan ends at the plane of symmetry (crown, middle) in each direction
    mirrored: tuple[bool, bool] = eqx.field(static=True)
    # whether the curved ends are clamped or slide in planes across the axis
    ends: Ends = eqx.field(static=True)
    # points for each load: for a disc along radius and around, else the elements (along the
    # arc, the axis) that it may reach over, zero for no extent
    spread: tuple[tuple[int, int], ...] = eqx.field(static=True)
    discs: tuple[bool, ...] = eqx.field(static=True)  # for each load, whether it is round

    @property
    def axes(self) -> tuple[SplineAxis, SplineAxis]:
        """Splines along the arc and along the axis."""
        half_arc, half_axial = self.mirrored
        left: End = "open" if self.ends == "clamped" else "mirror"
        return (
            SplineAxis(len(self.arc) - 1, "open", "mirror" if half_arc else "open"),
            SplineAxis(len(self.axial) - 1, left, "mirror" if half_axial else left),
        )

    @property
    def elements(self) -> tuple[int, int]:
        """Elements of the whole pad, along the arc and along the axis."""
        arc, axial = len(self.arc) - 1, len(self.axial) - 1
        return arc * (1 + self.mirrored[0]), axial * (1 + self.mirrored[1])

    def breakpoints(
        self, geometry: SkinGeometry
    ) -> tuple[Float[Array, "arc lane"], Float[Array, "axial lane"]]:
        """Angles [rad] and axial positions [m] of the breakpoints."""
        return (
            jnp.asarray(self.arc)[:, None] * geometry.half_angle,
            jnp.asarray(self.axial)[:, None] * (geometry.width / 2),
        )

    def unfolded(self) -> "PadPlan":
        """The whole pad from a half or a quarter."""
        arc, axial = (
            np.concatenate([x, -x[-2::-1]]) if mirrored else x
            for x, mirrored in zip((self.arc, self.axial), self.mirrored, strict=True)
        )
        # What reaches over a mirror plane reaches over elements on both sides.
        twice = tuple(1 + mirrored for mirrored in self.mirrored)
        most = (len(arc) - 1, len(axial) - 1)
        plan = dataclasses.replace(self, mirrored=(False, False))
        return plan._with(arc, axial, lambda n, way: min(n * twice[way], most[way]))

    def refined(self) -> "PadPlan":
        """Every element divided in four."""
        return self._with(_halved(self.arc), _halved(self.axial), lambda n, _: 2 * n)

    def joined(self) -> "PadPlan":
        """Pairs of elements joined: what `refined` has divided."""
        return self._with(self.arc[::2], self.axial[::2], lambda n, _: -(-n // 2))

    def _with(
        self, arc: np.ndarray, axial: np.ndarray, reach: Callable[[int, int], int]
    ) -> "PadPlan":
        """The loads on other elements: how many they reach over, by the number and the way."""
        spread = tuple(
            (n, m) if disc else (reach(n, 0), reach(m, 1))
            for (n, m), disc in zip(self.spread, self.discs, strict=True)
        )
        return dataclasses.replace(self, arc=arc, axial=axial, spread=spread)


def footprint(load: PadLoad, outer_size: float) -> Footprint:
    """A load's place in the first lane.

    `load`: with known numbers. `outer_size`: length of the outer face per angle [m].
    """

    def number(x: Array) -> float:
        return float(np.asarray(x)[0])

    arc, length = (number(x) for x in load.extent())
    disc = load.diameter is not None
    return Footprint(number(load.angle), number(load.axial), arc / outer_size, length, disc)


def plan_pad(
    half_angle: float,  # from the symmetry axis to a clamped edge [rad]
    length: float,  # between the ends [m]
    mid_size: float,  # length of the mid-line per angle [m]
    thickness: float,  # of the membrane [m]
    footprints: Sequence[Footprint],  # of the loads
    *,
    elements: tuple[int, int] | None = None,
    scale: float = 1.0,  # divides the size of elements where their number is not given
    mirrored: tuple[bool, bool] = (False, False),
    ends: Ends = "clamped",  # of the axis
    touched: Sequence[Footprint] = (),  # places of bodies
    sizes: ElementSizes = SHELL_SIZES,
) -> PadPlan:
    """Place breakpoints.

    `elements`: along the arc and along the axis of the whole pad; from the sizes of the pad and
    its loads where not given. Even where mirrored. `mirrored`: whether the loads are their own
    image in the crown's plane, and in the middle's: half or a quarter of the pad is enough.
    `sizes`: of elements, relative to each other where their number is given.
    Raises ValueError: an odd number of elements where the plan is to be mirrored.
    """
    decay = rounded(np.sqrt(mid_size * thickness))
    marked = [*footprints, *touched]
    arc_marks = [(mid_size * f.angle, mid_size * f.arc) for f in marked]
    axial_marks = [(f.axial, f.length) for f in marked]
    wanted = elements or (None, None)
    arc = _breakpoints(
        mid_size * half_angle, decay, arc_marks, wanted[0], scale, mirrored[0], True, sizes
    )
    axial = _breakpoints(
        length / 2, decay, axial_marks, wanted[1], scale, mirrored[1], ends == "clamped", sizes
    )
    spread = []
    for f in footprints:
        if f.disc:
            smallest = _smallest_near(arc * half_angle, f.angle, f.arc) * mid_size
            smallest = min(smallest, _smallest_near(axial * length / 2, f.axial, f.length))
            across = _even(f.length / smallest)
            spread.append((2 + 2 * across, 8 + 4 * across))
        else:
            spread.append(
                (_reach(arc * half_angle, f.arc), _reach(axial * length / 2, f.length))
            )
    discs = tuple(f.disc for f in footprints)
    return PadPlan(arc, axial, mirrored, ends, tuple(spread), discs)


def mirror_planes(loads: Sequence[PadLoad]) -> tuple[bool, bool]:
    """Whether loads are, as a whole, their own image in the crown's plane and the middle's.

    `loads`: with known numbers, of any lanes.
    """

    def row(load: PadLoad, signs: tuple[int, int, int, int]) -> np.ndarray:
        arc, length = load.extent()
        turn = jnp.zeros_like(load.turn) if load.vertical else load.turn
        numbers = [load.angle, turn, load.axial, load.tilt, load.force, arc, length]
        values = np.stack([np.asarray(x) for x in jnp.broadcast_arrays(*numbers)])
        values[:4] *= np.array(signs)[:, None]
        shape = [load.vertical, load.diameter is None, load.arc is None]
        flags = np.repeat(np.array(shape, float)[:, None], values.shape[1], 1)
        return np.concatenate([flags, values]) + 0.0

    def symmetric(signs: tuple[int, int, int, int]) -> bool:
        left = [row(load, (1, 1, 1, 1)) for load in loads]
        for image in [row(load, signs) for load in loads]:
            match = [
                i
                for i, x in enumerate(left)
                if x.shape == image.shape and np.allclose(x, image, rtol=1e-12, atol=1e-15)
            ]
            if not match:
                return False
            left.pop(match[0])
        return True

    return symmetric((-1, -1, 1, 1)), symmetric((1, 1, -1, -1))


def _breakpoints(
    half: float,
    decay: float,
    marks: Sequence[tuple[float, float]],
    elements: int | None,
    scale: float,
    mirrored: bool,
    clamped: bool,
    sizes: ElementSizes,
) -> np.ndarray:
    """Breakpoints as fractions of half the extent, by a density of elements."""
    # Lengths in decay lengths, rounded: scenes that differ by little are divided alike, so
    # that the difference of two solves is what the gradient says.
    extent = rounded(half / decay, _FINE)
    x = np.linspace(-extent, extent, 4001)
    size = np.full_like(x, sizes.largest)
    sources = [(-extent, 0.0, sizes.edge), (extent, 0.0, sizes.edge)] if clamped else []
    for centre, reach in marks:
        place = np.round(centre / half * _PLACES) / _PLACES
        sources.append((place * extent, rounded(reach / half, _FINE) * extent, sizes.load))
    for centre, reach, smallest in sources:
        distance = np.maximum(np.abs(x - centre) - reach, 0)
        size = np.minimum(size, smallest + sizes.growth * distance)
    if mirrored:
        size = np.minimum(size, size[::-1])
        if elements is not None and elements % 2:
            raise ValueError(
                f"a plan mirrored in the middle needs an even number of elements, got "
                f"{elements}"
            )
        x, size, elements = x[:2001], size[:2001], elements and elements // 2
    density = (1 / size[1:] + 1 / size[:-1]) / 2 * np.diff(x)
    total = np.concatenate([[0.0], np.cumsum(density)])
    # Loads elsewhere on the same pad shall find their program compiled.
    step = 2 if mirrored else 4
    count = elements or max(4, step * int(np.ceil(total[-1] * scale / step - 0.25)))
    places = np.interp(np.arange(count + 1) / count, total / total[-1], x / extent)
    places[0], places[-1] = -1.0, 0.0 if mirrored else 1.0
    return places


def _halved(x: np.ndarray) -> np.ndarray:
    return np.sort(np.concatenate([x, (x[1:] + x[:-1]) / 2]))


def _reach(breaks: np.ndarray, half: float) -> int:
    """Most elements that an interval may reach over, wherever it lies."""
    if half == 0:
        return 0
    last = np.searchsorted(breaks, breaks + 2 * half * (1 + 1e-9), side="right")
    return min(_even(np.max(last - np.arange(len(breaks))) + 1), len(breaks) - 1)


def _even(number: float) -> int:
    """The next even number: fewer shapes, so fewer programs, for nearby scenes."""
    return 2 * int(np.ceil(number / 2))


def _smallest_near(breaks: np.ndarray, centre: float, half: float) -> float:
    """Smallest element that an interval reaches over."""
    near = (breaks[1:] > centre - half) & (breaks[:-1] < centre + half)
    sizes = np.diff(breaks)
    return float(np.min(sizes[near] if near.any() else sizes))
