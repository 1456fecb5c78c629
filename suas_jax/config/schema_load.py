"""What acts on a skin from outside: line loads, pressures, the water and its warmth."""

import math
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias, get_args

from pydantic import Field, ValidationInfo, field_validator, model_validator

from suas_jax.config.errors import unknown
from suas_jax.config.fields import (
    Angle,
    AsList,
    Force,
    Length,
    PlacedError,
    PlacedSpec,
    PositiveLength,
    Pressure,
    Quantity,
    Spec,
    Temperature,
    file_key,
    quantity,
    quantity_of,
)

DIRECTIONS = ("radial", "vertical")
Tilt = Annotated[float, quantity("angle", above=-math.pi / 2, below=math.pi / 2)]


def _word_or_angle(value: Any, info: ValidationInfo) -> Any:
    if value in DIRECTIONS:
        return value
    if isinstance(value, str) and value.strip().isalpha():
        advice = unknown(value, DIRECTIONS, "direction", quoted=True)
        raise ValueError(f'{advice}, or an angle such as "10 deg"')
    strict = bool(info.context and info.context.get("units_required"))
    return quantity_of(value, "angle", bare_numbers=not strict)


Direction = Annotated[
    Literal["radial", "vertical"] | float, Quantity(_word_or_angle, dimension="angle")
]


class DeadForceSpec(PlacedSpec):
    """A force that keeps its size and direction while the skin moves.

    Attributes:
        force: total, positive along the direction (inward) [N].
        direction: ``"radial"`` (inward), ``"vertical"`` (down), or the angle by which the
            inward radial vector is turned counter-clockwise [rad].
        tilt: of the force out of the section's plane towards +axial [rad]; in three
            dimensions.
    """

    force: Force = file_key('"20.7 N"')
    direction: Direction = file_key('"radial"', "radial")
    tilt: Tilt = file_key('"0 deg"', 0.0)


class LineLoadSpec(DeadForceSpec):
    """A dead force on the outer face, even along a line parallel to the axis.

    Attributes:
        spread: length of the undeformed outer face's arc that it is spread over [m]; None for
            a line.
        length: of the line [m]; None for the whole width. In three dimensions.
    """

    kind: Literal["line"] = file_key('"line"', "line")
    spread: PositiveLength | None = file_key('"5 mm"', None)
    length: PositiveLength | None = file_key('"40 mm"', None)

    @property
    def half_extents(self) -> tuple[float, float]:
        """Along the arc of the outer face and along the axis [m]."""
        return (self.spread or 0.0) / 2, (self.length or 0.0) / 2


class PatchLoadSpec(DeadForceSpec):
    """A dead force, even over a patch of the undeformed outer face; in three dimensions.

    Attributes:
        size: of a rectangle, along the arc and along the axis [m].
        diameter: of a disc [m]; a patch has either a size or a diameter.
    """

    kind: Literal["patch"] = file_key('"patch"', "patch")
    size: Annotated[tuple[PositiveLength, PositiveLength], AsList] | None = file_key(
        '["6 mm", "6 mm"]', None
    )
    diameter: PositiveLength | None = file_key('"8 mm"', None)

    @field_validator("size", mode="before")
    @classmethod
    def _two_extents(cls, size: Any) -> Any:
        if isinstance(size, list | tuple) and len(size) != 2:
            raise ValueError(
                "two lengths are expected, along the arc and along the axis, for example "
                '["6 mm", "6 mm"]'
            )
        return size

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.size is None) == (self.diameter is None):
            raise PlacedError(
                "size" if self.size is not None else "diameter",
                'a patch has either size = ["6 mm", "6 mm"] or diameter = "8 mm"',
            )
        return self

    @property
    def half_extents(self) -> tuple[float, float]:
        """Along the arc of the outer face and along the axis [m]."""
        arc, axial = self.size or (self.diameter or 0.0,) * 2
        return arc / 2, axial / 2


class PressureLoadSpec(Spec):
    """A uniform pressure difference on the outer face.

    Attributes:
        pressure: positive presses inward [Pa].
    """

    kind: Literal["pressure"] = file_key('"pressure"', "pressure")
    pressure: Pressure = file_key('"1 kPa"')


class BodyLoadSpec(PlacedSpec):
    """A rigid body that is pressed onto the outer face, and may be dragged along it.

    Its reference point comes in along the inward normal of the place given; the body neither
    turns nor gives way.

    Attributes:
        shape: ``"cylinder"`` (its axis along the pad), ``"plate"`` or ``"wedge"`` on a section;
            ``"sphere"``, ``"cylinder"``, ``"plate"`` or ``"box"`` on a pad.
        radius: of a sphere or a cylinder, or of a wedge's rounded tip [m].
        opening: angle between the flanks of a wedge [rad].
        length: of a cylinder between its half-spherical ends [m]; None for an endless one. On
            pads.
        size: of a plate or a box, along the arc and along the axis before it is turned [m]. On
            pads; a section's plate has no end.
        edge: radius of the edges of a plate or a box [m]; on pads.

        turn: rotation about the approach, from the axis towards the arc [rad]; on pads.
        depth: travel beyond first touch of the undeformed outer face [m]; negative where the
            body is off it.
        force: instead of the depth: the component along the approach [N]; the travel is found.
        friction: Coulomb's coefficient; None for none.
        drag: travel along growing angles, at right angles to the approach [m].
        tangential_force: instead of the drag: what the body pulls the skin with along growing
            angles [N]; the drag is found.
        drag_axial: travel along the axis [m]; on pads.
        tangential_force_axial: instead of it: the pull along the axis [N]; on pads.
    """

    kind: Literal["body"] = file_key('"body"', "body")
    shape: Literal["cylinder", "plate", "wedge", "sphere", "box"] = file_key('"cylinder"')
    radius: PositiveLength | None = file_key('"10 mm"', None)
    opening: Annotated[float, quantity("angle", above=0.0, below=math.pi)] | None = file_key(
        '"90 deg"', None
    )
    length: PositiveLength | None = file_key('"30 mm"', None)
    size: Annotated[tuple[PositiveLength, PositiveLength], AsList] | None = file_key(
        '["20 mm", "30 mm"]', None
    )
    edge: PositiveLength = file_key('"2 mm"', 1e-3)
    turn: Angle = file_key('"30 deg"', 0.0)
    depth: Length | None = file_key('"2 mm"', None)
    force: Annotated[float, quantity("force", at_least=0.0)] | None = file_key('"12 N"', None)
    friction: Annotated[float, quantity("number", at_least=0.0)] | None = file_key("0.3", None)
    drag: Length | None = file_key('"1 mm"', None)
    tangential_force: Force | None = file_key('"2 N"', None)
    drag_axial: Length | None = file_key('"1 mm"', None)
    tangential_force_axial: Force | None = file_key('"2 N"', None)

    @field_validator("friction")
    @classmethod
    def _none_where_zero(cls, value: float | None) -> float | None:
        return value or None

    @model_validator(mode="after")
    def _driven(self) -> Self:
        if (self.depth is None) == (self.force is None):
            raise PlacedError(
                "depth",
                'missing; say how far the body is pressed in, for example depth = "2 mm" (or '
                'by which force = "12 N")'
                if self.depth is None
                else "a body is pressed by a depth or by a force; take one out",
            )
        for way in ("", "_axial"):
            drag, force = f"drag{way}", f"tangential_force{way}"
            if getattr(self, force) is None:
                continue
            if getattr(self, drag) is not None:
                raise PlacedError(
                    drag, f"a body is pulled along by a {drag} or by a {force}; take one out"
                )
            if self.friction is None:
                raise PlacedError(
                    force,
                    f"without friction nothing pulls along; add friction = 0.3, or use {drag}",
                )
        return self

    half_extents: ClassVar[tuple[float, float]] = (0.0, 0.0)

    @property
    def dragged(self) -> tuple[bool, bool]:
        """Whether it travels along growing angles, and along the axis."""
        return (
            self.drag is not None or self.tangential_force is not None,
            self.drag_axial is not None or self.tangential_force_axial is not None,
        )

    @property
    def pulled(self) -> bool:
        """Whether forces pull it along, so that its drag is found."""
        return self.tangential_force is not None or self.tangential_force_axial is not None


BODY_SHAPES: dict[int, dict[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    2: {"cylinder": (("radius",), ()), "plate": ((), ()), "wedge": (("radius", "opening"), ())},
    3: {
        "sphere": (("radius",), ("axial",)),
        "cylinder": (("radius",), ("axial", "length", "turn")),
        "plate": (("size",), ("axial", "edge", "turn")),
        "box": (("size",), ("axial", "edge", "turn")),
    },
}
"""Shapes of bodies in two and three dimensions: keys that they need, and may have."""

AnyLoad: TypeAlias = LineLoadSpec | PatchLoadSpec | PressureLoadSpec | BodyLoadSpec
LoadSpec = Annotated[AnyLoad, Field(discriminator="kind")]
LOADS: dict[str, type[AnyLoad]] = {
    load.model_fields["kind"].default: load for load in get_args(AnyLoad)
}


class EnvironmentSpec(Spec):
    """The surroundings. They change stress-free sizes against those in `ReferenceSpec`.

    Attributes:
        medium: what moves with the outer face: water, or nothing.
        temperature: of the whole skin [K]; None for that of the reference.
        depth: below the surface of the water [m]; None for the pressure of the reference.
        specific_weight: of the water [N/m^3]; by default the paper's 10.051 kN/m^3.
        atmospheric_pressure: at the water's surface [Pa]; by default the paper's 101.3 kPa.
    """

    medium: Literal["water", "air"] = file_key('"water"', "water")
    temperature: Temperature | None = file_key('"4 degC"', None)
    depth: Annotated[float, quantity("length", at_least=0.0)] | None = file_key('"20 m"', None)
    specific_weight: Annotated[float, quantity("specific weight", above=0.0)] = file_key(
        '"10.051 kN/m^3"', 10.051e3
    )
    atmospheric_pressure: Annotated[float, quantity("pressure", at_least=0.0)] = file_key(
        '"101.3 kPa"', 101.3e3
    )

    @property
    def ambient_pressure(self) -> float:
        """Absolute pressure of the water at the depth, which is given [Pa]."""
        return self.specific_weight * (self.depth or 0.0) + self.atmospheric_pressure

    @field_validator("specific_weight", "atmospheric_pressure")
    @classmethod
    def _only_with_depth(cls, value: float, info: ValidationInfo) -> float:
        default = cls.model_fields[info.field_name or ""].default
        if "depth" in info.data and info.data["depth"] is None and value != default:
            raise ValueError('has no effect without a depth; add depth, such as depth = "20 m"')
        return value


class ReferenceSpec(Spec):
    """When the skin was closed: free of stress but for mounting, with oil of these sizes.

    Attributes:
        temperature: of the whole skin [K].
        pressure: absolute, around it and in its oil [Pa].
    """

    temperature: Temperature = file_key('"20 degC"', 293.15)
    pressure: Annotated[float, quantity("pressure", at_least=0.0)] = file_key(
        '"101.3 kPa"', 101.3e3
    )
