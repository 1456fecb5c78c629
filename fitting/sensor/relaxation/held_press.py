"""Held presses of logs: the course of the load, and means of the readings, some a decade."""

from typing import Any, NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.sensor.logs.data import NoCalibration, SensorData
from fitting.sensor.logs.readings import ROUNDING
from fitting.sensor.shapes.scene_states import scene_load
from suas_jax.config import SceneSpec, SolveSpec, continuous_inputs, with_inputs
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.input_errors import stresses_of
from suas_jax.dynamics.course import History
from suas_jax.dynamics.history import history_sweep

# A load that changes by less than this, relative to its largest, is held.
_STEADY = 0.02
# Frames that one mean is of span this share of the time since the load last changed.
_SPAN = 0.12
_FEWEST = 10  # means of a hold that tell a course
_MOVES = 10.0  # range of a taxel's means, over their noise, that makes it tell something


class HeldPress(NamedTuple):
    """One log: a place, the course of its load, and what the taxels read."""

    scene: SceneSpec  # the skin under the load
    column: str  # of a history that drives the load
    time: Floats  # of the means [mean] [s]
    load: Floats  # force or travel [mean] [N or m]
    # counts [taxel, mean]; NaN where all are missing, and of taxels that the load hardly moves
    so: Floats
    deviation: Floats  # standard deviation of their noise [taxel, mean]
    began: Floats  # when the load last changed before each mean [mean] [s]
    drift_degree: int = 1  # in time, of the taxels' drift

    def readings(self, series: RelaxationSpec, stiffness: float) -> Floats:
        """Counts as the skin's model has them [taxel, mean].

        `stiffness` multiplies the long-term constants of the skin file.
        Raises NoCalibration: the loads have no equilibrium.
        """
        material = self.scene.material.model_copy(update={"relaxation": series})
        scene = self.scene.model_copy(update={"material": material})
        known = continuous_inputs(scene)
        scene = with_inputs(scene, {key: stiffness * known[key] for key in stresses_of(scene)})
        # The oil's film has come to rest long before a hold is over.
        given = History(self.time, {self.column: self.load})
        found = history_sweep(scene, given, film=False)
        for point in found.points:
            if point["status"] != "converged":
                load = float(np.interp(point["t_s"], self.time, self.load))
                unit = self.column.rpartition("_")[-1]
                raise NoCalibration(
                    f"the model has no state {point['t_s']:.4g} s into the log, under "
                    f"{load:.4g} {unit} ({point['status']}): check the load's unit, "
                    "and the skin file"
                )
        return np.array([[taxel["so"] for taxel in p["taxels"]] for p in found.points], float).T

    @property
    def hold(self) -> float:
        """The longest time that the load is held [s]."""
        pressed = (self.load > 0.5 * self.load.max()) & (self.load > 0)
        return float(np.max((self.time - self.began)[pressed], initial=0.0))

    @property
    def first(self) -> float:
        """The shortest time after a change of the load that readings are of [s]."""
        since = self.time - self.began
        return float(np.min(since[since > 0], initial=np.inf))


def held_presses(data: SensorData) -> tuple[HeldPress, ...]:
    """The presses of all logs, one each.

    Raises ValueError: a log has no held press, several places or loads, or begins under load.
    """
    return tuple(_held(data, k) for k in range(len(data.files)))


def _held(data: SensorData, k: int) -> HeldPress:
    path, own = data.files[k].path, data.log == k
    loads, state = data.loads, data.state[own]
    if np.nan_to_num(loads.displacement).any():
        raise ValueError(
            f"{path}: --fit relaxation takes a known force (load_0_force_N) or a body's travel "
            "(load_0_depth_mm), not the displacement of a point"
        )
    sizes = loads.depth if loads.bodies else np.nan_to_num(loads.force)
    load, pressed = sizes[0, state], np.unique(state[sizes[0, state] > 0])
    names = ("angle", "turn", "axial", "diameter")
    places = np.stack([getattr(loads, name)[0, pressed] for name in names])
    if sizes[1:, state].any() or np.any(np.abs(places - places[:, :1]) > 1e-9):
        raise ValueError(
            f"{path}: --fit relaxation takes one load at one place a log; write a log for each"
        )
    if abs(load[0]) > _STEADY * np.abs(load).max():
        raise ValueError(f"{path}: the log begins under load; begin it at rest")
    time = data.time[own]
    starts, began = _means(time, load)
    spec: Any = {name: getattr(data.spec, name) for name in data.spec.model_fields_set}
    at = scene_load(data.spec, loads, 0, int(pressed[0]) if len(pressed) else 0)
    count = np.diff([*starts, len(time)])
    so, deviation = _averaged(data.so[:, own], starts)
    low, high = (np.where(np.isfinite(so), so, x) for x in (np.inf, -np.inf))
    so[~(high.max(1) - low.min(1) > _MOVES * np.median(deviation, 1))] = np.nan
    held = HeldPress(
        SceneSpec(**spec, load=(at,), solve=SolveSpec(model="shell")),
        "depth_m" if loads.bodies else "force_N",
        np.add.reduceat(time, starts) / count,
        np.add.reduceat(load, starts) / count,
        so,
        deviation,
        began,
    )
    steady = np.sum((held.load > 0) & (held.time > held.began))
    if steady < _FEWEST or held.hold < _FEWEST * held.first:
        raise ValueError(
            f"{path}: nothing is held: the load stays within 2 % for {held.hold:.3g} "
            "s at most; press one place for a minute or more, and release it"
        )
    return held


def _means(time: Floats, load: Floats) -> tuple[list[int], Floats]:
    """First frames of the means, and when the load last changed before each."""
    steady = _STEADY * np.abs(load).max(initial=0.0)
    starts, began, level = [0], [float(time[0])], load[0]
    for i in range(1, len(time)):
        if abs(load[i] - level) > steady:
            level = load[i]
            if starts[-1] < i - 1:  # the load goes on from there, not from a mean before
                starts.append(i - 1)
                began.append(began[-1])
            began.append(float(time[i]))
        elif time[i] - time[starts[-1]] > _SPAN * (time[starts[-1]] - began[-1]):
            began.append(began[-1])
        else:
            continue
        starts.append(i)
    return starts, np.array(began)


def _averaged(so: Floats, starts: list[int]) -> tuple[Floats, Floats]:
    """Means of counts from some frames on, and their deviations by the noise within."""
    known = np.isfinite(so)
    count, total, squares = (
        np.add.reduceat(x, starts, axis=1)
        for x in (known.astype(float), np.where(known, so, 0.0), np.where(known, so, 0.0) ** 2)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count
        free = np.maximum(count - 1, 0).sum(1)
        noise = np.nansum(squares - count * mean**2, 1) / free
    noise = np.maximum(np.where(free >= _FEWEST, noise, np.nan), ROUNDING**2)
    usual = np.nanmedian(noise) if np.isfinite(noise).any() else 1.0
    noise = np.where(np.isfinite(noise), noise, usual)
    return mean, np.sqrt(noise[:, None] / np.maximum(count, 1))
