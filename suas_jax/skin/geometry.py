"""The skin's dimensions, which may vary: cubic splines through the values of a table.

Cross-section: a membrane clamped along both straight edges over a rigid wall, the oil film
between them. The wall is the inner face moved inwards along its normal.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.polynomials import gauss_legendre, polynomial
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection

_INTERVALS, _GAUSS = 64, 4  # of integrals over the whole arc


class Along(eqx.Module):
    """The cubic spline through values at fractions of the inner face's arc.

    Two continuous derivatives; not-a-knot at the ends. It is linear in the values, so that
    the places alone make its matrix.
    """

    # the fractions, from 0 at the left clamp to 1 at the right one
    at: tuple[float, ...] = eqx.field(static=True)
    values: Float[Array, "place #lane"]  # there [place, lane]
    # whether the right half is the mirror image of the left one
    mirrored: bool = eqx.field(static=True, default=False)

    def __call__(self, fraction: Float[Array, "*shape #lane"]) -> Float[Array, "*shape lane"]:
        """The number at fractions of the arc."""
        knots = np.array(self.at)
        table = jnp.einsum("pik,kl->pil", _powers(self.at), self.values)
        inside = jnp.sum(fraction[..., None] >= knots[1:-1], -1)
        x = fraction - jnp.asarray(knots)[inside]
        lane = jnp.arange(table.shape[-1])
        return polynomial([row[inside, lane] for row in table], x)

    def mean(self) -> Float[Array, " #lane"]:
        """Over the arc."""
        return jnp.asarray(_weights(self.at)) @ self.values


class Sheet(eqx.Module):
    """The product of two cubic splines, along the arc and along the axis; see `Along`."""

    # fractions of the inner face's arc, and of the length along the axis
    at: tuple[tuple[float, ...], tuple[float, ...]] = eqx.field(static=True)
    # there [place along the arc, place along the axis, lane]
    values: Float[Array, "arc axial #lane"]
    width: Lanes  # the length along the axis [m]
    # whether the right half is the mirror image of the left one
    mirrored: bool = eqx.field(static=True, default=False)

    def __call__(
        self, fraction: Float[Array, "*shape #lane"], axial: Float[Array, "*shape #lane"]
    ) -> Float[Array, "*shape lane"]:
        """The number at fractions of the arc and positions along the axis from its middle."""
        both = jnp.broadcast_arrays(fraction, 0.5 + axial / self.width)
        shares = [_shares(at, x) for at, x in zip(self.at, both, strict=True)]
        values = jnp.expand_dims(self.values, tuple(range(2, 1 + both[0].ndim)))
        return jnp.sum(values * shares[0][:, None] * shares[1], (0, 1))

    def mean(self) -> Along:
        """Over the length, along the arc."""
        values = jnp.einsum("b,abl->al", _weights(self.at[1]), self.values)
        return Along(self.at[0], values, self.mirrored)

    def beyond_mean(self) -> "Sheet":
        """What is left without the mean over the length."""
        rest = self.values - self.mean().values[:, None]
        return Sheet(self.at, rest, self.width, self.mirrored)


def _powers(at: tuple[float, ...]) -> Float[np.ndarray, "power interval place"]:
    """Of the splines through one at a place and zero at the others, from the knots."""
    from scipy.interpolate import CubicSpline  # a fifth of the package's imports

    return np.asarray(CubicSpline(np.array(at), np.eye(len(at))).c)[::-1]


def _weights(at: tuple[float, ...]) -> Float[np.ndarray, " place"]:
    """Of the values in their mean."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(np.array(at), np.eye(len(at)))
    return np.asarray(spline.integrate(0, 1))


def _shares(at: tuple[float, ...], x: Array) -> Float[Array, "place *shape"]:
    """Of the values in the spline at fractions."""
    knots = np.array(at)
    inside = jnp.sum(x[..., None] >= knots[1:-1], -1)
    table = jnp.moveaxis(jnp.asarray(_powers(at))[:, inside], -1, 1)  # [power, place, *shape]
    return polynomial(list(table), x - jnp.asarray(knots)[inside])


class SkinGeometry(eqx.Module):
    """Undeformed dimensions of a skin."""

    section: AbstractSection  # the membrane across its axis
    width: Lanes  # extent along the axis [m]
    oil_gap: Lanes  # from the inner face to the rigid wall, its mean where it varies [m]
    # the gap over the arc, or over arc and axis; None where it is even
    gap_along: Along | Sheet | None = None
    # of the outer face: the thickness beyond its mean over the axis
    # [m]; None where it is the same all along
    relief: Sheet | None = None
    # free size of the membrane over that of its seat; None where it fits
    growth: Growth | None = None

    @property
    def thickness(self) -> Lanes:
        """Of the membrane, its mean where it varies [m]."""
        return self.section.mean_thickness

    @property
    def half_angle(self) -> Lanes:
        """Angle of the right clamped edge [rad]; see `suas_jax.skin.section`."""
        return self.section.half_angle

    @property
    def symmetric(self) -> bool:
        """Whether the left half is the mirror image of the right one, gap and all."""
        even = self.gap_along is None or self.gap_along.mirrored
        return self.section.symmetric and even

    @property
    def varies_along_axis(self) -> bool:
        """Whether thickness or gap do."""
        return self.relief is not None or isinstance(self.gap_along, Sheet)

    @property
    def mid_size(self) -> Lanes:
        """Length of the mid-line per angle [m]."""
        return self.section.size

    @property
    def _turning(self) -> Lanes:
        """Turn of the normal from clamp to clamp per angle: 1 on a circle."""
        ends = self.section.inner_direction(jnp.stack([-self.half_angle, self.half_angle]))
        return (ends[1] - ends[0]) / (2 * self.half_angle)

    @property
    def outer_size(self) -> Lanes:
        """Length of the outer face per angle, a mean over the arc [m]."""
        return self.mid_size + self.thickness / 2 * self._turning

    @property
    def wall_size(self) -> Lanes:
        """Length of the wall per angle, a mean over the arc [m]."""
        return self.mid_size - (self.thickness / 2 + self.oil_gap) * self._turning

    def gap(self, angle: Array, axial: Array | None = None) -> Array:
        """From the inner face to the wall along the normal [m].

        `angle`: where [rad]. `axial`: position along the axis [m]; by default a mean along it.
        """
        along = self.gap_along
        if along is None:
            return self.oil_gap
        fraction = self.section.fraction(angle)
        if isinstance(along, Along):
            return along(fraction)
        return along.mean()(fraction) if axial is None else along(fraction, axial)

    def thickness_beyond_mean(self, angle: Array, axial: Array | None) -> Array | float:
        """Thickness of the membrane beyond its mean over the axis, on the outer face [m]."""
        return thickness_beyond_mean(self.section, self.relief, angle, axial)

    def outer_arc(self, angle: Array) -> Array:
        """Arc length of the outer face from its middle [m]."""
        return self._arc_beside(angle, self.section.mean_thickness / 2)

    def outer_rate(self, angle: Array) -> Array:
        """Length of the outer face per angle at an angle [m]."""
        section = self.section
        return section.size * (1 + section.mean_thickness / 2 * section.curvature(angle))

    def wall_arc(self, angle: Array) -> Array:
        """Arc length of the wall from its middle [m]."""
        return self._arc_beside(angle, -(self.section.mean_thickness / 2 + self.oil_gap))

    def _arc_beside(self, angle: Array, height: Lanes) -> Array:
        """Arc length of a parallel to the mid-line from its middle [m]."""
        section = self.section
        turn = section.direction(angle) - section.direction(0 * angle)
        return section.size * angle + height * turn

    def along_wall(self, angle: Array, length: Array, axial: Array | None = None) -> Array:
        """The angle a length further along the wall [rad]; see `gap`."""
        return self.section.moved(angle, length, -self._wall_depth(angle, axial))

    def wall_curvature(self, angle: Array, axial: Array | None = None) -> Array:
        """Curvature of the wall [1/m]; see `gap`."""
        curvature = self.section.curvature(angle)
        return curvature / (1 - curvature * self._wall_depth(angle, axial))

    def _wall_depth(self, angle: Array, axial: Array | None) -> Array:
        """From the mid-line to the wall along the normal [m]."""
        return self.section.thickness(angle) / 2 + self.gap(angle, axial)

    @property
    def film_area(self) -> Lanes:
        """Cross-section of the undeformed oil film, between wall and membrane [m^2].

        The integral of g (1 - k g / 2) over the inner face, k its curvature and g the gap;
        its mean along the axis.
        """
        section, half = self.section, self.half_angle
        if self.gap_along is None:
            length = section.arc(half) - section.arc(-half)
            return self.oil_gap * (length - self.oil_gap * half * self._turning)
        x, w = gauss_legendre(_GAUSS)
        even = jnp.linspace(-1.0, 1.0, _INTERVALS + 1)[:, None] * half
        edges = jnp.sort(jnp.concatenate([even, *(x[None] for x in section.breakpoints)]), 0)
        step = jnp.diff(edges, axis=0)
        angle = edges[:-1] + jnp.asarray(x)[:, None, None] * step
        one = jnp.ones_like(angle)
        _, length = jax.jvp(section.arc, (angle,), (one,))
        _, turn = jax.jvp(section.inner_direction, (angle,), (one,))
        weight = jnp.asarray(w)[:, None, None] * step

        def area(axial: Array | None) -> Lanes:
            gap = self.gap(angle, axial)
            return jnp.sum(weight * gap * (length - gap * turn / 2), (0, 1))

        if not isinstance(self.gap_along, Sheet):
            return area(None)
        knots = np.array(self.gap_along.at[1])
        place = (knots[:-1] + np.asarray(x)[:, None] * np.diff(knots)).reshape(-1, 1) - 0.5
        share = (np.asarray(w)[:, None] * np.diff(knots)).reshape(-1, 1)
        areas = jax.lax.map(area, place * self.width)
        return jnp.sum(share * areas, 0)


def thickness_beyond_mean(
    section: AbstractSection, relief: Sheet | None, angle: Array, axial: Array | None
) -> Array | float:
    """Thickness of a membrane beyond its mean over the axis, on the outer face [m].

    `section`: of the mean thickness. `relief`: over fraction of the arc and axial position;
    None where there is none. `angle`: where [rad]. `axial`: position along the axis [m]; None
    for the mean.
    """
    if relief is None or axial is None:
        return 0.0
    return relief(section.fraction(angle), axial)
