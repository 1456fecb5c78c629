"""A scene: a skin, what loads it, where it is, and how to solve it."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from suas_jax.config.consistency import contradictions
from suas_jax.config.errors import unknown
from suas_jax.config.fields import (
    Angle,
    AsList,
    Count,
    Force,
    PositiveLength,
    Pressure,
    Spec,
    quantity,
)
from suas_jax.config.quantities import to_si
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.config.schema_material import MaterialSpec
from suas_jax.config.schema_oil import AnyOilSpec
from suas_jax.config.schema_skin import ElectrodesSpec, GeometrySpec

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


class SolveSpec(Spec):
    """How to solve.

    Attributes:
        model: ``"shell"``, ``"solid"``, or ``"auto"``, the cheapest that meets ``rtol``.
        rtol: wanted relative error of displacement and pressure.
        oil_pressure: scale all loads until the oil reaches this pressure [Pa]; None applies
            the loads as they are.
        elements: shell elements along the whole arc; overrides ``rtol``.
        mesh: solid elements along the arc and through the thickness; overrides ``rtol``.
    """

    model: Literal["auto", "shell", "solid"] = Field(default="auto", examples=['"auto"'])
    rtol: Annotated[float, quantity("number", above=0.0, below=1.0)] = Field(
        default=1e-3, examples=["1e-3"]
    )
    oil_pressure: Annotated[float, quantity("pressure", nonzero=True)] | None = Field(
        default=None, examples=['"10 kPa"']
    )
    elements: Count | None = Field(default=None, examples=["16"])
    mesh: Annotated[tuple[Count, Count], AsList] | None = Field(
        default=None, examples=["[600, 4]"]
    )

    @field_validator("mesh", mode="before")
    @classmethod
    def _two_directions(cls, mesh: Any) -> Any:
        if isinstance(mesh, list | tuple) and len(mesh) != 2:
            raise ValueError(
                "two numbers are expected, along the arc and through the thickness, for "
                "example [600, 4]"
            )
        return mesh

    @field_validator("elements")
    @classmethod
    def _elements_of_a_shell(cls, elements: int | None, info: ValidationInfo) -> int | None:
        if elements is not None and info.data.get("model") == "solid":
            raise ValueError('belongs to the shell, but model is "solid"; use mesh instead')
        return elements

    @field_validator("mesh")
    @classmethod
    def _mesh_of_a_solid(
        cls, mesh: tuple[int, int] | None, info: ValidationInfo
    ) -> tuple[int, int] | None:
        if mesh is not None and info.data.get("model") == "shell":
            raise ValueError('belongs to the solid, but model is "shell"; use elements instead')
        return mesh


class SkinSpec(Spec):
    """A skin: dimensions, material, oil, and electrodes if it senses.

    Attributes:
        geometry: the dimensions.
        material: the membrane's law and constants.
        oil: how the oil answers.
        electrodes: what is sensed; None for nothing.
        calibration: where fitted numbers come from; None in a file written by hand.
    """

    geometry: GeometrySpec
    material: MaterialSpec
    oil: AnyOilSpec
    electrodes: ElectrodesSpec | None = None
    calibration: CalibrationSpec | None = None

    @model_validator(mode="after")
    def _without_contradictions(self) -> Self:
        found = contradictions(dict(self))
        if found:
            raise ValueError("; ".join(f"{key}: {advice}" for key, advice in found))
        return self


class SceneSpec(SkinSpec):
    """A skin with what loads it.

    Attributes:
        loads: what acts from outside, in the order of the file (``[[load]]``).
        environment: the surroundings; None leaves ambient pressure out.
        solve: how to solve.
    """

    loads: tuple[LoadSpec, ...] = Field(default=(), alias="load")
    environment: EnvironmentSpec | None = None
    solve: SolveSpec = SolveSpec()

    @property
    def skin(self) -> SkinSpec:
        """The skin alone."""
        given = {name: getattr(self, name) for name in SkinSpec.model_fields}
        return SkinSpec(**{name: value for name, value in given.items() if value is not None})
