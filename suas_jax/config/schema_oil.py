"""Oils: the models that the ``model`` of an [oil] table may name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import Field

from suas_jax.config.oil import OilSpec
from suas_jax.runtime.registry import model_classes

OILS: dict[str, type[OilSpec]] = model_classes("suas_jax.config.oils", OilSpec)
"""The declarations by name, one for each file of `suas_jax.config.oils`."""

if TYPE_CHECKING:
    AnyOilSpec = OilSpec
else:
    AnyOilSpec = Annotated[Union[tuple(OILS.values())], Field(discriminator="model")]  # noqa: UP007
