"""A digest of what decides a compiled program: equal contents, and nothing else, agree."""

import contextlib
import dataclasses
import enum
import functools
import hashlib
import importlib.util
import struct
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

PACKAGES = ("suas_jax", "fitting")
"""Packages whose source code is part of every key, so that a name stands for its content."""
# Libraries whose version is part of every key; see `program_store`.
LIBRARIES = ("jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix", "builtins")


class Keyed:
    """A static argument of a program that is compared by its key alone."""

    key: Any  # what decides the compiled program; hashable, and of plain values

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and self.key == other.key


class NoContentKeyError(ValueError):
    """A value's content can't be told: a closure, or an object of an unknown kind."""


def content_key(value: Any) -> str:
    """Digest of a value, the same in every process.

    It may consist of plain values, NumPy arrays, containers, data classes and modules of them,
    and functions and classes that their module knows by name. Raises NoContentKeyError: part of
    it can't be told from its content.
    """
    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(struct.pack("<q", len(part)))
        digest.update(part)
    return digest.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """A value as a sequence of bytes that no other value has."""
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        yield f"{type(value).__name__} {value!r}".encode()
    elif isinstance(value, enum.Enum):
        yield f"enum {named(type(value))}.{value.name}".encode()
    elif isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise NoContentKeyError(f"an array of {array.dtype}")
        yield f"array {array.dtype.str} {array.shape}".encode()
        yield array.tobytes()
    elif isinstance(value, np.dtype):
        yield f"dtype {value.str}".encode()
    elif isinstance(value, Keyed):
        yield f"keyed {named(type(value))}".encode()
        yield from _parts(value.key)
    elif isinstance(value, list | tuple):
        yield f"sequence {named(type(value))} {len(value)}".encode()
        for item in value:
            yield from _parts(item)
    elif isinstance(value, Mapping):
        yield f"mapping {named(type(value))} {len(value)}".encode()
        for key in sorted(value, key=lambda k: (type(k).__name__, repr(k))):
            yield from _parts(key)
            yield from _parts(value[key])
    elif isinstance(value, set | frozenset):
        yield f"set {len(value)}".encode()
        yield from sorted(content_key(item).encode() for item in value)
    elif hasattr(value, "__wrapped__"):  # a jitted function: known by name, or by what it wraps
        with contextlib.suppress(NoContentKeyError):
            value = named(value)
        yield from _parts(getattr(value, "__wrapped__", value))
    elif isinstance(value, functools.partial):
        yield b"partial"
        yield from _parts((value.func, value.args, value.keywords))
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield f"data {named(type(value))}".encode()
        for field in dataclasses.fields(value):
            yield f"field {field.name}".encode()
            # A module under construction may lack a field.
            yield from _parts(getattr(value, field.name, None))
    elif isinstance(value, type) or callable(value):
        yield f"named {named(value)}".encode()
    else:
        raise NoContentKeyError(f"a {type(value).__name__}")


def named(thing: Callable[..., Any] | type) -> str:
    """The name by which a function or class is found again.

    Raises NoContentKeyError: its name leads elsewhere (a lambda, a closure), or to code that is
    not part of the key.
    """
    module = getattr(thing, "__module__", None) or ""
    name = getattr(thing, "__qualname__", "")
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    if found is not thing:
        raise NoContentKeyError(f"{module}.{name}: its name leads elsewhere")
    if module.split(".")[0] not in (*PACKAGES, *LIBRARIES):
        raise NoContentKeyError(f"{module}: its source code is not part of the key")
    return f"{module}:{name}"


@functools.cache
def source_digest() -> str:
    """Digest of the source code of `PACKAGES`."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        found = importlib.util.find_spec(package)
        for folder in found.submodule_search_locations or () if found else ():
            for source in sorted(Path(folder).rglob("*.py")):
                digest.update(source.read_bytes())
    return digest.hexdigest()
