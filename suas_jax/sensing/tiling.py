"""ROBOSKIN triangles in rows on the wall, pointing up and down in turn.

A row of n triangles of edge a is (n + 1) a / 2 long and sqrt(3) a / 2 wide. Rows follow one
another along the axis, the triangles of a row along the arc, half an edge apart, all about the
crown and mid-width. The paper's pad carries up to 32 of them.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from suas_jax.config import GeometrySpec, ModuleSpec
from suas_jax.config.quantities import format_quantity
from suas_jax.skin.plain import plain_geometry

PAPER_EDGE = 24e-3
"""Edge of the paper's triangle [m]."""
PITCH_PER_EDGE = 6.533 / 30.0
"""Distance between neighbouring taxels over the edge of their triangle: an iCub's."""


class Triangle(NamedTuple):
    """Where a module lies."""

    angle: float  # of its centroid, from the symmetry axis [rad]
    axial: float  # of its centroid, from mid-width [m]
    rotation: float  # about its centroid [rad]


class PadLayout(NamedTuple):
    """Triangles of one size."""

    edge: float  # of the triangles [m]
    pitch: float  # between neighbouring taxels [m]
    triangles: tuple[Triangle, ...]  # row by row along the axis, each towards +angle


def pad_layout(
    rows: int, columns: int, *, wall_radius: float, half_angle: float, width: float
) -> PadLayout:
    """Rows of triangles, as large as the pad's wall allows.

    `rows`: along the axis. `columns`: triangles of a row, along the arc. `wall_radius`: of the
    wall that carries them [m]. `half_angle`: from the symmetry axis to an edge of the wall
    [rad]. `width`: of the pad, along the axis [m].
    Raises ValueError: no rows or columns.
    """
    if rows < 1 or columns < 1:
        raise ValueError(f"{rows}x{columns}: at least one row and one column are needed")
    arc = 2 * half_angle * wall_radius
    edge = min(2 * arc / (columns + 1), 2 * width / (math.sqrt(3) * rows))
    places = _places(rows, columns, edge)
    triangles = tuple(Triangle(along / wall_radius, *rest) for along, *rest in places)
    return PadLayout(edge, PITCH_PER_EDGE * edge, triangles)


def tiled_modules(
    geometry: GeometrySpec,
    *,
    rows: int = 4,  # of triangles along the axis
    columns: int = 8,  # triangles in a row
    edge: float = PAPER_EDGE,  # of a triangle on the unrolled wall [m]
    pitch: float | None = None,
    **module: Any,  # further keys of every module: diameter [m], numbering
) -> tuple[ModuleSpec, ...]:
    """Cover the wall, whatever its section, with triangles of a given size.

    The tiling is centred on the wall, the triangles of a row even along it. By default four
    rows of eight: the 32 triangles (320 taxels) of a half-cylinder, a row a bus.

    `pitch`: between neighbouring taxels [m]; by default the measured 6.533 mm of an iCub's
    triangle of 30 mm, scaled to the edge, so that taxels of neighbouring triangles don't meet
    in the corners.
    Returns modules row by row from -axial, each row from -angle.
    Raises ValueError: the tiling is larger than the wall; the message says by how much.
    """
    skin = plain_geometry(geometry)
    first, last = (float(skin.wall_arc(side * skin.half_angle)[0]) for side in (-1, 1))
    _must_fit("arc", (columns + 1) * edge / 2, last - first)
    _must_fit("width", rows * edge * math.sqrt(3) / 2, geometry.width)
    module["pitch"] = PITCH_PER_EDGE * edge if pitch is None else pitch
    along, axial, rotation = map(np.array, zip(*_places(rows, columns, edge), strict=True))
    middle: Any = np.zeros((len(along), 1))  # NumPy's, which need no program on a circle
    places = skin.along_wall(middle, middle + ((first + last) / 2 + along)[:, None])
    told = "angle" if geometry.has_angle else "arc"
    known = skin.section.given_angle if geometry.has_angle else skin.section.arc
    place = np.asarray(known(places))[:, 0]
    rows_of = zip(place.tolist(), axial.tolist(), rotation.tolist(), strict=True)
    return tuple(
        ModuleSpec(**{told: at}, axial=z, rotation=turn, **module) for at, z, turn in rows_of
    )


def _places(rows: int, columns: int, edge: float) -> list[tuple[float, float, float]]:
    """Centroids along the wall and the axis [m] from the middle, and rotations [rad]."""
    height = edge * math.sqrt(3) / 2
    found = []
    for row in range(rows):
        for column in range(columns):
            down = (row + column) % 2 == 1
            # A triangle's centroid lies a third of its height above its base.
            middle = row + (2 / 3 if down else 1 / 3) - rows / 2
            along = (column - (columns - 1) / 2) * edge / 2
            found.append((along, middle * height, math.pi if down else 0.0))
    return found


def _must_fit(what: str, needed: float, available: float) -> None:
    if needed > available * (1 + 1e-9):
        raise ValueError(
            f"the triangles need {format_quantity(needed, 'length')} of the wall's {what}, "
            f"which is {format_quantity(available, 'length')}: use fewer or smaller ones"
        )
