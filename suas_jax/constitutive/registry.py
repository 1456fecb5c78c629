"""Material laws by name, and from a [material] table to a law."""

from collections.abc import Callable

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

    Args:
        material: says which law.
        value: its constants by their paths in [material], such as ``C1`` or ``mu.0``; None
            takes the table's own.
    """
    return LAWS[material.law].of_material(material, value or _own(material))


def _own(material: LawSpec) -> Callable[[str], float]:
    def value(path: str) -> float:
        key, _, index = path.partition(".")
        found = getattr(material, key)
        return float(found[int(index)] if index else found)

    return value
