"""What makes a section impossible: folds and crossings. Each finding names where.

A circle's sizes are compared when its table is read; other sections are sampled here.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from suas_jax.config.errors import ConfigError, Mistake
from suas_jax.config.quantities import format_quantity
from suas_jax.runtime.compiled import COMPILED
from suas_jax.skin.geometry import SkinGeometry

_POINTS = 1601
_ALONG = 33  # places along the axis, where a table varies along it
_COARSE = 8  # of which every so many make the polygons whose sides may not cross


class Samples(NamedTuple):
    """A section at even angles, in one lane.

    Attributes:
        arc: along the inner face from its middle [m].
        thickness: of the membrane [m].
        gap: to the wall [m].
        curvature: of the inner face [1/m].
        inner: its positions [2, point] [m].
        wall: positions of the wall.
        outer: positions of the outer face.
    """

    arc: Any
    thickness: Any
    gap: Any
    curvature: Any
    inner: Any
    wall: Any
    outer: Any


@eqx.filter_jit
def samples(geometry: SkinGeometry, share: ArrayLike = 0.0) -> Samples:
    """Sample a section from clamp to clamp.

    Args:
        geometry: with numbers.
        share: position along the axis from its middle over its length.
    """
    section = geometry.section
    angle = jnp.linspace(-1.0, 1.0, _POINTS)[:, None] * section.half_angle
    axial = jnp.asarray(share) * geometry.width
    mean, gap = section.thickness(angle), geometry.gap(angle, axial)
    thick = mean + geometry.thickness_beyond_mean(angle, axial)
    middle, inner, normal = (
        f(angle) for f in (section.curvature, section.inner_face, section.inner_normal)
    )
    rows = (section.arc(angle), thick, gap, middle / (1 - middle * mean / 2))
    arc, thick, gap, curvature = (jnp.broadcast_to(x, angle.shape)[:, 0] for x in rows)
    curves = (
        x[..., 0]
        for x in (inner, inner - gap[:, None] * normal, inner + thick[:, None] * normal)
    )
    return Samples(arc, thick, gap, curvature, *curves)


def check_section(geometry: SkinGeometry) -> None:
    """Refuse a section that can't be.

    Args:
        geometry: with numbers.

    Raises:
        ConfigError: names the key, the place and what is wrong there.
    """
    shares = np.linspace(-0.5, 0.5, _ALONG) if geometry.varies_along_axis else [0.0]
    for share in shares:
        found = COMPILED.run(samples, geometry, np.asarray(share), once=True)
        at = Samples(*(np.asarray(x) for x in found))
        wrong = [*_sizes(at), *_crossings(at)]
        if wrong:
            place = format_quantity(float(share * geometry.width[0]), "length")
            where = f" (axial = {place})" if geometry.varies_along_axis else ""
            raise ConfigError(Mistake("skin", key, text + where) for key, text in wrong)


def _sizes(at: Samples) -> list[tuple[str, str]]:
    found = []
    for key, values in (("geometry.thickness", at.thickness), ("geometry.oil_gap", at.gap)):
        if not values.min() > 0:
            found.append(
                (
                    key,
                    f"is not above zero {_where(at, np.argmin(values))}, where the curve "
                    "through the table's values undershoots; add values there",
                )
            )
    if found:
        return found
    folds = at.curvature * at.gap
    if folds.max() >= 1:
        k = int(np.argmax(folds))
        radius = format_quantity(1 / at.curvature[k], "length")
        gap = format_quantity(at.gap[k], "length")
        found.append(
            (
                "geometry.oil_gap",
                f"is {gap} {_where(at, k)}, where the inner face is rounded by "
                f"{radius} alone: the wall would have a corner there; make the radius larger",
            )
        )
    thick = -at.curvature * at.thickness
    if thick.max() >= 1:
        k = int(np.argmax(thick))
        radius = format_quantity(-1 / at.curvature[k], "length")
        size = format_quantity(at.thickness[k], "length")
        found.append(
            (
                "geometry.thickness",
                f"is {size} {_where(at, k)}, where it is hollow by "
                f"{radius} alone: the outer face would have a corner there; make it larger",
            )
        )
    return found


def _crossings(at: Samples) -> list[tuple[str, str]]:
    found = []
    curves = (("inner face", at.inner), ("wall", at.wall), ("outer face", at.outer))
    for name, curve in curves:
        pair = _first_crossing(curve[:, ::_COARSE].T)
        if pair is not None:
            first, second = (_where(at, _COARSE * k) for k in pair)
            found.append(("geometry", f"the {name} crosses itself, {first} and {second}"))
            break
    return found


def _first_crossing(points: np.ndarray) -> tuple[int, int] | None:
    """Sides of an open polygon that cross: the first such pair."""
    start, step = points[:-1], np.diff(points, axis=0)

    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])

    between = start[None] - start[:, None]
    size = cross(step[:, None], step[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        own = cross(between, step[None]) / size
        other = cross(between, step[:, None]) / size
    inside = (own > 0) & (own < 1) & (other > 0) & (other < 1)
    pairs = np.argwhere(np.triu(inside, 2))
    return None if not len(pairs) else (int(pairs[0][0]), int(pairs[0][1]))


def _where(at: Samples, index: int | np.integer) -> str:
    return f"at arc = {format_quantity(float(at.arc[index]), 'length')}"
