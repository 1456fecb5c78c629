"""Pictures of a scene, solved again whenever one of its sliders moves."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from fitting.inverse_load.estimate.estimate import Contact
from fitting.view.hub import Hub
from fitting.view.picture import Grid, Picture, arrow, describe, taxel_states
from fitting.view.scene_model import (
    SceneModel,
    Solved,
    body_rows,
    known_contacts,
    placed,
    surfaces_of,
)
from suas_jax.config import LineLoadSpec, LoadSpec, PatchLoadSpec, SceneSpec, with_solve
from suas_jax.config.input_errors import stresses_of
from suas_jax.equilibrium.outcomes import advice
from suas_jax.runtime.compiling import COMPILE_TIME, listening
from suas_jax.scene.taxel_film import TaxelFilm
from suas_jax.skin.plain import clamped_edge

_LEAST_FORCE = 20.0  # upper end of a force's slider, unless the scene has a larger force [N]
_EDGE = 0.94  # of the half angle and half width that loads may be moved to
_FORCE, _FINGER = 5.0, 8e-3  # of a skin that comes without loads [N], [m]
_STIFFNESS = "stiffness"
SIZES = {"thickness": "geometry.thickness", "oil_gap": "geometry.oil_gap"}
"""TOML paths of the skin's dimensions that have sliders."""
_LOOK = 0.25  # between two looks whether to end [s]
_PREPARING = "The skin at rest, until the model is ready."
_COMPILING = "compiling, once for this kind of scene, up to a minute; pictures stand still"


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


class SceneSource:
    """A scene whose loads, thickness, gap and stiffness can be changed."""

    def __init__(self, scene: SceneSpec, title: str) -> None:
        scene = all_stated(scene)
        self._scene = scene
        self._grid = Grid.of(scene.geometry)
        self._film = None if scene.electrodes is None else TaxelFilm(scene)
        self._model = SceneModel(scene, self._grid)
        self._sliders = sliders_of(scene)
        self._values = {slider["name"]: slider["value"] for slider in self._sliders}
        description = describe(
            scene, self._grid, self._film, title, source="scene", sliders=self._sliders
        )
        description["bodies"] = surfaces_of(scene)
        self.hub = Hub(description)

    def run(self, over: Callable[[], bool]) -> None:
        """Answer the sliders until it is over."""
        began, wanted, ready = time.monotonic(), True, False
        self.hub.show(self._without_answer(0.0, "preparing", _PREPARING))
        with listening(self._compiling):
            while not (over() or self.hub.closed):
                if wanted:
                    self.hub.show(self._picture(time.monotonic() - began))
                if not ready:
                    ready = True
                    seconds = time.monotonic() - began
                    self.hub.say(f"ready after {seconds:.1f} s: move a slider, drag an arrow")
                wishes = self.hub.wishes(_LOOK)
                moved = {name: x for name, x in wishes.items() if name in self._values}
                wanted = bool(moved)
                self._values |= moved

    def _compiling(self, begins: bool) -> None:
        self.hub.say(_COMPILING if begins else "compiled")

    def _picture(self, elapsed: float) -> Picture:
        begin, compiling = time.perf_counter(), COMPILE_TIME.seconds
        values = inputs_by(self._scene, self._values)
        try:
            solved = self._model(values)
        except ValueError as error:
            return self._without_answer(elapsed, "not_allowed", str(error))
        spent = time.perf_counter() - begin - (COMPILE_TIME.seconds - compiling)
        so = solved.so if self._film is not None else np.zeros(0)
        change = so - self._rest_of(values) if self._film is not None else so
        contacts = known_contacts(self._scene, self._grid, solved.loads)
        return Picture(
            elapsed,
            solved.status,
            _in_words(solved),
            lambda: solved.displacement,
            change,
            taxel_states(so),
            [self._arrow(i, contact) for i, contact in contacts.items()],
            self._rows(solved, spent),
            sum(contact.force for contact in contacts.values()),
            solved.oil_pressure if solved.converged else float("nan"),
            {
                "geometry": {k: values[p] for k, p in SIZES.items() if p in values},
                "bodies": placed(solved.bodies),
            },
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
        gap = values.get(SIZES["oil_gap"])
        return self._film.rest if gap is None else self._film.rest_under(gap)

    def _arrow(self, i: int, contact: Contact) -> dict[str, Any]:
        """A load as it is drawn, with the sliders that dragging it moves."""
        arc = f"load.{i}.arc"
        along = arc if arc in self._values else f"load.{i}.angle"
        across = None if contact.axial is None else f"load.{i}.axial"
        return arrow(contact, self._grid) | {"along": along, "across": across}

    def _rows(self, solved: Solved, spent: float) -> list[tuple[str, str]]:
        moved = 1e3 * float(np.linalg.norm(solved.displacement, axis=1).max())
        return [
            *body_rows(solved.loads),
            ("oil pressure", f"{1e-3 * solved.oil_pressure:.3f} kPa"),
            ("smallest gap", f"{1e3 * max(solved.min_gap, 0.0):.3f} mm"),
            ("largest displacement", f"{moved:.3f} mm"),
            ("solved in", f"{1e3 * spent:.0f} ms"),
        ]


def _in_words(solved: Solved) -> str:
    """What the outcome means."""
    if solved.status == "converged":
        return "The membrane lies on the wall." if solved.min_gap <= 0 else "In equilibrium."
    return advice(solved.status)
