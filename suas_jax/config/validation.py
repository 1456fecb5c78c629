"""From one table of a file to its specification, or to mistakes a person can act on."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from suas_jax.config.errors import listed, nearest, show, show_key, unknown
from suas_jax.config.fields import FILE_RULES, PlacedError, Spec
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.config.schema_load import LOADS, EnvironmentSpec, ReferenceSpec
from suas_jax.config.schema_scene import DEFAULT_SECTION, LAWS, OILS, SECTIONS
from suas_jax.config.schema_skin import ElectrodesSpec, WallSpec
from suas_jax.config.schema_solve import SolveSpec

TABLES: dict[str, tuple[type[Spec], ...]] = {
    "geometry": tuple(SECTIONS.values()),
    "material": tuple(LAWS.values()),
    "oil": tuple(OILS.values()),
    "electrodes": (ElectrodesSpec,),
    "wall": (WallSpec,),
    "reference": (ReferenceSpec,),
    "environment": (EnvironmentSpec,),
    "calibration": (CalibrationSpec,),
    "load": tuple(LOADS.values()),
    "solve": (SolveSpec,),
}
"""The specifications that each table of a file may turn into."""

CHOICES: dict[str, tuple[str, Mapping[str, type[Any]]]] = {
    "geometry": ("section", SECTIONS),
    "material": ("law", LAWS),
    "oil": ("model", OILS),
    "load": ("kind", LOADS),
}
"""The key that chooses among the specifications of a table, and what it may say."""

SpecT = TypeVar("SpecT", bound=Spec)


class Finding(NamedTuple):
    """A mistake in a table: dotted path, advice, and the value if the file has one."""

    key: str
    advice: str
    value: str | None = None


def validate_table(
    specification: type[SpecT], table: object, key: str, *, units_required: bool = True
) -> tuple[SpecT | None, list[Finding]]:
    """Turn one table, of a dotted path such as ``load.0``, into its specification.

    Numbers state their unit where units are required, as in files. Returns the specification
    and no findings, or None and every mistake in the table.
    """
    if not isinstance(table, Mapping):
        return None, [Finding(key, f"a table is expected: {_header(key)}", show(table))]
    rules = FILE_RULES if units_required else None
    try:
        return specification.model_validate(table, context=rules), []
    except ValidationError as error:
        details = error.errors(include_url=False)
        places = [detail["loc"] for detail in details]
        return None, [
            _finding(detail, specification, table, key)
            for detail in details
            # Entries that are wrong themselves are not counted.
            if not (detail["type"] == "too_short" and _inside(detail["loc"], places))
        ]


def _inside(place: Sequence[int | str], places: Sequence[Sequence[int | str]]) -> bool:
    """Whether one of the places lies inside another."""
    return any(len(x) > len(place) and x[: len(place)] == place for x in places)


def choose_specification(
    table: Mapping[str, Any], key: str, discriminator: str, choices: Mapping[str, type[SpecT]]
) -> tuple[type[SpecT] | None, list[Finding]]:
    """Choose the specification that a table's ``law`` or ``kind`` (`discriminator`) names.

    Returns the specification and no findings, or None and what is wrong with the key.
    """
    path = f"{key}.{discriminator}"
    quoted = listed(show(name) for name in choices)
    if discriminator not in table and key == "geometry":
        return choices[DEFAULT_SECTION], []
    if discriminator not in table:
        preset = (
            '; or name a preset, or the hardness: shore = "60 A"' if key == "material" else ""
        )
        return None, [Finding(path, f"missing; add it, allowed: {quoted}{preset}")]
    chosen = table[discriminator]
    if not isinstance(chosen, str) or chosen not in choices:
        advice = unknown(str(chosen), choices, discriminator, quoted=True)
        return None, [Finding(path, advice, show(chosen))]
    return choices[chosen], []


def unknown_key(
    key: str, known: Sequence[str], table: str = "", chosen: str | None = None
) -> str:
    """Say what an unknown key may have been meant to be, and where it may belong.

    It stands in a table (empty at the top of the file) of a chosen law, model or kind.
    """
    near = nearest(key, known)
    chooser, choices = CHOICES.get(table.split(".")[0], ("", {}))
    others = [name for name, spec in choices.items() if key in spec.model_fields]
    if others and near is None and chosen is not None:
        named = f"{chooser} = {show(chosen)}"
        return (
            f"has no meaning with {named}; take it out, or set {chooser} = "
            f"{listed(map(show, others))}"
        )
    owners = [
        name
        for name, specifications in TABLES.items()
        if name != table.split(".")[0]
        and any(key in spec.model_fields for spec in specifications)
    ]
    top_level = key == "skin" or key in TABLES
    if near is None and table and top_level:
        place = "before the first [table]" if key == "skin" else f"as {_header(key)}"
        return f"unknown key; it belongs at the top level of the file, {place}"
    if near is None and owners:
        return f"unknown key; it belongs in {listed(map(_header, owners))}"
    return unknown(key, known, "key" if table else "key or table")


def _header(key: str) -> str:
    """Write how a table begins in the file."""
    return "[[load]]" if key.split(".")[0] == "load" else f"[{key}]"


def _finding(
    detail: Mapping[str, Any], specification: type[Spec], table: Mapping[str, Any], key: str
) -> Finding:
    """Translate one of the validation library's findings."""
    location = list(detail["loc"])
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, PlacedError):
        location.append(cause.place)
    owner, field = _field_at(specification, location)
    last = str(location[-1]) if location else ""
    there, value = _value_at(table, location)
    path = ".".join([key, *map(show_key, location)])
    shown = show(value) if there else None
    kind = detail["type"]
    if kind == "missing":
        return Finding(path, _missing(last, field), shown)
    if kind == "extra_forbidden":
        choice = _chosen(specification, key) if owner is specification else None
        advice = unknown_key(last, list(owner.model_fields), key, choice)
        return Finding(path, advice, shown)
    if kind == "literal_error" and field is not None:
        return Finding(path, unknown(str(value), _choices(field), "value", quoted=True), shown)
    advice = str(cause or detail["msg"])
    if kind == "too_short":
        limits = detail["ctx"]
        least, given = limits["min_length"], limits["actual_length"]
        advice = f"has {given} entries; at least {least} are needed"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        advice = "a table in braces is expected"
    if advice.endswith("is expected") and field is not None and field.examples:
        list_key = next(part for part in reversed(location) if isinstance(part, str))
        advice += f", for example {list_key} = {field.examples[0]}"
    return Finding(path, advice, shown)


def _chosen(specification: type[Spec], key: str) -> str | None:
    """The name that a table's specification was chosen by; None if there is no choice."""
    _, choices = CHOICES.get(key.split(".")[0], ("", {}))
    return next((name for name, spec in choices.items() if spec is specification), None)


def _missing(key: str, field: FieldInfo | None) -> str:
    choices = _choices(field) if field is not None else []
    if choices:
        return f"missing; add it, allowed: {listed(show(choice) for choice in choices)}"
    examples = field.examples if field is not None else None
    return "missing; add it" + (f", for example {key} = {examples[0]}" if examples else "")


def _choices(field: FieldInfo) -> list[str]:
    """List the words that a key may hold."""
    annotations = (field.annotation, *get_args(field.annotation))
    literal = next((a for a in annotations if get_origin(a) is Literal), None)
    return [str(choice) for choice in get_args(literal)] if literal else []


def _field_at(
    specification: type[Spec], location: Sequence[object]
) -> tuple[type[BaseModel], FieldInfo | None]:
    """Follow a path through nested specifications to the one that owns its last key."""
    owner: type[BaseModel] = specification
    field: FieldInfo | None = None
    for part in location:
        if not isinstance(part, str):
            continue
        if field is not None:
            inside = (field.annotation, *get_args(field.annotation))
            owner = next(
                (a for a in inside if isinstance(a, type) and issubclass(a, BaseModel)), owner
            )
        field = owner.model_fields.get(part)
    return owner, field


def _value_at(table: Any, location: Sequence[Any]) -> tuple[bool, Any]:
    """Find what the file has at a path; False if it has nothing there."""
    value = table
    for part in location:
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            return False, None
    return True, value
