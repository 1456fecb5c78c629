"""The loads behind a simulated log, in columns that `suas fit sensor` takes as known inputs."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from suas_jax.config import GeometrySpec, LoadSpec, SceneSpec

Columns = dict[str, NDArray[np.float64]]


class NotKnownInputsError(ValueError):
    """A load that no columns of known inputs describe; says which and why."""


def true_loads(
    scene: SceneSpec,
    forces: Sequence[float],
    moved: Mapping[str, NDArray[np.float64]],
    frames: int,
) -> Columns:
    """Columns `load_0_force_N`, `load_0_angle_deg` and their like, by name [frame].

    Args:
        scene: whose loads act.
        forces: total force of each load [N]; that of a pressure is not used.
        moved: what a load path changes, by its columns' names [frame].
        frames: their number.

    Raises:
        NotKnownInputsError: a load has no such columns: a pressure, a spread load, a rectangle.
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
