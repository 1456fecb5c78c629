"""Tile the wall with triangular modules, as the paper's pad carries up to 32 of them."""

import math
from typing import Any

import numpy as np

from suas_jax.config import GeometrySpec, ModuleSpec
from suas_jax.config.quantities import format_quantity
from suas_jax.skin.plain import plain_geometry

PAPER_EDGE = 24e-3
"""Edge of the paper's triangle [m]."""

_MEASURED_EDGE, _MEASURED_PITCH = 30e-3, 6.533e-3  # of an iCub's triangle


def tiled_modules(
    geometry: GeometrySpec,
    *,
    rows: int = 4,
    columns: int = 8,
    edge: float = PAPER_EDGE,
    pitch: float | None = None,
    **module: Any,
) -> tuple[ModuleSpec, ...]:
    """Cover the wall with rows of triangles that point up and down in turn.

    Rows follow one another along the axis, the triangles of a row along the wall, whatever its
    section, half an edge apart; the tiling is centred on the wall. By default four rows of
    eight: the 32 triangles (320 taxels) of a half-cylinder, a row a bus.

    Args:
        geometry: of the skin.
        rows: of triangles along the axis.
        columns: triangles in a row.
        edge: of a triangle on the unrolled wall [m].
        pitch: between neighbouring taxels [m]; by default the measured 6.533 mm of an
            iCub's triangle of 30 mm, scaled to the edge, so that taxels of neighbouring
            triangles don't meet in the corners.
        **module: further keys of every module: diameter [m], numbering.

    Returns:
        Modules row by row from -axial, each row from the left; by `angle` where the section
        knows one, else by `arc`.

    Raises:
        ValueError: the tiling is larger than the wall; the message says by how much.
    """
    if pitch is None:
        pitch = _MEASURED_PITCH * edge / _MEASURED_EDGE
    height, skin = edge * math.sqrt(3) / 2, plain_geometry(geometry)
    first, last = (float(skin.wall_arc(side * skin.half_angle)[0]) for side in (-1, 1))
    _must_fit("arc", (columns + 1) * edge / 2, last - first)
    _must_fit("width", rows * height, geometry.width)
    along = (first + last + (np.arange(columns) - (columns - 1) / 2) * edge) / 2
    middle: Any = np.zeros((columns, 1))  # NumPy's, which need no program on a circle
    places = skin.along_wall(middle, middle + along[:, None])
    told = "angle" if geometry.has_angle else "arc"
    known = skin.section.given_angle if geometry.has_angle else skin.section.arc
    place = np.asarray(known(places))[:, 0].tolist()
    modules = []
    for row in range(rows):
        for column in range(columns):
            down = (row + column) % 2 == 1
            # A triangle's centroid lies a third of its height above its base.
            middle = row + (2 / 3 if down else 1 / 3) - rows / 2
            rotation = math.pi if down else 0.0
            pose: dict[str, Any] = {
                told: place[column],
                "axial": middle * height,
                "rotation": rotation,
            }
            modules.append(ModuleSpec(**pose, pitch=pitch, **module))
    return tuple(modules)


def _must_fit(what: str, needed: float, available: float) -> None:
    if needed > available * (1 + 1e-9):
        raise ValueError(
            f"the triangles need {format_quantity(needed, 'length')} of the wall's {what}, "
            f"which is {format_quantity(available, 'length')}: use fewer or smaller ones"
        )
