"""Kinds of section and oil models by name, and from tables to objects."""

import dataclasses
import functools
from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.config.geometry import GeometrySpec, SheetSpec
from suas_jax.config.oil import OilSpec
from suas_jax.runtime.registry import model_classes
from suas_jax.skin.charted import AbstractCurve, ChartedSection
from suas_jax.skin.circle import Circle
from suas_jax.skin.geometry import Along, Sheet, SkinGeometry
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.prestress import Prestress
from suas_jax.skin.section import AbstractSection

OILS: dict[str, type[AbstractOil]] = model_classes(
    "suas_jax.skin.oils",
    AbstractOil,  # type: ignore[type-abstract]
)
"""The models by name, one for each file of `suas_jax.skin.oils`."""


CURVES: dict[str, type[AbstractCurve]] = model_classes(
    "suas_jax.skin.sections",
    AbstractCurve,  # type: ignore[type-abstract]
)
"""The kinds of section by name, one for each file of `suas_jax.skin.sections`."""


_ANGLES = ("angle", "half_angle", "start")


def build_geometry(
    spec: GeometrySpec, value: Callable[[str], Array], prestress: Prestress | None = None
) -> SkinGeometry:
    """Build the dimensions of a [geometry] table.

    `spec`: says which section, and what varies along it. `value`: gives its numbers by key,
    with a lane axis [SI]. `prestress`: how large seat and membrane have become; None where they
    are as written.
    """
    if prestress is not None:
        scale = prestress.scale
        if scale is not None:
            value = functools.partial(_scaled, value, scale)
        return dataclasses.replace(build_geometry(spec, value), growth=prestress.growth)

    def stacked(key: str, count: int) -> Array:
        values = [value(f"{key}.{k}") for k in range(count)]
        return jnp.stack(jnp.broadcast_arrays(*values))

    def along(key: str) -> Array | Along | Sheet:
        table = getattr(spec, key)
        if isinstance(table, float):
            return value(key)
        rows, own = len(table.arc), f"{key}.value"
        if not isinstance(table, SheetSpec):
            return Along(table.arc, stacked(own, rows), table.mirrored)
        values = [stacked(f"{own}.{k}", len(table.axial)) for k in range(rows)]
        both = jnp.stack(jnp.broadcast_arrays(*values))
        return Sheet((table.arc, table.axial), both, value("width"), table.mirrored)

    thickness, gap, relief = along("thickness"), along("oil_gap"), None
    if isinstance(thickness, Sheet):
        relief, thickness = thickness.beyond_mean(), thickness.mean()
    if spec.section == "circle" and not isinstance(thickness, Along):
        section: AbstractSection = Circle(
            inner_radius=value("inner_radius"),
            mean_thickness=thickness,
            half_angle=value("half_angle"),
        )
    else:
        section = ChartedSection.of(CURVES[spec.section].of(spec, value), thickness)
    even = gap.mean() if isinstance(gap, Sheet) else gap
    mean = even.mean() if isinstance(even, Along) else even
    uneven = gap if isinstance(gap, Along | Sheet) else None
    return SkinGeometry(section, value("width"), mean, uneven, relief)


def _scaled(value: Callable[[str], Array], scale: Array, key: str) -> Array:
    return value(key) if key.rpartition(".")[2] in _ANGLES else scale * value(key)


def build_oil(oil: OilSpec, value: Callable[[str], Array]) -> AbstractOil:
    """Build the model of an [oil] table.

    `oil`: says which model. `value`: its constants by their keys, with a lane axis.
    """
    keys = type(oil).model_fields.keys() - OilSpec.model_fields.keys()
    return OILS[oil.model](**{key: value(key) for key in sorted(keys)})
