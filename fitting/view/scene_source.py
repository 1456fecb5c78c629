"""Pictures of a scene, solved again whenever a slider moves."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from fitting.inverse_load.estimate.estimate import Contact
from fitting.view.grid import Grid
from fitting.view.hub import Hub
from fitting.view.picture import Picture, arrow, describe, taxel_states
from fitting.view.scene_model import AbstractSceneModel, Solved, crown, scene_model
from suas_jax.config import (
    LAWS,
    LineLoadSpec,
    LoadSpec,
    PatchLoadSpec,
    SceneSpec,
    continuous_inputs,
    with_solve,
)
from suas_jax.equilibrium.outcomes import advice
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.taxel_film import TaxelFilm
from suas_jax.skin.plain import clamped_edge, plain_geometry

_LOOK = 0.25  # between two looks whether to end [s]
_LEAST_FORCE = 20.0  # upper end of a force's slider, unless the scene has a larger force [N]
_EDGE = 0.94  # of the half angle and half width that loads may be moved to
_FORCE, _FINGER = 5.0, 8e-3  # of a skin that comes without loads [N], [m]
_COMPILING = (
    "The model is being compiled for this scene, which takes up to a minute; the program is "
    "kept for the next time."
)
_STIFFNESS = "stiffness"
_SIZES = {"thickness": "geometry.thickness", "oil_gap": "geometry.oil_gap"}


class SceneSource:
    """A scene whose loads, thickness, gap and stiffness can be changed."""

    def __init__(self, scene: SceneSpec, title: str) -> None:
        scene.require_no_bodies("`suas view`")
        scene = _all_stated(scene)
        self._scene = scene
        self._grid = Grid.of(scene.geometry)
        self._film = None if scene.electrodes is None else TaxelFilm(scene)
        self._model: AbstractSceneModel = scene_model(scene, self._grid)
        self._sliders = sliders_of(scene)
        self._values = {slider["name"]: slider["value"] for slider in self._sliders}
        description = describe(
            scene, self._grid, self._film, title, source="scene", sliders=self._sliders
        )
        self.hub = Hub(description)

    def run(self, over: Callable[[], bool]) -> None:
        """Answer the sliders until it is over."""
        began, wanted, first = time.monotonic(), True, True
        self.hub.show(self._without_answer(0.0, "compiling", _COMPILING))
        while not (over() or self.hub.closed):
            if wanted:
                self.hub.show(self._picture(time.monotonic() - began))
                if first:
                    self.hub.say(f"compiled in {COMPILED.seconds:.1f} s; move the sliders")
                    first = False
            wishes = self.hub.wishes(_LOOK)
            moved = {name: x for name, x in wishes.items() if name in self._values}
            wanted = bool(moved)
            self._values |= moved

    def _picture(self, elapsed: float) -> Picture:
        begin, compiling = time.perf_counter(), COMPILED.seconds
        values = {k: v for k, v in self._values.items() if k != _STIFFNESS}
        values |= stiffened(self._scene, self._values[_STIFFNESS])
        try:
            solved = self._model(values)
        except ValueError as error:
            return self._without_answer(elapsed, "not_allowed", str(error))
        spent = time.perf_counter() - begin - (COMPILED.seconds - compiling)
        so = solved.so if self._film is not None else np.zeros(0)
        change = so - self._rest_of(values) if self._film is not None else so
        states = taxel_states(so)
        return Picture(
            elapsed,
            solved.status,
            _in_words(solved),
            lambda: solved.displacement,
            change,
            states,
            [arrow(contact, self._grid) for contact in self._contacts(values)],
            self._rows(solved, spent),
            sum(contact.force for contact in self._contacts(values)),
            solved.oil_pressure if solved.status == "converged" else float("nan"),
            {"geometry": {k: values[p] for k, p in _SIZES.items() if p in values}},
        )

    def _without_answer(self, elapsed: float, status: str, message: str) -> Picture:
        """The skin at rest, and why there is no more to show."""
        nothing = np.zeros((len(self._grid.points[0]), 3))
        count = 0 if self._film is None else len(self._film.rest)
        nan = float("nan")
        return Picture(
            elapsed, status, message, lambda: nothing, np.full(count, nan),
            taxel_states(np.full(count, nan)), [], [], nan, nan,
        )  # fmt: skip

    def _rest_of(self, values: dict[str, float]) -> np.ndarray:
        """Counts at rest under the oil gap that the slider says."""
        assert self._film is not None
        gap = values.get(_SIZES["oil_gap"])
        return self._film.rest if gap is None else self._film.rest_under(gap)

    def _contacts(self, values: dict[str, float]) -> list[Contact]:
        """The scene's forces, as contacts whose place is known."""
        found = []
        for i, load in enumerate(self._scene.loads):
            if load.kind not in ("line", "patch"):
                continue
            told = "angle" if load.arc is None else "arc"
            place = values[f"load.{i}.{told}"]
            angle = float(self._grid.places.from_place(told, np.asarray(place)))
            turn = load.direction if isinstance(load.direction, float) else 0.0
            if load.direction == "vertical":
                turn = self._grid.direction(angle)
            pad = self._scene.geometry.dimension == 3 and load.kind == "patch"
            axial = values.get(f"load.{i}.axial") if pad else None
            arc = place if told == "arc" else None
            shown = float(self._grid.places.angle(np.asarray(angle)))
            force = values[f"load.{i}.force"]
            found.append(Contact(shown, force, turn, None, axial=axial, arc=arc))
        return found

    def _rows(self, solved: Solved, spent: float) -> list[tuple[str, str]]:
        moved = 1e3 * float(np.linalg.norm(solved.displacement, axis=1).max())
        return [
            ("oil pressure", f"{1e-3 * solved.oil_pressure:.3f} kPa"),
            ("smallest gap", f"{1e3 * max(solved.min_gap, 0.0):.3f} mm"),
            ("largest displacement", f"{moved:.3f} mm"),
            ("solved in", f"{1e3 * spent:.0f} ms"),
        ]


def _in_words(solved: Solved) -> str:
    """What the outcome means."""
    if solved.status == "converged":
        touching = solved.min_gap <= 0
        return "The membrane lies on the wall." if touching else "In equilibrium."
    return advice(solved.status)


def _all_stated(scene: SceneSpec) -> SceneSpec:
    """The scene with the inputs of its sliders stated, and its loads as they are."""
    if scene.solve.oil_pressure is not None:
        scene = with_solve(scene, oil_pressure=None)
    loads: list[LoadSpec] = [
        load.model_copy(update={"axial": load.axial} if load.kind == "patch" else {})
        for load in scene.loads
    ]
    if not loads:  # a skin alone: something to press it with
        pad, place = scene.geometry.dimension == 3, crown(scene.geometry)
        loads.append(
            PatchLoadSpec(**place, force=_FORCE, axial=0.0, diameter=_FINGER)
            if pad
            else LineLoadSpec(**place, force=_FORCE)
        )
    return scene.model_copy(update={"loads": tuple(loads)})


def stiffened(scene: SceneSpec, factor: float) -> dict[str, float]:
    """The material's constants that are stresses, times a factor, by TOML path."""
    inputs = continuous_inputs(scene)
    declared = LAWS[scene.material.law].declared()
    return {
        path: factor * value
        for path, value in inputs.items()
        if path.startswith("material.") and declared[path.split(".")[1]].dimension == "stress"
    }


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

    section, end = plain_geometry(geometry).section, _EDGE * geometry.width / 2
    reach = {by_arc: _EDGE * clamped_edge(section, by_arc)[0] for by_arc in (True, False)}
    for i, load in enumerate(scene.loads):
        which = f" {i + 1}" if len(scene.loads) > 1 else ""
        if load.kind == "pressure":
            now = load.pressure
            ends = min(0.0, 3 * now), max(0.0, 3 * now) or 1e4
            add(f"load.{i}.pressure", f"pressure{which}", "kPa", 1e-3, ends, now)
            continue
        assert load.kind != "body"  # refused above
        most = max(_LEAST_FORCE, 2 * load.force)
        add(f"load.{i}.force", f"force{which}", "N", 1.0, (0.0, most), load.force)
        half = reach[load.arc is not None]
        if load.arc is not None:
            add(f"load.{i}.arc", f"arc{which}", "mm", 1e3, (-half, half), load.arc)
        elif load.angle is not None:
            add(f"load.{i}.angle", f"angle{which}", "°", 180 / np.pi, (-half, half), load.angle)
        if load.kind == "patch":
            add(f"load.{i}.axial", f"along the axis{which}", "mm", 1e3, (-end, end), load.axial)
    for name, path in _SIZES.items():
        size = getattr(geometry, name)
        if isinstance(size, float):  # tables along the skin have no one number
            add(path, name.replace("_", " "), "mm", 1e3, (size / 2, 2 * size), size)
    add(_STIFFNESS, "stiffness", "×", 1.0, (0.25, 4.0), 1.0)
    return found
