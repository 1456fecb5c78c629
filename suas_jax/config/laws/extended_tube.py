"""The extended tube law: its constants."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from suas_jax.config.law import Constant, LawSpec


class ExtendedTubeSpec(LawSpec):
    """Extended tube law: a crosslinked part of limited stretch and a confining tube.

    Psi = Gc/2 ((1 - d^2) x/(1 - d^2 x) + log(1 - d^2 x)) + 2 Ge/beta^2 sum(l^-beta - 1), with
    x = I1 - 3 and d = delta.

    Attributes:
        Gc: modulus of the crosslinks [Pa]; Gc (1 - 2 delta^2) + Ge is the shear modulus of
            small strain.
        Ge: modulus of the confining tube [Pa].
        delta: inextensibility: 1/delta^2 is the largest I1 - 3.
        beta: release of the confinement with deformation, usually at most one.
    """

    law: Literal["extended-tube"] = Field(default="extended-tube", examples=['"extended-tube"'])
    Gc: Annotated[float, Constant(positive=True)] = Field(examples=['"0.19 MPa"'])
    Ge: Annotated[float, Constant(positive=True, degree=(0, 1))] = Field(examples=['"0.2 MPa"'])
    delta: Annotated[float, Constant("number", positive=True, start=(-5.0, -2.0))] = Field(
        examples=["0.09"]
    )
    beta: Annotated[float, Constant("number", positive=True, start=(-2.0, 0.5))] = Field(
        examples=["0.2"]
    )

    compared: ClassVar[tuple[int, ...]] = (1,)
