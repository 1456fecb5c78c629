"""An arc of an ellipse."""

import math
from typing import Annotated, Any, Literal

from pydantic import field_validator

from suas_jax.config.fields import AsList, PositiveLength, file_key, quantity
from suas_jax.config.geometry import GeometrySpec


class EllipseSpec(GeometrySpec):
    """x = a sin t, y = b cos t for |t| up to the half angle.

    Attributes:
        inner_semi_axes: a, half the width at the base, and b, the height [m].
        half_angle: t at a clamped edge [rad].
    """

    section: Literal["ellipse"] = file_key('"ellipse"', "ellipse")
    inner_semi_axes: Annotated[tuple[PositiveLength, PositiveLength], AsList] = file_key(
        '["57.5 mm", "40 mm"]'
    )
    half_angle: Annotated[float, quantity("angle", above=0.0, below=math.pi)] = file_key(
        '"90 deg"'
    )

    @field_validator("inner_semi_axes", mode="before")
    @classmethod
    def _two(cls, axes: Any) -> Any:
        if isinstance(axes, list | tuple) and len(axes) != 2:
            raise ValueError('half width and height are expected, ["57.5 mm", "40 mm"]')
        return axes
