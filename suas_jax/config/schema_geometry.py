"""The dimensions of a skin; the kinds of section are files of `suas_jax.config.sections`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Discriminator, Tag

from suas_jax.config.geometry import GeometrySpec
from suas_jax.runtime.registry import model_classes

SECTIONS: dict[str, type[GeometrySpec]] = model_classes(
    "suas_jax.config.sections", GeometrySpec
)
"""The declarations by name, one for each file of the folder."""

DEFAULT_SECTION = "circle"


def _section(table: Any) -> str:
    given = table.get("section") if isinstance(table, dict) else getattr(table, "section", None)
    return given if isinstance(given, str) else DEFAULT_SECTION


if TYPE_CHECKING:
    AnyGeometrySpec = GeometrySpec
else:
    AnyGeometrySpec = Annotated[
        Union[tuple(Annotated[spec, Tag(name)] for name, spec in SECTIONS.items())],  # noqa: UP007
        Discriminator(_section),
    ]
