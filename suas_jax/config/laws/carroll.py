"""Carroll's law: its constants."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from suas_jax.config.law import Constant, LawSpec


class CarrollSpec(LawSpec):
    """Carroll law, Psi = A (I1 - 3) + B (I1^4 - 81) + C (sqrt(I2) - sqrt(3)).

    Attributes:
        A: first constant [Pa]; 2 A + 216 B + C/sqrt(3) is the shear modulus of small strain.
        B: second constant [Pa], which stiffens at large strain.
        C: third constant [Pa], which acts at small strain.
    """

    law: Literal["carroll"] = Field(default="carroll", examples=['"carroll"'])
    A: Annotated[float, Constant(positive=True)] = Field(examples=['"0.15 MPa"'])
    B: Annotated[float, Constant(positive=True, degree=(4, 0))] = Field(examples=['"0.3 Pa"'])
    C: Annotated[float, Constant(positive=True, degree=(0, 1))] = Field(examples=['"95 kPa"'])

    compared: ClassVar[tuple[int, ...]] = (1,)
