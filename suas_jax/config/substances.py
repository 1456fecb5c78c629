"""How much what skins are made of grows with warmth and yields to pressure, by name.

A key that holds an expansion or a bulk modulus may hold one of these names instead: a typical
figure of handbooks and suppliers, with the standard deviation that grade, filler and
temperature leave open. Measure yours where it matters: 0.1 % of the oil's volume moves the
force by 4 % (docs/prestress.md).

Rubbers: expansion of unfilled EPDM and silicone vulcanisates, less with filler; bulk moduli of
1.5 to 2.5 GPa. Oils, by volume: polydimethylsiloxane of 50 cSt and more 9.2 to 10.4e-4, its
bulk modulus from a speed of sound of 980 m/s; mineral (transformer) oil 7 to 8e-4 and 1.4 to
1.8 GPa. Printed plastics as data sheets state them at room temperature (ISO 11359-2), bulk
moduli from Young's modulus and a Poisson's ratio of 0.35 to 0.4; across the layers they
differ. Aluminium: wrought alloys.
"""

import functools
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import ValidationInfo

from suas_jax.config.fields import Quantity, quantity
from suas_jax.config.tolerance import TypicalQuantity

Kind = Literal["rubber", "oil", "solid"]


class Substance(NamedTuple):
    """A substance: values and standard deviations."""

    kind: Kind  # where it may be named
    expansion: tuple[float, float]  # per kelvin, of lengths; of an oil by volume [1/K]
    bulk_modulus: tuple[float, float]  # [Pa]


SUBSTANCES = {
    "EPDM": Substance("rubber", (1.6e-4, 0.3e-4), (2.0e9, 0.3e9)),
    "silicone": Substance("rubber", (2.7e-4, 0.4e-4), (1.5e9, 0.3e9)),
    "silicone-oil": Substance("oil", (9.6e-4, 0.3e-4), (0.95e9, 0.1e9)),
    "mineral-oil": Substance("oil", (7.5e-4, 0.4e-4), (1.6e9, 0.2e9)),
    "PLA": Substance("solid", (7.0e-5, 1.0e-5), (4.0e9, 1.0e9)),
    "PETG": Substance("solid", (6.5e-5, 1.0e-5), (3.0e9, 0.8e9)),
    "ABS": Substance("solid", (9.0e-5, 1.5e-5), (3.0e9, 0.8e9)),
    "PA12": Substance("solid", (1.1e-4, 0.2e-4), (2.5e9, 0.7e9)),
    "resin": Substance("solid", (9.0e-5, 2.5e-5), (3.5e9, 1.0e9)),
    "aluminium": Substance("solid", (2.3e-5, 0.1e-5), (7.0e10, 0.3e10)),
}
"""By name: rubbers, oils, and what walls are made of."""


def _value(kind: Kind, key: str, own: Quantity, value: Any, info: ValidationInfo) -> float:
    """A quantity as it is written, or that of a substance."""
    if isinstance(value, str) and value.strip()[:1].isalpha():
        named = {name: x for name, x in SUBSTANCES.items() if x.kind == kind}
        if value in named:
            return TypicalQuantity(*getattr(named[value], key))
        names = ", ".join(f'"{name}"' for name in named)
        raise ValueError(f"unknown substance; give a value with its unit, or one of {names}")
    number: float = own.func(value, info)  # type: ignore[call-arg]
    return number


def _named(kind: Kind, key: Literal["expansion", "bulk_modulus"]) -> Quantity:
    own = quantity("expansion") if key == "expansion" else quantity("pressure", above=0.0)
    check = functools.partial(_value, kind, key, own)
    return Quantity(check, dimension=own.dimension, rules=own.rules)


RubberExpansion = Annotated[float, _named("rubber", "expansion")]
RubberBulkModulus = Annotated[float, _named("rubber", "bulk_modulus")]
OilExpansion = Annotated[float, _named("oil", "expansion")]
OilBulkModulus = Annotated[float, _named("oil", "bulk_modulus")]
WallExpansion = Annotated[float, _named("solid", "expansion")]
WallBulkModulus = Annotated[float, _named("solid", "bulk_modulus")]
