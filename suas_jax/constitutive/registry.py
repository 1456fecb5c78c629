"""Material laws by name, and from a [material] table to a law."""

from collections.abc import Callable
from typing import Any

from jaxtyping import Array

from suas_jax.config.law import LawSpec
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.runtime.registry import model_classes

LAWS: dict[str, type[AbstractLaw]] = model_classes(
    "suas_jax.constitutive.laws",
    AbstractLaw,  # type: ignore[type-abstract]
)
"""The laws by name, one for each file of `suas_jax.constitutive.laws`."""


def build_law(
    material: LawSpec, value: Callable[[str], Array | float] | None = None
) -> AbstractLaw:
    """Build the law of a [material] table.

    `material`: says which law. `value`: its constants by their paths in [material], such as
    ``C1`` or ``mu.0``; None takes the table's own.
    Returns the elastic law; the instantaneous one where the table's `response` says so.
    """
    found = value or _own(material)
    if material.response == "instantaneous":
        found = _instantaneous(material, found)
    return LAWS[material.law].of_material(material, found)


def _own(material: LawSpec) -> Callable[[str], float]:
    def value(path: str) -> float:
        found: Any = material
        for key in path.split("."):
            found = found[int(key)] if isinstance(found, tuple) else getattr(found, key)
        return float(found)

    return value


def _instantaneous(
    material: LawSpec, value: Callable[[str], Array | float]
) -> Callable[[str], Array | float]:
    """Stress constants over the long-term share: the energy of every law is linear in them."""
    assert material.relaxation is not None
    terms = range(len(material.relaxation.g))
    share = 1.0 - sum(value(f"relaxation.g.{i}") for i in terms)

    def scaled(path: str) -> Array | float:
        return value(path) / share if material.unit(path) == "Pa" else value(path)

    return scaled
