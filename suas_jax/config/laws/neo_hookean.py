"""The neo-Hookean law: its constant."""

from typing import Annotated, ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.law import Constant, LawSpec


class NeoHookeanSpec(LawSpec):
    """Neo-Hookean law, Psi = mu/2 (I1 - 3).

    Attributes:
        mu: shear modulus [Pa].
    """

    law: Literal["neo-hookean"] = file_key('"neo-hookean"', "neo-hookean")
    mu: Annotated[float, Constant(positive=True)] = file_key('"32.6 MPa"')

    compared: ClassVar[tuple[int, ...]] = (1,)

    def coefficients(self) -> dict[tuple[int, int], float]:
        """mu/2 of I1 - 3."""
        return {(1, 0): 0.5 * self.mu}
