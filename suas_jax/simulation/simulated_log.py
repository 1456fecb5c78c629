"""A scene, or a path of loads, as the sensor output that a skin would send."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.integrity import Flags, Integrity
from suas_jax.acquisition.log.log_file import LogWriter, log_header
from suas_jax.config import GeometrySpec, LoadSpec, SceneSpec, continuous_inputs, load_scene
from suas_jax.config.csv_table import SURROUNDINGS
from suas_jax.files.writing import written
from suas_jax.sensing.converter import Converter, Sample
from suas_jax.sensing.taxels import by_taxel
from suas_jax.simulation.capacitances import capacitances, static_state
from suas_jax.simulation.load_path import load_path

Columns = dict[str, NDArray[np.float64]]


class NotKnownInputsError(ValueError):
    """A load that no columns of known inputs describe; says which and why."""


def true_loads(
    scene: SceneSpec,  # whose loads act
    forces: Sequence[float],  # total force of each load [N]; that of a pressure is not used
    # what a load path changes, by its columns' names [frame]
    moved: Mapping[str, NDArray[np.float64]],
    frames: int,  # their number
) -> Columns:
    """Columns `load_0_force_N`, `load_0_angle_deg` and their like, by name [frame].

    Raises NotKnownInputsError: a load has no such columns: a pressure, a spread load, a
    rectangle.
    """
    columns: Columns = {}
    flat = scene.geometry.dimension == 2
    for i, load in enumerate(scene.loads):
        _refuse_others(i, load, flat, scene.geometry)
        assert load.kind in ("line", "patch")
        own: dict[str, float] = {"force_N": forces[i]}
        if load.angle is not None:
            own["angle_deg"] = np.rad2deg(load.angle)
        elif load.arc is not None:
            own["arc_m"] = load.arc
        if load.direction == "vertical":
            own["direction_deg"] = own["angle_deg"]
        elif load.direction != "radial":
            own["direction_deg"] = np.rad2deg(load.direction)
        if not flat:
            own["axial_m"] = load.axial
        if load.kind == "patch" and load.diameter is not None:
            own["diameter_m"] = load.diameter
        values = {key: np.full(frames, value) for key, value in own.items()}
        for name, series in moved.items():
            if name in SURROUNDINGS:
                continue
            _, index, key = name.split(".")
            if int(index) == i and key != "tilt_deg":
                values[key] = np.asarray(series, float)
        if load.direction == "vertical" and f"loads.{i}.direction_deg" not in moved:
            values["direction_deg"] = values["angle_deg"]
        for key, series in values.items():
            name = f"load_{i}_{key}"
            scale = 1e3 if key.endswith("_m") else 1.0
            columns[name.removesuffix("_m") + "_mm" if scale > 1 else name] = scale * series
    return columns


def _refuse_others(i: int, load: LoadSpec, flat: bool, geometry: GeometrySpec) -> None:
    why = ""
    if load.kind == "pressure":
        why = "a pressure"
    elif load.kind == "body":
        why = "a body"
    elif load.kind == "line" and (load.spread is not None or not flat):
        why = "spread" if load.spread is not None else "a line on a pad"
    elif load.kind == "patch" and load.diameter is None:
        why = "a rectangle"
    elif load.tilt != 0.0:
        why = "tilted"
    elif load.direction == "vertical" and not (
        geometry.section == "circle" and load.angle is not None
    ):
        why = "vertical, not placed by the angle of a circle"
    if why:
        raise NotKnownInputsError(f"load {i} is {why}, for which there are no such columns")


_SCENE_SECONDS = 10.0
_MOST_FRAMES = 1_000_000


@dataclass(frozen=True)
class LogFaults:
    """What goes wrong between skin and log."""

    drop: float = 0.0  # probability that a frame is lost
    missing: float = 0.0  # probability that a single count is missing
    # time from which a taxel (module, number) keeps its count [s]
    stuck: Mapping[tuple[int, int], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("drop", "missing"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name)}: a probability is needed")


@dataclass(frozen=True)
class SimulatedLog:
    """Sensor outputs of a simulation."""

    scene: SceneSpec  # with the electrodes
    converter: Converter  # of capacitance to counts
    sample: Sample  # the converter's counts
    # of the taxels [frame, taxel] [F]; NaN where the membrane touches one
    capacitance: NDArray[np.float64]
    readings: list[Reading]  # as a device would send them, less what was lost
    origin: str  # seed and settings, in words
    # columns of the loads, and of surroundings that change [frame]
    known: Columns = field(default_factory=dict)
    untold: str = ""  # why there are none of the loads, in words


def simulate_log(
    file: Path,  # scene (.toml) or load path
    *,
    rate: float = 10.0,  # frames per second
    duration: float | None = None,  # [s]; None for the path's own, or ten seconds of a scene
    faults: LogFaults | None = None,  # what goes wrong between skin and log; nothing by default
    seed: int = 0,  # of noise, drift and faults
    # of the `Converter`, by name; None keeps what the scene's [electrodes] state
    settings: Mapping[str, float | None] | None = None,
    # called with the number of frames solved so far
    progress: Callable[[int], None] = lambda frames: None,
) -> SimulatedLog:
    """Play a scene, or a load path.

    Raises ValueError: the file, the skin or a setting can't be used; NoSolutionError: a load
    has no equilibrium.
    """
    path = None if file.suffix.lower() == ".toml" else load_path(file)
    scene = load_scene(file) if path is None else path.scene
    scene.require_no_bodies("`suas simulate`")
    converter = converter_of(scene, **(settings or {}))
    if duration is None:
        duration = _SCENE_SECONDS if path is None else float(path.time[-1] - path.time[0])
    if not duration * rate <= _MOST_FRAMES:
        raise ValueError(
            f"{duration:g} s at {rate:g} Hz: {duration * rate:.3g} frames; at most "
            f"{_MOST_FRAMES} are simulated at a time"
        )
    count = max(1, int(np.floor(duration * rate * (1 + 1e-12))) + (path is not None))
    time = np.arange(count) / rate
    random = np.random.default_rng(seed)
    moved: dict[str, NDArray[np.float64]] = {}
    if path is None:
        static, forces = static_state(scene)
        capacitance = np.tile(static, (count, 1))
    else:
        # Frames at a row's time are at it to the last digit: it may be that of a jump.
        played = np.round(path.time[0] + time, 12)
        capacitance = capacitances(path, played, progress)
        forces = [getattr(load, "force", None) or 0.0 for load in scene.loads]
        moved = path.at(played)
    untold, loads = "", {}
    try:
        loads = true_loads(scene, forces, moved, count)
    except NotKnownInputsError as error:
        untold = str(error)
    columns = loads | {name: moved[name] for name in SURROUNDINGS if name in moved}
    # A channel's gain is the converter's: the film's capacitance is without it.
    given = by_taxel(scene.sensing, continuous_inputs(scene), "gain", 1.0)
    gain = np.asarray(given).reshape(-1)
    # What a unit's channels have beside the model, where a calibration found it.
    record = scene.calibration
    offsets = 0.0 if record is None else np.nan_to_num(record.offsets_of(len(capacitance.T)))
    sample = converter.sample(capacitance * gain + offsets * converter.lsb, time, random)
    found = list(readings(scene, time, sample, faults or LogFaults(), random))
    origin = f"seed {seed}, {rate:g} Hz, {converter}"
    return SimulatedLog(scene, converter, sample, capacitance, found, origin, columns, untold)


def write_simulated_log(log: SimulatedLog, output: Path, source: Path) -> None:
    """Write a log as the logger would, with its true loads and source, whole or not at all."""
    judge = Integrity(None, checked=True)
    header = log_header(
        skin=str(source),
        scale=f"{1e15 * log.converter.lsb:.9g} fF",
        start_time=datetime.now(UTC),
        simulated=log.origin,
        **({"true_loads": f"not written: {log.untold}"} if log.untold else {}),
    )
    taxels = max(log.scene.sensing.taxel_names[1])
    with (
        written(output) as draft,
        LogWriter(draft, header, taxels=taxels, flags=(*Flags._fields, *log.known)) as writer,
    ):
        known = np.stack([*log.known.values()], 1) if log.known else None
        for r in log.readings:
            t_device, flags = judge.judge(r)
            own = () if known is None else [float(f"{x:.9g}") for x in known[r.seq]]
            writer.write(r.t_host, t_device, r.seq, r.module, r.counts, (*flags, *own))


def readings(
    scene: SceneSpec,  # with the electrodes
    time: NDArray[np.float64],  # of the frames on the device's clock [s]
    sample: Sample,  # the converter's counts
    faults: LogFaults,  # what goes wrong on the way
    random: np.random.Generator,  # source of the faults
) -> Iterator[Reading]:
    """Frames as a device would send them: module after module, frame after frame."""
    module, number = (np.array(x) for x in scene.sensing.taxel_names)
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

    Raises ValueError: the scene has no electrodes, or a setting makes no sense.
    """
    own: dict[str, float | None] = {"lsb": scene.sensing.lsb, "noise": scene.sensing.noise}
    own |= {key: value for key, value in changes.items() if value is not None}
    return Converter(**own)  # type: ignore[arg-type]
