"""The Gent law: its constants."""

from typing import Annotated, ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.law import Constant, LawSpec


class GentSpec(LawSpec):
    """Gent law, Psi = -mu Jm/2 log(1 - (I1 - 3)/Jm).

    Attributes:
        mu: shear modulus [Pa].
        Jm: value of I1 - 3 at which the chains are fully stretched.
    """

    law: Literal["gent"] = file_key('"gent"', "gent")
    mu: Annotated[float, Constant(positive=True)] = file_key('"0.4 MPa"')
    Jm: Annotated[
        float, Constant("number", positive=True, limits_i1=True, start=(-4.0, 2.0))
    ] = file_key("80.0")

    compared: ClassVar[tuple[int, ...]] = (1,)
