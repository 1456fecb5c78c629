"""Settings of material cards: units, name, density; and the terms of polynomial laws."""

import dataclasses
import re
from collections.abc import Mapping
from typing import Any

from suas_jax.config.law import LawSpec
from suas_jax.config.laws.ogden import OgdenSpec
from suas_jax.constitutive import build_law

BULK = 1e4
"""Bulk modulus of a card, in shear moduli, where a program demands one."""
UNITS = {"SI": ("Pa", 1.0, 1.0), "mm-N-MPa": ("MPa", 1e-6, 1e-12)}
"""Systems of units: unit of stress, what a pascal and what 1 kg/m³ are in them."""


class CardError(ValueError):
    """A program has no such law, or is not known."""


@dataclasses.dataclass(frozen=True)
class CardSettings:
    """What a card says beside the law."""

    units: str = "SI"  # "SI" or "mm-N-MPa"
    name: str = "membrane"  # of the material
    # [kg/m³]; None leaves it to the user where a program needs none
    density: float | None = None
    # [Pa]; None stands for an incompressible material, or `BULK` shear moduli
    bulk_modulus: float | None = None

    def __post_init__(self) -> None:
        if self.units not in UNITS:
            raise CardError(
                f"--card-units {self.units}: unknown units; allowed: {', '.join(UNITS)}"
            )
        if not re.fullmatch(r"[A-Za-z][\w-]{0,39}", self.name):
            raise CardError(
                f'--card-name "{self.name}": letters, digits, "_" and "-" are allowed, 40 at '
                f"most, beginning with a letter"
            )
        if self.density is not None and not self.density > 0.0:
            raise CardError(f"--density {self.density}: must be greater than zero")
        if self.bulk_modulus is not None and not self.bulk_modulus > 0.0:
            raise CardError(f"--bulk-modulus {self.bulk_modulus} Pa: must be greater than zero")

    @property
    def stress(self) -> str:
        """Unit of stress."""
        return UNITS[self.units][0]

    @property
    def density_there(self) -> float | None:
        """Density in the card's units."""
        return None if self.density is None else self.density * UNITS[self.units][2]

    @property
    def bulk_there(self) -> float | None:
        """Bulk modulus in the card's units, if it is known."""
        return None if self.bulk_modulus is None else self.bulk_modulus * UNITS[self.units][1]

    @property
    def compressibility_there(self) -> float:
        """2/K in the card's units: D1 of Abaqus, d of ANSYS; zero if incompressible."""
        return 0.0 if self.bulk_there is None else 2.0 / self.bulk_there

    def bulk_of(self, law: LawSpec) -> float:
        """The bulk modulus, or the usual one where a program demands one; the law's unit."""
        return BULK * shear_modulus(law) if self.bulk_there is None else self.bulk_there

    def bulk_in_words(self) -> str:
        """Where `bulk_of` comes from."""
        if self.bulk_there is None:
            return f"{BULK:g} shear moduli, nearly incompressible"
        return f"{self.bulk_there:.6g} {self.stress}"


def in_units(law: LawSpec, pascal: float) -> LawSpec:
    """The law with its stresses in another unit, of which a pascal is `pascal`."""

    def converted(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(converted(entry) for entry in value)
        return value * pascal

    given = law.model_fields_set
    changes = {
        key: converted(getattr(law, key))
        for key, constant in law.declared().items()
        if key in given and constant.unit == "Pa"
    }
    if law.softening is not None:
        changes["softening"] = law.softening.model_copy(update={"m": law.softening.m * pascal})
    return law.model_copy(update=changes)


def instantaneous(law: LawSpec) -> LawSpec:
    """The law of a load that is faster than all relaxation."""
    share = 1.0 if law.relaxation is None else law.relaxation.long_term_share
    return in_units(law.model_copy(update={"softening": None}), 1.0 / share)


def shear_modulus(law: LawSpec) -> float:
    """Long-term shear modulus at small strain, in the law's unit."""
    return float(build_law(law.model_copy(update={"response": "long-term"})).shear_modulus)


def ogden_terms(law: OgdenSpec) -> list[tuple[float, float]]:
    """mu_p and alpha_p by term, in the mu/alpha convention."""
    pairs = list(zip(law.mu, law.alpha, strict=True))
    if law.convention == "mu/alpha":
        return pairs
    return [(2.0 * mu / alpha, alpha) for mu, alpha in pairs]


def missing(law: LawSpec, program: str, offered: str) -> CardError:
    """The refusal of a law that a program doesn't have."""
    return CardError(
        f"--export {program}: no card for the law {law.law}; {program} is offered for {offered}"
    )


def degree_of(coefficients: Mapping[tuple[int, int], float]) -> int:
    """Degree of a polynomial law."""
    return max(i + j for i, j in coefficients)


def polynomial_terms(coefficients: Mapping[tuple[int, int], float]) -> list[float]:
    """C10, C01, C20, C11, C02, ...: the order of Abaqus, CalculiX and ANSYS."""
    order = [(n - j, j) for n in range(1, degree_of(coefficients) + 1) for j in range(n + 1)]
    return [coefficients.get(place, 0.0) for place in order]
