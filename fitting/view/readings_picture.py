"""Pictures of readings and what was estimated from them: of logs and of live ports."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Flags, Floats
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.view.picture import (
    GOOD,
    Grid,
    Picture,
    arrow,
    describe,
    estimate_in_words,
    estimate_values,
    taxel_states,
    total_force,
)
from suas_jax.config import GeometrySpec, SkinSpec
from suas_jax.scene.taxel_film import TaxelFilm

_LENGTHS = 2.0  # of the covariance, in distances between neighbouring taxels
_LEAST_LENGTH = 8e-3  # [m] a fingertip's dent is not narrower
_AMPLITUDE = 0.2  # standard deviation of the displacement in terms of the oil gap
_EDGE_POINTS = 41  # along each clamp
_TINY = 1e-6  # variance that keeps the matrix regular, relative


class InterpolatedMembrane:
    """The shape that a skin's readings show, without a model of what loads it.

    The displacement along the normal over the skin is a Gaussian process with a Matern
    covariance (smoothness 5/2), zero at the clamps; the gaps that the counts mean are its noisy
    values at the taxels. Its mean is linear in them, so a frame costs one product with a matrix
    that is made once for each set of taxels that can be used.

    `film`: of its taxels. `noise`: standard deviation of a reading [counts]. `grid`: of the
    points that are asked for.
    """

    def __init__(
        self, geometry: GeometrySpec, film: TaxelFilm, noise: float, grid: Grid
    ) -> None:
        self._film, self._grid = film, grid
        self._pad = geometry.dimension == 3
        self._points = self._place(*grid.points)
        self._taxels = self._place(film.section_angle, film.axial)
        self._edges = self._place(*_clamps(grid, geometry.width / 2))
        self._length = max(_LENGTHS * _spacing(self._taxels), _LEAST_LENGTH)
        slope = film.gap(film.rest + noise) - film.gap(film.rest - noise)
        self._variance = (slope / 2 / (_AMPLITUDE * geometry.mean_gap)) ** 2
        self._used = np.zeros(len(film.rest), bool)
        self._weights = np.zeros((len(self._points), 0))

    def __call__(self, so: Floats, usable: Flags) -> NDArray:
        """Displacement of the grid's points [point, 3] [m].

        `so`: readings [taxel] [counts]; NaN where missing. `usable`: taxels to go by [taxel].
        """
        gap = self._film.gap(so)
        usable = usable & np.isfinite(gap)
        if not np.array_equal(usable, self._used) or not self._weights.size:
            self._used, self._weights = usable, self._weights_of(usable)
        height = self._weights @ (gap - self._film.rest_gap)[usable]
        return height[:, None] * self._grid.outward

    def _place(self, angle: NDArray, axial: NDArray) -> Floats:
        """Places on the unrolled inner face [place, 2] [m]; a section has the arc alone."""
        along = axial if self._pad else np.zeros_like(axial)
        return np.stack([self._grid.places.inner_arc(angle), along], 1)

    def _weights_of(self, usable: Flags) -> Floats:
        known = np.concatenate([self._taxels[usable], self._edges])
        variance = np.concatenate([self._variance[usable], np.zeros(len(self._edges))])
        matrix = self._covariance(known, known) + np.diag(variance + _TINY)
        across = self._covariance(known, self._points)
        weights = np.linalg.solve(matrix, across)
        return np.ascontiguousarray(weights[: usable.sum()].T)

    def _covariance(self, a: NDArray, b: NDArray) -> Floats:
        distance = np.linalg.norm(a[:, None] - b[None], axis=-1)
        x = np.sqrt(5.0) * distance / self._length
        return np.asarray((1 + x + x**2 / 3) * np.exp(-x))


def _clamps(grid: Grid, end: float) -> tuple[Floats, Floats]:
    """Angles and axial positions of points along the clamped edges."""
    half = float(grid.angle[-1])
    if len(grid.axial) == 1:
        return np.array([-half, half]), np.zeros(2)
    arc = np.linspace(-half, half, _EDGE_POINTS)
    axial = np.linspace(-end, end, _EDGE_POINTS)[1:-1]
    sides = [(arc, np.full_like(arc, z)) for z in (-end, end)]
    sides += [(np.full_like(axial, a), axial) for a in (-half, half)]
    return np.concatenate([a for a, _ in sides]), np.concatenate([z for _, z in sides])


def _spacing(places: Floats) -> float:
    """Median distance from a taxel to its nearest neighbour [m]."""
    if len(places) < 2:
        return 0.0
    distance = np.linalg.norm(places[:, None] - places[None], axis=-1)
    return float(np.median(np.sort(distance, 1)[:, 1]))


class ReadingsPictures:
    """Makes pictures of a skin's frames.

    `spec`: the skin. `rest`: readings at rest [taxel] [counts]; those of the model where not
    given.
    """

    def __init__(self, spec: SkinSpec, rest: Floats | None) -> None:
        self._spec, self._grid = spec, Grid.of(spec.geometry)
        self.film = TaxelFilm(spec, rest)
        self._membrane = InterpolatedMembrane(
            spec.geometry, self.film, spec.sensing.noise, self._grid
        )

    def description(self, title: str, **more: Any) -> dict[str, Any]:
        """What a page needs to know once; see `describe`."""
        return describe(self._spec, self._grid, self.film, title, **more)

    def picture(
        self,
        time: float,  # of the frame [s]
        so: Floats,  # readings [taxel] [counts]; NaN where missing
        stuck: Flags,  # taxels that repeat one count beyond chance [taxel]
        estimate: LoadEstimate | None,  # what was estimated; None if nothing was
        values: list[tuple[str, str]],  # further rows of the table
        **more: Any,  # keys of the header
    ) -> Picture:
        """A frame's picture."""
        left_out = set(np.flatnonzero(stuck).tolist())
        left_out |= set(() if estimate is None else estimate.left_out)
        states = taxel_states(so, sorted(left_out))
        status, message = estimate_in_words(estimate)
        gap = self.film.gap(so)[states == GOOD]
        rows = estimate_values(estimate)
        if gap.size:
            rows.append(("smallest gap over a taxel", f"{1e3 * np.nanmin(gap):.3f} mm"))
        return Picture(
            time,
            status,
            message,
            lambda: self._membrane(so, states == GOOD),
            so - self.film.rest,
            states,
            [] if estimate is None else [arrow(c, self._grid) for c in estimate.contacts],
            rows + values,
            total_force(estimate),
            float("nan") if estimate is None else estimate.oil_pressure,
            more,
        )
