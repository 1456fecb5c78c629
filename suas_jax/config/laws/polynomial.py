"""The general polynomial law: its constants."""

from typing import Annotated, ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.law import Constant, LawSpec


class PolynomialSpec(LawSpec):
    """General polynomial law, Psi = sum C_ij (I1 - 3)^i (I2 - 3)^j up to the third degree.

    Attributes:
        C10: of (I1 - 3) [Pa]; 2 (C10 + C01) is the shear modulus of small strain.
        C01: of (I2 - 3) [Pa].
        C20: of (I1 - 3)^2 [Pa].
        C11: of (I1 - 3) (I2 - 3) [Pa].
        C02: of (I2 - 3)^2 [Pa].
        C30: of (I1 - 3)^3 [Pa].
        C21: of (I1 - 3)^2 (I2 - 3) [Pa].
        C12: of (I1 - 3) (I2 - 3)^2 [Pa].
        C03: of (I2 - 3)^3 [Pa].
    """

    law: Literal["polynomial"] = file_key('"polynomial"', "polynomial")
    C10: Annotated[float, Constant(degree=(1, 0), since=1)] = file_key('"0.17 MPa"')
    C01: Annotated[float, Constant(degree=(0, 1), since=1)] = file_key('"5 kPa"', 0.0)
    C20: Annotated[float, Constant(degree=(2, 0), since=2)] = file_key('"-1 kPa"', 0.0)
    C11: Annotated[float, Constant(degree=(1, 1), since=2)] = file_key('"0 Pa"', 0.0)
    C02: Annotated[float, Constant(degree=(0, 2), since=2)] = file_key('"0 Pa"', 0.0)
    C30: Annotated[float, Constant(degree=(3, 0), since=3)] = file_key('"40 Pa"', 0.0)
    C21: Annotated[float, Constant(degree=(2, 1), since=3)] = file_key('"0 Pa"', 0.0)
    C12: Annotated[float, Constant(degree=(1, 2), since=3)] = file_key('"0 Pa"', 0.0)
    C03: Annotated[float, Constant(degree=(0, 3), since=3)] = file_key('"0 Pa"', 0.0)

    half_modulus: ClassVar[tuple[str, ...]] = ("C10", "C01")
    usual_terms: ClassVar[int] = 2
    compared: ClassVar[tuple[int, ...]] = (2,)
    is_polynomial: ClassVar[bool] = True
