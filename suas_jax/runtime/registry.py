"""Interchangeable models found by their files: one file a model, and no list to keep.

A model is named after its file: ``laws/arruda_boyce.py`` holds the model ``arruda-boyce``.
"""

import importlib
import pkgutil
from pathlib import Path
from types import ModuleType
from typing import TypeVar

T = TypeVar("T")
_ROOT = Path(__file__).parents[2]


def model_names(package: str) -> list[str]:
    """Names of the models of a package, in alphabetical order. Nothing is imported.

    `package`: dotted name of the folder, such as ``suas_jax.config.laws``.
    """
    folder = _ROOT.joinpath(*package.split("."))
    found = pkgutil.iter_modules([str(folder)])
    return sorted(module.name.replace("_", "-") for module in found)


def model_module(package: str, name: str) -> ModuleType:
    """Import the file of a model, one of `model_names` of the folder."""
    return importlib.import_module(f"{package}.{name.replace('-', '_')}")


def model_classes(package: str, base: type[T]) -> dict[str, type[T]]:
    """Import every model of a package, by name: the one class of each file derived from `base`.

    Raises TypeError: a file defines no such class, or several.
    """
    found = {}
    for name in model_names(package):
        module = model_module(package, name)
        classes = [
            value
            for value in vars(module).values()
            if isinstance(value, type)
            and issubclass(value, base)
            and value.__module__ == module.__name__
        ]
        if len(classes) != 1:
            raise TypeError(f"{module.__name__} must define one {base.__name__}")
        found[name] = classes[0]
    return found
