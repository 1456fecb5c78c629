"""Figures of a pad under round contacts as functions of its variables.

Readings have exact derivatives by place and force, through `forward`; derivatives of figures by
the variables are central differences between skins a small step away. All skins share the
meshes of the skin to start from, so that figures change smoothly, and their states begin with
the design's own. Of a pad that is its own mirror image a quarter of the places is solved.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats, Rows
from fitting.datasheet.figures import Accuracy, Cases, figures_at
from fitting.datasheet.pad import ELEMENTS
from fitting.datasheet.readings import Readings, far_taxels, read
from fitting.datasheet.words import PLACED
from fitting.design.problem import STEP, Outcome, Problem, without_crosstalk
from fitting.design.want import Want
from fitting.force_range.bound import rated_force
from fitting.inverse_load.pad.facts import PadShape
from fitting.inverse_load.pad.rest import film_readings
from fitting.inverse_load.pad.table import grid
from fitting.inverse_load.pad.table_build import mirror_images
from fitting.inverse_load.settings import DIAMETER, PAD_MODEL_ERROR
from suas_jax import Loads, Skin, forward, skin_of
from suas_jax.equilibrium.balance import State
from suas_jax.mechanics.pad.net import NetTopology
from suas_jax.runtime.compiled import COMPILED

_AXIALS = 3  # places along the axis
_LIGHT = ("sensitivity_counts_per_N", "detection_limit_N")  # figures of slopes at rest
_CLOSED = 1e-4  # of the film's gap, from where Newton's step to first contact is exact
_TRIES, _GROWTH = 40, (1.05, 2.0)  # forces on the way there, and what they grow by
_APART = 1e-3  # relative, of two forces that tell how the gap falls


class _Solved(NamedTuple):
    """Readings of a place, one a skin; None where they are not asked for."""

    rest: list[Readings] | None
    half: list[Readings] | None
    rated: list[Readings]
    touch: Floats  # first contact [skin] [N]


@eqx.filter_jit
def _read(skin: Skin, loads: Loads, start: State) -> tuple[Readings, State]:
    return read(skin, loads, start)


def _silent(text: str) -> None:
    """What a copy in another process tells."""


class PadProblem(Problem):
    """The figures of a pad under contacts of the data sheet's diameter."""

    tolerance: ClassVar[float] = 1e-5

    def __init__(
        self,
        want: Want,
        progress: Callable[[str], None] = _silent,
        elements: tuple[int, int] = ELEMENTS,  # of the meshes
        axials: int = _AXIALS,  # places along the axis
    ) -> None:
        super().__init__(want)
        self.elements, self._tell, self._designs = elements, progress, 0
        spec = want.spec
        skin = skin_of(spec, elements=elements, contact=False)
        taxels, edge = skin.electrodes.taxels.places, np.array(PadShape.of(skin).edge(DIAMETER))
        first, last = taxels.min(0), taxels.max(0)
        if want.angles is not None:
            first[0], last[0] = want.angles
        self.ends = np.clip(first, -edge, edge), np.clip(last, -edge, edge)
        self.grid = want.places, axials
        at = grid(*(np.linspace(*ends) for ends in zip(*self.ends, self.grid, strict=True)))
        self._at = at  # the places, angle [rad] and position [m] [place, coordinate]
        even = spec.geometry.mirrored_along_axis and skin.geometry.symmetric
        self._mirrored = even and bool(np.allclose(-self.ends[0], self.ends[1]))
        self._image = (at < 0) @ [1, 2] if self._mirrored else np.zeros(len(at), int)
        own = np.round(np.abs(at) if self._mirrored else at, 12)
        # Which of the places that are solved each place is, or is an image of.
        self._places, self._of = np.unique(own, axis=0, return_inverse=True)
        self._meshes = [skin.around(self._loads(k, 0.0)).mesh for k in range(len(self._places))]
        self._near = np.full(len(self._places), np.nan)  # first contact of the last design
        self.rated = want.force or 1.0
        if want.force is None:
            progress("first contact")
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                places = range(len(self._places))
                touch = list(pool.map(partial(self._contacts, [skin]), places))
            self.rated = rated_force(np.concatenate(touch))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_tell": _silent}

    def placed(self, x: Floats) -> Outcome:
        """The figures that have places; see the base class."""
        steps = STEP * np.eye(len(x))
        rows = [x, *(x + side * step for step in steps for side in (-1.0, 1.0))]
        plain = [self._skin_at(row) for row in rows]
        pairs = [(skin, np.arange(len(skin.electrodes.taxels.places))[None]) for skin in plain]
        if self._mirrored:
            pairs = [mirror_images(skin) for skin in plain]
        skins, where = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        self._designs += 1
        found, count = [], len(self._places)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for solved in pool.map(partial(self._solved, plain, skins), range(count)):
                found.append(solved)
                self._tell(f"design {self._designs}: {len(found)} of {count} places")
        cases = self._cases(found, plain, where)
        result = (cases.rest.result, cases.half.result, cases.rated.result)
        accuracy = Accuracy(self.want.spec.sensing.noise, PAD_MODEL_ERROR)
        far = far_taxels(plain[0], self._at)
        figures = jax.tree.map(np.asarray, figures_at(cases, accuracy, far))
        none = without_crosstalk(self.keys, far)
        values = {
            key: np.where(zero, 0.0, getattr(figures, PLACED[key].field))
            for key, zero in zip(self.keys, none, strict=True)
        }
        good = all(np.isfinite(value).all() for value in values.values())
        return Outcome(
            {key: value[0] for key, value in values.items()},
            {key: ((v[2::2] - v[1::2]) / (2 * STEP)).T for key, v in values.items()},
            good and not any(np.any(x) for x in result),
        )

    def _skin_at(self, x: Floats) -> Skin:
        inputs = self.want.inputs(x)
        return skin_of(self.want.spec, inputs, elements=self.elements, contact=False)

    def _loads(self, k: int, force: float) -> Loads:
        return Loads.patch(*self._places[k], force, DIAMETER)

    def _on_mesh(self, skin: Skin, k: int) -> Skin:
        return replace(skin, mesh=self._meshes[k])

    def _rest(self, k: int) -> State:
        """Where paths begin: one program serves them and states from neighbours."""
        mesh, zero = self._meshes[k], jnp.zeros(1)
        assert mesh is not None
        return State(jnp.zeros((*NetTopology(*mesh.axes).free.shape, 1)), zero, zero)

    def _solved(self, plain: Sequence[Skin], skins: Sequence[Skin], k: int) -> _Solved:
        """What is asked for of a place on the design and its neighbours.

        `skins` are the `plain` ones with images of their taxels.
        """
        touch = np.full(len(skins), self.rated)
        if "range_N" in self.keys:
            touch = self._contacts(plain, k)
        rest = half = None
        if skins[0].prestressed or set(_LIGHT) & set(self.keys):
            rest = self._readings(skins, k, 0.0)
        if "nonlinearity" in self.keys:
            half = self._readings(skins, k, self.rated / 2)
        return _Solved(rest, half, self._readings(skins, k, self.rated), touch)

    def _readings(self, skins: Sequence[Skin], k: int, force: float) -> list[Readings]:
        """Under a force, of the design first, whose state the others begin with."""
        found, start = [], self._rest(k)
        for i, skin in enumerate(skins):
            pad, loads = self._on_mesh(skin, k), self._loads(k, force)
            readings, state = COMPILED.run(_read, pad, loads, start)
            found.append(jax.tree.map(lambda x: np.asarray(x)[..., 0], readings))
            start = state if i == 0 and force > 0 else start
        return found

    def _contacts(self, skins: Sequence[Skin], k: int) -> Floats:
        """First contact of the design and its neighbours [skin] [N]; NaN where unknown.

        That of a neighbour is a step of Newton's method from the design's.
        """

        def gap(skin: Skin, force: float, start: State) -> tuple[float, State]:
            found = forward(self._on_mesh(skin, k), self._loads(k, force), start)
            good = bool(found.solved[0])
            return float(found.min_gap[0]) if good else np.nan, found.state

        film = float(skins[0].geometry.oil_gap[0])
        force = self._near[k] if np.isfinite(self._near[k]) else self.rated
        low, high, state = (0.0, film), (np.inf, np.nan), self._rest(k)
        for _ in range(_TRIES):
            left, state = gap(skins[0], force, state)
            if not np.isfinite(left):
                return np.full(len(skins), np.nan)
            if abs(left) < _CLOSED * film:
                break
            low, high = ((force, left), high) if left > 0 else (low, (force, left))
            if np.isinf(high[0]):
                ahead = film / max(film - left, 1e-3 * film)  # of a gap that falls evenly
                force *= float(np.clip(ahead, *_GROWTH))
            else:
                share = np.clip(low[1] / (low[1] - high[1]), 0.1, 0.9)
                force = float(low[0] + share * (high[0] - low[0]))
        else:
            return np.full(len(skins), np.nan)
        further = gap(skins[0], force * (1 + _APART), state)[0]
        before = gap(skins[0], force * (1 - _APART), state)[0]
        slope = (further - before) / (2 * _APART * force)
        gaps = [left, *(gap(skin, force, state)[0] for skin in skins[1:])]
        self._near[k] = force
        return force - np.array(gaps) / slope

    def _cases(
        self, found: list[_Solved], skins: Sequence[Skin], where: Sequence[Rows]
    ) -> Cases:
        """Readings of all places on all skins [taxel, skin, place]."""

        def all_places(rows: list[list[Readings]]) -> Readings:
            """From those of the places that are solved [place, skin]."""
            own = [
                [_seen(rows[k][i], taxels[image]) for i, taxels in enumerate(where)]
                for k, image in zip(self._of, self._image, strict=True)
            ]
            columns = [jax.tree.map(lambda *x: np.stack(x, -1), *skins) for skins in own]
            both: Readings = jax.tree.map(lambda *x: np.stack(x, -1), *columns)
            return both

        rated = all_places([x.rated for x in found])
        rest, half = rated, rated
        if found[0].rest is not None:
            rest = all_places([x.rest for x in found if x.rest is not None])
        else:
            film = np.array([film_readings(skin) for skin in skins]).T
            rest = rest._replace(so=np.broadcast_to(film[..., None], rest.so.shape))
        if found[0].half is not None:
            half = all_places([x.half for x in found if x.half is not None])
        touch = np.array([found[k].touch for k in self._of]).T
        zero = np.zeros_like(touch)
        near = rated._replace(gap=zero, gap_slope=zero - 1)
        return Cases(rest, half, rated, near, touch)


def _seen(readings: Readings, taxels: Rows) -> Readings:
    """What a contact's mirror image does, by the taxels that are images of the pad's own."""
    return readings._replace(so=readings.so[taxels], slope=readings.slope[:, taxels])
