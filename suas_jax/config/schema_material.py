"""Materials: which law, and its constants.

The discriminating key is ``law``. Constants are stored in pascals, pure numbers as they are.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from suas_jax.config.fields import (
    AsList,
    Number,
    PlacedError,
    PositiveNumber,
    PositiveStress,
    Spec,
    Stress,
)
from suas_jax.config.quantities import format_quantity


class NeoHookeanSpec(Spec):
    """Neo-Hookean law, Psi = mu/2 (I1 - 3).

    Attributes:
        mu: shear modulus [Pa].
    """

    law: Literal["neo-hookean"] = Field(default="neo-hookean", examples=['"neo-hookean"'])
    mu: PositiveStress = Field(examples=['"32.6 MPa"'])


class MooneyRivlinSpec(Spec):
    """Mooney-Rivlin law of Eq. 23, Psi = C1 (I1 - 3) + C2 (I2 - 3) + C3 (I2 - 3)^2.

    Attributes:
        C1: first constant [Pa].
        C2: second constant [Pa]; 2 (C1 + C2) is the shear modulus of small strain.
        C3: third constant [Pa].
    """

    law: Literal["mooney-rivlin"] = Field(default="mooney-rivlin", examples=['"mooney-rivlin"'])
    C1: Stress = Field(examples=['"20.7 MPa"'])
    C2: Stress = Field(default=0.0, examples=['"-4.4 MPa"'])
    C3: Stress = Field(default=0.0, examples=['"77 kPa"'])

    @model_validator(mode="after")
    def _stiff_at_small_strain(self) -> Self:
        if self.C1 + self.C2 <= 0.0:
            raise PlacedError(
                "C2" if "C2" in self.model_fields_set else "C1",
                f"C1 + C2, half the shear modulus of small strain, must be greater than zero, "
                f"but C1 is {format_quantity(self.C1, 'stress')} and C2 is "
                f"{format_quantity(self.C2, 'stress')}",
            )
        return self


class YeohSpec(Spec):
    """Yeoh law, Psi = C1 (I1 - 3) + C2 (I1 - 3)^2 + C3 (I1 - 3)^3.

    Attributes:
        C1: first constant [Pa]; 2 C1 is the shear modulus of small strain.
        C2: second constant [Pa].
        C3: third constant [Pa].
    """

    law: Literal["yeoh"] = Field(default="yeoh", examples=['"yeoh"'])
    C1: PositiveStress = Field(examples=['"0.2 MPa"'])
    C2: Stress = Field(default=0.0, examples=['"-2 kPa"'])
    C3: Stress = Field(default=0.0, examples=['"50 Pa"'])


class OgdenSpec(Spec):
    """Ogden law, in either of the two conventions that circulate.

    ``"mu/alpha"`` (Eq. 11): Psi = sum mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3),
    shear modulus of small strain 1/2 sum mu_p alpha_p (Eq. 12).
    ``"2mu/alpha^2"``: Psi = sum 2 mu_p/alpha_p^2 (...), shear modulus sum mu_p. A constant of
    the second, times 2/alpha_p, is a constant of the first.

    Attributes:
        mu: constants mu_p [Pa], one for each term.
        alpha: exponents alpha_p, one for each term.
        convention: what the constants mean.
    """

    law: Literal["ogden"] = Field(default="ogden", examples=['"ogden"'])
    convention: Literal["mu/alpha", "2mu/alpha^2"] = Field(examples=['"mu/alpha"'])
    alpha: Annotated[tuple[Number, ...], AsList] = Field(examples=["[1.3, 5.0, -2.0]"])
    mu: Annotated[tuple[Stress, ...], AsList] = Field(
        examples=['["0.63 MPa", "1.2 kPa", "-10 kPa"]']
    )

    @field_validator("alpha")
    @classmethod
    def _nonzero_exponents(cls, alpha: tuple[float, ...]) -> tuple[float, ...]:
        if not alpha:
            raise ValueError("at least one term is needed")
        if 0.0 in alpha:
            raise PlacedError(alpha.index(0.0), "exponents must not be zero")
        return alpha

    @field_validator("mu")
    @classmethod
    def _stiffening_terms(
        cls, mu: tuple[float, ...], info: ValidationInfo
    ) -> tuple[float, ...]:
        alpha = info.data.get("alpha")
        convention = info.data.get("convention")
        if alpha is None:
            return mu
        if len(mu) != len(alpha):
            raise ValueError(
                f"mu and alpha must have one entry for each term, but mu has {len(mu)} and "
                f"alpha has {len(alpha)}"
            )
        # Each term must add to the stiffness (Eq. 12). In the second convention mu alpha of
        # the first is 2 mu, whatever the sign of alpha.
        for term, (modulus, exponent) in enumerate(zip(mu, alpha, strict=True)):
            if convention == "mu/alpha" and modulus * exponent <= 0.0:
                raise PlacedError(
                    term,
                    f"mu * alpha must be greater than zero in each term (Eq. 12), but alpha is "
                    f"{exponent:g}",
                )
            if convention == "2mu/alpha^2" and modulus <= 0.0:
                raise PlacedError(
                    term, "must be greater than zero in the 2mu/alpha^2 convention"
                )
        return mu


class GentSpec(Spec):
    """Gent law, Psi = -mu Jm/2 log(1 - (I1 - 3)/Jm).

    Attributes:
        mu: shear modulus [Pa].
        Jm: value of I1 - 3 at which the chains are fully stretched.
    """

    law: Literal["gent"] = Field(default="gent", examples=['"gent"'])
    mu: PositiveStress = Field(examples=['"0.4 MPa"'])
    Jm: PositiveNumber = Field(examples=["80.0"])


class ArrudaBoyceSpec(Spec):
    """Arruda-Boyce law, Psi = mu sum C_i lambda_m^(2 - 2i) (I1^i - 3^i), five terms.

    Attributes:
        mu: rubbery modulus [Pa]; the shear modulus of small strain is larger.
        lambda_m: locking stretch of a chain.
    """

    law: Literal["arruda-boyce"] = Field(default="arruda-boyce", examples=['"arruda-boyce"'])
    mu: PositiveStress = Field(examples=['"0.28 MPa"'])
    lambda_m: PositiveNumber = Field(examples=["5.1"])


class PolynomialSpec(Spec):
    """General polynomial law, Psi = sum C_ij (I1 - 3)^i (I2 - 3)^j up to the third degree.

    Attributes:
        C10: ..., each constant C_ij [Pa]; 2 (C10 + C01) is the shear modulus of small strain.
    """

    law: Literal["polynomial"] = Field(default="polynomial", examples=['"polynomial"'])
    C10: Stress = Field(examples=['"0.17 MPa"'])
    C01: Stress = Field(default=0.0, examples=['"5 kPa"'])
    C20: Stress = Field(default=0.0, examples=['"-1 kPa"'])
    C11: Stress = Field(default=0.0, examples=['"0 Pa"'])
    C02: Stress = Field(default=0.0, examples=['"0 Pa"'])
    C30: Stress = Field(default=0.0, examples=['"40 Pa"'])
    C21: Stress = Field(default=0.0, examples=['"0 Pa"'])
    C12: Stress = Field(default=0.0, examples=['"0 Pa"'])
    C03: Stress = Field(default=0.0, examples=['"0 Pa"'])

    @model_validator(mode="after")
    def _stiff_at_small_strain(self) -> Self:
        if self.C10 + self.C01 <= 0.0:
            raise PlacedError(
                "C01" if "C01" in self.model_fields_set else "C10",
                "C10 + C01, half the shear modulus of small strain, must be greater than zero",
            )
        return self


AnyMaterialSpec = (
    NeoHookeanSpec
    | MooneyRivlinSpec
    | YeohSpec
    | OgdenSpec
    | GentSpec
    | ArrudaBoyceSpec
    | PolynomialSpec
)
MaterialSpec = Annotated[AnyMaterialSpec, Field(discriminator="law")]

LAWS: dict[str, type[AnyMaterialSpec]] = {
    "neo-hookean": NeoHookeanSpec,
    "mooney-rivlin": MooneyRivlinSpec,
    "yeoh": YeohSpec,
    "ogden": OgdenSpec,
    "gent": GentSpec,
    "arruda-boyce": ArrudaBoyceSpec,
    "polynomial": PolynomialSpec,
}
