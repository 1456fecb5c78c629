"""Play a scene, or a path of loads, as the readings of the skin's electronics.

A load path is a CSV file beside the scene whose loads it moves::

    # scene: press.toml
    t_s,loads.0.force_N,loads.0.angle_deg
    0.0,0.0,-30
    2.0,15.0,30

The first column is time, the others are loads of the scene by the names that `suas solve
--json` gives them: `force_N`, `angle_deg`, `direction_deg` (counter-clockwise from the
inward radial) and `pressure_Pa`. Between rows everything changes linearly; what no column
names stays as the scene has it.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.frames.reading import Reading
from suas_jax.config import LineLoadSpec, SceneSpec, load_scene
from suas_jax.config.csv_table import number_in, read_csv_table
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.scene.forward import SPREAD_POINTS, Loads, forward, loads_of, skin_of
from suas_jax.scene.solve import solve
from suas_jax.sensing.converter import Converter, Sample
from suas_jax.sensing.taxels import taxel_names

# Frames solved in one call, and the shape that is compiled.
_BLOCK = 256
_COLUMN = re.compile(r"loads\.(\d+)\.(force_N|angle_deg|direction_deg|pressure_Pa)")


class NoSolutionError(Exception):
    """No equilibrium was found for a load; the message says which and why."""


@dataclass(frozen=True)
class LoadPath:
    """Loads over time.

    Attributes:
        scene: whose loads move.
        time: of the rows [s].
        columns: values by name, in the units of the names [row].
    """

    scene: SceneSpec
    time: NDArray[np.float64]
    columns: dict[str, NDArray[np.float64]]

    def at(self, time: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Values at some times [s], linear between rows, constant beyond them."""
        return {k: np.interp(time, self.time, v) for k, v in self.columns.items()}


@dataclass(frozen=True)
class Faults:
    """What goes wrong between skin and log.

    Attributes:
        drop: probability that a frame is lost.
        missing: probability that a single count is missing.
        stuck: time from which a taxel (module, number) keeps its count [s].
    """

    drop: float = 0.0
    missing: float = 0.0
    stuck: Mapping[tuple[int, int], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("drop", "missing"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name)}: a probability is needed")


def load_path(file: Path) -> LoadPath:
    """Read a load path.

    Raises:
        ValueError: naming file, line, column, value and what is allowed.
        OSError: it, or its scene, can't be read.
    """
    table = read_csv_table(file)
    if not table.rows:
        raise ValueError(f"{file}: no rows; a load path is '# scene: FILE', column names, rows")
    if "scene" not in table.header:
        where = f"{file}, line {table.line}"
        raise ValueError(f"{where}: '# scene: FILE' is missing above the column names")
    scene = load_scene(file.parent / table.header["scene"])
    _check_columns(f"{file}, line {table.line}", table.names, scene)
    numbers = np.array([[number_in(text) for text in fields] for _, fields in table.rows])
    for (line, fields), values in zip(table.rows, numbers, strict=True):
        for name, text, value in zip(table.names, fields, values, strict=True):
            if np.isnan(value):
                where = f"{file}, line {line}, column {name}"
                raise ValueError(f'{where}: "{text}": expected a number')
    late = np.flatnonzero(~(np.diff(numbers[:, 0]) > 0))
    if late.size:
        line, _ = table.rows[late[0] + 1]
        raise ValueError(f"{file}, line {line}, column t_s: time must increase")
    columns = dict(zip(table.names[1:], numbers[:, 1:].T, strict=True))
    return LoadPath(scene, numbers[:, 0], columns)


def _check_columns(where: str, names: Sequence[str], scene: SceneSpec) -> None:
    if scene.solve.oil_pressure is not None:
        raise ValueError(
            f"{where}: the scene scales its loads to solve.oil_pressure, but a load path "
            "gives them as they are; take oil_pressure out of the scene"
        )
    if names[0] != "t_s" or len(set(names)) < len(names):
        raise ValueError(f'{where}: "{",".join(names)[:80]}": expected t_s,loads.0.force_N,...')
    for name in names[1:]:
        found = _COLUMN.fullmatch(name)
        kinds = {"line": "force_N, angle_deg or direction_deg", "pressure": "pressure_Pa"}
        if found is None or int(found[1]) >= len(scene.loads):
            raise ValueError(
                f'{where}, column "{name}": expected loads.K.force_N, .angle_deg, '
                f".direction_deg or .pressure_Pa with K below {len(scene.loads)}, the number "
                "of the scene's loads"
            )
        load = scene.loads[int(found[1])]
        allowed = kinds[load.kind]
        if found[2] not in allowed:
            raise ValueError(f'{where}, column "{name}": a {load.kind} load has {allowed}')
        if isinstance(load, LineLoadSpec) and load.spread is not None:
            raise ValueError(f'{where}, column "{name}": a spread load can\'t move in a path')


def capacitances(
    path: LoadPath,
    time: NDArray[np.float64],
    progress: Callable[[int], None] = lambda done: None,
) -> NDArray[np.float64]:
    """Capacitance of every taxel along a load path [frame, taxel] [F].

    Args:
        path: loads over time.
        time: of the frames [s].
        progress: called with the number of frames done.

    Raises:
        NoSolutionError: some loads have no equilibrium.
    """
    free = skin_of(path.scene, contact=False)
    held = skin_of(path.scene)
    run = eqx.filter_jit(forward)
    loads = _loads(path, time)
    edge = float(free.geometry.half_angle[0])
    if loads.angle.size and float(jnp.max(jnp.abs(loads.angle))) >= edge:
        raise ValueError(f"a load leaves the skin, which ends at {np.rad2deg(edge):.4g} deg")
    blocks = []
    for begin in range(0, len(time), _BLOCK):
        index = np.minimum(np.arange(begin, begin + _BLOCK), len(time) - 1)
        block = Loads(*(x[..., index] for x in _fields(loads)))
        output = run(free, block)
        # The program that knows contact is compiled where the membrane reaches the wall.
        if held.wall is not None and bool(jnp.any(output.min_gap < 0)):
            output = run(held, block)
        failed = np.flatnonzero(np.asarray(output.result))
        if failed.size:
            name = NAMES[int(output.result[failed[0]])]
            raise NoSolutionError(f"t = {time[index[failed[0]]]:g} s: {name}. {advice(name)}")
        blocks.append(np.asarray(output.readings.capacitance).T)
        progress(min(begin + _BLOCK, len(time)))
    return np.concatenate(blocks)[: len(time)]


def _fields(loads: Loads) -> tuple[jnp.ndarray, ...]:
    return loads.angle, loads.force, loads.turn, loads.external_pressure


def _loads(path: LoadPath, time: NDArray[np.float64]) -> Loads:
    """The scene's loads with what the path moves, a lane a frame."""
    base, values = loads_of(path.scene), path.at(time)
    frames = len(time)
    angle, force, turn, _ = (
        np.array(np.broadcast_to(x, (*x.shape[:-1], frames))) for x in _fields(base)
    )
    pressure, row = np.zeros(frames), 0
    for i, load in enumerate(path.scene.loads):
        if not isinstance(load, LineLoadSpec):
            pressure += values.get(f"loads.{i}.pressure_Pa", load.pressure)
            continue
        if load.spread is not None:
            row += SPREAD_POINTS
            continue
        angle[row] = np.deg2rad(values.get(f"loads.{i}.angle_deg", np.rad2deg(angle[row])))
        force[row] = values.get(f"loads.{i}.force_N", force[row])
        if load.direction == "vertical":
            turn[row] = angle[row]
        if f"loads.{i}.direction_deg" in values:
            turn[row] = np.deg2rad(values[f"loads.{i}.direction_deg"])
        row += 1
    return Loads(*(jnp.asarray(x) for x in (angle, force, turn, pressure)))


def static_capacitance(scene: SceneSpec) -> NDArray[np.float64]:
    """Capacitance of every taxel of a scene at rest under its loads [taxel] [F].

    Raises:
        NoSolutionError: the scene has no equilibrium.
    """
    report = solve(scene).report
    if report["status"] != "converged":
        raise NoSolutionError(f"{report['status']}. {report['message']}")
    return np.array([taxel["capacitance_F"] for taxel in report["taxels"]])


def readings(
    scene: SceneSpec,
    time: NDArray[np.float64],
    sample: Sample,
    faults: Faults,
    random: np.random.Generator,
) -> Iterator[Reading]:
    """Frames as a device would send them: module after module, frame after frame.

    Args:
        scene: with the electrodes.
        time: of the frames on the device's clock [s].
        sample: the converter's counts.
        faults: what goes wrong on the way.
        random: source of the faults.
    """
    assert scene.electrodes is not None
    module, number = (np.array(x) for x in taxel_names(scene.electrodes))
    counts = sample.counts.copy()
    for (m, k), since in faults.stuck.items():
        taxel = np.flatnonzero((module == m) & (number == k))
        if not taxel.size:
            raise ValueError(f"stuck taxel {m}.{k}: the skin has no such taxel")
        first = int(np.searchsorted(time, since))
        if first < len(time):
            counts[first:, taxel] = counts[first, taxel]
    for seq, (t, row) in enumerate(zip(time, counts, strict=True)):
        lost = random.random() < faults.drop
        missing = random.random(len(row)) < faults.missing
        if lost:
            continue
        for m in np.unique(module):
            mine = np.flatnonzero(module == m)
            values = tuple(None if missing[i] else int(row[i]) for i in mine)
            yield Reading(seq, float(t), int(m), values, t_host=float(t))


def converter_of(scene: SceneSpec, **changes: float | None) -> Converter:
    """The converter of [electrodes], with changes where they aren't None.

    Raises:
        ValueError: the scene has no electrodes, or a setting makes no sense.
    """
    if scene.electrodes is None:
        raise ValueError("the scene's skin has no [electrodes]: there is nothing to simulate")
    own: dict[str, float | None] = {
        "lsb": scene.electrodes.lsb,
        "noise": scene.electrodes.noise,
    }
    own |= {key: value for key, value in changes.items() if value is not None}
    return Converter(**own)  # type: ignore[arg-type]
