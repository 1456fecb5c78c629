"""The dimensions of a skin with the numbers of its table, for meshes, figures and checks."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from suas_jax.config import continuous_inputs, structure
from suas_jax.config.errors import ConfigError, Mistake
from suas_jax.config.geometry import GeometrySpec
from suas_jax.config.quantities import format_quantity
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import Keyed
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.registry import build_geometry
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.section_checks import check_section


class _Table(Keyed):
    """A [geometry] table compared by all of it."""

    def __init__(self, spec: GeometrySpec) -> None:
        self.spec, self.key = spec, shape_key(spec)


def shape_key(spec: GeometrySpec) -> tuple[Any, ...]:
    """What decides the program that makes a section.

    Its numbers are part of it: they tell whether the section is its own mirror image.
    """
    return structure(spec), tuple(continuous_inputs(spec).items())


@eqx.filter_jit
def _built(table: _Table, numbers: dict[str, Any]) -> SkinGeometry:
    return build_geometry(table.spec, numbers.__getitem__)


def charted(spec: GeometrySpec) -> bool:
    """Whether a section is described by a table, which takes a program to make."""
    return not spec.is_circle


@functools.lru_cache(maxsize=64)
def plain_geometry(spec: GeometrySpec) -> SkinGeometry:
    """The dimensions, in one lane: a circle's are NumPy arrays, which need no program.

    Args:
        spec: the [geometry] table.

    Raises:
        ConfigError: the section can't be; the message says where and why.
    """
    known = {**dict(structure(spec)), **continuous_inputs(spec)}
    numbers: Any = {k: np.array([v]) for k, v in known.items() if isinstance(v, float | int)}
    if spec.is_circle:
        return build_geometry(spec, numbers.__getitem__)
    with jax.ensure_compile_time_eval():  # also while a caller is traced
        geometry: SkinGeometry = COMPILED.run(_built, _Table(spec), numbers, once=True)
        check_section(geometry)
    return geometry


def clamped_edge(section: AbstractSection, by_arc: bool) -> tuple[float, str]:
    """Where a section ends on the right, as its scenes state places.

    Args:
        section: of plain numbers.
        by_arc: as an arc length from its middle [m]; else as the angle [rad] that it knows.

    Returns:
        The number, and what a person reads.
    """
    half = section.half_angle
    with jax.ensure_compile_time_eval():  # also while a caller is traced
        end = float((section.arc(half) if by_arc else section.given_angle(half))[0])
    return end, format_quantity(end, "length" if by_arc else "angle")


def angles_at(spec: GeometrySpec, name: str, places: np.ndarray) -> np.ndarray:
    """Where places on a section are, as sections define angles [rad].

    Args:
        spec: the [geometry] table.
        name: "angle" or "arc".
        places: as scenes state them [rad or m], of any shape.
    """
    section = plain_geometry(spec).section
    found = section.from_arc if name == "arc" else section.from_given_angle
    flat = found(jnp.asarray(places, float).reshape(-1, 1))
    return np.asarray(flat).reshape(np.shape(places))


def check_places(spec: GeometrySpec, places: dict[str, Any]) -> None:
    """Refuse what lies off a section that is no plain circle, whose table is checked alone.

    Args:
        spec: the [geometry] table.
        places: loads, taxels and modules by their keys.

    Raises:
        ConfigError: names what lies off the skin, and how far it may lie.
    """
    if spec.is_circle:
        return
    section, found = plain_geometry(spec).section, []
    for key, place in places.items():
        by_arc = place.arc is not None
        name = "arc" if by_arc else "angle"
        end, edge = clamped_edge(section, by_arc)
        if abs(getattr(place, name)) > end * (1 + 1e-9):
            advice = f"lies off the skin, whose clamped edges are at -{edge} and {edge}"
            found.append(Mistake("skin", f"{key}.{name}", advice))
    if found:
        raise ConfigError(found)
