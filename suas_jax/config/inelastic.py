"""What a material does beside its elastic law: stress relaxation and softening."""

from typing import Annotated, Any

from pydantic import ValidationInfo, field_validator, model_validator

from suas_jax.config.fields import PlacedError, Spec, at_most, file_key, quantity
from suas_jax.config.tolerance import text_of

MOST_RELAXATIONS = 16
"""Terms of a Prony series that a file may have."""


class RelaxationSpec(Spec):
    """Prony series of the stress: G(t)/G(0) = 1 - sum g_i (1 - exp(-t/tau_i)).

    Attributes:
        g: shares of the instantaneous stress that relax; what remains is the long-term share.
        tau: their relaxation times [s].
    """

    g: Annotated[
        tuple[Annotated[float, quantity("number", above=0.0, below=1.0)], ...],
        at_most(MOST_RELAXATIONS),
    ] = file_key("[0.2, 0.1]")
    tau: Annotated[
        tuple[Annotated[float, quantity("time", above=0.0)], ...], at_most(MOST_RELAXATIONS)
    ] = file_key('["0.1 s", "10 s"]')

    def table(self) -> dict[str, Any]:
        """The table of a file, quantities as text with units."""
        g = [text_of(share, 1.0, "") for share in self.g]
        return {"g": g, "tau": [text_of(tau, 1.0, "s") for tau in self.tau]}

    @property
    def long_term_share(self) -> float:
        """Long-term modulus over the instantaneous one, 1 - sum g_i."""
        return 1.0 - sum(self.g)

    @field_validator("g")
    @classmethod
    def _leaves_something(cls, g: tuple[float, ...]) -> tuple[float, ...]:
        if not g:
            raise ValueError("at least one term is needed")
        if sum(g) >= 1.0:
            raise PlacedError(
                len(g) - 1,
                f"the sum of g must be less than 1, so that a long-term modulus remains, but "
                f"it is {sum(g):.6g}",
            )
        return g

    @field_validator("tau")
    @classmethod
    def _one_time_a_share(
        cls, tau: tuple[float, ...], info: ValidationInfo
    ) -> tuple[float, ...]:
        g = info.data.get("g")
        if g is not None and len(g) != len(tau):
            raise ValueError(
                f"g and tau must have one entry for each term, but g has {len(g)} and tau has "
                f"{len(tau)}"
            )
        return tau


class SofteningSpec(Spec):
    """Softening below the largest energy reached before, Mullins (Ogden and Roxburgh 1999).

    The stress is multiplied by 1 - erf((W_max - W)/(m + beta W_max))/r.

    Attributes:
        r: 1/r is the largest share of the stress that is lost.
        m: energy below W_max at which most of it is lost [J/m3], written as a stress.
        beta: how much that energy grows with W_max.
    """

    r: Annotated[float, quantity("number", above=1.0)] = file_key("1.9")
    m: Annotated[float, quantity("stress", at_least=0.0)] = file_key('"50 kPa"')
    beta: Annotated[float, quantity("number", at_least=0.0)] = file_key("0.1")

    def table(self) -> dict[str, Any]:
        """The table of a file, quantities as text with units."""
        numbers = {key: text_of(getattr(self, key), 1.0, "") for key in ("r", "beta")}
        return {"r": numbers["r"], "m": text_of(self.m, 1e6, "MPa"), "beta": numbers["beta"]}

    @model_validator(mode="after")
    def _has_a_width(self) -> "SofteningSpec":
        if self.m == 0.0 and self.beta == 0.0:
            raise PlacedError("m", "m and beta must not both be zero")
        return self
