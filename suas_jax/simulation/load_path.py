"""Loads of a scene that change over time.

A load path is a CSV file beside the scene whose loads it moves::

    # scene: press.toml
    t_s,loads.0.force_N,loads.0.angle_deg
    0.0,0.0,-30
    2.0,15.0,30

The first column is time, the others are loads of the scene by the names that `suas solve
--json` gives them: `force_N`, `angle_deg` or `arc_m`, `direction_deg` (counter-clockwise from
the inward radial) and `pressure_Pa`; in three dimensions also `axial_m`, `tilt_deg` (towards
+axial) and the `diameter_m` of a round patch. `temperature_degC` is that of the whole skin,
`water_depth_m` its depth below the surface. A load that is spread over an arc stays where it
is; its force may change. Between rows everything changes linearly, two rows of one time are a
jump; what no column names stays as the scene has it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from suas_jax.config import (
    ConfigError,
    LineLoadSpec,
    LoadSpec,
    SceneSpec,
    SkinSpec,
    load_scene,
    load_skin,
)
from suas_jax.config.csv_table import SURROUNDINGS, number_in, read_csv_table
from suas_jax.config.schema_load import EnvironmentSpec

_COLUMN = re.compile(r"loads\.(\d+)\.([a-z]+_[A-Za-z]+)")
_LINE = ("force_N", "angle_deg", "arc_m", "direction_deg")
_ON_PADS = ("axial_m", "tilt_deg")


@dataclass(frozen=True)
class LoadPath:
    """Loads over time."""

    scene: SceneSpec  # whose loads move
    time: NDArray[np.float64]  # of the rows, never falling [s]
    columns: dict[str, NDArray[np.float64]]  # values by name, in the units of the names [row]

    def at(self, time: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Values at some times [s], linear between rows, constant beyond them.

        At the time of a jump they are those after it.
        """
        return {k: np.interp(time, self.time, v) for k, v in self.columns.items()}

    def moments(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Times [s], which rise, with those of the rows between them.

        A jump has two: its own and the next smaller number, at which it is still to come.
        """
        jumps = self.time[1:][np.diff(self.time) == 0]
        turns = np.concatenate([self.time, np.nextafter(jumps, -np.inf)])
        return np.union1d(time, turns[(turns > time[0]) & (turns < time[-1])])

    def times(self, moments: NDArray[np.float64]) -> NDArray[np.float64]:
        """What a clock shows at moments [s]: both those of a jump are at its own time."""
        next_one = np.nextafter(moments, np.inf)
        return np.where(np.isin(next_one, self.time), next_one, moments)

    def surroundings(self, time: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Temperature [K] and depth [m], those that change, by their paths in a scene."""
        values = self.at(time)
        return {
            f"environment.{column.key}": values[name] + column.zero
            for name, column in SURROUNDINGS.items()
            if name in values
        }


def load_path(file: Path) -> LoadPath:
    """Read a load path.

    Raises ValueError: naming file, line, column, value and what is allowed; OSError: it, or its
    scene, can't be read.
    """
    table = read_csv_table(file)
    if not table.rows:
        raise ValueError(f"{file}: no rows; a load path is '# scene: FILE', column names, rows")
    if "scene" not in table.header:
        where = f"{file}, line {table.line}"
        raise ValueError(f"{where}: '# scene: FILE' is missing above the column names")
    scene = load_scene(file.parent / table.header["scene"])
    scene.require_no_bodies(f"{file}: a load path")
    _check_columns(f"{file}, line {table.line}", table.names, scene)
    numbers = np.array([[number_in(text) for text in fields] for _, fields in table.rows])
    for (line, fields), values in zip(table.rows, numbers, strict=True):
        for name, text, value in zip(table.names, fields, values, strict=True):
            if np.isnan(value):
                where = f"{file}, line {line}, column {name}"
                raise ValueError(f'{where}: "{text}": expected a number')
    early = np.flatnonzero(np.diff(numbers[:, 0]) < 0)
    if early.size:
        line, _ = table.rows[early[0] + 1]
        raise ValueError(f"{file}, line {line}, column t_s: less than in the row before")
    columns = dict(zip(table.names[1:], numbers[:, 1:].T, strict=True))
    return LoadPath(_surrounded(str(file), scene, columns), numbers[:, 0], columns)


def _surrounded(
    where: str, scene: SceneSpec, columns: dict[str, NDArray[np.float64]]
) -> SceneSpec:
    """The scene with what its columns change of its surroundings stated, as it begins."""
    found = {}
    for name, column in SURROUNDINGS.items():
        if name not in columns:
            continue
        values = columns[name]
        if scene.material.relaxation is not None:
            raise ValueError(
                f'{where}, column "{name}": it is not followed where the material relaxes; '
                "take `relaxation` out of [material], or use suas sweep --history"
            )
        worst = column.beyond(values.min(), values.max())
        if worst is not None:
            raise ValueError(
                f'{where}, column "{name}": {worst:g}: {column.low:g} to {column.high:g} is '
                "allowed"
            )
        found[column.key] = float(values[0]) + column.zero
    if not found:
        return scene
    around = (scene.environment or EnvironmentSpec()).model_copy(update=found)
    return scene.model_copy(update={"environment": around})


def skin_behind(file: Path) -> SkinSpec:
    """The skin of a skin file, of a scene, or of the scene that a load path moves.

    Raises ValueError: the file is none of these, or can't be used; OSError: it can't be read.
    """
    if file.suffix.lower() != ".toml":
        return load_path(file).scene.skin
    try:
        return load_skin(file)
    except ConfigError:
        return load_scene(file).skin  # or the reason why it is neither


def _check_columns(where: str, names: Sequence[str], scene: SceneSpec) -> None:
    if scene.solve.oil_pressure is not None:
        raise ValueError(
            f"{where}: the scene scales its loads to solve.oil_pressure, but a load path "
            "gives them as they are; take oil_pressure out of the scene"
        )
    if names[0] != "t_s" or len(set(names)) < len(names):
        raise ValueError(f'{where}: "{",".join(names)[:80]}": expected t_s,loads.0.force_N,...')
    for name in names[1:]:
        if name in SURROUNDINGS:
            continue
        found = _COLUMN.fullmatch(name)
        if found is None or int(found[1]) >= len(scene.loads):
            raise ValueError(
                f'{where}, column "{name}": expected loads.K.force_N, .angle_deg, .arc_m, '
                f".direction_deg or .pressure_Pa with K below {len(scene.loads)}, the number "
                "of the scene's loads; in three dimensions also .axial_m, .tilt_deg and "
                f".diameter_m; and {' and '.join(SURROUNDINGS)}"
            )
        load = scene.loads[int(found[1])]
        allowed = _allowed(load, scene.geometry.dimension)
        if found[2] not in allowed:
            raise ValueError(
                f'{where}, column "{name}": a {load.kind} load has {", ".join(allowed)}'
            )
        by_arc = getattr(load, "arc", None) is not None
        other = "angle_deg" if by_arc else "arc_m"
        if found[2] == other:
            raise ValueError(
                f'{where}, column "{name}": the scene places this load by '
                f"{'arc' if by_arc else 'angle'}, and so does its path"
            )
        spread = isinstance(load, LineLoadSpec) and load.spread is not None
        if scene.geometry.dimension == 2 and spread and found[2] != "force_N":
            raise ValueError(
                f'{where}, column "{name}": a spread load can\'t move in a path; its force_N '
                "may change"
            )


def _allowed(load: LoadSpec, dimension: int) -> tuple[str, ...]:
    """What a path may move of a load."""
    if load.kind == "pressure":
        return ("pressure_Pa",)
    if dimension == 2:
        return _LINE
    round_ = load.kind == "patch" and load.diameter is not None
    return (*_LINE, *_ON_PADS, *(("diameter_m",) if round_ else ()))
