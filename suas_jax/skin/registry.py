"""Oil models by name, and from an [oil] table to a model."""

from collections.abc import Callable

from jaxtyping import Array

from suas_jax.config.oil import OilSpec
from suas_jax.runtime.registry import model_classes
from suas_jax.skin.oil import AbstractOil

OILS: dict[str, type[AbstractOil]] = model_classes(
    "suas_jax.skin.oils",
    AbstractOil,  # type: ignore[type-abstract]
)
"""The models by name, one for each file of `suas_jax.skin.oils`."""


def build_oil(oil: OilSpec, value: Callable[[str], Array]) -> AbstractOil:
    """Build the model of an [oil] table.

    Args:
        oil: says which model.
        value: its constants by their keys, with a lane axis.
    """
    keys = type(oil).model_fields.keys() - OilSpec.model_fields.keys()
    return OILS[oil.model](**{key: value(key) for key in sorted(keys)})
