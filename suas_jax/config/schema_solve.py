"""How a scene is solved."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from suas_jax.config.fields import AsList, Count, Spec, quantity


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
