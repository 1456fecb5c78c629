"""The page of the configuration files, from the specifications that read them."""

import inspect
import itertools
import re
import types
from collections.abc import Iterator
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from suas_jax.config.fields import Quantity, Spec
from suas_jax.config.law import Constant
from suas_jax.config.oil import FLUIDS
from suas_jax.config.presets import load_preset, preset_names
from suas_jax.config.quantities import DIMENSIONS, format_quantity
from suas_jax.config.validation import CHOICES, TABLES

HEAD = """# Configuration files

A skin and a scene are TOML files. A quantity is text with its unit, such as `"57.5 mm"`; a
key that is not listed here is an error. Paths are relative to the file that names them. A scene
begins with `skin = "FILE"`, the skin file whose tables it takes; tables and keys of the scene
itself win over them. [Files and commands](../scenes.md) has examples.

This page is written from the specifications in `suas_jax.config` when the site is built.
"""

_TABLE_NOTES = {
    "geometry": "required",
    "material": "required",
    "oil": "required",
    "load": "in a scene, any number of them",
    "environment": "in a scene",
    "solve": "in a scene",
}


def page() -> str:
    """The whole page, in MyST Markdown."""
    parts = [HEAD]
    for table, specifications in TABLES.items():
        note = _TABLE_NOTES.get(table, "optional")
        brackets = f"[[{table}]]" if table == "load" else f"[{table}]"
        parts.append(f"## `{brackets}`\n\n{note.capitalize()}.\n")
        if table in CHOICES:
            key, choices = CHOICES[table]
            parts.append(f"The key `{key}` chooses among: {_code_list(choices)}.\n")
        for specification in specifications:
            parts.append(_section(table, specification))
        parts.append({"material": _presets, "oil": _fluids}.get(table, str)())
    parts.append(_units())
    return "\n".join(parts)


def described_keys(specification: type[Spec]) -> dict[str, str]:
    """What the docstrings of a specification say about its keys."""
    found: dict[str, str] = {}
    for ancestor in reversed(specification.__mro__):
        text = inspect.cleandoc(ancestor.__dict__.get("__doc__") or "")
        _, _, attributes = text.partition("Attributes:\n")
        entries = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", attributes, re.MULTILINE)
        found |= {key: " ".join(meaning.split()) for key, meaning in entries}
    return found


def _section(table: str, specification: type[Spec]) -> str:
    """Equation, keys and nested tables of one specification."""
    if table not in CHOICES:
        return _body(specification)
    key = CHOICES[table][0]
    name = specification.model_fields[key].default
    return f'### `{key} = "{name}"`\n\n' + _body(specification, chooser=key)


def _body(specification: type[Spec], chooser: str = "") -> str:
    text = inspect.cleandoc(specification.__doc__ or "").partition("Attributes:")[0].strip()
    lines = ["| key | holds | default | meaning | example |", "|---|---|---|---|---|"]
    meanings = described_keys(specification)
    nested: list[tuple[str, type[Spec]]] = []
    for key, field in specification.model_fields.items():
        if key == chooser:
            continue
        cells = (
            f"`{key}`",
            _holds(field),
            _default(field),
            _markdown(_for_files(meanings.get(key, ""))),
            ", ".join(f"`{example}`" for example in field.examples or ()),
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        nested += [(key, part) for part in specifications_in(field.annotation)]
    if len(lines) == 2:
        lines = []
    lines = [_markdown(text), "", *lines, ""]
    for key, part in nested:
        lines.append(f"**`{key}`**: {_body(part)}")
    return "\n".join(lines)


def specifications_in(annotation: Any) -> Iterator[type[Spec]]:
    """Tables that stand inside the value of a key."""
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        yield annotation
    for part in get_args(annotation):
        yield from specifications_in(part)


def _marks(field: FieldInfo) -> Iterator[Any]:
    """Everything that annotates a key, the entries of its lists included."""

    def inside(annotation: Any) -> Iterator[Any]:
        yield from getattr(annotation, "__metadata__", ())
        for part in get_args(annotation):
            yield from inside(part)

    return itertools.chain(field.metadata, inside(field.annotation))


def _mark(field: FieldInfo) -> Quantity | Constant | None:
    """What says which quantity a key holds."""
    return next((m for m in _marks(field) if isinstance(m, Quantity | Constant)), None)


def _holds(field: FieldInfo) -> str:
    """Kind of value and what is allowed."""
    mark = _mark(field)
    if mark is None:
        return _kind(field.annotation, "a number")
    rules = mark.rules if isinstance(mark, Quantity) else ()
    if isinstance(mark, Constant) and mark.positive:
        rules = ("must be greater than zero",)
    allowed = [re.sub("^must (be )?", "", rule).replace("not be ", "not ") for rule in rules]
    return "; ".join([_kind(field.annotation, DIMENSIONS[mark.dimension].article), *allowed])


def _kind(annotation: Any, number: str) -> str:
    """Kind of value in words; `number` is what a float is."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return " or ".join(f'`"{choice}"`' for choice in arguments)
    if getattr(annotation, "__metadata__", None):
        return _kind(arguments[0], number)
    if origin in (Union, types.UnionType):
        kinds = [_kind(part, number) for part in arguments if part is not type(None)]
        return ", or ".join(dict.fromkeys(kinds))
    if origin is tuple:
        return f"a list, each {_kind(arguments[0], number)}"
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        return "a table"
    names = {bool: "`true` or `false`", int: "a whole number", float: number, str: "a text"}
    return names[annotation]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default()
    if value is None or value == () or value == "":
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, float):
        mark = _mark(field)
        if mark is not None:
            shown = format_quantity(value, mark.dimension)
            return f'`"{shown}"`' if DIMENSIONS[mark.dimension].si else f"`{shown}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value}`"


def _for_files(meaning: str) -> str:
    """A key in Python said of a file: the unit is the file's, None is a missing key."""
    meaning = re.sub(r"\s*\[[A-Za-z/^0-9]+\]", "", meaning)
    meaning = re.sub(r"\bNone(?= for| where)", "left out", meaning)
    return meaning.replace("None", "leaving it out").rstrip(".")


def _markdown(text: str) -> str:
    """Docstring text as Markdown: literals in single quotes, nothing else special."""
    text = text.replace("``", "`")
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(p if p.startswith("`") else re.sub(r"([*_^<])", r"\\\1", p) for p in parts)


def _presets() -> str:
    lines = [
        "### `preset`",
        "",
        "In place of `law` and its constants, the name of a material that ships with the "
        "project; constants given beside it override the preset's.",
        "",
        "| preset | law | constants |",
        "|---|---|---|",
    ]
    for name in preset_names():
        table = load_preset(name)
        constants = ", ".join(
            f"{key} = {value}" for key, value in table.items() if key != "law"
        )
        constants = _markdown(constants.replace("'", ""))
        lines.append(f"| `{name}` | `{table['law']}` | {constants} |")
    return "\n".join([*lines, ""])


def _fluids() -> str:
    named = ", ".join(f'`"{name}"` ({value:g})' for name, value in FLUIDS.items())
    return f"Fluids by name, with their relative permittivity: {named}.\n"


def _units() -> str:
    lines = [
        "## Units",
        "",
        "Any unit of the right kind is understood, with SI prefixes, products and powers "
        '(`"10.051 kN/m^3"`, `"2.5 kgf/cm^2"`). Messages and examples use these:',
        "",
        "| kind | SI | shown |",
        "|---|---|---|",
    ]
    for kind, dimension in DIMENSIONS.items():
        if dimension.si:
            shown = ", ".join(name for name, _ in dimension.units)
            lines.append(f"| {kind} | {dimension.si} | {shown} |")
    return "\n".join([*lines, ""])


def _code_list(names: Any) -> str:
    return ", ".join(f'`"{name}"`' for name in names)
