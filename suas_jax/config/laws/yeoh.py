"""The Yeoh law: its constants."""

from typing import Annotated, ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.law import Constant, LawSpec


class YeohSpec(LawSpec):
    """Yeoh law, Psi = C1 (I1 - 3) + C2 (I1 - 3)^2 + C3 (I1 - 3)^3.

    Attributes:
        C1: first constant [Pa]; 2 C1 is the shear modulus of small strain.
        C2: second constant [Pa].
        C3: third constant [Pa].
    """

    law: Literal["yeoh"] = file_key('"yeoh"', "yeoh")
    C1: Annotated[float, Constant(positive=True)] = file_key('"0.2 MPa"')
    C2: Annotated[float, Constant(degree=(2, 0), since=2)] = file_key('"-2 kPa"', 0.0)
    C3: Annotated[float, Constant(degree=(3, 0), since=3)] = file_key('"50 Pa"', 0.0)

    compared: ClassVar[tuple[int, ...]] = (3,)
    is_polynomial: ClassVar[bool] = True
