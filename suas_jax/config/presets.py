"""Materials that ship with the project, by name."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from suas_jax.config.errors import ConfigError, Mistake, show, unknown
from suas_jax.config.law import LawSpec
from suas_jax.config.schema_material import LAWS
from suas_jax.config.toml_file import read_toml


@functools.cache
def shipped_folder() -> Path:
    """Find the folder of the materials, skins, scenes and test data that ship with the project.

    Returns:
        The folder beside this module in an installed package, or ``configs`` of the checkout
        that this module lies in.
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
    """Read a preset.

    Args:
        name: of the preset, such as ``"epdm-paper"``.

    Returns:
        The keys of its [material] table, as they stand in the file.

    Raises:
        ConfigError: if there is no such preset.
    """
    if name not in preset_names():
        advice = unknown(name, preset_names(), "preset", quoted=True)
        raise ConfigError([Mistake("", "material.preset", advice, show(name))])
    path = preset_folder() / f"{name}.toml"
    table = read_toml(path).get("material")
    if not isinstance(table, dict) or table.get("law") not in LAWS:
        raise ConfigError([Mistake(str(path), "material", "is missing, or names no known law")])
    return table


def expand_preset(material: Mapping[str, Any]) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Replace ``preset`` by the keys it stands for; the other keys override its constants.

    Args:
        material: a [material] table with the key ``preset``.

    Returns:
        The expanded table, and what is wrong with it: pairs of key and advice.

    Raises:
        ConfigError: if the preset's own file is damaged.
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
        elif key in fixed:
            wrong.append((key, f"preset = {show(name)} already sets it; leave one of them out"))
        elif key != "preset":
            advice = unknown(key, free, "key")
            wrong.append((key, f"{advice} (beside preset = {show(name)}, law {show(law)})"))
    return table, wrong
