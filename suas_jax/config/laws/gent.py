"""The Gent law: its constants."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from suas_jax.config.law import Constant, LawSpec


class GentSpec(LawSpec):
    """Gent law, Psi = -mu Jm/2 log(1 - (I1 - 3)/Jm).

    Attributes:
        mu: shear modulus [Pa].
        Jm: value of I1 - 3 at which the chains are fully stretched.
    """

    law: Literal["gent"] = Field(default="gent", examples=['"gent"'])
    mu: Annotated[float, Constant(positive=True)] = Field(examples=['"0.4 MPa"'])
    Jm: Annotated[
        float, Constant("number", positive=True, limits_i1=True, start=(-4.0, 2.0))
    ] = Field(examples=["80.0"])

    compared: ClassVar[tuple[int, ...]] = (1,)
