"""What of a scene can be changed on the page: its sliders, and how they change the scene."""

from typing import Any

import numpy as np

from suas_jax.config import LineLoadSpec, LoadSpec, PatchLoadSpec, SceneSpec, with_solve
from suas_jax.config.input_errors import stresses_of
from suas_jax.skin.plain import clamped_edge

_LEAST_FORCE = 20.0  # upper end of a force's slider, unless the scene has a larger force [N]
_EDGE = 0.94  # of the half angle and half width that loads may be moved to
_FORCE, _FINGER = 5.0, 8e-3  # of a skin that comes without loads [N], [m]
_STIFFNESS = "stiffness"
SIZES = {"thickness": "geometry.thickness", "oil_gap": "geometry.oil_gap"}
"""TOML paths of the skin's dimensions that have sliders."""


def all_stated(scene: SceneSpec) -> SceneSpec:
    """The scene with the inputs of its sliders stated, and its loads as they are.

    Raises ValueError: a body has friction, which forbids moving it to and fro.
    """
    if any(body.friction is not None for body in scene.bodies):
        raise ValueError(
            "`suas view`: friction is modelled for a body that is pressed on once, not for one "
            "that moves to and fro; take `friction` out of the scene"
        )
    if scene.solve.oil_pressure is not None:
        scene = with_solve(scene, oil_pressure=None)
    pad = scene.geometry.dimension == 3
    loads: list[LoadSpec] = [
        load.model_copy(update={"axial": load.axial})
        if load.kind == "patch" or (load.kind == "body" and pad)
        else load
        for load in scene.loads
    ]
    if not loads:  # a skin alone: something to press it with
        place: dict[str, Any] = {"angle": 0.0} if scene.geometry.has_angle else {"arc": 0.0}
        loads.append(
            PatchLoadSpec(**place, force=_FORCE, axial=0.0, diameter=_FINGER)
            if pad
            else LineLoadSpec(**place, force=_FORCE)
        )
    return scene.model_copy(update={"loads": tuple(loads)})


def inputs_by(scene: SceneSpec, values: dict[str, float]) -> dict[str, float]:
    """The scene's inputs by TOML path, for the values of its sliders.

    Stiffness is one factor on the material's constants that are stresses.
    """
    found = {name: value for name, value in values.items() if name != _STIFFNESS}
    stresses = stresses_of(scene).items()
    found |= {path: values[_STIFFNESS] * value for path, value in stresses}
    return found


def sliders_of(scene: SceneSpec) -> list[dict[str, Any]]:
    """The controls of a scene: TOML path, label, unit, bounds and value in SI units."""
    geometry, found = scene.geometry, []

    def add(name: str, label: str, unit: str, scale: float, ends: tuple, value: float) -> None:
        least, most = ends
        found.append(
            {
                "name": name, "label": label, "unit": unit, "scale": scale,
                "least": min(least, value), "most": max(most, value), "value": value,
            }
        )  # fmt: skip

    end = _EDGE * geometry.width / 2
    reach = {by_arc: _EDGE * clamped_edge(geometry, by_arc)[0] for by_arc in (True, False)}
    for i, load in enumerate(scene.loads):
        which = f" {i + 1}" if len(scene.loads) > 1 else ""
        if load.kind == "pressure":
            now = load.pressure
            ends = min(0.0, 3 * now), max(0.0, 3 * now) or 1e4
            add(f"load.{i}.pressure", f"pressure{which}", "kPa", 1e-3, ends, now)
            continue
        if load.force is not None:
            most = max(_LEAST_FORCE, 2 * load.force)
            add(f"load.{i}.force", f"force{which}", "N", 1.0, (0.0, most), load.force)
        elif load.kind == "body" and load.depth is not None:
            most = max(geometry.mean_gap, 1.5 * load.depth)
            add(f"load.{i}.depth", f"travel{which}", "mm", 1e3, (0.0, most), load.depth)
        half = reach[load.arc is not None]
        if load.arc is not None:
            add(f"load.{i}.arc", f"arc{which}", "mm", 1e3, (-half, half), load.arc)
        elif load.angle is not None:
            add(f"load.{i}.angle", f"angle{which}", "°", 180 / np.pi, (-half, half), load.angle)
        if load.kind != "line" and geometry.dimension == 3:
            add(f"load.{i}.axial", f"along the axis{which}", "mm", 1e3, (-end, end), load.axial)
    for name, path in SIZES.items():
        size = getattr(geometry, name)
        if isinstance(size, float):  # tables along the skin have no one number
            add(path, name.replace("_", " "), "mm", 1e3, (size / 2, 2 * size), size)
    add(_STIFFNESS, "stiffness", "×", 1.0, (0.25, 4.0), 1.0)
    return found
