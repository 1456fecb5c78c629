"""Half a step in time of a skin in motion: its film, its own mass, the water outside, bodies.

The unknowns q of the membrane and the oil's mean pressure p obey ::

    g(dq/dt, q) + f(q, past) - p dV/dq - loads(t) - bodies(q, t) = 0,   V(q) = V_oil(p)

where g is the force of what moves (`suas_jax.dynamics.motion`, `moving_pad`), and f is
the force of a membrane that may remember. Either half of a step (`suas_jax.dynamics.tr_bdf2`)
is one kind of equation ::

    dq/dt = (q - q_b) / c,   dv/dt = (v - v_b) / c

with what is known before it. Newton's method solves it with one dense inverse for as many
steps as it is good for. Volume is kept as in statics: it is one of the equations.

A body that a travel drives is where it is at the end of the half. One that a force presses has
no mass: its travel is one more unknown, and that it carries its force one more equation. Where
it has no force, or touches nothing, it stays at the skin.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from suas_jax.dynamics.inertia import Densities
from suas_jax.dynamics.motion import MovingSection, Sampling, dense, free_unknowns
from suas_jax.dynamics.moving_pad import MovingPad
from suas_jax.equilibrium.balance import Problem, State, border_of, imbalance
from suas_jax.mechanics.pad.pad import Pad, parts_of
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.skin.geometry import SkinGeometry

_MOST_CORRECTIONS = 30
_EXACT = 1e-12  # correction of the volume that does not count, over the film's
_EXACT_FORCE = 3e-9  # relative error of a body's force that does not count
_OTHER_STEP = 0.02  # difference of steps that an inverse serves
_SLOW = 0.5  # ratio of corrections from which on an inverse is made anew
# In thicknesses: how deep a body that touches nothing is moved in, and how far off the skin one
# without a force stays.
_NEAR = 1e-4


class Inverse(NamedTuple):
    """An inverse of the equations' derivative, and what it was made for."""

    matrix: Float[Array, "equation equation"]
    step: Float[Array, ""]  # length of a half [s]
    held: Bool[Array, " body"]  # bodies that carried a force


class Half(NamedTuple):
    """An end of half a step."""

    state: State  # unknowns and pressure
    velocity: StationVector  # of the unknowns
    flow: Any  # velocities of oil and faces
    rate: Any  # of the flow
    travel: Float[Array, " body"]  # of bodies that forces press [m]
    share: Float[Array, " body"]  # of the forces that reports tell of them, in the balance
    corrections: Int[Array, ""]  # that it took
    inverse: Inverse  # made last
    good: Bool[Array, ""]  # whether it was found


class Base(NamedTuple):
    """What is known before half a step, and how long it is."""

    q: StationVector  # unknowns that a velocity adds to
    flow: Any  # that a rate adds to
    length: Float[Array, ""]  # c of the module [s]


@dataclasses.dataclass(frozen=True)
class SkinAtMoment:
    """A skin at some values, its membrane answering as its past has it."""

    problem: Problem  # membrane, oil and loads
    level: Float[Array, " lane"]  # factor on the loads
    geometry: SkinGeometry  # of the skin
    given: Densities  # densities and viscosity
    outside: Float[Array, "harmonic harmonic"]  # added mass of a pad's water
    pressed: tuple[int, ...]  # which of the bodies forces press

    @property
    def scale(self) -> Array:
        """Forces of the whole skin over those of the membrane."""
        membrane = self.problem.mechanics
        return (
            self.geometry.width[0]
            if membrane.per_width
            else jnp.asarray(1.0 * parts_of(membrane))
        )

    def near(self, q: StationVector) -> MovingSection | MovingPad:
        """What moves, close to a state."""
        membrane = self.problem.mechanics
        if isinstance(membrane, Pad):
            return MovingPad.near(membrane, self.geometry, self.given, self.outside, q)
        assert isinstance(membrane, Shell)
        sampling = Sampling.of(membrane, self.geometry)
        return MovingSection(sampling.near(q), sampling, self.given)

    def _at(self, travel: Float[Array, " body"]) -> Problem:
        """The problem, the bodies that forces press at some travel."""
        bodies = list(self.problem.mechanics.bodies)
        for k, i in enumerate(self.pressed):
            bodies[i] = dataclasses.replace(bodies[i], travel=travel[k : k + 1])
        membrane = self.problem.mechanics.with_bodies(bodies)
        return dataclasses.replace(self.problem, mechanics=membrane)

    def _carried(self, q: StationVector, travel: Float[Array, " body"]) -> Array:
        """Forces of the bodies that forces press, in units of the membrane's."""

        def energy(travel: Array) -> Array:
            return jnp.sum(self._at(travel).mechanics.contact_energy(q, self.level))

        return jax.grad(energy)(travel)

    def _apart(self, q: StationVector, travel: Float[Array, " body"]) -> Array:
        """Smallest gap to each of them [m]."""
        membrane = self._at(travel).mechanics
        gaps = [
            jnp.min(membrane.touched(q, membrane.bodies[i].placed(self.level)).gap)
            for i in self.pressed
        ]
        return jnp.stack(gaps) if gaps else jnp.zeros(0)

    def _inverse(
        self,
        state: State,
        velocity: StationVector,
        travel: Float[Array, " body"],
        held: Bool[Array, " body"],
        length: Array,
    ) -> Inverse:
        """Of the derivative of the equations, at a state."""
        problem = self._at(travel)
        membrane, oil = problem.mechanics, problem.oil
        free = free_unknowns(membrane)
        net = state.pressure - self.level * problem.external_pressure
        a = membrane.assemble(state.q, net, self.level)
        matrix = dense(a.tangent, free)
        matrix += self.near(state.q).stiffness(velocity, length, free)
        border = -a.volume_gradient.reshape(-1)[free]
        corner = oil.compliance(state.pressure, membrane.film_volume)
        whole = jnp.block([[matrix, border[:, None]], [border, corner]])
        if self.pressed:

            def forces(travel: Array) -> tuple[Array, Array]:
                y = BorderedVector(state.q, state.pressure)
                found = imbalance(self._at(travel), y, self.level).stations
                return found.reshape(-1)[free], self._carried(state.q, travel)

            by, own = jax.jacfwd(forces)(travel)
            by = jnp.pad(jnp.where(held, by, 0.0), ((0, 1), (0, 0)))
            own = jnp.where(held[:, None] & held, own, jnp.eye(len(held)))
            whole = jnp.block([[whole, by], [by.T, own]])
        return Inverse(jnp.linalg.inv(whole), length, held)

    def lasting(self, half: Half, wrong: StationVector) -> Array:
        """What an error of the unknowns leaves once stiff motions have faded.

        Of the motion c^-1 (I - B^-1 A) of an implicit step, with B the derivative of its
        equations and A that of what does not move (Hosea and Shampine). What a body hits
        swings far faster than a step; as it fades, it shall not shorten it.
        """
        free = free_unknowns(self.problem.mechanics)

        def still(q: StationVector) -> Array:
            y = BorderedVector(q, half.state.pressure)
            found = imbalance(self._at(half.travel), y, self.level)
            forces = jnp.where(half.inverse.held, self._carried(q, half.travel), 0.0)
            return jnp.concatenate([found.stations.reshape(-1)[free], border_of(found), forces])

        _, right = jax.jvp(still, (half.state.q,), (wrong,))
        faded = (half.inverse.matrix @ right)[: len(free)]
        return (
            jnp.zeros(wrong.size)
            .at[free]
            .set(wrong.reshape(-1)[free] - faded)
            .reshape(wrong.shape)
        )

    def _expected(self, base: Base, last: "Half") -> tuple[State, Array]:
        """State at the velocity of before, and travels that keep bodies as near to the skin.

        Contact is so stiff that a body left behind would be lost and met again, each time with
        another inverse.
        """
        q = base.q + base.length * last.velocity
        moved = self._apart(q, last.travel) - self._apart(last.state.q, last.travel)
        return last.state._replace(q=q), last.travel + moved

    def found(
        self,
        base: Base,  # what is known before it
        last: "Half",  # to begin with, and an inverse made nearby
        exact: Array,  # size of a displacement that does not count [m]
        wanted: Float[Array, " body"],  # forces that bodies carry, in units of the membrane's
    ) -> Half:
        """The end of half a step, by Newton's method."""
        begin, travel = self._expected(base, last)
        free, near = free_unknowns(self.problem.mechanics), self.near(begin.q)
        volume, thick = self.problem.mechanics.film_volume[0], self.geometry.thickness[0]
        count = len(free)

        def moving(y: BorderedVector) -> tuple[Array, StationVector, Any, Any]:
            velocity = (y.stations - base.q) / base.length
            return (velocity, *near.force(y.stations, velocity, base.flow, base.length))

        def correct(at: _Newton) -> _Newton:
            velocity, own, _, _ = moving(at.y)
            wrong = imbalance(self._at(at.travel), at.y, self.level)
            defect, pressure = border_of(wrong), border_of(at.y)
            carried = self._carried(at.y.stations, at.travel)
            apart = self._apart(at.y.stations, at.travel)
            held = (carried > 0) & (wanted > 0)
            idle = -apart - jnp.where(wanted > 0, 1.0, -1.0) * _NEAR * thick
            forces = jnp.where(held, carried - wanted, idle)
            right = (wrong.stations + own).reshape(-1)[free]
            right = jnp.concatenate([right, defect, forces])
            stale = jnp.abs(base.length / jnp.maximum(at.inverse.step, 1e-300) - 1)
            anew = (stale > _OTHER_STEP) | at.slow | jnp.any(held != at.inverse.held)
            state = State(at.y.stations, pressure, self.level)
            inverse = jax.lax.cond(
                anew,
                lambda: self._inverse(state, velocity, at.travel, held, base.length),
                lambda: at.inverse,
            )
            change = inverse.matrix @ right
            step = jnp.zeros(at.y.stations.size).at[free].set(change[:count])
            step = step.reshape(at.y.stations.shape)
            y = BorderedVector(at.y.stations - step, pressure - change[count : count + 1])
            size = self.problem.mechanics.displacement_size(step)[0]
            size = jnp.maximum(size, jnp.max(jnp.abs(change[count + 1 :]), initial=0.0))
            # Contact is stiff: a force may still be wrong where its travel hardly is.
            missed = jnp.where(held, jnp.abs(carried - wanted) / wanted, 0.0) / _EXACT_FORCE
            size = jnp.maximum(size, exact * jnp.max(missed, initial=0.0))
            counts = (at.taken > 0) & (at.size > exact)
            ratio = jnp.where(counts, size / at.size, 0.0)
            left = jnp.where(counts, jnp.minimum(ratio, 1.0), 1.0)
            done = (left * size <= exact) & (left * jnp.abs(defect[0]) <= _EXACT * volume)
            lost = ~jnp.isfinite(size)
            slow = counts & (ratio > _SLOW) & ~anew
            return _Newton(
                y,
                at.travel - change[count + 1 :],
                inverse._replace(step=jnp.where(lost, 0.0, inverse.step)),
                size,
                at.taken + 1,
                slow,
                done,
                lost,
            )

        def going(at: _Newton) -> Array:
            return ~at.done & ~at.lost & (at.taken < _MOST_CORRECTIONS)

        never, none = jnp.asarray(False), 0.0 * base.length
        y = BorderedVector(begin.q, begin.pressure)
        start = _Newton(
            y, travel, last.inverse, none, jnp.zeros((), jnp.int32), never, never, never
        )
        end = jax.lax.while_loop(going, correct, start)
        velocity, _, flow, rate = moving(end.y)
        state = State(end.y.stations, border_of(end.y), self.level)
        taken = end.taken + last.corrections
        return Half(
            state, velocity, flow, rate, end.travel, last.share, taken, end.inverse, end.done
        )


class _Newton(NamedTuple):
    """Newton's method on its way."""

    y: BorderedVector
    travel: Float[Array, " body"]
    inverse: Inverse
    size: Float[Array, ""]
    taken: Int[Array, ""]
    slow: Bool[Array, ""]
    done: Bool[Array, ""]
    lost: Bool[Array, ""]
