"""Cubic B-splines by Bezier extraction.

On every element a cubic spline is a cubic polynomial, here in Bernstein form: the four
Bernstein coefficients are fixed combinations of the four control values that the element
sees, ``b_a = sum_i C_ia d_i`` with the element's *extraction matrix* C (Borden et al. 2011).
So whatever the knots, elements differ by small matrices alone and share every other table.

An interval may end in two ways: *open*, the knot repeated until the spline interpolates its
last control value, or *mirrored*, the knots reflected beyond the end. There the spline goes
on as its own mirror image, even or odd, with all its continuity.
"""

import dataclasses
import functools
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

End = Literal["open", "mirror"]

DEGREE = 3


def bernstein(
    xi: Float[Array | np.ndarray, "*points"], derivative: int = 0
) -> list[Float[Array | np.ndarray, "*points"]]:
    """The four cubic Bernstein polynomials, or a derivative by xi, at points in [0, 1].

    `xi`: local coordinate. `derivative`: order of differentiation, 0 to 3.
    Returns four values, each shaped like xi.
    """
    x, y = xi, 1 - xi
    if derivative == 0:
        return [y * y * y, 3 * x * y * y, 3 * x * x * y, x * x * x]
    if derivative == 1:
        return [-3 * y * y, 3 * y * (y - 2 * x), 3 * x * (2 * y - x), 3 * x * x]
    if derivative == 2:
        return [6 * y, 6 * x - 12 * y, 6 * y - 12 * x, 6 * x]
    return [0 * xi + third for third in (-6, 18, -18, 6)]


@dataclasses.dataclass(frozen=True)
class SplineAxis:
    """Cubic splines on an interval divided in elements; the breakpoints are given apart.

    The first and the last control value never are unknowns: at an open end they are the
    values there, which a clamp fixes at zero; at a mirrored end they are images. What is
    left are the *stations*.
    """

    elements: int  # number of elements
    left: End = "open"  # how the interval ends at its first breakpoint
    right: End = "open"  # how it ends at its last breakpoint
    # of the knots between elements: 1 for two continuous derivatives, 2 for one; None stands
    # for 1 everywhere
    multiplicity: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        """Reject what has no meaning.

        Raises ValueError: too few elements, or multiplicities that don't fit them.
        """
        mirrored = "mirror" in (self.left, self.right)
        fewest = 3 if mirrored else 1
        if self.elements < fewest:
            raise ValueError(f"a spline needs {fewest} elements or more, got {self.elements}")
        inner = self.multiplicity
        if inner is not None and (len(inner) != self.elements - 1 or not {*inner} <= {1, 2}):
            raise ValueError(
                f"{self.elements} elements have {self.elements - 1} inner knots of "
                f"multiplicity 1 or 2, got {inner}"
            )

    @functools.cached_property
    def _inner(self) -> tuple[int, ...]:
        return self.multiplicity or (1,) * (self.elements - 1)

    @functools.cached_property
    def _weights(self) -> Float[np.ndarray, "knot breakpoint"]:
        """Knots as combinations of breakpoints."""
        unit = np.eye(self.elements + 1)
        counts = [1, *self._inner, 1]
        knots = [row for row, count in zip(unit, counts, strict=True) for _ in range(count)]
        before, after = [knots[0]] * DEGREE, [knots[-1]] * DEGREE
        if self.left == "mirror":
            before = [2 * knots[0] - knots[k] for k in range(DEGREE, 0, -1)]
        if self.right == "mirror":
            after = [2 * knots[-1] - knots[-1 - k] for k in range(1, DEGREE + 1)]
        return np.array([*before, *knots, *after])

    @functools.cached_property
    def first(self) -> Int[np.ndarray, " element"]:
        """First of the four control values that an element sees; the first of all is 0."""
        return np.concatenate([[0], np.cumsum(self._inner)]).astype(int)

    @property
    def stations(self) -> int:
        """Number of control values that are unknowns."""
        return len(self._weights) - DEGREE - 3

    @functools.cached_property
    def station_of(self) -> Int[np.ndarray, "element 4"]:
        """Station behind each of an element's control values; -1 for those that are none."""
        station = self.first[:, None] + np.arange(4) - 1
        return np.where(station < self.stations, station, -1)

    def unfolded(self) -> "SplineAxis":
        """The axis with its mirror image beyond the right end."""
        inner = self.multiplicity and (*self.multiplicity, 1, *self.multiplicity[::-1])
        return SplineAxis(2 * self.elements, self.left, self.left, inner)

    def halved(self) -> "SplineAxis":
        """Every element divided in two."""
        inner = self.multiplicity
        if inner is not None:
            inner = tuple(k for m in (*inner, 0) for k in (1, m) if k)
        return SplineAxis(2 * self.elements, self.left, self.right, inner)

    def joined(self) -> "SplineAxis":
        """Pairs of elements joined, the opposite of `halved`.

        Raises ValueError: elements don't come in pairs.
        """
        if self.elements % 2 or self.multiplicity is not None:
            raise ValueError(f"{self.elements} elements are not pairs")
        return SplineAxis(self.elements // 2, self.left, self.right)

    def knots(
        self, breakpoints: Float[Array, "breakpoint *lane"]
    ) -> Float[Array, "knot *lane"]:
        """All knots, those beyond the ends included."""
        return jnp.asarray(self._weights) @ breakpoints

    def abscissae(
        self, breakpoints: Float[Array, "breakpoint *lane"]
    ) -> Float[Array, "station *lane"]:
        """Greville abscissae of the stations, those next to open ends moved to the ends.

        A clamp at an open end says something about the directions there.
        """
        knots = self.knots(breakpoints)
        means = (knots[2:-4] + knots[3:-3] + knots[4:-2]) / 3
        # At mirrored ends they lie there anyway.
        return means.at[0].set(breakpoints[0]).at[-1].set(breakpoints[-1])

    @functools.partial(jax.jit, static_argnames=("self", "parity"), inline=True)
    def extraction(
        self, breakpoints: Float[Array, " breakpoint"], parity: int | None = 1
    ) -> Float[Array, "4 4 element"]:
        """Extraction matrices [control value, Bernstein coefficient, element].

        Rows of control values that are not stations are zero; an image's row is added to
        that of its station.

        `breakpoints`: ascending. `parity`: 1 where the mirror image has the same sign, -1 where
        the opposite one; None for rows of all control values as they are.
        """
        knots = self.knots(breakpoints)
        at = self.first + DEGREE
        near = knots[at + np.arange(-2, 4)[:, None]]
        # Bezier coefficients are values of the polynomial's blossom, each at its own number of
        # starts and ends of the element: [value, control value, Bernstein, element].
        ends = np.arange(4) > np.arange(3)[:, None]  # [level, Bernstein]
        values = jnp.broadcast_to(np.eye(4)[:, :, None, None], (4, 4, 4, self.elements))
        for level in range(3):
            u = jnp.where(ends[level][:, None], near[3], near[2])
            a, b = near[level:3, None, None], near[3 : 6 - level, None, None]
            share = (u - a) / (b - a)
            values = (1 - share) * values[:-1] + share * values[1:]
        matrix = values[0]
        return matrix if parity is None else self.folded(matrix, parity)

    def folded(
        self, extraction: Float[Array, "4 4 element"], parity: int, held: bool = True
    ) -> Float[Array, "4 4 element"]:
        """Rows of all control values with images added to their stations, the rest zero.

        `extraction`: rows of all control values as they are. `parity`: see `extraction`.
        `held`: whether the value at an open end is zero; else it is that of the next station.
        """
        element = np.arange(self.elements)
        first, last = element == 0, element == self.elements - 1
        outer, left, right, beyond = extraction
        if self.left == "mirror":
            right = right + parity * first * outer
        elif not held:
            left = left + first * outer
        if self.right == "mirror":
            left = left + parity * last * beyond
        elif not held:
            right = right + last * beyond
        return jnp.stack([outer * ~first, left, right, beyond * ~last])

    def matrix(
        self, breakpoints: Float[Array, " breakpoint"], parity: int = 1
    ) -> Float[Array, "4 element station"]:
        """Bernstein coefficients of all elements as a matrix on the stations' values."""
        return self.on_stations(self.extraction(breakpoints, parity))

    def shapes_at(
        self,
        breakpoints: Float[np.ndarray, " breakpoint"],  # ascending
        x: Float[np.ndarray, " place"],
        parity: int,  # see `extraction`
        held: bool,  # see `folded`
    ) -> Float[np.ndarray, "place station"]:
        """Values of the stations' splines at places."""
        from scipy.interpolate import BSpline  # a fifth of the package's imports

        every = BSpline.design_matrix(x, self._weights @ breakpoints, DEGREE).toarray()
        shapes = every[:, 1:-1]
        for end, at, outer in ((self.left, (0, 1), 0), (self.right, (-1, -2), -1)):
            if end == "mirror":
                shapes[:, at[1]] += parity * every[:, outer]
            elif not held:
                shapes[:, at[0]] += every[:, outer]
        return shapes

    def on_stations(
        self, extraction: Float[Array, "4 4 element"]
    ) -> Float[Array, "4 element station"]:
        """Bernstein coefficients from folded extraction matrices."""
        where = np.eye(self.stations + 1)[self.station_of][:, :, :-1]  # element, control
        return jnp.einsum("iae,eis->aes", extraction, where)
