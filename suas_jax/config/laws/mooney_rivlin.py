"""The Mooney-Rivlin law: its constants."""

from typing import Annotated, ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.law import Constant, LawSpec


class MooneyRivlinSpec(LawSpec):
    """Mooney-Rivlin law of Eq. 23, Psi = C1 (I1 - 3) + C2 (I2 - 3) + C3 (I2 - 3)^2.

    Attributes:
        C1: first constant [Pa].
        C2: second constant [Pa]; 2 (C1 + C2) is the shear modulus of small strain.
        C3: third constant [Pa].
    """

    law: Literal["mooney-rivlin"] = file_key('"mooney-rivlin"', "mooney-rivlin")
    C1: Annotated[float, Constant()] = file_key('"20.7 MPa"')
    C2: Annotated[float, Constant(degree=(0, 1), since=2)] = file_key('"-4.4 MPa"', 0.0)
    C3: Annotated[float, Constant(degree=(0, 2), since=3)] = file_key('"77 kPa"', 0.0)

    half_modulus: ClassVar[tuple[str, ...]] = ("C1", "C2")
    compared: ClassVar[tuple[int, ...]] = (2, 3)
    is_polynomial: ClassVar[bool] = True
