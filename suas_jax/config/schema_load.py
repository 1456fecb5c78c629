"""What acts on a skin from outside: line loads, pressures, the depth of the water."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from suas_jax.config.errors import unknown
from suas_jax.config.fields import Angle, Force, PositiveLength, Pressure, Spec, quantity
from suas_jax.config.quantities import to_si

DIRECTIONS = ("radial", "vertical")


class LineLoadSpec(Spec):
    """A dead force, uniform over the width, on the outer face.

    Attributes:
        angle: where it acts, from the symmetry axis, positive towards +x [rad].
        force: total over the width, positive along the direction (inward) [N].
        direction: ``"radial"`` (inward), ``"vertical"`` (down), or the angle by which the
            inward radial vector is turned counter-clockwise [rad].
        spread: length of the undeformed outer face's arc that it is spread over [m]; None for
            a line.
    """

    kind: Literal["line"] = Field(default="line", examples=['"line"'])
    angle: Angle = Field(examples=['"45 deg"'])
    force: Force = Field(examples=['"20.7 N"'])
    direction: Literal["radial", "vertical"] | float = Field(
        default="radial", examples=['"radial"']
    )
    spread: PositiveLength | None = Field(default=None, examples=['"5 mm"'])

    @field_validator("direction", mode="before")
    @classmethod
    def _word_or_angle(cls, value: Any, info: ValidationInfo) -> Any:
        if value in DIRECTIONS:
            return value
        if isinstance(value, str) and value.strip().isalpha():
            advice = unknown(value, DIRECTIONS, "direction", quoted=True)
            raise ValueError(f'{advice}, or an angle such as "10 deg"')
        strict = bool(info.context and info.context.get("units_required"))
        return to_si(value, "angle", bare_numbers=not strict)


class PressureLoadSpec(Spec):
    """A uniform pressure difference on the outer face.

    Attributes:
        pressure: positive presses inward [Pa].
    """

    kind: Literal["pressure"] = Field(default="pressure", examples=['"pressure"'])
    pressure: Pressure = Field(examples=['"1 kPa"'])


LoadSpec = Annotated[LineLoadSpec | PressureLoadSpec, Field(discriminator="kind")]

LOADS: dict[str, type[LineLoadSpec | PressureLoadSpec]] = {
    "line": LineLoadSpec,
    "pressure": PressureLoadSpec,
}


class EnvironmentSpec(Spec):
    """The surroundings, whose pressure acts on both sides and drops out of the deformation.

    Attributes:
        depth: below the surface of the water [m]; None leaves ambient pressure out.
        specific_weight: of the water [N/m^3]; by default the paper's 10.051 kN/m^3.
        atmospheric_pressure: [Pa]; by default the paper's 101.3 kPa.
    """

    depth: Annotated[float, quantity("length", at_least=0.0)] | None = Field(
        default=None, examples=['"20 m"']
    )
    specific_weight: Annotated[float, quantity("specific weight", above=0.0)] = Field(
        default=10.051e3, examples=['"10.051 kN/m^3"']
    )
    atmospheric_pressure: Annotated[float, quantity("pressure", at_least=0.0)] = Field(
        default=101.3e3, examples=['"101.3 kPa"']
    )

    @field_validator("specific_weight", "atmospheric_pressure")
    @classmethod
    def _only_with_depth(cls, value: float, info: ValidationInfo) -> float:
        if "depth" in info.data and info.data["depth"] is None:
            raise ValueError('has no effect without a depth; add depth, such as depth = "20 m"')
        return value
