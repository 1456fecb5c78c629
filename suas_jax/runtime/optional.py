"""Libraries that not everybody installs."""

import importlib
from types import ModuleType


def optional(name: str, needed: str, extra: str) -> ModuleType:
    """A library that an extra of this package brings.

    Raises ValueError: it is not installed; `needed` begins the message, as "X files need".
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ValueError(
            f'{needed} {name}, which is not installed: pip install "suas-jax[{extra}]"'
        ) from None
