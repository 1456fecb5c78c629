"""Materials: the laws that the ``law`` of a [material] table may name.

Constants are stored in pascals, pure numbers as they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import Field

from suas_jax.config.law import LawSpec
from suas_jax.runtime.registry import model_classes

LAW_FILES = "suas_jax.config.laws"
LAWS: dict[str, type[LawSpec]] = model_classes(LAW_FILES, LawSpec)
"""The declarations by name, one for each file of `suas_jax.config.laws`."""

if TYPE_CHECKING:
    MaterialSpec = LawSpec
else:
    MaterialSpec = Annotated[Union[tuple(LAWS.values())], Field(discriminator="law")]  # noqa: UP007
