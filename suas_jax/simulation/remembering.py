"""Capacitances along a load path of a skin whose membrane remembers, and was at rest before.

Loads may move over a section; on a pad, whose elements gather at loads, they stay.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.constitutive.relaxation import PronySeries
from suas_jax.dynamics.driven import (
    AbstractDriven,
    DrivenSkin,
    Travels,
    Values,
    answering,
    seen,
    series_of,
)
from suas_jax.dynamics.steps import Moment, Rows, begun, followed
from suas_jax.equilibrium.balance import Problem
from suas_jax.mechanics.pad.model import PadMesh
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Inputs, Structure
from suas_jax.scene.loads import Loads
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of
from suas_jax.scene.skin import Skin
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.simulation.pad_frames import no_solution

_BLOCK = 64  # frames that one call follows
_TOLERANCE = 1e-5  # error of the stress that a step may make
_LOADS = ("angle", "force", "turn", "external_pressure")


@dataclasses.dataclass(frozen=True)
class _Section(AbstractDriven):
    """A section on an even mesh, whose loads may move."""

    skin: Skin

    def problem(self, values: Values, travels: Travels) -> Problem:
        """See the base class."""
        del travels
        return self.skin.problem(Loads(*(values[key] for key in _LOADS)))


def _read(
    skin: AbstractDriven, electrodes: Electrodes
) -> Callable[[Moment], tuple[Array, Array, Array, Array]]:
    """Reads capacitances, whether the membrane passes the wall, outcome and time."""

    def read(now: Moment) -> tuple[Array, Array, Array, Array]:
        relaxed = now.past.relaxed(skin.series)
        problem = answering(skin.problem(now.values, now.travels), relaxed)
        shown = seen(problem, now.state)[1]
        mechanics = problem.mechanics.around(now.state.q)
        found = electrodes.read(mechanics, shown.q)
        gap = mechanics.shape(shown.q).smallest_gap(electrodes.geometry).value
        return found.capacitance[:, 0], gap[0], now.result[0], now.time

    return read


def _block(
    skin: AbstractDriven, electrodes: Electrodes, rows: Rows, start: Moment | Values
) -> tuple[Moment, tuple[Array, Array, Array, Array]]:
    begin = start if isinstance(start, Moment) else begun(skin, rows.begin[0], start)
    return followed(skin, rows, begin, jnp.asarray(_TOLERANCE), _read(skin, electrodes))


@eqx.filter_jit
def _section_block(
    skin: Skin, series: PronySeries, rows: Rows, start: Moment | Values
) -> tuple[Moment, tuple[Array, Array, Array, Array]]:
    return _block(_Section(series, skin), skin.electrodes, rows, start)


@eqx.filter_jit
def _pad_block(
    scene: Structure, plan: PadMesh, inputs: Inputs, rows: Rows, start: Moment | Values
) -> tuple[Moment, tuple[Array, Array, Array, Array]]:
    driven = DrivenSkin.of(scene, plan, inputs, rows.final)
    electrodes = scene_parts(scene.scene, inputs).skin.sensing()
    return _block(driven, electrodes, rows, start)


def followed_section(
    scene: SceneSpec,  # that remembers, with the instantaneous response
    skins: tuple[Skin, Skin],  # without and with its wall
    time: NDArray[np.float64],  # of the frames [s]
    loads: Loads,  # a lane a frame
    progress: Callable[[int], None],  # called with the number of frames done
) -> NDArray[np.float64]:
    """Capacitances of a section along a path [frame, taxel] [F].

    Raises NoSolutionError: a load has no equilibrium.
    """
    values = {
        key: np.moveaxis(np.asarray(getattr(loads, key)), -1, 0)[..., None] for key in _LOADS
    }
    series, few = series_of(scene, inputs_of(scene)), len(time) < _BLOCK

    def run(rows: Rows, start: Moment | Values, *, held: bool) -> Any:
        return COMPILED.run(_section_block, skins[held], series, rows, start, once=few)

    return _followed(time, values, run, progress, holds=skins[True].wall is not None)


def followed_pad(
    scene: SceneSpec,
    plan: PadMesh,
    time: NDArray[np.float64],
    moved: dict[str, NDArray[np.float64]],
    progress: Callable[[int], None],
) -> NDArray[np.float64]:
    """The same of a pad on a mesh, whose inputs are `moved` by path [frame]."""
    inputs = inputs_of(scene)

    def run(rows: Rows, start: Moment | Values, *, held: bool) -> Any:
        known = Structure(scene, wall=held), plan, inputs
        return COMPILED.run(_pad_block, *known, rows, start, once=True, long=True)

    sizes = {k for k in continuous_inputs(scene) if k.endswith((".force", ".pressure"))}
    constant = {k: np.full(len(time), inputs[k]) for k in sizes if k.startswith("load.")}
    return _followed(time, constant | moved, run, progress, holds=scene.wall.contact)


def _followed(
    time: NDArray[np.float64],
    values: dict[str, NDArray[np.float64]],
    run: Callable[..., Any],
    progress: Callable[[int], None],
    *,
    holds: bool,
) -> NDArray[np.float64]:
    """Block after block; with the wall from the one on in which it is reached."""
    loads = ("force", "pressure")
    rest = {k: 0 * x[0] if k.endswith(loads) else x[0] for k, x in values.items()}
    start: Moment | Values = jax.tree.map(jnp.asarray, rest)
    held, found = False, []
    for first in range(0, len(time), _BLOCK):
        rows = _rows(time, values, rest, first)
        end, read = run(rows, start, held=held)
        if holds and not held and bool(np.any(np.asarray(read[1]) < 0)):
            held = True
            end, read = run(rows, start, held=True)
        capacitance, _, result, reached = (np.asarray(x) for x in read)
        lost = np.flatnonzero(result)
        if lost.size:
            raise no_solution(reached[lost[0]], result[lost[0]])
        found.append(capacitance)
        start = end
        progress(min(first + _BLOCK, len(time)))
    return np.concatenate(found)[: len(time)]


def _rows(
    time: NDArray[np.float64],
    values: dict[str, NDArray[np.float64]],
    rest: dict[str, NDArray[np.float64]],
    first: int,
) -> Rows:
    """Some frames; the last one is repeated without duration to fill up."""
    wanted = np.arange(first, first + _BLOCK)
    index = np.minimum(wanted, len(time) - 1)
    before = np.where(wanted < len(time), np.maximum(index - 1, 0), index)
    begin = {k: x[before] for k, x in values.items()}
    if first == 0:
        begin = {k: np.concatenate([rest[k][None], x[1:]]) for k, x in begin.items()}
    end = {k: x[index] for k, x in values.items()}
    rows = time[before], time[index], begin, end, wanted < len(time)
    return Rows(*jax.tree.map(jnp.asarray, rows))
