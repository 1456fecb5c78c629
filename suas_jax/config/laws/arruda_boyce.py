"""The Arruda-Boyce law: its constants."""

from typing import Annotated, ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.law import Constant, LawSpec


class ArrudaBoyceSpec(LawSpec):
    """Arruda-Boyce law, Psi = mu sum C_i lambda_m^(2 - 2i) (I1^i - 3^i), five terms.

    Attributes:
        mu: rubbery modulus [Pa]; the shear modulus of small strain is larger.
        lambda_m: locking stretch of a chain.
    """

    law: Literal["arruda-boyce"] = file_key('"arruda-boyce"', "arruda-boyce")
    mu: Annotated[float, Constant(positive=True)] = file_key('"0.28 MPa"')
    lambda_m: Annotated[float, Constant("number", positive=True, start=(0.2, 3.0))] = file_key(
        "5.1"
    )

    compared: ClassVar[tuple[int, ...]] = (1,)
