"""What tables that are each right may still say against one another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from suas_jax.config.errors import listed, show
from suas_jax.config.quantities import format_quantity
from suas_jax.config.schema_load import BODY_SHAPES

if TYPE_CHECKING:
    from suas_jax.config.geometry import GeometrySpec
    from suas_jax.config.schema_load import (
        BodyLoadSpec,
        LineLoadSpec,
        LoadSpec,
        PatchLoadSpec,
    )
    from suas_jax.config.schema_skin import ElectrodesSpec, ModuleSpec, TaxelSpec
    from suas_jax.config.schema_solve import SolveSpec
    from suas_jax.config.schema_wall import WallSpec
    from suas_jax.config.sections.circle import CircleSpec

    Placed: TypeAlias = LineLoadSpec | PatchLoadSpec | BodyLoadSpec | TaxelSpec | ModuleSpec

# Room for the rounding of a unit conversion: 90 deg may be given as 1.5707963267949 rad.
_SLACK = 1.0 + 1e-9
_MOST_GROWTH = 0.5


class Contradiction(NamedTuple):
    """A key whose value doesn't fit another table.

    Attributes:
        key: dotted path, such as ``load.0.angle``.
        advice: what it doesn't fit, and what is allowed.
    """

    key: str
    advice: str


def contradictions(tables: Mapping[str, Any]) -> list[Contradiction]:
    """Compare tables with one another.

    Args:
        tables: specifications by field name (``geometry``, ``oil``, ``electrodes``, ``wall``,
            ``loads``, ``solve``). What is missing or None (such as a table that is itself
            wrong, or one of the loads) is left out of the comparison.

    Returns:
        Every contradiction, in the order of the tables.
    """
    found: list[Contradiction] = []
    geometry, solve = tables.get("geometry"), tables.get("solve")
    loads = tables.get("loads")
    if geometry is not None and tables.get("electrodes") is not None:
        found += _off_the_wall(geometry, tables["electrodes"])
    if tables.get("electrodes") is not None and tables.get("oil") is not None:
        found += _unknown_permittivity(tables["oil"].relative_permittivity)
    if geometry is not None and tables.get("wall") is not None:
        found += _thicker_than_the_wall(geometry, tables["wall"])
    if geometry is not None:
        for index, load in enumerate(loads or ()):
            if load is not None:
                found += _misplaced(f"load.{index}", geometry, load)
        if solve is not None:
            found += _of_another_dimension(geometry, solve)
        found += _off_a_section(geometry, loads or ())
    if solve is not None and solve.oil_pressure is not None:
        found += _unreachable_pressure(solve, tables)
    if geometry is not None and geometry.mounting_axial is not None and geometry.dimension == 2:
        advice = 'belongs to three dimensions; take it out, or set geometry.ends = "clamped"'
        found.append(Contradiction("geometry.mounting_axial", advice))
    oil = tables.get("oil")
    if oil is not None and oil.fill is not None and not oil.trapped:
        found.append(Contradiction("oil.fill", "vented oil flows freely; take it out"))
    if tables.get("environment") is not None:
        found += _out_of_proportion(tables)
    return found


def _out_of_proportion(tables: Mapping[str, Any]) -> Iterator[Contradiction]:
    """Surroundings that would change the size of a part by half or more."""
    from suas_jax.config.schema_load import ReferenceSpec

    environment = tables["environment"]
    reference = tables.get("reference") or ReferenceSpec()
    warming = rise = 0.0
    if environment.temperature is not None:
        warming = environment.temperature - reference.temperature
    if environment.depth is not None:
        head = environment.specific_weight * environment.depth
        rise = head + environment.atmospheric_pressure - reference.pressure
    for name in ("material", "wall", "oil"):
        part = tables.get(name)
        if part is None:
            continue
        growth = (part.expansion or 0.0) * warming
        if abs(growth) >= _MOST_GROWTH:
            yield Contradiction(
                f"{name}.expansion",
                f"{warming:.4g} K (environment.temperature less reference.temperature) would "
                f"change its size by {100 * growth:.4g} %; at most {100 * _MOST_GROWTH:.0f} % "
                "are allowed",
            )
        stiff = getattr(part, "bulk_modulus", None)
        if stiff is not None and abs(rise) >= _MOST_GROWTH * stiff:
            yield Contradiction(
                f"{name}.bulk_modulus",
                f"the water's pressure at this depth less reference.pressure, "
                f"{format_quantity(rise, 'pressure')}, must be less than half of it",
            )
    oil = tables.get("oil")
    air = getattr(oil, "ambient_pressure", None)
    if environment.depth is not None and air is not None and air != reference.pressure:
        yield Contradiction(
            "oil.ambient_pressure",
            "with a depth the air starts from reference.pressure, "
            f"{format_quantity(reference.pressure, 'pressure')}; give both the same value",
        )


def _unknown_permittivity(relative_permittivity: float | None) -> Iterator[Contradiction]:
    if relative_permittivity is None:
        yield Contradiction(
            "oil.relative_permittivity",
            "missing; [electrodes] needs it, for example relative_permittivity = 2.2",
        )


def _circle(geometry: GeometrySpec) -> CircleSpec | None:
    """A section whose places are told by closed forms; others are checked with their curve."""
    from suas_jax.config.sections.circle import CircleSpec

    return geometry if isinstance(geometry, CircleSpec) else None


def angle_on(geometry: CircleSpec, place: Placed) -> float:
    """Angle of a place on a circle, however it is told [rad]."""
    if place.angle is not None:
        return place.angle
    assert place.arc is not None
    return place.arc / geometry.inner_radius


def _without_angle(key: str, geometry: GeometrySpec, place: Placed) -> Iterator[Contradiction]:
    if place.angle is not None and not geometry.has_angle:
        yield Contradiction(
            f"{key}.angle",
            f'has no meaning with geometry.section = "{geometry.section}"; say where by the '
            'arc length of the inner face from its middle, for example arc = "22 mm"',
        )


def _thicker_than_the_wall(geometry: GeometrySpec, wall: WallSpec) -> Iterator[Contradiction]:
    circle = _circle(geometry)
    if circle is None:
        return
    radius = circle.inner_radius - circle.mean_gap
    if wall.layer is not None and wall.layer.thickness >= radius:
        yield Contradiction(
            "wall.layer.thickness",
            f"must be less than the wall's radius, {format_quantity(radius, 'length')} "
            f"(inner_radius - oil_gap); the layer lies under the oil film",
        )


def _unreachable_pressure(
    solve: SolveSpec, tables: Mapping[str, Any]
) -> Iterator[Contradiction]:
    """Loads are scaled to reach a pressure: they need something to scale, and oil."""
    oil, loads = tables.get("oil"), tables.get("loads")
    if oil is not None and not oil.trapped:
        yield Contradiction(
            "solve.oil_pressure",
            "vented oil stays at zero pressure; take oil_pressure out, or set oil.model = "
            '"incompressible"',
        )
    if any(load is not None and load.kind == "body" for load in loads or ()):
        yield Contradiction(
            "solve.oil_pressure",
            "loads are scaled to reach this pressure, and a body is pressed by its own depth "
            "or force; take oil_pressure out",
        )
    elif loads is not None and all(load is not None for load in loads):
        sizes = [load.pressure if load.kind == "pressure" else load.force for load in loads]
        if not any(sizes):
            have = "all loads are zero" if sizes else "there is no load"
            yield Contradiction(
                "solve.oil_pressure",
                f"{have}, and loads are scaled to reach this pressure; add a [[load]] that is "
                f"not zero, or take oil_pressure out",
            )


def _misplaced(key: str, geometry: GeometrySpec, load: LoadSpec) -> Iterator[Contradiction]:
    """A load off the skin, or one that its dimension has no place for."""
    if load.kind == "body":
        yield from _of_no_shape(key, geometry, load)
        if geometry.dimension == 3:
            yield from _off_the_pad(key, geometry, load, (0.0, 0.0))
        else:
            yield from _off_the_skin(key, geometry, load)
    elif load.kind == "patch":
        if geometry.dimension == 3:
            yield from _off_the_pad(key, geometry, load, load.half_extents)
        else:
            yield Contradiction(
                f"{key}.kind",
                "a patch needs a pad whose curved ends are clamped, which is solved in three "
                'dimensions: set geometry.ends = "clamped", or use kind = "line"',
            )
    elif load.kind == "line":
        if geometry.dimension == 3:
            half = ((load.spread or 0.0) / 2, (load.length or 0.0) / 2)
            yield from _off_the_pad(key, geometry, load, half)
            return
        for name in ("axial", "length", "tilt"):
            if getattr(load, name):
                yield Contradiction(
                    f"{key}.{name}",
                    'belongs to three dimensions, and geometry.ends = "sliding" is plane '
                    'strain; take it out, or set geometry.ends = "clamped"',
                )
        yield from _off_the_skin(key, geometry, load)


def _of_no_shape(
    key: str, geometry: GeometrySpec, body: BodyLoadSpec
) -> Iterator[Contradiction]:
    """Keys of a body that its shape lacks, or doesn't have, in the skin's dimension."""
    shapes = BODY_SHAPES[geometry.dimension]
    if body.shape not in shapes:
        where = "a section" if geometry.dimension == 2 else "a pad (geometry.ends)"
        allowed = listed(show(name) for name in shapes)
        yield Contradiction(f"{key}.shape", f"is no shape of a body on {where}; use {allowed}")
        return
    needed, optional = shapes[body.shape]
    for name in needed:
        if getattr(body, name) is None:
            yield Contradiction(f"{key}.{name}", f"missing; a {body.shape} needs it")
    if geometry.dimension == 3:
        optional += ("drag_axial", "tangential_force_axial")
    for name in (
        *("radius", "opening", "length", "size", "edge", "axial", "turn"),
        *("drag_axial", "tangential_force_axial"),
    ):
        given = getattr(body, name) != type(body).model_fields[name].default
        if given and name not in needed + optional:
            on = "section" if geometry.dimension == 2 else "pad"
            yield Contradiction(
                f"{key}.{name}", f"has no meaning for a {body.shape} on a {on}; take it out"
            )
    if body.size is not None and body.edge > min(body.size) / 2:
        yield Contradiction(f"{key}.edge", "must not be more than half of the smaller size")


def _off_a_section(
    geometry: GeometrySpec, loads: Sequence[LoadSpec | None]
) -> Iterator[Contradiction]:
    """Check what tables along the axis belong to."""
    for key in geometry.sheets:
        if geometry.dimension == 2:
            yield Contradiction(
                f"geometry.{key}.axial",
                "a table along the axis belongs to three dimensions; take axial out, or set "
                'geometry.ends = "clamped"',
            )
    for index, load in enumerate(loads):
        if load is not None and load.kind == "body" and "thickness" in geometry.sheets:
            yield Contradiction(
                f"load.{index}.kind",
                "bodies press on skins whose thickness is the same along the axis; take "
                "geometry.thickness.axial out",
            )


def _of_another_dimension(geometry: GeometrySpec, solve: SolveSpec) -> Iterator[Contradiction]:
    """Meshes and models that the skin's dimension doesn't have."""
    if geometry.dimension == 2:
        if isinstance(solve.elements, tuple):
            yield Contradiction(
                "solve.elements",
                "two numbers belong to three dimensions; in plane strain give one, along the "
                "arc, for example 16",
            )
        if solve.mesh is not None and len(solve.mesh) != 2:
            yield Contradiction(
                "solve.mesh",
                "three numbers belong to three dimensions; in plane strain give two, along the "
                "arc and through the thickness, for example [600, 4]",
            )
        return
    mesh = solve.mesh
    if mesh and (len(mesh) != 3 or mesh[0] % 4 or mesh[1] % 4 or not 2 <= mesh[2] <= 4):
        yield Contradiction(
            "solve.mesh",
            "three numbers are needed in three dimensions, elements along the arc and along "
            "the axis, multiples of 4, and the degree through the thickness, 2 to 4, for "
            "example [40, 32, 3]",
        )
    if isinstance(solve.elements, int):
        yield Contradiction(
            "solve.elements",
            "two numbers are needed in three dimensions, along the arc and along the axis, "
            "for example [24, 20]",
        )


def _off_the_pad(
    key: str,
    geometry: GeometrySpec,
    load: LineLoadSpec | PatchLoadSpec | BodyLoadSpec,
    half_extents: tuple[float, float],
) -> Iterator[Contradiction]:
    """Check that a loaded part of the outer face lies between the clamped edges."""
    yield from _without_angle(key, geometry, load)
    half_arc, half_length = half_extents
    circle = _circle(geometry)
    if circle is not None:
        outer = circle.inner_radius + circle.mean_thickness
        reach = abs(angle_on(circle, load)) + half_arc / outer
        if reach >= circle.half_angle:
            yield Contradiction(
                f"{key}.{_named(load)}",
                f"the loaded part reaches {format_quantity(reach, 'angle')}, over the clamped "
                f"edge at {format_quantity(circle.half_angle, 'angle')} (geometry.half_angle)",
            )
    end, reach = geometry.width / 2, abs(load.axial) + half_length
    over = reach >= end if load.kind == "patch" else reach > end * _SLACK
    if over or abs(load.axial) >= end:
        yield Contradiction(
            f"{key}.axial",
            f"the loaded part reaches {format_quantity(reach, 'length')} from the middle, over "
            f"the clamped end at {format_quantity(end, 'length')} (half of geometry.width)",
        )


def _named(place: Placed) -> str:
    return "angle" if place.angle is not None else "arc"


def _off_the_skin(
    key: str, geometry: GeometrySpec, load: LineLoadSpec | BodyLoadSpec
) -> Iterator[Contradiction]:
    yield from _without_angle(key, geometry, load)
    circle = _circle(geometry)
    if circle is None:
        return
    edge = format_quantity(circle.half_angle, "angle")
    angle = angle_on(circle, load)
    if abs(angle) >= circle.half_angle:
        yield Contradiction(
            f"{key}.{_named(load)}",
            f"lies off the skin, whose clamped edges are at -{edge} and {edge} "
            f"(geometry.half_angle); the angle is measured from the symmetry axis",
        )
    elif load.kind == "line" and load.spread is not None:
        outer_radius = circle.inner_radius + circle.mean_thickness
        room = 2.0 * outer_radius * (circle.half_angle - abs(angle))
        if load.spread >= room:
            yield Contradiction(
                f"{key}.spread",
                f"reaches over the clamped edge at {edge}; at "
                f"{format_quantity(angle, 'angle')} there is room for a spread of less "
                f"than {format_quantity(room, 'length')}",
            )


def _off_the_wall(
    geometry: GeometrySpec, electrodes: ElectrodesSpec
) -> Iterator[Contradiction]:
    for index, taxel in enumerate(electrodes.taxels):
        yield from _centre(f"electrodes.taxels.{index}", geometry, taxel)
    for index, module in enumerate(electrodes.modules):
        key = f"electrodes.modules.{index}"
        centre, circle = list(_centre(key, geometry, module)), _circle(geometry)
        yield from centre if centre or circle is None else _corners(key, circle, module)


def _centre(
    key: str, geometry: GeometrySpec, place: TaxelSpec | ModuleSpec
) -> Iterator[Contradiction]:
    yield from _without_angle(key, geometry, place)
    circle = _circle(geometry)
    angle = None if circle is None else angle_on(circle, place)
    yield from _place(f"{key}.", geometry, angle, place.axial, _named(place))


def _place(
    key: str,
    geometry: GeometrySpec,
    angle: float | None,
    axial: float,
    name: str = "angle",
    what: str = "",
) -> Iterator[Contradiction]:
    circle = _circle(geometry)
    if circle is not None and angle is not None and abs(angle) > circle.half_angle * _SLACK:
        edge = format_quantity(circle.half_angle, "angle")
        yield Contradiction(
            f"{key}{name}",
            f"{what}lies off the skin, which ends at -{edge} and {edge} (geometry.half_angle)",
        )
    if abs(axial) > 0.5 * geometry.width * _SLACK:
        end = format_quantity(0.5 * geometry.width, "length")
        yield Contradiction(
            f"{key}axial",
            f"{what}lies off the skin, which ends at -{end} and {end} (half of geometry.width)",
        )


def _corners(key: str, geometry: CircleSpec, module: ModuleSpec) -> Iterator[Contradiction]:
    """Check the three corner taxels, sqrt(3) pitches from the centroid on the wall."""
    wall = geometry.inner_radius - geometry.mean_gap
    reported: set[str] = set()
    for corner in range(3):
        turn = module.rotation + math.pi / 2.0 + corner * 2.0 * math.pi / 3.0
        reach = math.sqrt(3.0) * module.pitch
        angle = angle_on(geometry, module) + reach * math.cos(turn) / wall
        axial = module.axial + reach * math.sin(turn)
        at = f"{format_quantity(angle, 'angle')}, {format_quantity(axial, 'length')}"
        what = f"a corner taxel, at {at}, "
        for found in _place(f"{key}.", geometry, angle, axial, _named(module), what):
            if found.key not in reported:
                reported.add(found.key)
                yield found
