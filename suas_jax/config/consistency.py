"""What tables that are each right may still say against one another."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from suas_jax.config.errors import listed, show
from suas_jax.config.fields import PlacedSpec
from suas_jax.config.geometry import GeometrySpec
from suas_jax.config.quantities import DimensionName, format_quantity
from suas_jax.config.schema_load import (
    BODY_SHAPES,
    BodyLoadSpec,
    LineLoadSpec,
    LoadSpec,
    PatchLoadSpec,
    ReferenceSpec,
)
from suas_jax.config.schema_skin import ElectrodesSpec, ModuleSpec, TaxelSpec, WallSpec
from suas_jax.config.schema_solve import SolveSpec
from suas_jax.config.sections.circle import CircleSpec

# Room for the rounding of a unit conversion: 90 deg may be given as 1.5707963267949 rad.
_SLACK = 1.0 + 1e-9
_MOST_GROWTH = 0.5

Contradictions: TypeAlias = Iterator[tuple[str, str]]
"""Keys whose values don't fit another table, such as ``load.0.angle``; each with advice."""


def contradictions(tables: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Key and advice of everything that tables say against one another, in their order.

    Specifications stand under their field names. What is missing or None (such as a table that
    is itself wrong, or one of the loads) is left out of the comparison.
    """
    return list(_found(tables))


def _found(tables: Mapping[str, Any]) -> Contradictions:
    names = ("geometry", "oil", "electrodes", "solve", "loads")
    geometry, oil, electrodes, solve, loads = map(tables.get, names)
    if geometry is not None and electrodes is not None:
        yield from _off_the_wall(geometry, electrodes)
    if electrodes is not None and oil is not None and oil.relative_permittivity is None:
        advice = "missing; [electrodes] needs it, for example relative_permittivity = 2.2"
        yield "oil.relative_permittivity", advice
    if geometry is not None and tables.get("wall") is not None:
        yield from _thicker_than_the_wall(geometry, tables["wall"])
    if geometry is not None:
        for index, load in enumerate(loads or ()):
            if load is not None:
                yield from _misplaced(f"load.{index}", geometry, load)
        if solve is not None:
            yield from _of_another_dimension(geometry, solve)
        yield from _off_a_section(geometry, loads or ())
    yield from _in_one_another(loads or ())
    if solve is not None and solve.oil_pressure is not None:
        yield from _unreachable_pressure(oil, loads)
    if geometry is not None and geometry.mounting_axial is not None and geometry.dimension == 2:
        advice = 'belongs to three dimensions; take it out, or set geometry.ends = "clamped"'
        yield "geometry.mounting_axial", advice
    if oil is not None and oil.fill is not None and not oil.trapped:
        yield "oil.fill", "vented oil flows freely; take it out"
    if tables.get("environment") is not None:
        yield from _out_of_proportion(tables)


def _out_of_proportion(tables: Mapping[str, Any]) -> Contradictions:
    """Surroundings that would change the size of a part by half or more."""
    environment = tables["environment"]
    reference = tables.get("reference") or ReferenceSpec()
    warming = rise = 0.0
    if environment.temperature is not None:
        warming = environment.temperature - reference.temperature
    if environment.depth is not None:
        rise = environment.ambient_pressure - reference.pressure
    for name in ("material", "wall", "oil"):
        part = tables.get(name)
        if part is None:
            continue
        growth = (part.expansion or 0.0) * warming
        if abs(growth) >= _MOST_GROWTH:
            yield (
                f"{name}.expansion",
                f"{warming:.4g} K (environment.temperature less reference.temperature) would "
                f"change its size by {100 * growth:.4g} %; at most {100 * _MOST_GROWTH:.0f} % "
                "are allowed",
            )
        stiff = getattr(part, "bulk_modulus", None)
        if stiff is not None and abs(rise) >= _MOST_GROWTH * stiff:
            yield (
                f"{name}.bulk_modulus",
                f"the water's pressure at this depth less reference.pressure, "
                f"{format_quantity(rise, 'pressure')}, must be less than half of it",
            )
    air = getattr(tables.get("oil"), "ambient_pressure", None)
    if environment.depth is not None and air is not None and air != reference.pressure:
        yield (
            "oil.ambient_pressure",
            "with a depth the air starts from reference.pressure, "
            f"{format_quantity(reference.pressure, 'pressure')}; give both the same value",
        )


def _circle(geometry: GeometrySpec) -> CircleSpec | None:
    """A section whose places are told by closed forms; others are checked with their curve."""
    return geometry if isinstance(geometry, CircleSpec) else None


def angle_on(geometry: CircleSpec, place: PlacedSpec) -> float:
    """Angle of a place on a circle, however it is told [rad]."""
    if place.angle is not None:
        return place.angle
    assert place.arc is not None
    return place.arc / geometry.inner_radius


def _without_angle(key: str, geometry: GeometrySpec, place: PlacedSpec) -> Contradictions:
    if place.angle is not None and not geometry.has_angle:
        yield (
            f"{key}.angle",
            f'has no meaning with geometry.section = "{geometry.section}"; say where by the '
            'arc length of the inner face from its middle, for example arc = "22 mm"',
        )


def _thicker_than_the_wall(geometry: GeometrySpec, wall: WallSpec) -> Contradictions:
    circle = _circle(geometry)
    if circle is None:
        return
    radius = circle.inner_radius - circle.mean_gap
    if wall.layer is not None and wall.layer.thickness >= radius:
        yield (
            "wall.layer.thickness",
            f"must be less than the wall's radius, {format_quantity(radius, 'length')} "
            f"(inner_radius - oil_gap); the layer lies under the oil film",
        )


def _unreachable_pressure(oil: Any, loads: Sequence[LoadSpec | None] | None) -> Contradictions:
    """Loads are scaled to reach a pressure: they need something to scale, and oil."""
    key = "solve.oil_pressure"
    if oil is not None and not oil.trapped:
        yield (
            key,
            "vented oil stays at zero pressure; take oil_pressure out, or set oil.model = "
            '"incompressible"',
        )
    given = [load for load in loads or () if load is not None]
    if any(load.kind == "body" for load in given):
        yield (
            key,
            "loads are scaled to reach this pressure, and a body is pressed by its own depth "
            "or force; take oil_pressure out",
        )
    elif loads is not None and len(given) == len(loads):
        sizes = [load.pressure if load.kind == "pressure" else load.force for load in given]
        if not any(sizes):
            have = "all loads are zero" if sizes else "there is no load"
            yield (
                key,
                f"{have}, and loads are scaled to reach this pressure; add a [[load]] that is "
                f"not zero, or take oil_pressure out",
            )


def _in_one_another(loads: Sequence[LoadSpec | None]) -> Contradictions:
    """Bodies that forces press at one place: what each carries hangs on next to nothing."""
    taken: dict[Any, int] = {}
    for index, load in enumerate(loads):
        if load is None or load.kind != "body" or not load.force or any(load.dragged):
            continue
        first = taken.setdefault((load.angle, load.arc, load.axial), index)
        if first != index:
            yield (
                f"load.{index}.force",
                f"load.{first} is pressed by a force at the same place, where only one rigid "
                "body is; press one with the sum of both forces, or move one aside",
            )


def _misplaced(key: str, geometry: GeometrySpec, load: LoadSpec) -> Contradictions:
    """A load off the skin, or one that its dimension has no place for."""
    on_pad = geometry.dimension == 3
    if load.kind == "pressure":
        return
    if load.kind == "patch" and not on_pad:
        yield (
            f"{key}.kind",
            "a patch needs a pad whose curved ends are clamped, which is solved in three "
            'dimensions: set geometry.ends = "clamped", or use kind = "line"',
        )
        return
    if load.kind == "body":
        yield from _of_no_shape(key, geometry, load)
    elif load.kind == "line" and not on_pad:
        for name in ("axial", "length", "tilt"):
            if getattr(load, name):
                yield (
                    f"{key}.{name}",
                    'belongs to three dimensions, and geometry.ends = "sliding" is plane '
                    'strain; take it out, or set geometry.ends = "clamped"',
                )
    yield from _without_angle(key, geometry, load)
    if on_pad:
        yield from _off_the_pad(key, geometry, load)
    elif load.kind != "patch":
        yield from _off_the_skin(key, geometry, load)


def _of_no_shape(key: str, geometry: GeometrySpec, body: BodyLoadSpec) -> Contradictions:
    """Keys of a body that its shape lacks, or doesn't have, in the skin's dimension."""
    shapes, on = BODY_SHAPES[geometry.dimension], {2: "section", 3: "pad"}[geometry.dimension]
    if body.shape not in shapes:
        where = f"a {on}" if geometry.dimension == 2 else "a pad (geometry.ends)"
        allowed = listed(show(name) for name in shapes)
        yield f"{key}.shape", f"is not a shape of a body on {where}; use {allowed}"
        return
    needed, optional = shapes[body.shape]
    for name in needed:
        if getattr(body, name) is None:
            yield f"{key}.{name}", f"missing; a {body.shape} needs it"
    along_axis = ("drag_axial", "tangential_force_axial")
    known = (*needed, *optional, *(along_axis if geometry.dimension == 3 else ()))
    for name in ("radius", "opening", "length", "size", "edge", "axial", "turn", *along_axis):
        given = getattr(body, name) != type(body).model_fields[name].default
        if given and name not in known:
            yield f"{key}.{name}", f"has no meaning for a {body.shape} on a {on}; take it out"
    if body.size is not None and body.edge > min(body.size) / 2:
        yield f"{key}.edge", "must not be more than half of the smaller size"


def _off_a_section(geometry: GeometrySpec, loads: Sequence[LoadSpec | None]) -> Contradictions:
    """Check what tables along the axis belong to."""
    for key in geometry.sheets:
        if geometry.dimension == 2:
            yield (
                f"geometry.{key}.axial",
                "a table along the axis belongs to three dimensions; take axial out, or set "
                'geometry.ends = "clamped"',
            )
    for index, load in enumerate(loads):
        if load is not None and load.kind == "body" and "thickness" in geometry.sheets:
            yield (
                f"load.{index}.kind",
                "bodies press on skins whose thickness is the same along the axis; take "
                "geometry.thickness.axial out",
            )


def _of_another_dimension(geometry: GeometrySpec, solve: SolveSpec) -> Contradictions:
    """Meshes and models that the skin's dimension doesn't have."""
    mesh = solve.mesh
    if geometry.dimension == 2:
        if isinstance(solve.elements, tuple):
            yield (
                "solve.elements",
                "two numbers belong to three dimensions; in plane strain give one, along the "
                "arc, for example 16",
            )
        if mesh is not None and len(mesh) != 2:
            yield (
                "solve.mesh",
                "three numbers belong to three dimensions; in plane strain give two, along the "
                "arc and through the thickness, for example [600, 4]",
            )
        return
    if mesh and (len(mesh) != 3 or mesh[0] % 4 or mesh[1] % 4 or not 2 <= mesh[2] <= 4):
        yield (
            "solve.mesh",
            "three numbers are needed in three dimensions, elements along the arc and along "
            "the axis, multiples of 4, and the degree through the thickness, 2 to 4, for "
            "example [40, 32, 3]",
        )
    if isinstance(solve.elements, int):
        yield (
            "solve.elements",
            "two numbers are needed in three dimensions, along the arc and along the axis, "
            "for example [24, 20]",
        )


def _off_the_pad(
    key: str, geometry: GeometrySpec, load: LineLoadSpec | PatchLoadSpec | BodyLoadSpec
) -> Contradictions:
    """Check that a loaded part of the outer face lies between the clamped edges."""
    half_arc, half_length = load.half_extents
    circle = _circle(geometry)
    if circle is not None:
        outer = circle.inner_radius + circle.mean_thickness
        reach = abs(angle_on(circle, load)) + half_arc / outer
        if reach >= circle.half_angle:
            yield (
                f"{key}.{load.told_by}",
                f"the loaded part reaches {format_quantity(reach, 'angle')}, over the clamped "
                f"edge at {format_quantity(circle.half_angle, 'angle')} (geometry.half_angle)"
                + _room(circle.half_angle - half_arc / outer, "angle"),
            )
    end, reach = geometry.width / 2, abs(load.axial) + half_length
    over = reach >= end if load.kind == "patch" else reach > end * _SLACK
    if over or abs(load.axial) >= end:
        yield (
            f"{key}.axial",
            f"the loaded part reaches {format_quantity(reach, 'length')} from the middle, over "
            f"the clamped end at {format_quantity(end, 'length')} (half of geometry.width)"
            + _room(end - half_length, "length"),
        )


def _room(room: float, dimension: DimensionName) -> str:
    """Say where the centre of a loaded part may lie on the pad."""
    if room <= 0:
        return "; make it smaller"
    return f"; place its centre less than {format_quantity(room, dimension)} from the middle"


def _off_the_skin(
    key: str, geometry: GeometrySpec, load: LineLoadSpec | BodyLoadSpec
) -> Contradictions:
    circle = _circle(geometry)
    if circle is None:
        return
    edge = format_quantity(circle.half_angle, "angle")
    angle = angle_on(circle, load)
    if abs(angle) >= circle.half_angle:
        where = f"{edge} (geometry.half_angle); the angle is measured from the symmetry axis"
        if load.arc is not None:
            edge = format_quantity(circle.half_angle * circle.inner_radius, "length")
            where = f"{edge} of arc from the middle of the inner face"
        yield (
            f"{key}.{load.told_by}",
            f"lies off the skin, whose clamped edges are at -{edge} and {where}",
        )
    elif load.kind == "line" and load.spread is not None:
        outer_radius = circle.inner_radius + circle.mean_thickness
        room = 2.0 * outer_radius * (circle.half_angle - abs(angle))
        if load.spread >= room:
            yield (
                f"{key}.spread",
                f"reaches over the clamped edge at {edge}; at "
                f"{format_quantity(angle, 'angle')} there is room for a spread of less "
                f"than {format_quantity(room, 'length')}",
            )


def _off_the_wall(geometry: GeometrySpec, electrodes: ElectrodesSpec) -> Contradictions:
    circle = _circle(geometry)
    placed: dict[str, Sequence[TaxelSpec | ModuleSpec]]
    placed = {"taxels": electrodes.taxels, "modules": electrodes.modules}
    for kind, places in placed.items():
        for index, place in enumerate(places):
            key = f"electrodes.{kind}.{index}"
            angle = None if circle is None else angle_on(circle, place)
            wrong = list(_without_angle(key, geometry, place))
            wrong += _place(key, geometry, angle, place.axial, place.told_by)
            if place.diameter > geometry.width:
                width = format_quantity(geometry.width, "length")
                wrong.append((f"{key}.diameter", f"is larger than the skin, {width} wide"))
            if not wrong and circle is not None and isinstance(place, ModuleSpec):
                wrong += _corners(key, circle, place)
            yield from wrong


def _place(
    key: str,
    geometry: GeometrySpec,
    angle: float | None,
    axial: float,
    told_by: str,
    what: str = "",
) -> Contradictions:
    circle = _circle(geometry)
    if circle is not None and angle is not None and abs(angle) > circle.half_angle * _SLACK:
        edge = format_quantity(circle.half_angle, "angle")
        yield (
            f"{key}.{told_by}",
            f"{what}lies off the skin, which ends at -{edge} and {edge} (geometry.half_angle)",
        )
    if abs(axial) > 0.5 * geometry.width * _SLACK:
        end = format_quantity(0.5 * geometry.width, "length")
        yield (
            f"{key}.axial",
            f"{what}lies off the skin, which ends at -{end} and {end} (half of geometry.width)",
        )


def _corners(key: str, geometry: CircleSpec, module: ModuleSpec) -> Contradictions:
    """Check the three corner taxels, sqrt(3) pitches from the centroid on the wall."""
    wall = geometry.inner_radius - geometry.mean_gap
    found: dict[str, str] = {}
    for corner in range(3):
        turn = module.rotation + math.pi / 2.0 + corner * 2.0 * math.pi / 3.0
        reach = math.sqrt(3.0) * module.pitch
        angle = angle_on(geometry, module) + reach * math.cos(turn) / wall
        axial = module.axial + reach * math.sin(turn)
        at = f"{format_quantity(angle, 'angle')}, {format_quantity(axial, 'length')}"
        what = f"a corner taxel, at {at}, "
        for place, advice in _place(key, geometry, angle, axial, module.told_by, what):
            found.setdefault(place, advice)
    yield from found.items()
