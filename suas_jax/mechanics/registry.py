"""The models of the membrane, by the name that they have in scenes and reports."""

from suas_jax.mechanics.model import AbstractModel
from suas_jax.mechanics.shell.model import SHELL
from suas_jax.mechanics.solid.model import SOLID

MODELS: dict[str, AbstractModel] = {model.name: model for model in (SHELL, SOLID)}
