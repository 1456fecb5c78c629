"""Pictures of a scene, solved again whenever a slider moves."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from fitting.inverse_load.estimate.estimate import Contact
from fitting.view.grid import Grid
from fitting.view.hub import Hub
from fitting.view.known_loads import body_rows, known_contacts, placed, surfaces_of
from fitting.view.picture import Picture, arrow, describe, taxel_states
from fitting.view.scene_model import SceneModel, Solved
from fitting.view.sliders import SIZES, all_stated, inputs_by, sliders_of
from suas_jax.config import SceneSpec
from suas_jax.equilibrium.outcomes import advice
from suas_jax.runtime.compiling import COMPILE_TIME, listening
from suas_jax.scene.taxel_film import TaxelFilm

_LOOK = 0.25  # between two looks whether to end [s]
_PREPARING = "The skin at rest, until the model is ready."
_COMPILING = "compiling, once for this kind of scene, up to a minute; pictures stand still"


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
