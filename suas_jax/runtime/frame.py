"""What a compiled program returns besides its arrays, as JSON.

A frame says what the arrays are parts of: dictionaries, named tuples and modules of this
project, with fixed numbers and words. Reading it makes such containers and nothing else.
"""

import dataclasses
import importlib
from collections.abc import Callable, Iterator
from typing import Any

import jax
from jaxtyping import Array

from suas_jax.runtime.content_key import PACKAGES, NoContentKeyError, named


class Hole:
    """Stands for an array in what a program returns."""


def count_holes(frame: Any) -> int:
    """Number of arrays that a frame has room for."""
    return sum(isinstance(x, Hole) for x in jax.tree.leaves(frame))


def filled_by(call: Callable[..., Any], frame: Any) -> Callable[..., Any]:
    """The program that puts the arrays of a call in the places of the `Hole`s of a frame."""
    leaves, structure = jax.tree.flatten(frame)

    def filled(*arrays: Array) -> Any:
        found = iter(call(*arrays))
        results = [next(found) if isinstance(x, Hole) else x for x in leaves]
        return jax.tree.unflatten(structure, results)

    return filled


def frame_to_json(frame: Any) -> Any:
    """A frame as a tree that `json.dumps` takes.

    Raises NoContentKeyError: it holds something that could not be made again.
    """
    if frame is None or isinstance(frame, bool | int | float | str):
        return {"value": frame}
    if isinstance(frame, Hole):
        return "array"
    if isinstance(frame, dict) and all(isinstance(key, str) for key in frame):
        return {"dict": {key: frame_to_json(value) for key, value in frame.items()}}
    kind = type(frame)
    if kind in (list, tuple):
        return {kind.__name__: [frame_to_json(item) for item in frame]}
    if _is_ours(kind) and isinstance(frame, tuple) and hasattr(kind, "_fields"):
        return {"named": named(kind), "fields": [frame_to_json(item) for item in frame]}
    if _is_ours(kind) and dataclasses.is_dataclass(frame):
        fields = {f.name: getattr(frame, f.name) for f in dataclasses.fields(frame)}
        items = {name: frame_to_json(value) for name, value in fields.items()}
        return {"module": named(kind), "fields": items}
    raise NoContentKeyError(f"a program that returns a {kind.__name__}")


def frame_from_json(tree: Any) -> Any:
    """The frame that `frame_to_json` wrote. Raises ValueError: it is none."""
    match tree:
        case "array":
            return Hole()
        case {"value": value}:
            return value
        case {"dict": items}:
            return {key: frame_from_json(value) for key, value in items.items()}
        case {"list": items}:
            return list(_all(items))
        case {"tuple": items}:
            return tuple(_all(items))
        case {"named": name, "fields": items}:
            kind = _class(name)
            if not issubclass(kind, tuple):
                raise ValueError(f"{name} is not a named tuple")
            return tuple.__new__(kind, tuple(_all(items)))
        case {"module": name, "fields": items}:
            kind = _class(name)
            if not dataclasses.is_dataclass(kind):
                raise ValueError(f"{name} has no fields")
            made = object.__new__(kind)
            for key, value in items.items():
                object.__setattr__(made, key, frame_from_json(value))
            return made
    raise ValueError("no frame of a program")


def _all(items: list[Any]) -> Iterator[Any]:
    return (frame_from_json(item) for item in items)


def _is_ours(kind: type) -> bool:
    return kind.__module__.split(".")[0] in PACKAGES


def _class(name: str) -> type:
    """A class of this project by module and name."""
    module, _, path = name.partition(":")
    if module.split(".")[0] not in PACKAGES:
        raise ValueError(f"{name}: is not a class of this project")
    found: Any = importlib.import_module(module)
    for part in path.split("."):
        found = getattr(found, part, None)
    if not isinstance(found, type) or found.__module__ != module:
        raise ValueError(f"{name}: is not a class of this project")
    return found
