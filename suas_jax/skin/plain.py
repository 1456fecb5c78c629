"""The dimensions of a skin with the numbers of its table, for meshes, figures and checks.

What makes a section impossible, folds and crossings, is sampled here; a finding names where. A
circle's sizes are compared when its table is read.
"""

import functools
from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from suas_jax.config import continuous_inputs, structure
from suas_jax.config.errors import ConfigError, Mistake
from suas_jax.config.geometry import GeometrySpec
from suas_jax.config.quantities import DimensionName, format_quantity
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import Keyed
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.registry import build_geometry
from suas_jax.skin.section import AbstractSection

_POINTS = 1601
_ALONG = 33  # places along the axis, where a table varies along it
_COARSE = 8  # of which every so many make the polygons whose sides may not cross


class Samples(NamedTuple):
    """A section at even angles, in one lane."""

    arc: Any  # along the inner face from its middle [m]
    thickness: Any  # of the membrane [m]
    gap: Any  # to the wall [m]
    curvature: Any  # of the inner face [1/m]
    inner: Any  # its positions [2, point] [m]
    wall: Any  # positions of the wall
    outer: Any  # positions of the outer face


@eqx.filter_jit
def samples(geometry: SkinGeometry, share: ArrayLike = 0.0) -> Samples:
    """Sample a section from clamp to clamp.

    `geometry`: with numbers. `share`: position along the axis from its middle over its length.
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

    `geometry`: with numbers.
    Raises ConfigError: names the key, the place and what is wrong there.
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
    tables = ("geometry.thickness", at.thickness), ("geometry.oil_gap", at.gap)
    shares, found = (at.arc - at.arc[0]) / np.ptp(at.arc), []
    for key, values in tables:
        k = int(np.argmin(values))
        if not values[k] > 0:
            least = format_quantity(float(values[k]), "length")
            text = f"would be {least} at arc = {shares[k]:.3g} of the table, where the curve"
            found.append((key, f"{text} through its values undershoots; add values there"))
    if found:
        return found
    sharp = (
        (at.curvature, *tables[1], "the inner face is rounded by", "the wall", "the radius"),
        (-at.curvature, *tables[0], "it is hollow by", "the outer face", "it"),
    )
    for bend, key, size, how, face, what in sharp:
        if (bend * size).max() >= 1:
            k = int(np.argmax(bend * size))
            own, radius = (format_quantity(x, "length") for x in (size[k], 1 / bend[k]))
            text = f"is {own} {_where(at, k)}, where {how} {radius} alone: {face} would have a"
            found.append((key, f"{text} corner there; make {what} larger"))
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


class _Table(Keyed):
    """A [geometry] table compared by all of it."""

    def __init__(self, spec: GeometrySpec) -> None:
        self.spec, self.key = spec, shape_key(spec)


def shape_key(spec: GeometrySpec) -> tuple[Any, ...]:
    """What decides the program that makes a section.

    Its numbers are part of it, but for a circle's: they tell whether the section is its own
    mirror image.
    """
    return structure(spec), () if spec.is_circle else tuple(continuous_inputs(spec).items())


@eqx.filter_jit
def _built(table: _Table, numbers: dict[str, Any]) -> SkinGeometry:
    return build_geometry(table.spec, numbers.__getitem__)


def charted(spec: GeometrySpec) -> bool:
    """Whether a section is described by a table, which takes a program to make."""
    return not spec.is_circle


@functools.lru_cache(maxsize=64)
def plain_geometry(spec: GeometrySpec) -> SkinGeometry:
    """The dimensions, in one lane: a circle's are NumPy arrays, which need no program.

    Raises ConfigError: the section can't be; the message says where and why.
    """
    known = {**dict(structure(spec)), **continuous_inputs(spec)}
    numbers: Any = {k: np.array([v]) for k, v in known.items() if isinstance(v, float | int)}
    if spec.is_circle:
        return build_geometry(spec, numbers.__getitem__)
    with jax.ensure_compile_time_eval():  # also while a caller is traced
        geometry: SkinGeometry = COMPILED.run(_built, _Table(spec), numbers, once=True)
        check_section(geometry)
    return geometry


def _asked(spec: GeometrySpec, question: Callable[..., Any], *arguments: Any) -> np.ndarray:
    """What a section answers, by one kept program; a circle's numbers need none."""
    if spec.is_circle:
        return np.asarray(question(*arguments))
    with jax.ensure_compile_time_eval():  # also while a caller is traced
        return np.asarray(COMPILED.run(_compiled(question), *arguments, once=True))


@functools.cache
def _compiled(question: Callable[..., Any]) -> Callable[..., Any]:
    return eqx.filter_jit(question)


def _angles(section: AbstractSection, name: str, places: Any) -> Any:
    return section.from_arc(places) if name == "arc" else section.from_given_angle(places)


def _edge(section: AbstractSection, name: str) -> Any:
    half = section.half_angle
    return section.arc(half) if name == "arc" else section.given_angle(half)


def _rooms(section: AbstractSection, angle: Any) -> Any:
    """Along the outer face, from places to the nearer clamp [m]."""
    ends = jnp.stack([-section.half_angle, section.half_angle])[:, None]
    turn = section.direction(ends) - section.direction(angle)
    along = section.size * (ends - angle) + section.thickness(angle) / 2 * turn
    return jnp.min(jnp.abs(along), 0)


def _wall_arcs(geometry: SkinGeometry, angle: Any) -> Any:
    return geometry.wall_arc(angle)


def clamped_edge(spec: GeometrySpec, by_arc: bool) -> tuple[float, str]:
    """Where a section ends on the right, as its scenes state places.

    `by_arc`: as an arc length from its middle [m]; else as the angle [rad] that it knows.
    Returns the number, and what a person reads.
    """
    name = "arc" if by_arc else "angle"
    end = float(_asked(spec, _edge, plain_geometry(spec).section, name)[0])
    return end, format_quantity(end, "length" if by_arc else "angle")


def angles_at(spec: GeometrySpec, name: str, places: np.ndarray) -> np.ndarray:
    """Where places on a section are, as sections define angles [rad].

    `name`: "angle" or "arc". `places`: as scenes state them [rad or m], of any shape.
    """
    flat = np.asarray(places, float).reshape(-1, 1)
    found = _asked(spec, _angles, plain_geometry(spec).section, name, flat)
    return found.reshape(np.shape(places))


def _angles_of(spec: GeometrySpec, places: Collection[Any]) -> np.ndarray:
    """The same of loads, taxels or modules."""
    by_arc = np.array([place.arc is not None for place in places], bool)
    told = np.array([place.angle if place.arc is None else place.arc for place in places])
    angles = np.empty(told.shape)
    for name, own in (("arc", by_arc), ("angle", ~by_arc)):
        if own.any():
            angles[own] = angles_at(spec, name, told[own])
    return angles


def along_wall(spec: GeometrySpec, places: dict[str, Any]) -> tuple[list[float], float]:
    """Arc length of the wall from its middle to places, and to the right clamp [m].

    `places`: taxels or modules by their keys.
    Raises ConfigError: one of them lies off the skin.
    """
    check_places(spec, places)
    geometry = plain_geometry(spec)
    at = np.append(_angles_of(spec, places.values()), float(geometry.half_angle[0]))
    *arcs, end = _asked(spec, _wall_arcs, geometry, at[:, None])[:, 0].tolist()
    return arcs, end


def check_places(spec: GeometrySpec, places: dict[str, Any]) -> None:
    """Refuse what lies off a section that is not a plain circle, whose table is checked alone.

    `places`: loads, taxels and modules by their keys.
    Raises ConfigError: names what lies off the skin, and how far it may lie.
    """
    if spec.is_circle:
        return
    section, found = plain_geometry(spec).section, []
    rooms = np.zeros(len(places))
    if any(_extent(place)[1] for place in places.values()):
        angles = _angles_of(spec, places.values())
        rooms = _asked(spec, _rooms, section, angles[:, None])[:, 0]
    for (key, place), room in zip(places.items(), rooms.tolist(), strict=True):
        by_arc = place.arc is not None
        name = "arc" if by_arc else "angle"
        end, edge = clamped_edge(spec, by_arc)
        told = getattr(place, name)
        wide, half = _extent(place)
        if abs(told) > end * (1 + 1e-9):
            advice = f"lies off the skin, whose clamped edges are at -{edge} and {edge}"
            dimension: DimensionName = "length" if by_arc else "angle"
            shown = f'"{format_quantity(told, dimension)}"'
            found.append(Mistake("skin", f"{key}.{name}", advice, shown))
        elif half and half >= room:
            advice = (
                f"reaches over the clamped edge at {edge}; there is room for less than "
                f"{format_quantity(2 * room, 'length')} along the arc"
            )
            found.append(Mistake("skin", f"{key}.{wide}", advice))
    if found:
        raise ConfigError(found)


def _extent(place: Any) -> tuple[str, float]:
    """Key that says how far a load spreads along the arc, and half of that [m]."""
    half = getattr(place, "half_extents", (0.0, 0.0))[0]
    keys = ("spread", "size", "diameter")
    return next((k for k in keys if getattr(place, k, None) is not None), ""), half
