"""Readings under a load field: forces at many nodes of the outer face, and derivatives.

Nodes lie on an even grid, along the arc of a section, along arc and axis of a pad. Each carries
a dead force along the inward normal. They are closer than a dent is wide, so that forces of the
same size press as an even pressure does.
"""

import dataclasses
from typing import NamedTuple

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
from suas_jax.skin.pad_loads import PadLoadPoints
from suas_jax.skin.section import outward

_SPACING = 4e-3, 9e-3  # between nodes of a section and of a pad, at most [m]


class FieldNodes(NamedTuple):
    """Nodes of a load field on one skin."""

    # angle [rad] and, on a pad, position along the axis from the middle [m] [node, coordinate]
    places: Floats
    metres: Floats  # where they are on the unrolled outer face [node, coordinate] [m]
    direction: Floats  # of the normal from the symmetry axis, clockwise [node] [rad]


class FieldState(NamedTuple):
    """What the model says of a load field."""

    so: Float[Array, " taxel"]  # readings [counts]
    jacobian: Float[Array, "taxel node"]  # by the nodes' forces [counts/N]
    pressure: Float[Array, ""]  # of the oil [Pa]
    min_gap: Float[Array, ""]  # between membrane and wall [m]
    state: State
    outcome: Int[Array, ""]  # 0 where it is an equilibrium


def nodes_of(skin: Skin, edge: Floats, along: ContactPlaces) -> FieldNodes:
    """The nodes of a skin; its largest angle [rad] and axial position [m] are given."""
    half = np.array([float(along.outer_arc(edge[0])), *edge[1:]])
    counts = np.ceil(2 * half / _SPACING[skin.is_pad]).astype(int) + 1
    axes = [np.linspace(-e, e, n) for e, n in zip(edge, counts, strict=True)]
    places = np.stack([x.reshape(-1) for x in np.meshgrid(*axes, indexing="ij")], 1)
    angle = places[:, 0]
    metres = np.column_stack([along.outer_arc(angle), places[:, 1:]])
    direction = np.asarray(skin.geometry.section.direction(jnp.asarray(angle)[:, None]))[:, 0]
    return FieldNodes(places, metres, direction)


class FieldForward:
    """The model of one skin under forces at nodes."""

    def __init__(self, skin: Skin, nodes: FieldNodes) -> None:
        self._skin, self._nodes = skin.around(_no_patches()), nodes

    def rest(self) -> State:
        """The undeformed state, where fits of a load field begin."""
        zero = jnp.zeros(1)
        rest = _problem(self._skin, self._nodes, jnp.zeros((len(self._nodes.places), 1)))
        return State(rest.mechanics.rest(), zero, zero)

    def __call__(self, force: Floats, start: State) -> FieldState:
        """Readings under forces [node] [N], from the state of a field nearby."""
        given = self._skin, self._nodes, force[:, None], start
        found: FieldState = COMPILED.run(_FIELD_PROGRAM, *given)
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


def _evaluated(
    skin: Skin, nodes: FieldNodes, force: Float[Array, "node 1"], start: State
) -> FieldState:
    problem = _problem(skin, nodes, force)
    found = equilibrium(problem, start, omitted=not skin.is_pad)
    root = jax.lax.stop_gradient(found.state)
    _, shown, membrane = corrected(problem, root, found.change)

    def so(force: Float[Array, "node 1"]) -> Float[Array, " taxel"]:
        moved = _problem(skin, nodes, force)
        q = differentiable(moved, root).q
        return skin.electrodes.read(moved.mechanics, q).so[:, 0]

    along = jax.linearize(so, force)[1]
    jacobian = jax.vmap(along, out_axes=1)(jnp.eye(len(force))[..., None])
    gap = membrane.shape(shown.q).smallest_gap(skin.geometry).value
    read = skin.electrodes.read(membrane, shown.q).so[:, 0]
    return FieldState(read, jacobian, shown.pressure[0], gap[0], root, found.outcome[0])


_FIELD_PROGRAM = eqx.filter_jit(_evaluated)
