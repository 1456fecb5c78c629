"""An arc of a circle."""

import math
from typing import Annotated, Literal, Self

from pydantic import model_validator

from suas_jax.config.fields import PlacedError, PositiveLength, file_key, quantity
from suas_jax.config.geometry import GeometrySpec
from suas_jax.config.quantities import format_quantity


class CircleSpec(GeometrySpec):
    """A half-cylinder, or less or more of one.

    Attributes:
        inner_radius: radius of the membrane's inner face [m].
        half_angle: angle from the symmetry axis to a clamped edge [rad].
    """

    section: Literal["circle"] = file_key('"circle"', "circle")
    inner_radius: PositiveLength = file_key('"57.5 mm"')
    half_angle: Annotated[float, quantity("angle", above=0.0, below=math.pi)] = file_key(
        '"90 deg"'
    )

    @property
    def is_circle(self) -> bool:
        """See the base class."""
        return isinstance(self.thickness, float) and isinstance(self.oil_gap, float)

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        thickness, gap, radius = self.mean_thickness, self.mean_gap, self.inner_radius
        shown = format_quantity(radius, "length")
        if thickness >= radius:
            raise PlacedError("thickness", f"must be less than inner_radius ({shown})")
        arc = 2.0 * self.half_angle * radius
        if arc <= thickness:
            raise PlacedError(
                "half_angle",
                f"the arc between the edges is {format_quantity(arc, 'length')}, no longer "
                f"than the membrane is thick ({format_quantity(thickness, 'length')}); "
                f"half_angle is measured from the symmetry axis to one edge",
            )
        if gap >= radius:
            raise PlacedError(
                "oil_gap",
                f"must be less than inner_radius ({shown}): the rigid wall lies at "
                f"inner_radius - oil_gap",
            )
        return self
