"""Readings under a load field: forces at many nodes of the outer face, and derivatives.

Nodes lie on an even grid, along the arc of a section, along arc and axis of a pad. Each carries
a dead force along the inward normal. They are closer than a dent is wide, so that forces of the
same size press as an even pressure does.
"""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fitting.arrays import Floats
from fitting.inverse_load.estimate.place import ContactPlaces
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import differentiable, equilibrium
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin
from suas_jax.skin.loads import PadLoadPoints
from suas_jax.skin.section import AbstractSection, outward

_SPACING = 4e-3, 9e-3  # between nodes of a section and of a pad, at most [m]


class FieldNodes(NamedTuple):
    """Nodes of a load field on one skin."""

    # angle [rad] and, on a pad, position along the axis from the middle [m] [node, coordinate]
    places: Floats
    direction: Floats  # of the normal from the symmetry axis, clockwise [node] [rad]

    @classmethod
    def at(cls, skin: Skin, places: Floats) -> "FieldNodes":
        """Nodes at places."""
        found = COMPILED.run(_direction, skin.geometry.section, places[:, :1], once=True)
        return cls(places, np.asarray(found)[:, 0])


class FieldState(NamedTuple):
    """What the model says of a load field."""

    so: Float[Array, " taxel"]  # readings [counts]
    # by the nodes' forces, of the readings [counts/N] and, last, of the pressure [Pa/N]; empty
    # where not asked for
    jacobian: Float[Array, "channel node"]
    pressure: Float[Array, ""]  # of the oil [Pa]
    min_gap: Float[Array, ""]  # between membrane and wall [m]
    state: State
    outcome: Int[Array, ""]  # 0 where it is an equilibrium

    @property
    def channels(self) -> Float[Array, " channel"]:
        """Readings and, last, the oil's pressure."""
        return jnp.append(self.so, self.pressure)


def even_nodes(skin: Skin, edge: Floats, along: ContactPlaces) -> FieldNodes:
    """An even grid over a skin; its largest angle [rad] and axial position [m] are given."""
    half = np.array([float(along.outer_arc(edge[0])), *edge[1:]])
    counts = np.ceil(2 * half / _SPACING[skin.is_pad]).astype(int) + 1
    axes = [np.linspace(-e, e, n) for e, n in zip(edge, counts, strict=True)]
    places = np.stack([x.reshape(-1) for x in np.meshgrid(*axes, indexing="ij")], 1)
    return FieldNodes.at(skin, places)


class FieldForward:
    """The model of one skin under forces at nodes."""

    def __init__(self, skin: Skin, nodes: FieldNodes) -> None:
        self._skin, self._nodes = skin.around(_no_patches()), nodes

    def rest(self) -> State:
        """The undeformed state, where fits of a load field begin."""

        def rest() -> Array:
            none = jnp.zeros((len(self._nodes.places), 1))
            return _problem(self._skin, self._nodes, none).mechanics.rest()

        zero = jnp.zeros(1)
        return State(jnp.zeros(jax.eval_shape(rest).shape), zero, zero)

    def __call__(self, force: Floats, start: State) -> FieldState:
        """Readings and slopes under forces [node] [N], from the state of a field nearby."""
        return self._run(_FIELD_PROGRAM, force, start)

    def state(self, force: Floats, start: State) -> FieldState:
        """The same without slopes."""
        return self._run(_STATE_PROGRAM, force, start)

    def _run(self, program: Any, force: Floats, start: State) -> FieldState:
        given = self._skin, self._nodes, force[:, None], start
        found: FieldState = COMPILED.run(program, *given)
        return found


def _problem(skin: Skin, nodes: FieldNodes, force: Float[Array, "node 1"]) -> Problem:
    places, zero = jnp.asarray(nodes.places)[..., None], jnp.zeros(1)
    angle = places[:, 0]
    if not skin.is_pad:
        return skin.problem(Loads(angle, force, jnp.zeros_like(force), zero))
    inward = -outward(jnp.asarray(nodes.direction)[:, None])
    towards = jnp.concatenate([inward, jnp.zeros_like(inward[:1])])
    points = PadLoadPoints(angle, places[:, 1], force * towards)
    problem = skin.problem(_no_patches())
    pad = problem.mechanics
    assert isinstance(pad, Pad)
    return dataclasses.replace(problem, mechanics=dataclasses.replace(pad, points=points))


def _no_patches() -> Loads:
    return Loads.patch(*[np.zeros((0, 1))] * 4)


def _state(
    skin: Skin, nodes: FieldNodes, force: Float[Array, "node 1"], start: State
) -> FieldState:
    problem = _problem(skin, nodes, force)
    found = equilibrium(problem, start, omitted=not skin.is_pad)
    root = jax.lax.stop_gradient(found.state)
    _, shown, membrane = corrected(problem, root, found.change)
    gap = membrane.shape(shown.q).smallest_gap(skin.geometry).value
    read = skin.electrodes.read(membrane, shown.q).so[:, 0]
    none = jnp.zeros((0, len(force)))
    return FieldState(read, none, shown.pressure[0], gap[0], root, found.outcome[0])


def _with_slopes(
    skin: Skin, nodes: FieldNodes, force: Float[Array, "node 1"], start: State
) -> FieldState:
    at = _state(skin, nodes, force, start)

    def channels(force: Float[Array, "node 1"]) -> Float[Array, " channel"]:
        moved = _problem(skin, nodes, force)
        known = differentiable(moved, at.state)
        so = skin.electrodes.read(moved.mechanics, known.q).so[:, 0]
        return jnp.append(so, known.pressure)

    along = jax.linearize(channels, force)[1]
    return at._replace(jacobian=jax.vmap(along, out_axes=1)(jnp.eye(len(force))[..., None]))


@eqx.filter_jit
def _direction(section: AbstractSection, angle: Array) -> Array:
    return section.direction(angle)


_STATE_PROGRAM = eqx.filter_jit(_state)
_FIELD_PROGRAM = eqx.filter_jit(_with_slopes)
