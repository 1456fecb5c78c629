"""A scene and how its numbers change over a history: loads and temperature over time.

The file of a history is a table::

    t_s,force_N
    0,0
    0.1,20
    60.1,20
    60.2,0

`force_N` is the sum of the loads' magnitudes, as for a curve, `factor` multiplies all loads as
the scene has them, `depth_m` is the travel of the body that is pressed in most and
`temperature_degC` that of the whole skin; one of them at least is needed. What no column names
stays as the scene has it. Between rows everything changes linearly; two rows of one time are a
jump. The skin has been at rest before the first row.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from suas_jax.config import SceneSpec, continuous_inputs, with_inputs
from suas_jax.config.csv_table import TEMPERATURE, number_in, read_csv_table
from suas_jax.config.errors import show_key, unknown
from suas_jax.config.quantities import ZERO_CELSIUS
from suas_jax.dynamics.driven import FACTOR
from suas_jax.dynamics.steps import Rows
from suas_jax.scene.sweep import SweepError
from suas_jax.scene.travel import driven_by_force, shares_of_travel
from suas_jax.skin.prestress import is_prestressed

MOST_ROWS = 100_000
_COLUMNS = ("force_N", "factor", "depth_m", TEMPERATURE)
_CHOICE = f"at least one of force_N (or factor), depth_m and {TEMPERATURE}"
_WARMTH = "environment.temperature"
_NOTHING = {
    "force_N": "there is no load with a force to scale; add [[load]] with force",
    "depth_m": "there is no body with a depth to change; give a [[load]] a depth",
    TEMPERATURE: "the scene has no temperature to change; give [environment] a temperature",
}


class History(NamedTuple):
    """Loads over time."""

    time: Float[np.ndarray, " row"]  # of the rows [s], never falling
    columns: dict[str, Float[np.ndarray, " row"]]  # values by name, one for each row


def read_history(file: Path) -> History:
    """Read a history.

    Raises ValueError: a column is missing or unknown, a field is not a number, or time falls;
    OSError: the file can't be read.
    """
    table = read_csv_table(file)
    for name in table.names:
        if name not in ("t_s", *_COLUMNS):
            reason = unknown(name, ("t_s", *_COLUMNS), "column, or its unit is another")
            raise ValueError(f"{file}: {show_key(name)}: {reason}")
    found = [name for name in table.names if name != "t_s"]
    if "t_s" not in table.names or not _allowed(found) or not table.rows:
        given = ", ".join(table.names) or "none"
        raise ValueError(
            f"{file}: the columns are {given}; t_s and {_CHOICE} are needed, "
            "once each, and a row"
        )
    if len(table.rows) > MOST_ROWS:
        raise ValueError(f"{file}: {len(table.rows)} rows; at most {MOST_ROWS} are followed")
    rows = np.array([[number_in(text) for text in fields] for _, fields in table.rows])
    for (line, fields), row in zip(table.rows, rows, strict=True):
        if not np.all(np.isfinite(row)):
            raise ValueError(
                f"{file}, line {line}: {','.join(fields)[:80]}: numbers are needed"
            )
    columns = dict(zip(table.names, rows.T, strict=True))
    time = columns.pop("t_s")
    falls = np.flatnonzero(np.diff(time) < 0)
    if len(falls):
        line = table.rows[falls[0] + 1][0]
        raise ValueError(f"{file}, line {line}: t_s is less than in the row before")
    return History(time, columns)


def _allowed(names: Sequence[str]) -> bool:
    """Whether columns go together."""
    known = bool(names) and len(set(names)) == len(names) and set(names) <= set(_COLUMNS)
    return known and not {"factor", "force_N"} <= set(names)


def history_of(time: Sequence[float], **values: Sequence[float]) -> History:
    """A history from Python: times [s] and any columns that a file may have.

    Raises:
        ValueError: another name, none, or different lengths.
    """
    columns = {name: np.asarray(x, float) for name, x in values.items()}
    if not _allowed(list(columns)) or any(len(x) != len(time) for x in columns.values()):
        raise ValueError(f"a value a time is needed for {_CHOICE}")
    return History(np.asarray(time, float), columns)


class Course(NamedTuple):
    """A scene and how its numbers change."""

    scene: SceneSpec  # at full load
    time: Float[np.ndarray, " row"]  # of the rows [s]
    # of a factor on all loads, or of inputs by their paths; one a row each
    values: dict[str, Float[np.ndarray, " row"]]
    rest: dict[str, float]  # the values before the first row

    @classmethod
    def of(cls, scene: SceneSpec, history: History) -> Self:
        """That of a history: a factor if nothing but all loads change, together.

        Raises SweepError: the scene has nothing that a column changes.
        """
        columns = history.columns
        shares = {name: _driven(scene, name) for name in columns if name != "factor"}
        for name, found in shares.items():
            if not found:
                raise SweepError(_NOTHING[name])
        loads = _load_inputs(scene)
        alone = set().union(*shares.values()) | (set(loads) if "factor" in columns else set())
        others = set(loads) - alone
        together = len(columns) == 1 and not others and not driven_by_force(scene)
        # A factor brings bodies no farther off than where the undeformed skin has them.
        met = bool(scene.bodies) and is_prestressed(scene)
        if together and TEMPERATURE not in columns and not met:
            ((name, values),) = columns.items()
            if name == "factor":
                return cls(scene, history.time, {FACTOR: values}, {FACTOR: 0.0})
            top = float(values[np.argmax(np.abs(values))]) or 1.0
            full = with_inputs(scene, {k: share * top for k, share in shares[name].items()})
            return cls(full, history.time, {FACTOR: values / top}, {FACTOR: 0.0})
        factor = columns.get("factor", np.ones(len(history.time)))
        driven = {key: factor * value for key, value in loads.items()}
        for name, found in shares.items():
            offset = ZERO_CELSIUS if name == TEMPERATURE else 0.0
            driven |= {key: share * columns[name] + offset for key, share in found.items()}
        # A body that begins off the skin has been there.
        off = {key: min(0.0, float(driven[key][0])) for key in loads if key.endswith(".depth")}
        rest = dict.fromkeys(loads, 0.0) | off
        if TEMPERATURE in columns:
            rest[_WARMTH] = float(driven[_WARMTH][0])
        return cls(scene, history.time, driven, rest)

    @property
    def apart(self) -> dict[str, float]:
        """As `rest`, bodies off a skin whose stress at rest may bring it out to meet them."""
        off = -self.scene.geometry.mean_gap if is_prestressed(self.scene) else 0.0
        return {key: off if key.endswith(".depth") else x for key, x in self.rest.items()}

    @property
    def scaled(self) -> SceneSpec:
        """The scene by whose inputs derivatives are: at a factor of one, or the largest."""
        return self.scene if FACTOR in self.values else self.largest

    @property
    def largest(self) -> SceneSpec:
        """The scene with the largest value of everything that changes."""
        known = continuous_inputs(self.scene)
        if FACTOR in self.values:
            level = float(np.max(np.abs(self.values[FACTOR])))
            loads = {key: level * known[key] for key in _load_inputs(self.scene)}
            return with_inputs(self.scene, loads)
        middle = {_WARMTH: self.scene.reference.temperature}
        peak = {
            key: float(x[np.argmax(np.abs(x - middle.get(key, 0.0)))])
            for key, x in self.values.items()
        }
        return with_inputs(self.scene, peak)

    def block(self, first: int, count: int) -> Rows:
        """Some rows; the last one is repeated to fill up."""
        index = np.minimum(np.arange(first, first + count), len(self.time) - 1)
        before = np.maximum(index - 1, 0)
        more = np.arange(first, first + count) >= len(self.time)
        begin = np.where(more, self.time[index], self.time[before])
        start = {
            key: np.where(index == 0, self.rest[key], np.where(more, x[index], x[before]))
            for key, x in self.values.items()
        }
        end = {key: x[index] for key, x in self.values.items()}
        rows = begin, self.time[index], start, end, ~more
        return Rows(*jax.tree.map(jnp.asarray, rows))


def _load_inputs(scene: SceneSpec) -> dict[str, float]:
    """Sizes of all loads, by the paths of their inputs."""
    known = continuous_inputs(scene)
    ends = (".force", ".pressure", ".depth")
    return {k: x for k, x in known.items() if k.startswith("load.") and k.endswith(ends)}


def _driven(scene: SceneSpec, column: str) -> dict[str, float]:
    """Which inputs a column changes, and by how much for every unit of it."""
    if column == TEMPERATURE:
        known = scene.environment is not None and scene.environment.temperature is not None
        return {_WARMTH: 1.0} if known else {}
    loads = _load_inputs(scene)
    if column == "depth_m":
        return shares_of_travel({k: x for k, x in loads.items() if k.endswith(".depth")})
    total = sum(abs(x) for key, x in loads.items() if key.endswith(".force"))
    # What presses from all sides goes with the forces, as along a curve.
    ends = (".force", ".pressure")
    return {k: x / total for k, x in loads.items() if k.endswith(ends)} if total else {}
