"""ROBOSKIN triangles that cover a whole pad, in rows that point up and down in turn."""

import math
from typing import NamedTuple

PITCH_PER_EDGE = 6.533 / 30.0
"""Distance between neighbouring taxels over the edge of their triangle: an iCub's."""


class Triangle(NamedTuple):
    """Where a module lies.

    Attributes:
        angle: of its centroid, from the symmetry axis [rad].
        axial: of its centroid, from mid-width [m].
        rotation: about its centroid [rad].
    """

    angle: float
    axial: float
    rotation: float


class PadLayout(NamedTuple):
    """Triangles of one size.

    Attributes:
        edge: of the triangles [m].
        pitch: between neighbouring taxels [m].
        triangles: row by row along the axis, each towards +angle.
    """

    edge: float
    pitch: float
    triangles: tuple[Triangle, ...]


def pad_layout(
    rows: int, columns: int, *, wall_radius: float, half_angle: float, width: float
) -> PadLayout:
    """Rows of triangles, as large as the pad's wall allows, about its middle.

    A row of n triangles of edge a is (n + 1) a / 2 long and sqrt(3) a / 2 wide.

    Args:
        rows: along the axis.
        columns: triangles of a row, along the arc.
        wall_radius: of the wall that carries them [m].
        half_angle: from the symmetry axis to an edge of the wall [rad].
        width: of the pad, along the axis [m].

    Raises:
        ValueError: no rows or columns.
    """
    if rows < 1 or columns < 1:
        raise ValueError(f"{rows}x{columns}: at least one row and one column are needed")
    arc = 2 * half_angle * wall_radius
    edge = min(2 * arc / (columns + 1), 2 * width / (math.sqrt(3) * rows))
    height = math.sqrt(3) / 2 * edge
    triangles = []
    for row in range(rows):
        base = (row - rows / 2) * height
        for column in range(columns):
            points_up = (row + column) % 2 == 0
            triangles.append(
                Triangle(
                    (column - (columns - 1) / 2) * edge / 2 / wall_radius,
                    base + height / 3 * (1 if points_up else 2),
                    0.0 if points_up else math.pi,
                )
            )
    return PadLayout(edge, PITCH_PER_EDGE * edge, tuple(triangles))
