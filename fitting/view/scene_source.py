"""Pictures of a scene, solved again whenever a slider moves."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fitting.inverse_load.estimate.estimate import Contact
from fitting.view.bodies import placed, surfaces_of
from fitting.view.grid import Grid
from fitting.view.hub import Hub
from fitting.view.picture import Picture, arrow, describe, taxel_states
from fitting.view.scene_model import SceneModel, Solved
from fitting.view.sliders import SIZES, all_stated, inputs_by, sliders_of
from suas_jax.config import SceneSpec
from suas_jax.equilibrium.outcomes import advice
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.compiling import listening
from suas_jax.scene.taxel_film import TaxelFilm

_LOOK = 0.25  # between two looks whether to end [s]
_PREPARING = "The skin at rest, until the model is ready."
_COMPILING = "compiling, once for this kind of scene, up to a minute; pictures stand still"
_HALF_WIDTHS = "contact_half_width_m", "contact_half_width_axial_m"


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
        begin, compiling = time.perf_counter(), COMPILED.seconds
        values = inputs_by(self._scene, self._values)
        try:
            solved = self._model(values)
        except ValueError as error:
            return self._without_answer(elapsed, "not_allowed", str(error))
        spent = time.perf_counter() - begin - (COMPILED.seconds - compiling)
        so = solved.so if self._film is not None else np.zeros(0)
        change = so - self._rest_of(values) if self._film is not None else so
        contacts = self._contacts([load.get("force_N", 0.0) for load in solved.loads])
        return Picture(
            elapsed,
            solved.status,
            _in_words(solved),
            lambda: solved.displacement,
            change,
            taxel_states(so),
            self._arrows(contacts),
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

    def _contacts(self, forces: Sequence[float]) -> dict[int, Contact]:
        """The scene's loads that have a place, as contacts that are known, by their number."""
        found, values = {}, self._values
        for i, load in enumerate(self._scene.loads):
            if load.kind == "pressure":
                continue
            told = "angle" if load.arc is None else "arc"
            place = values[f"load.{i}.{told}"]
            angle = float(self._grid.places.from_place(told, np.asarray(place)))
            way = "radial" if load.kind == "body" else load.direction
            turn = way if isinstance(way, float) else 0.0
            if way == "vertical":
                turn = self._grid.direction(angle)
            arc = place if told == "arc" else None
            shown = float(self._grid.places.angle(np.asarray(angle)))
            axial = values.get(f"load.{i}.axial")
            found[i] = Contact(shown, forces[i], turn, None, axial=axial, arc=arc)
        return found

    def _arrows(self, contacts: dict[int, Contact]) -> list[dict[str, Any]]:
        """Contacts as they are drawn, with the sliders that dragging them moves."""
        return [
            arrow(contact, self._grid)
            | {
                "along": f"load.{i}.{'angle' if contact.arc is None else 'arc'}",
                "across": None if contact.axial is None else f"load.{i}.axial",
            }
            for i, contact in contacts.items()
        ]

    def _rows(self, solved: Solved, spent: float) -> list[tuple[str, str]]:
        moved = 1e3 * float(np.linalg.norm(solved.displacement, axis=1).max())
        bodies = [
            (f"body {i + 1}" if len(solved.loads) > 1 else "body", body_text(load))
            for i, load in enumerate(solved.loads)
            if "depth_m" in load
        ]
        return [
            *bodies,
            ("oil pressure", f"{1e-3 * solved.oil_pressure:.3f} kPa"),
            ("smallest gap", f"{1e3 * max(solved.min_gap, 0.0):.3f} mm"),
            ("largest displacement", f"{moved:.3f} mm"),
            ("solved in", f"{1e3 * spent:.0f} ms"),
        ]


def body_text(load: dict[str, Any]) -> str:
    """Travel, force and zone of contact of a body, from its report."""
    force, depth = load["force_N"], 1e3 * load["depth_m"]
    if force <= 0:
        return f"{depth:.3f} mm, touches nothing"
    zone = [2e3 * load[key] for key in _HALF_WIDTHS if key in load]
    over = " by ".join(f"{x:.1f}" for x in zone) + " mm"
    if not load["contact_resolved"]:
        over = "a zone smaller than the mesh"
    return f"{depth:.3f} mm, {force:.3f} N, over {over}"


def _in_words(solved: Solved) -> str:
    """What the outcome means."""
    if solved.status == "converged":
        return "The membrane lies on the wall." if solved.min_gap <= 0 else "In equilibrium."
    return advice(solved.status)
