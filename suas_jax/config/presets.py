"""Materials that ship with the project, by name."""

import functools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from suas_jax.config.errors import ConfigError, Mistake, show, unknown
from suas_jax.config.law import LawSpec
from suas_jax.config.schema_scene import LAWS
from suas_jax.config.toml_file import read_toml


@functools.cache
def shipped_folder() -> Path:
    """The folder of the materials, skins, scenes and test data that ship with the project.

    It is beside this module in an installed package, else ``configs`` of the checkout.
    """
    installed = Path(__file__).parent / "shipped"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "configs"


def preset_folder() -> Path:
    """The folder of the material presets."""
    return shipped_folder() / "materials"


def preset_names() -> list[str]:
    """List the material presets that ``preset = "..."`` may name."""
    return sorted(path.stem for path in preset_folder().glob("*.toml"))


def load_preset(name: str) -> dict[str, Any]:
    """Keys of a preset's [material] table, as they stand in its file.

    Raises ConfigError: there is no such preset.
    """
    if name not in preset_names():
        advice = unknown(name, preset_names(), "preset", quoted=True)
        raise ConfigError([Mistake("", "material.preset", advice, show(name))])
    path = preset_folder() / f"{name}.toml"
    table = read_toml(path).get("material")
    if not isinstance(table, dict) or table.get("law") not in LAWS:
        raise ConfigError([Mistake(str(path), "material", "is missing, or names no known law")])
    return table


# Where Gent's relation was measured, and by how much rubbers of one hardness differ.
_SOFTEST, _HARDEST = 20.0, 95.0
_SHORE_SPREAD = 50  # per cent
_SHORE = re.compile(r"(\d+(?:\.\d+)?)\s*A")


def expand_shore(material: Mapping[str, Any]) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Replace ``shore`` by a neo-Hookean law: a first guess where no test was made.

    Gent's relation of the indentation hardness (A. N. Gent, IRI Trans. 34, 1958)::

        E = 0.0981 (56 + 7.62336 S) / (0.137505 (254 - 2.54 S)) MPa,   mu = E / 3

    It is known to a factor of 1.5, which the modulus carries as its deviation.

    Returns the expanded [material] table, and pairs of key and advice of what is wrong with it.
    """
    found = _SHORE.fullmatch(str(material["shore"]).strip())
    hardness = float(found.group(1)) if found else 0.0
    if not _SOFTEST <= hardness <= _HARDEST:
        return {}, [("shore", 'a hardness from 20 to 95 Shore A is expected, such as "60 A"')]
    for key in ("law", "preset", "mu"):
        if key in material:
            return {}, [("shore", f"gives a law and its modulus; leave it or {key} out")]
    ratio = (56 + 7.62336 * hardness) / (0.137505 * (254 - 2.54 * hardness))
    modulus = f"{0.0981 * ratio / 3:.4g} MPa +- {_SHORE_SPREAD} %"
    kept = {key: value for key, value in material.items() if key != "shore"}
    return {"law": "neo-hookean", "mu": modulus, **kept}, []


def expand_preset(material: Mapping[str, Any]) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Replace ``preset`` by the keys it stands for; the other keys override its constants.

    Returns the expanded [material] table, and pairs of key and advice of what is wrong with it.
    """
    name = material["preset"]
    if not isinstance(name, str) or name not in preset_names():
        return {}, [("preset", unknown(str(name), preset_names(), "preset", quoted=True))]
    table = load_preset(name)
    law = table["law"]
    constants = list(LAWS[law].declared())
    free = [*constants, *(key for key in LawSpec.model_fields if key != "law")]
    fixed = LAWS[law].model_fields.keys() - set(free)
    wrong: list[tuple[str, str]] = []
    for key, value in material.items():
        if key in free:
            table[key] = value
            if key in constants:  # of which the preset's note says something else
                table.pop("note", None)
        elif key in fixed:
            wrong.append((key, f"preset = {show(name)} already sets it; leave one of them out"))
        elif key != "preset":
            advice = unknown(key, free, "key")
            wrong.append((key, f"{advice} (beside preset = {show(name)}, law {show(law)})"))
    return table, wrong
