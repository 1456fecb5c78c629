"""The van der Waals law: its constants."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator

from suas_jax.config.law import Constant, LawSpec


class VanDerWaalsSpec(LawSpec):
    """Van der Waals law of a network of limited stretch whose chains attract each other.

    Psi = mu (-L (log(1 - eta) + eta) - 2/3 a (x/2)^(3/2)), with L = lambda_m^2 - 3,
    x = (1 - beta) (I1 - 3) + beta (I2 - 3) and eta = sqrt(x/L).

    Attributes:
        mu: shear modulus of small strain [Pa].
        lambda_m: locking stretch, greater than the root of three.
        a: global interaction of the chains.
        beta: share of the second invariant, usually at most one.
    """

    law: Literal["van-der-waals"] = Field(default="van-der-waals", examples=['"van-der-waals"'])
    mu: Annotated[float, Constant(positive=True)] = Field(examples=['"0.4 MPa"'])
    lambda_m: Annotated[float, Constant("number", positive=True, start=(1.0, 3.0))] = Field(
        examples=["10.0"]
    )
    a: Annotated[float, Constant("number", positive=True, start=(-3.0, 0.0))] = Field(
        examples=["0.25"]
    )
    beta: Annotated[float, Constant("number", positive=True, start=(-4.0, -1.0))] = Field(
        examples=["0.05"]
    )

    compared: ClassVar[tuple[int, ...]] = (1,)

    @field_validator("lambda_m")
    @classmethod
    def _longer_than_at_rest(cls, lambda_m: float) -> float:
        if lambda_m**2 <= 3.0:
            raise ValueError("must be greater than 1.7321, the root of three")
        return lambda_m
