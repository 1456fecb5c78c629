"""Lines and arcs with common tangents."""

import math
from typing import Annotated, ClassVar, Literal, Self

from pydantic import model_validator

from suas_jax.config.fields import Angle, PlacedError, PositiveLength, Spec, at_most, file_key
from suas_jax.config.geometry import GeometrySpec
from suas_jax.config.quantities import format_quantity

_LEVEL = 1e-6  # rad that a mirrored path may miss the horizontal by


class PieceSpec(Spec):
    """A straight line, or an arc that turns clockwise where its angle is positive.

    Attributes:
        line: length of a line [m].
        radius: of an arc of the inner face [m].
        angle: that the arc turns by [rad].
    """

    line: PositiveLength | None = file_key('"20 mm"', None)
    radius: PositiveLength | None = file_key('"30 mm"', None)
    angle: Angle | None = file_key('"90 deg"', None)

    @model_validator(mode="after")
    def _line_or_arc(self) -> Self:
        arc = self.radius is not None and bool(self.angle)
        if (self.line is None) != arc or (self.radius is None) != (self.angle is None):
            raise ValueError(
                'a piece is { line = "20 mm" } or { radius = "30 mm", angle = "90 deg" }'
            )
        return self


class PathSpec(GeometrySpec):
    """Pieces from the left clamp on, each with the direction in which the one before it ends.

    Attributes:
        path: the pieces.
        mirror: whether the path ends at the crown and is mirrored there.
        start: direction of the first piece from +x, counter-clockwise [rad].
    """

    section: Literal["path"] = file_key('"path"', "path")
    path: Annotated[tuple[PieceSpec, ...], at_most(100)] = file_key(
        '[{ line = "20 mm" }, { radius = "30 mm", angle = "90 deg" }]', min_length=1
    )
    mirror: bool = file_key("true", False)
    start: Angle = file_key('"90 deg"', math.pi / 2)

    has_angle: ClassVar[bool] = False

    @model_validator(mode="after")
    def _level_at_the_crown(self) -> Self:
        end = self.start - sum(piece.angle or 0.0 for piece in self.path)
        if self.mirror and abs(end) > _LEVEL:
            raise PlacedError(
                "path",
                f"ends in a direction of {format_quantity(end, 'angle')}, so that its mirror "
                "image makes a corner at the crown; let start and the arcs' angles agree",
            )
        return self
