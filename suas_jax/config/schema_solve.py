"""How a scene is solved."""

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ValidationInfo, field_validator

from suas_jax.config.fields import AsList, Count, Spec, file_key, quantity, whole_number


def _one_count_or_two(value: Any) -> Any:
    if not isinstance(value, list | tuple):
        return whole_number(value)
    if len(value) != 2:
        raise ValueError(
            "one number is expected, along the arc, or two, along the arc and along the "
            "axis, for example [24, 20]"
        )
    return tuple(whole_number(count) for count in value)


Elements = Annotated[int | tuple[int, int], BeforeValidator(_one_count_or_two)]

# Ten times what any tolerance above rounding needs.
_MOST_ELEMENTS = 20_000


_MODELS = {"elements": ("shell", "solid", "mesh"), "mesh": ("solid", "shell", "elements")}


class SolveSpec(Spec):
    """How to solve.

    Attributes:
        model: ``"shell"``, ``"solid"``, or ``"auto"``, the cheapest that meets ``rtol``.
        rtol: wanted relative error of displacement and pressure; None for 1e-3 in plane strain
            and 1e-2 in three dimensions.
        oil_pressure: scale all loads until the oil reaches this pressure [Pa]; None applies
            the loads as they are.
        elements: shell elements along the whole arc and, in three dimensions, along the
            axis; overrides ``rtol``.
        mesh: solid elements along the arc and through the thickness; in three dimensions
            elements along arc and axis, in fours, and the degree of the polynomials through the
            thickness, 2 to 4; overrides ``rtol``.
        symmetry: whether a half or a quarter is solved where the scene has it.
    """

    model: Literal["auto", "shell", "solid"] = file_key('"auto"', "auto")
    rtol: Annotated[float, quantity("number", above=0.0, below=1.0)] | None = file_key(
        "1e-3", None
    )
    oil_pressure: Annotated[float, quantity("pressure", nonzero=True)] | None = file_key(
        '"10 kPa"', None
    )
    elements: Elements | None = file_key("16", None)
    mesh: Annotated[tuple[Count, ...], AsList] | None = file_key("[600, 4]", None)
    symmetry: bool = file_key("true", True)

    @field_validator("mesh", mode="before")
    @classmethod
    def _directions(cls, mesh: Any) -> Any:
        if isinstance(mesh, list | tuple) and len(mesh) not in (2, 3):
            raise ValueError(
                "two numbers are expected, along the arc and through the thickness, for "
                "example [600, 4]; in three dimensions three: elements along arc and axis, and "
                "a degree, for example [40, 32, 3]"
            )
        return mesh

    @field_validator("elements", "mesh")
    @classmethod
    def _not_too_many(cls, counts: int | tuple[int, ...] | None) -> Any:
        size = math.prod(counts) if isinstance(counts, tuple) else counts or 0
        if size > _MOST_ELEMENTS:
            raise ValueError(f"{size} elements; at most {_MOST_ELEMENTS} are solved")
        return counts

    @field_validator("elements", "mesh")
    @classmethod
    def _of_this_model(cls, counts: Any, info: ValidationInfo) -> Any:
        own, other, instead = _MODELS[info.field_name or ""]
        if counts is not None and info.data.get("model") == other:
            raise ValueError(
                f'belongs to the {own}, but model is "{other}"; use {instead} instead'
            )
        return counts
