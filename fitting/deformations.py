"""The membrane's shape in every known state of an experiment.

Known is a load's place and either its force or its displacement. Where the displacement is
known the force is found: Newton's method, with the derivative that the equilibrium gives.
A state has its own mesh with a station under each load and others gathered around it, so
that the shape under the load is as exact as that of `suas solve`; all states share one
compiled program.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.compiled import COMPILED
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium import Problem, State, equilibrium
from suas_jax.gap import PolarFace, polar_face
from suas_jax.geometry import SkinGeometry
from suas_jax.loads import LineLoad, LoadPoints
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.shell import Shell
from suas_jax.mesh import plan_mesh
from suas_jax.oil import AbstractOil
from suas_jax.results import NAMES, advice

ELEMENTS = 48
"""Elements of a state's mesh along the whole arc."""
# States solved in one call.
_BLOCK = 256
_NEWTON = 25
_ACCURACY = 1e-10  # of a displacement that is met [m]
_FIRST_FORCE = 1e-3  # N


class NoDeformation(ArithmeticError):  # noqa: N818
    """A known state has no equilibrium; the message says which and why."""


@dataclasses.dataclass(frozen=True)
class KnownLoads:
    """What is known of the loads, state by state.

    Attributes:
        angle: where they act, from the symmetry axis [load, state, rad].
        turn: of the force from the inward radial, counter-clockwise [load, state, rad].
        force: total over the width [load, state, N]; NaN where the displacement is known.
        displacement: of the material point under the load, along the load's direction
            [load, state, m]; NaN where the force is known.
        inner: whether the displacement is the inner face's; else the mid-surface's [load].
    """

    angle: np.ndarray
    turn: np.ndarray
    force: np.ndarray
    displacement: np.ndarray
    inner: np.ndarray

    @property
    def states(self) -> int:
        """Number of states."""
        return self.angle.shape[1]

    def take(self, index: np.ndarray) -> "KnownLoads":
        """Some of the states."""
        return KnownLoads(
            self.angle[:, index],
            self.turn[:, index],
            self.force[:, index],
            self.displacement[:, index],
            self.inner,
        )

    def with_rest(self) -> "KnownLoads":
        """One more state, without loads."""
        zero = np.zeros((len(self.angle), 1))
        return KnownLoads(
            np.concatenate([self.angle, zero], 1),
            np.concatenate([self.turn, zero], 1),
            np.concatenate([self.force, zero], 1),
            np.concatenate([self.displacement, np.nan * zero], 1),
            self.inner,
        )


class Meshes(eqx.Module):
    """Stations and load points of every state.

    Attributes:
        angles: of the stations [station, state].
        select: element of each load [element, load, state].
        xi: place of each load in its element [load, state].
    """

    angles: Float[Array, "station state"]
    select: Float[Array, "element load state"]
    xi: Float[Array, "load state"]

    @classmethod
    def under(
        cls, angle: np.ndarray, half_angle: float, layer: float, elements: int = ELEMENTS
    ) -> "Meshes":
        """Mesh every state with a station at each load.

        Args:
            angle: of the loads [load, state, rad].
            half_angle: of the skin [rad].
            layer: decay length of the boundary layers as an angle [rad].
            elements: along the whole arc.
        """
        distinct, inverse = np.unique(angle, axis=1, return_inverse=True)
        stations, positions, elements_of = [], [], []
        for places in distinct.T:
            numbers = [-half_angle, half_angle, *places]
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


class Press(eqx.Module):
    """States of one fluid in JAX arrays: everything but the skin and the forces.

    Attributes:
        meshes: of the states.
        angle: of the loads [load, state, rad].
        turn: of the loads [load, state, rad].
        inner: one where displacements are the inner face's, else zero [load, 1].
    """

    meshes: Meshes
    angle: Float[Array, "load state"]
    turn: Float[Array, "load state"]
    inner: Float[Array, "load 1"]

    def problem(
        self, geometry: SkinGeometry, law: AbstractLaw, oil: AbstractOil, force: Array
    ) -> Problem:
        """The discrete problem under some forces [load, state, N]."""
        direction = LineLoad(self.angle, force, self.turn).direction
        per_width = force * direction / geometry.width
        points = LoadPoints(self.meshes.select, self.meshes.xi, per_width)
        shell = Shell.build(geometry, law, self.meshes.angles, points, symmetric=False)
        return Problem(shell, oil, jnp.zeros(1))

    def take(self, index: np.ndarray) -> "Press":
        """Some of the states."""
        meshes, angle, turn = jax.tree.map(
            lambda x: x[..., index], (self.meshes, self.angle, self.turn)
        )
        return Press(meshes, angle, turn, self.inner)

    def displacements(
        self, mechanics: AbstractMechanics, q: Array
    ) -> Float[Array, "load state"]:
        """Of the material points under the loads, along the loads [m]."""
        rows = []
        for k in range(self.angle.shape[0]):
            at = mechanics.at_angle(q, self.angle[k])
            mid = at.mid_displacement.reshape(2, -1)
            inner = at.inner_displacement.reshape(2, -1)
            way = LineLoad(self.angle[k], self.angle[k], self.turn[k]).direction
            rows.append(jnp.sum(way * jnp.where(self.inner[k] > 0, inner, mid), 0))
        return jnp.stack(rows)


class Response(NamedTuple):
    """What some forces do; every entry has a state axis.

    Attributes:
        state: the equilibrium.
        displacement: under each load, along it [load, state, m].
        compliance: derivative of the displacements by the forces [of, by, state, m/N].
        face: the deformed inner face.
        result: index of the outcome.
    """

    state: State
    displacement: Array
    compliance: Array
    face: PolarFace
    result: Array


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

    def solve(force: Array) -> tuple[Array, tuple[State, PolarFace, Array]]:
        problem = press.problem(geometry, law, oil, force)
        found = equilibrium(problem, start)
        face = polar_face(problem.mechanics, found.state.q, geometry.inner_radius)
        moved = press.displacements(problem.mechanics, found.state.q)
        return moved, (found.state, face, found.result)

    moved, push, (state, face, result) = jax.linearize(solve, force, has_aux=True)
    loads = force.shape[0]
    unit = jnp.broadcast_to(jnp.eye(loads)[:, :, None], (loads, *force.shape))
    compliance = jnp.moveaxis(jax.vmap(push)(unit), 0, 1)
    return Response(state, moved, compliance, face, result)


@dataclasses.dataclass(frozen=True)
class Deformed:
    """Solved states.

    Attributes:
        press: the states.
        force: on each load, given or found [load, state, N].
        displacement: of each load [load, state, m].
        pressure: of the oil [state, Pa].
        face: the deformed inner faces.
        state: the equilibria, to start neighbouring ones from.
    """

    press: Press
    force: np.ndarray
    displacement: np.ndarray
    pressure: np.ndarray
    face: PolarFace
    state: State


def deform(
    loads: KnownLoads,
    geometry: SkinGeometry,
    law: AbstractLaw,
    oil: AbstractOil,
    progress: Callable[[int], None] = lambda done: None,
) -> Deformed:
    """Find the shape of the membrane in every state.

    Args:
        loads: what is known of the loads.
        geometry: of the skin.
        law: its material.
        oil: how the fluid in the gap answers.
        progress: called with the number of states done.

    Raises:
        NoDeformation: a state has no equilibrium, or its displacement is not met.
    """
    half_angle = float(geometry.half_angle[0])
    meshes = Meshes.under(loads.angle, half_angle, _layer(geometry, law, loads))
    inner = jnp.asarray(loads.inner, float)[:, None]
    press = Press(meshes, jnp.asarray(loads.angle), jnp.asarray(loads.turn), inner)
    count = loads.states
    size = min(_BLOCK, 1 << (count - 1).bit_length())
    parts = []
    for begin in range(0, count, size):
        index = np.minimum(np.arange(begin, begin + size), count - 1)
        parts.append(_solve(press.take(index), loads.take(index), geometry, law, oil))
        progress(min(begin + size, count))
    force = np.concatenate([f for f, _ in parts], -1)[:, :count]
    found = [r for _, r in parts]

    def joined(*xs: Array) -> Array:
        return jnp.concatenate(xs, -1)[..., :count]

    state = jax.tree.map(joined, *(r.state for r in found))
    face = jax.tree.map(joined, *(r.face for r in found))
    moved = np.concatenate([np.asarray(r.displacement) for r in found], -1)[:, :count]
    return Deformed(press, force, moved, np.asarray(state.pressure), face, state)


def _layer(geometry: SkinGeometry, law: AbstractLaw, loads: KnownLoads) -> float:
    """Decay length of the boundary layers as an angle [rad]: an order of magnitude.

    sqrt(D / N) with the bending stiffness D = mu t^3 / 3 and the tension N of the tent that
    a displacement d of the arch's order makes, as in `suas_jax.problem.layer_angle`.
    """
    radius, thickness = float(geometry.mid_radius[0]), float(geometry.thickness[0])
    mu = float(np.asarray(law.shear_modulus).reshape(-1)[0])
    force = np.nanmedian(np.abs(loads.force)) if np.isfinite(loads.force).any() else np.nan
    if not np.isfinite(force) or force <= 0:
        return min(1.0, 2.0 * np.sqrt(thickness / radius))
    tension = 3 * force / float(geometry.width[0])
    return float(min(1.0, np.sqrt(mu * thickness**3 / (3 * tension)) / radius))


def _solve(
    press: Press,
    loads: KnownLoads,
    geometry: SkinGeometry,
    law: AbstractLaw,
    oil: AbstractOil,
) -> tuple[np.ndarray, Response]:
    """Forces that meet what is known, and the equilibria under them."""
    wanted = np.isfinite(loads.displacement)
    force = np.where(wanted, _FIRST_FORCE * np.sign(loads.displacement), loads.force)
    force = np.nan_to_num(force)
    rest = press.problem(geometry, law, oil, jnp.asarray(force)).mechanics.rest()
    count = loads.states
    zero = jnp.zeros(count)
    start = State(jnp.broadcast_to(rest, (*rest.shape[:-1], count)), zero, zero)

    def run(force: np.ndarray, start: State) -> Response:
        response: Response = COMPILED.run(
            respond, press, geometry, law, oil, jnp.asarray(force), start, once=True
        )
        return response

    found = run(force, start)
    if not wanted.any():
        _insist(found, loads, force)
        return force, found
    good, good_found = force, found
    step = np.ones(count)
    for _ in range(_NEWTON):
        missing = np.where(
            wanted, loads.displacement - np.asarray(good_found.displacement), 0.0
        )
        if np.max(np.abs(missing)) < _ACCURACY:
            break
        # Loads whose force is known keep it: their rows and columns drop out.
        compliance = np.moveaxis(np.asarray(good_found.compliance), -1, 0)
        both = wanted.T[:, :, None] & wanted.T[:, None, :]
        matrix = np.where(both, compliance, 0.0)
        diagonal = np.einsum("skk->sk", matrix)
        diagonal[~wanted.T] = 1.0
        change = np.linalg.solve(matrix, missing.T[..., None])[..., 0].T
        force = good + step * change
        found = run(force, good_found.state)
        fine = (np.asarray(found.result) == 0) & np.isfinite(found.displacement).all(0)
        error = np.where(wanted, loads.displacement - np.asarray(found.displacement), 0.0)
        closer = fine & (np.abs(error).max(0) <= np.abs(missing).max(0) + _ACCURACY)
        good = np.where(closer, force, good)
        good_found = jax.tree.map(
            lambda new, old: jnp.where(jnp.asarray(closer), new, old),  # noqa: B023
            found,
            good_found,
        )
        step = np.where(closer, np.minimum(1.0, 2 * step), step / 4)
    missing = np.where(wanted, loads.displacement - np.asarray(good_found.displacement), 0.0)
    worst = int(np.argmax(np.abs(missing).max(0)))
    if np.abs(missing[:, worst]).max() > 1e3 * _ACCURACY:
        k = int(np.argmax(np.abs(missing[:, worst])))
        raise NoDeformation(
            f"load {k} at {np.rad2deg(loads.angle[k, worst]):.4g} deg: no force moves the "
            f"membrane by {1e3 * loads.displacement[k, worst]:.4g} mm (the nearest that was "
            f"reached is {1e3 * float(good_found.displacement[k, worst]):.4g} mm); check the "
            "column's unit and sign, and that the load is one the skin can carry"
        )
    return good, good_found


def _insist(found: Response, loads: KnownLoads, force: np.ndarray) -> None:
    failed = np.flatnonzero(np.asarray(found.result))
    if not failed.size:
        return
    at = failed[0]
    name = NAMES[int(found.result[at])]
    where = ", ".join(
        f"{force[k, at]:.4g} N at {np.rad2deg(loads.angle[k, at]):.4g} deg"
        for k in range(len(force))
    )
    raise NoDeformation(f"{where}: {name}. {advice(name)}; check the columns' units")
