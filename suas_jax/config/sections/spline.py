"""A smooth curve through points."""

import itertools
import math
from typing import Annotated, ClassVar, Literal

from pydantic import field_validator

from suas_jax.config.fields import AsList, Length, at_most, file_key
from suas_jax.config.geometry import GeometrySpec

MOST_POINTS = 400
_Point = Annotated[tuple[Length, Length], AsList]


class SplineSpec(GeometrySpec):
    """The cubic spline through points by the length of their chords.

    Attributes:
        points: x and y from the left clamp to the right one [m]; in files also the name of
            a table with the columns x and y and their units.
    """

    section: Literal["spline"] = file_key('"spline"', "spline")
    points: Annotated[tuple[_Point, ...], at_most(MOST_POINTS)] = file_key(
        '"section.csv"', min_length=4
    )

    has_angle: ClassVar[bool] = False

    @field_validator("points")
    @classmethod
    def _apart(cls, points: tuple[_Point, ...]) -> tuple[_Point, ...]:
        for k, (a, b) in enumerate(itertools.pairwise(points)):
            if math.dist(a, b) == 0:
                raise ValueError(f"points {k} and {k + 1} (from 0) are the same")
        if points[0][0] >= points[-1][0]:
            raise ValueError("the points go from the left clamp to the right one: x must grow")
        return points
