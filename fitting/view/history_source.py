"""Pictures of a history: a scene's loads over time, solved before and then played."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.arrays import Floats
from fitting.view.hub import Hub, Player
from fitting.view.picture import Grid, Picture, arrow, describe, taxel_states
from fitting.view.scene_model import body_rows, known_contacts, moved
from suas_jax.equilibrium.outcomes import advice
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Inputs, Structure, build_problem
from suas_jax.scene.curve import total_force
from suas_jax.scene.program import inputs_of, structure_of
from suas_jax.scene.sweep import Sweep
from suas_jax.scene.taxel_film import TaxelFilm

_SECONDS = 12.0  # that playing takes at first


@eqx.filter_jit
def _moved(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, q: Array, points: Array
) -> Array:
    return moved(build_problem(scene.scene, plan, inputs).mechanics, q, *points)


class HistorySource:
    """A history on a timeline.

    `sweep`: that was solved, see `suas_jax.dynamics.history.history_sweep`. `title`: what the
    page calls it.
    """

    def __init__(self, sweep: Sweep, title: str) -> None:
        assert sweep.shown is not None
        self._sweep, self._shown, scene = sweep, sweep.shown, sweep.scene
        self._grid = Grid.of(scene.geometry)
        self._film = None if scene.electrodes is None else TaxelFilm(scene)
        loads = enumerate(scene.loads)
        at_touch = {f"load.{i}.depth": np.zeros(()) for i, x in loads if x.kind == "body"}
        self._known = structure_of(scene, wall=False), sweep.plan, at_touch | inputs_of(scene)
        self._points = jnp.stack([jnp.asarray(x) for x in self._grid.points])
        times = np.array([point["t_s"] for point in sweep.points])
        self._player = Player(times, _SECONDS)
        self.hub = Hub(
            describe(
                scene, self._grid, self._film, title,
                source="history", timeline=self._player.timeline,
            )
        )  # fmt: skip

    def run(self, over: Callable[[], bool]) -> None:
        """Play until it is over."""
        if self._sweep.film is not None:
            self.hub.say(self._sweep.film["message"])
        rows = [(p["t_s"], total_force(p), p["oil_pressure_Pa"]) for p in self._sweep.points]
        self.hub.chart(rows)
        self._player.run(self.hub, over, self._show)

    def _displacement(self, index: int) -> Floats:
        q = jnp.asarray(self._shown[index])
        return np.asarray(COMPILED.run(_moved, *self._known, q, self._points))

    def _show(self, index: int) -> None:
        point, film = self._sweep.points[index], self._film
        so = np.array([taxel["so"] for taxel in point.get("taxels", ())], float)
        loads = point["loads"]
        contacts = known_contacts(self._sweep.scene, self._grid, loads)
        converged = point["status"] == "converged"
        values = [
            *body_rows(loads),
            ("force", f"{total_force(point):.3f} N"),
            ("oil pressure", f"{1e-3 * point['oil_pressure_Pa']:.3f} kPa"),
            ("smallest gap", f"{1e3 * max(point['min_gap_m'], 0.0):.3f} mm"),
            ("largest displacement", f"{1e3 * point['max_displacement_m']:.3f} mm"),
            ("row", f"{index + 1} of {len(self._shown)}"),
        ]
        picture = Picture(
            point["t_s"],
            point["status"],
            "At this moment." if converged else advice(point["status"]),
            lambda: self._displacement(index),
            so - film.rest if film is not None else so,
            taxel_states(so),
            [arrow(contact, self._grid) for contact in contacts.values()],
            values,
            total_force(point),
            point["oil_pressure_Pa"],
            self._player.header,
        )
        self.hub.show(picture)
