"""What cards of materials are made of: the law in the card's units, its terms, and settings."""

import dataclasses
import functools
import re
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

    units: str = "SI"  # or "mm-N-MPa"
    name: str = "membrane"  # of the material
    density: float | None = None  # [kg/m³]; None leaves it to the user where none is needed
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
        for option, size, unit in (
            ("--density", self.density, ""),
            ("--bulk-modulus", self.bulk_modulus, " Pa"),
        ):
            if size is not None and not size > 0.0:
                raise CardError(f"{option} {size}{unit}: must be greater than zero")


@dataclasses.dataclass(frozen=True)
class Material:
    """A law and what its card says beside it, in the units of the card."""

    law: LawSpec
    program: str
    settings: CardSettings

    @property
    def name(self) -> str:
        """Of the material."""
        return self.settings.name

    @property
    def unit(self) -> str:
        """Unit of stress."""
        return UNITS[self.settings.units][0]

    @property
    def density(self) -> float | None:
        """Density, if it is known."""
        known = self.settings.density
        return None if known is None else known * UNITS[self.settings.units][2]

    @property
    def bulk(self) -> float | None:
        """Bulk modulus, if it is known."""
        known = self.settings.bulk_modulus
        return None if known is None else known * UNITS[self.settings.units][1]

    @property
    def compressibility(self) -> float:
        """2/K: D1 of Abaqus, d of ANSYS; zero if incompressible."""
        return 0.0 if self.bulk is None else 2.0 / self.bulk

    @property
    def demanded_bulk(self) -> float:
        """The bulk modulus, or the usual one where a program demands one."""
        return BULK * self.shear_modulus if self.bulk is None else self.bulk

    @functools.cached_property
    def shear_modulus(self) -> float:
        """Long-term shear modulus at small strain."""
        law = self.law.model_copy(update={"response": "long-term"})
        return float(build_law(law).shear_modulus)

    @property
    def ogden(self) -> list[tuple[float, float]] | None:
        """mu_p and alpha_p by term, in the mu/alpha convention; None for other laws."""
        if not isinstance(self.law, OgdenSpec):
            return None
        pairs = list(zip(self.law.mu, self.law.alpha, strict=True))
        if self.law.convention == "mu/alpha":
            return pairs
        return [(2.0 * mu / alpha, alpha) for mu, alpha in pairs]

    def at_most(self, most: int) -> list[tuple[float, float]] | None:
        """The terms of Ogden's law where a program takes no more; None for other laws."""
        if self.ogden is not None and len(self.ogden) > most:
            raise self.missing(f"Ogden with at most {most} terms")
        return self.ogden

    def coefficients(self, offered: str) -> dict[tuple[int, int], float]:
        """Coefficients of a polynomial law; other laws are refused, with those `offered`."""
        found = self.law.coefficients()
        if found is None:
            raise self.missing(offered)
        return dict(found)

    def polynomial(self, offered: str) -> tuple[int, list[float]]:
        """Degree of a polynomial law, and C10, C01, C20, C11, C02, ..., Abaqus' order."""
        found = self.coefficients(offered)
        degree = degree_of(found)
        order = [(n - j, j) for n in range(1, degree + 1) for j in range(n + 1)]
        return degree, [found.get(place, 0.0) for place in order]

    @property
    def prony(self) -> list[tuple[float, float]]:
        """Shares and times of the relaxation; empty without."""
        series = self.law.relaxation
        return [] if series is None else list(zip(series.g, series.tau, strict=True))

    @property
    def long_term_share(self) -> float:
        """Of the modulus; one without relaxation."""
        return 1.0 if self.law.relaxation is None else self.law.relaxation.long_term_share

    @property
    def mullins(self) -> list[float]:
        """r, m and beta of the softening; empty without."""
        part = self.law.softening
        return [] if part is None else [part.r, part.m, part.beta]

    def instantaneous(self) -> "Material":
        """The material under a load that is faster than all relaxation."""
        law = in_units(
            self.law.model_copy(update={"softening": None}), 1 / self.long_term_share
        )
        return dataclasses.replace(self, law=law)

    def missing(self, offered: str) -> CardError:
        """The refusal of a law that a program doesn't have."""
        return CardError(
            f"--export {self.program}: no card for the law {self.law.law}; {self.program} is "
            f"offered for {offered}"
        )


def in_units(law: LawSpec, pascal: float) -> LawSpec:
    """The law with its stresses in another unit, of which a pascal is `pascal`."""

    def converted(value: Any) -> Any:
        return tuple(map(converted, value)) if isinstance(value, tuple) else value * pascal

    changes = {
        key: converted(getattr(law, key))
        for key, constant in law.declared().items()
        if key in law.model_fields_set and constant.unit == "Pa"
    }
    if law.softening is not None:
        changes["softening"] = law.softening.model_copy(update={"m": law.softening.m * pascal})
    return law.model_copy(update=changes)


def degree_of(coefficients: dict[tuple[int, int], float]) -> int:
    """Degree of a polynomial law."""
    return max(i + j for i, j in coefficients)
