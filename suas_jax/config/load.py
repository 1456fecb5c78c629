"""Load skins and scenes from TOML files: one error lists all that is wrong.

A scene takes its tables from the skin file it names, from itself, or from both.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from suas_jax.config.consistency import contradictions
from suas_jax.config.csv_table import read_points
from suas_jax.config.errors import ConfigError, Mistake, show, show_key
from suas_jax.config.geometry import GeometrySpec
from suas_jax.config.oil import OilSpec
from suas_jax.config.presets import expand_preset, expand_shore
from suas_jax.config.schema_scene import SceneSpec, SkinSpec
from suas_jax.config.toml_file import missing_file, read_toml
from suas_jax.config.validation import (
    CHOICES,
    TABLES,
    Finding,
    choose_specification,
    unknown_key,
    validate_table,
)

SKIN_TABLES = tuple(name for name in TABLES if name not in ("load", "solve"))
SCENE_TABLES = tuple(TABLES)
MOST_LOADS = 64
REQUIRED_TABLES = ("geometry", "material", "oil")


def load_scene(path: str | os.PathLike[str]) -> SceneSpec:
    """Load a scene file, with its skin and preset filled in.

    Args:
        path: the TOML file. The path of its skin is relative to it.

    Raises:
        ConfigError: anything is wrong with the file or its skin file; the message lists every
            mistake with the file, the key, the value and what is allowed.
    """
    return scene_from_dict(read_toml(path), base=Path(path).parent, file=os.fspath(path))


def load_skin(path: str | os.PathLike[str]) -> SkinSpec:
    """Load a skin file (TOML), with its preset filled in.

    Raises:
        ConfigError: anything is wrong with the file, as for `load_scene`.
    """
    data = read_toml(path)
    if "skin" in data:
        advice = "this file is a scene; give the skin file that it names"
        raise ConfigError([Mistake(os.fspath(path), "skin", advice, show(data["skin"]))])
    draft = _Draft(os.fspath(path))
    draft.adopt(data, os.fspath(path), SKIN_TABLES)
    return SkinSpec(**draft.specifications())


def scene_from_dict(
    data: Mapping[str, Any], base: str | os.PathLike[str] = ".", file: str = "scene"
) -> SceneSpec:
    """Build a scene from the tables of a scene file, by the rules of `load_scene`.

    Args:
        data: the tables, with quantities as text with units.
        base: the folder that the path of the skin is relative to.
        file: what messages call the file.
    """
    return SceneSpec(**_scene_draft(data, Path(base), file).specifications())


def located(mistake: Mistake, path: str | os.PathLike[str]) -> Mistake:
    """A mistake that a skin's or a scene's numbers show, with the file that has the key.

    `mistake`: found after loading, when no specification knows its file. `path`: the skin or
    scene that was loaded.
    """
    draft = _scene_draft(read_toml(path), Path(path).parent, os.fspath(path))
    return mistake._replace(file=draft.file_of(mistake.key))


def _scene_draft(data: Mapping[str, Any], base: Path, file: str) -> "_Draft":
    """Tables of a scene with those of the skin that it names; see `scene_from_dict`."""
    draft = _Draft(file, otherwise=', or name a skin file: skin = "..."')
    own = dict(data)
    if "skin" in own:
        draft.adopt_skin(own.pop("skin"), base)
    draft.adopt(own, file, SCENE_TABLES)
    return draft


class _Draft:
    """Tables on their way to specifications, with the file that each key came from."""

    def __init__(self, file: str, otherwise: str = ""):
        self.file = file
        self.otherwise = otherwise
        self.tables: dict[str, Any] = {}
        self.origin: dict[str, str] = {}
        self.mistakes: list[Mistake] = []
        self.complete = True

    def adopt_skin(self, skin: object, base: Path) -> None:
        """Take the tables of the skin file that a scene names."""
        trouble: str | None = None
        path = ""
        if not isinstance(skin, str) or not skin.strip():
            trouble = 'the path of a skin file is expected, for example "../skins/suas.toml"'
        else:
            path = os.path.normpath(base / skin)
            trouble = missing_file(path, named_in=os.path.basename(self.file))
            if trouble:
                trouble += (
                    f" (looked for {show(path, 500)}, relative to the file that names it)"
                )
        # Without its skin a scene lacks tables; only the skin is then to blame.
        if trouble:
            self.complete = False
            self.mistakes.append(Mistake(self.file, "skin", trouble, show(skin)))
            return
        try:
            self.adopt(read_toml(path), path, SKIN_TABLES)
        except ConfigError as error:
            self.complete = False
            self.mistakes += error.mistakes

    def adopt(self, data: Mapping[str, Any], file: str, known: tuple[str, ...]) -> None:
        """Take the tables of a file; its keys override those already here."""
        for name, table in data.items():
            if name not in known:
                self._refuse(name, table, file, known)
                continue
            before = self.tables.get(name)
            if isinstance(table, Mapping) and isinstance(before, Mapping):
                kept = _kept(name, before, table)
                for key in before.keys() - kept.keys():
                    self.origin.pop(f"{name}.{key}", None)
                if not kept:
                    self.origin[name] = file
                self.tables[name] = {**kept, **table}
                self.origin.update({f"{name}.{key}": file for key in table})
            else:
                self.tables[name] = table
                self.origin[name] = file

    def _refuse(self, name: str, table: object, file: str, known: tuple[str, ...]) -> None:
        """Note a key that doesn't belong at the top level of a file."""
        if name in SCENE_TABLES or name == "skin":
            advice = "is not a part of a skin file; it belongs in a scene, which names its skin"
        else:
            advice = unknown_key(name, ["skin", *known] if "load" in known else known)
        self.mistakes.append(Mistake(file, show_key(name), advice, show(table)))

    def specifications(self) -> dict[str, Any]:
        """Turn the tables into specifications by field name; raises every mistake at once."""
        parts: dict[str, Any] = {}
        for name in SCENE_TABLES:
            if name == "load" and name in self.tables:
                parts["loads"] = self._loads(self.tables[name])
            elif name in self.tables:
                parts[name] = self._table(name, name, self.tables[name])
            elif name in REQUIRED_TABLES and self.complete:
                advice = f"the table [{name}] is missing; add it" + self.otherwise
                self.mistakes.append(Mistake(self.file, name, advice))
        # A table that is given but wrong is None here; one that isn't given is absent. The
        # comparison leaves out the first, and takes the second for its default.
        compared = {"loads": (), **parts} if self.complete else parts
        for key, advice in contradictions(compared):
            self._note(Finding(key, advice, self._shown(key)))
        if self.mistakes:
            raise ConfigError(self.mistakes)
        return parts

    def _table(self, name: str, key: str, table: Any) -> Any:
        specification: Any = TABLES[name][0]
        findings: list[Finding] = []
        if isinstance(table, Mapping):
            if name == "material":
                table, findings = self._expanded(table)
            if name in CHOICES and not findings:
                specification, findings = choose_specification(table, key, *CHOICES[name])
            if name == "geometry" and not findings:
                table, findings = self._with_points(table)
        part = None
        if not findings:
            part, findings = validate_table(specification, table, key)
        self._note(*findings)
        return part

    def _with_points(self, table: Mapping[str, Any]) -> tuple[Mapping[str, Any], list[Finding]]:
        """Replace the name of a table of points by the points in it."""
        points = table.get("points")
        if not isinstance(points, str):
            return table, []
        folder = Path(self.file_of("geometry.points")).parent
        try:
            return {**table, "points": read_points(folder / points)}, []
        except (OSError, ValueError) as error:
            missing = isinstance(error, FileNotFoundError)
            why = f"no such file in {folder}" if missing else error
            advice = f"{why}; a table with the columns x and y and their units is expected"
            return table, [Finding("geometry.points", advice, show(points))]

    def _expanded(self, material: Mapping[str, Any]) -> tuple[Mapping[str, Any], list[Finding]]:
        if "preset" not in material and "shore" not in material:
            return material, []
        expand = expand_shore if "shore" in material else expand_preset
        table, wrong = expand(material)
        return table, [
            Finding(f"material.{show_key(key)}", advice, show(material[key]))
            for key, advice in wrong
        ]

    def _loads(self, tables: object) -> tuple[Any, ...] | None:
        if not isinstance(tables, list | tuple):
            hint = "in double brackets" if isinstance(tables, Mapping) else "one for each load"
            self._note(Finding("load", f"write loads as tables [[load]], {hint}", show(tables)))
            return None
        if len(tables) > MOST_LOADS:
            advice = f"{len(tables)} loads; at most {MOST_LOADS} are solved"
            self._note(Finding("load", advice))
            return None
        return tuple(self._table("load", f"load.{k}", table) for k, table in enumerate(tables))

    def _note(self, *findings: Finding) -> None:
        for key, advice, value in findings:
            self.mistakes.append(Mistake(self.file_of(key), key, advice, value))

    def file_of(self, key: str) -> str:
        """Find the file that the longest known part of a key came from."""
        parts = key.split(".")
        for length in range(len(parts), 0, -1):
            file = self.origin.get(".".join(parts[:length]))
            if file is not None:
                return file
        return self.file

    def _shown(self, key: str) -> str | None:
        value: Any = self.tables
        for part in key.split("."):
            try:
                value = value[int(part) if isinstance(value, list | tuple) else part]
            except (KeyError, IndexError, TypeError, ValueError):
                return None
        return show(value)


def _kept(name: str, before: Mapping[str, Any], table: Mapping[str, Any]) -> dict[str, Any]:
    """Choose what stays of a skin file's table when a scene gives its own keys."""
    if name == "material" and table.keys() & {"law", "preset", "shore"}:
        return {}
    if name == "electrodes" and "layout" in table:
        return {}
    if name == "geometry" and "section" in table:
        return {key: value for key, value in before.items() if key in GeometrySpec.model_fields}
    if name == "oil" and "model" in table:
        return {key: value for key, value in before.items() if key in OilSpec.model_fields}
    return dict(before)
