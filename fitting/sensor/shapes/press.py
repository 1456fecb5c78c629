"""The forward model of many states under known places of loads: meshes, and the response.

A state has its own mesh with a station under each load and others gathered around it, so
that the shape under the load is as exact as that of `suas solve`; all states share one
compiled program.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import Problem, State, equilibrium
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.section import NormalFace, section_of
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.mesh.plan import plan_mesh
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad, LoadPoints
from suas_jax.skin.oil import AbstractOil

ELEMENTS = 48
"""Elements of a state's mesh along the whole arc."""


class Meshes(eqx.Module):
    """Stations and load points of every state."""

    angles: Float[Array, "station state"]  # of the stations [station, state]
    select: Float[Array, "element load state"]  # element of each load [element, load, state]
    xi: Float[Array, "load state"]  # place of each load in its element [load, state]

    @classmethod
    def under(
        cls,
        angle: np.ndarray,  # of the loads [load, state, rad]
        half_angle: float,  # of the skin [rad]
        layer: float,  # decay length of the boundary layers as an angle [rad]
        kinks: Sequence[float] = (),  # where the section's curvature jumps [rad]
        elements: int = ELEMENTS,  # along the whole arc
    ) -> "Meshes":
        """Mesh every state with a station at each load."""
        distinct, inverse = np.unique(angle, axis=1, return_inverse=True)
        stations, positions, elements_of = [], [], []
        for places in distinct.T:
            numbers = [-half_angle, half_angle, *places, *kinks]
            plan = plan_mesh(numbers, [False] * len(places), elements, layer)
            row = plan.stations @ plan.values
            element = np.clip(np.searchsorted(row, places + 1e-9) - 1, 0, elements - 1)
            stations.append(row)
            elements_of.append(np.eye(elements)[:, element])
            positions.append((places - row[element]) / (row[element + 1] - row[element]))
        which = inverse.reshape(-1)
        return cls(
            jnp.asarray(np.stack(stations, -1)[:, which]),
            jnp.asarray(np.stack(elements_of, -1)[..., which]),
            jnp.asarray(np.stack(positions, -1)[:, which]),
        )


def first_only(loads: Array) -> Array:
    """One for the first of the loads [load, ...], zero for the others [load, 1]."""
    return (jnp.arange(len(loads)) == 0)[:, None] * 1.0


class Press(eqx.Module):
    """States of one fluid in JAX arrays: everything but the skin and the forces."""

    meshes: Meshes  # of the states
    angle: Float[Array, "load state"]  # of the loads [load, state, rad]
    turn: Float[Array, "load state"]  # of the loads [load, state, rad]
    # one where displacements are the inner face's, else zero [load, 1]
    inner: Float[Array, "load 1"]

    def problem(
        self, geometry: SkinGeometry, law: AbstractLaw, oil: AbstractOil, force: Array
    ) -> Problem:
        """The discrete problem under some forces [load, state, N]."""
        direction = LineLoad(self.angle, force, self.turn).direction(geometry.section)
        per_width = force * direction / geometry.width
        points = LoadPoints(self.meshes.select, self.meshes.xi, per_width)
        shell = Shell.build(geometry, law, self.meshes.angles, points, symmetric=False)
        return Problem(shell, oil, jnp.zeros(1))

    def take(self, index: np.ndarray) -> "Press":
        """Some of the states."""
        meshes, angle, turn = jax.tree.map(
            lambda x: jnp.asarray(np.asarray(x)[..., index]),
            (self.meshes, self.angle, self.turn),
        )
        return Press(meshes, angle, turn, self.inner)

    def shifted(self, angle: Array | float) -> "Press":
        """The same with the first load moved within its element, on the same mesh.

        The load moves by an angle [rad].
        """
        first = first_only(self.angle)
        lengths = jnp.diff(self.meshes.angles, axis=0)
        xi = self.meshes.xi + first * angle / jnp.einsum(
            "els,es->ls", self.meshes.select, lengths
        )
        meshes = Meshes(self.meshes.angles, self.meshes.select, xi)
        return Press(meshes, self.angle + first * angle, self.turn, self.inner)

    def displacements(
        self, mechanics: AbstractMechanics, q: Array
    ) -> Float[Array, "load state"]:
        """Of the material points under the loads, along the loads [m]."""
        rows = []
        for k in range(self.angle.shape[0]):
            at = section_of(mechanics).at_angle(q, self.angle[k])
            mid = at.mid_displacement.reshape(2, -1)
            inner = at.inner_displacement.reshape(2, -1)
            way = LineLoad(self.angle[k], self.angle[k], self.turn[k]).direction(
                mechanics.section
            )
            rows.append(jnp.sum(way * jnp.where(self.inner[k] > 0, inner, mid), 0))
        return jnp.stack(rows)


class Response(NamedTuple):
    """What some forces do; every entry has a state axis."""

    state: State  # the shell's equilibrium
    pressure: Array  # of the oil [state, Pa]
    displacement: Array  # under each load, along it [load, state, m]
    compliance: Array  # derivative of the displacements by the forces [of, by, state, m/N]
    face: NormalFace  # the deformed inner face
    result: Array  # index of the outcome


@eqx.filter_jit
def respond(
    press: Press,
    geometry: SkinGeometry,
    law: AbstractLaw,
    oil: AbstractOil,
    force: Array,
    start: State,
) -> Response:
    """Equilibria under given forces, and how displacements change with them."""

    def solve(force: Array) -> tuple[Array, tuple[State, Array, NormalFace, Array]]:
        problem = press.problem(geometry, law, oil, force)
        found = equilibrium(problem, start, omitted=True)
        root, shown, shell = corrected(problem, found.state, found.change)
        face = section_of(shell).face(shown.q)
        moved = press.displacements(shell, shown.q)
        return moved, (root, shown.pressure, face, found.outcome)

    moved, push, (state, pressure, face, result) = jax.linearize(solve, force, has_aux=True)
    loads = force.shape[0]
    unit = jnp.broadcast_to(jnp.eye(loads)[:, :, None], (loads, *force.shape))
    compliance = jnp.moveaxis(jax.vmap(push)(unit), 0, 1)
    return Response(state, pressure, moved, compliance, face, result)
