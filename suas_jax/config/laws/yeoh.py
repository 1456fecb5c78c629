"""The Yeoh law: its constants."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from suas_jax.config.law import Constant, LawSpec


class YeohSpec(LawSpec):
    """Yeoh law, Psi = C1 (I1 - 3) + C2 (I1 - 3)^2 + C3 (I1 - 3)^3.

    Attributes:
        C1: first constant [Pa]; 2 C1 is the shear modulus of small strain.
        C2: second constant [Pa].
        C3: third constant [Pa].
    """

    law: Literal["yeoh"] = Field(default="yeoh", examples=['"yeoh"'])
    C1: Annotated[float, Constant(positive=True)] = Field(examples=['"0.2 MPa"'])
    C2: Annotated[float, Constant(degree=(2, 0), since=2)] = Field(
        default=0.0, examples=['"-2 kPa"']
    )
    C3: Annotated[float, Constant(degree=(3, 0), since=3)] = Field(
        default=0.0, examples=['"50 Pa"']
    )

    compared: ClassVar[tuple[int, ...]] = (3,)
    is_polynomial: ClassVar[bool] = True
