"""The Ogden law: its constants, in either of the two conventions that circulate."""

from typing import Annotated, ClassVar, Literal

from pydantic import ValidationInfo, field_validator

from suas_jax.config.fields import PlacedError, at_most, file_key
from suas_jax.config.law import Constant, LawSpec

MOST_TERMS = 16
"""Terms that a file may have."""


class OgdenSpec(LawSpec):
    """Ogden law.

    ``"mu/alpha"`` (Eq. 11): Psi = sum mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3),
    shear modulus of small strain 1/2 sum mu_p alpha_p (Eq. 12).
    ``"2mu/alpha^2"``: Psi = sum 2 mu_p/alpha_p^2 (...), shear modulus sum mu_p. A constant of
    the second, times 2/alpha_p, is a constant of the first.

    Attributes:
        mu: constants mu_p [Pa], one for each term.
        alpha: exponents alpha_p, one for each term.
        convention: what the constants mean.
    """

    law: Literal["ogden"] = file_key('"ogden"', "ogden")
    convention: Literal["mu/alpha", "2mu/alpha^2"] = file_key('"mu/alpha"')
    alpha: Annotated[tuple[Annotated[float, Constant("number")], ...], at_most(MOST_TERMS)] = (
        file_key("[1.3, 5.0, -2.0]")
    )
    mu: Annotated[tuple[Annotated[float, Constant()], ...], at_most(MOST_TERMS)] = file_key(
        '["0.63 MPa", "1.2 kPa", "-10 kPa"]'
    )

    usual_terms: ClassVar[int] = 3
    compared: ClassVar[tuple[int, ...]] = (1, 2, 3, 4)

    @classmethod
    def most_terms(cls) -> int:
        """Terms of a fit; a file may have more."""
        return 6

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
