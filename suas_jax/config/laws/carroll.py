"""Carroll's law: its constants."""

from typing import Annotated, ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.law import Constant, LawSpec


class CarrollSpec(LawSpec):
    """Carroll law, Psi = A (I1 - 3) + B (I1^4 - 81) + C (sqrt(I2) - sqrt(3)).

    Attributes:
        A: first constant [Pa]; 2 A + 216 B + C/sqrt(3) is the shear modulus of small strain.
        B: second constant [Pa], which stiffens at large strain.
        C: third constant [Pa], which acts at small strain.
    """

    law: Literal["carroll"] = file_key('"carroll"', "carroll")
    A: Annotated[float, Constant(positive=True)] = file_key('"0.15 MPa"')
    B: Annotated[float, Constant(positive=True, degree=(4, 0))] = file_key('"0.3 Pa"')
    C: Annotated[float, Constant(positive=True, degree=(0, 1))] = file_key('"95 kPa"')

    compared: ClassVar[tuple[int, ...]] = (1,)
