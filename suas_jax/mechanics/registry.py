"""The models of the membrane, by dimension and by the name that they have in scenes."""

from suas_jax.mechanics.model import AbstractModel
from suas_jax.mechanics.pad.model import PAD
from suas_jax.mechanics.pad_solid.model import PAD_SOLID
from suas_jax.mechanics.shell.model import SHELL
from suas_jax.mechanics.solid.model import SOLID

MODELS: dict[int, dict[str, AbstractModel]] = {
    dimension: {
        model.name: model
        for model in (SHELL, SOLID, PAD, PAD_SOLID)
        if model.dimension == dimension
    }
    for dimension in (2, 3)
}
"""The cheapest first in each dimension."""
