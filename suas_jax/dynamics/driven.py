"""A skin whose numbers change over time, and its equilibria with a membrane that remembers.

What changes is a factor on all loads, or any of the scene's inputs: forces, travels of
bodies, the temperature. The former scales one problem, which is built once, and its path can be
followed in steps of the factor; the latter make another problem for every moment.

A body that is pressed by a force travels until it carries it. Forces grow with travels, close
to a power law, so that Newton's method in the logarithms of both meets them; Broyden's formula
learns the slopes, which the next moment begins with.
"""

import abc
import dataclasses
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from suas_jax.config import SkinSpec
from suas_jax.constitutive.relaxation import Past, PronySeries, Response
from suas_jax.equilibrium.balance import Problem, State, Verification, verify
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.correction import corrected_touch
from suas_jax.equilibrium.equilibrium import Equilibrium
from suas_jax.equilibrium.load_path import follow
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.pad.pad import Pad, parts_of
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.scene.build import Inputs, Structure, problem_of
from suas_jax.scene.contact_zone import body_observables
from suas_jax.scene.parts import SceneParts, scene_parts
from suas_jax.scene.travel import FIRST, LEAST, LONGEST, POWER, driven_by_force

FACTOR = "factor"
"""Of the values that change: on all loads. The others are inputs by their paths."""
Values = dict[str, Array]

_TOLERANCE, _LOOSE = 1e-10, 1e-8  # of a force, and where rounding leaves no more
_MOST_TRAVELS = 30


class Travels(NamedTuple):
    """How far bodies that are pressed by forces have come."""

    length: Float[Array, " body"]  # of each of them [m]
    slope: Float[Array, "body body"]  # of the logarithms of the forces by those of the travels


class Step(NamedTuple):
    """A step in time that is tried."""

    values: Values  # at its end
    before: Travels  # of bodies that are pressed by forces, at its begin
    past: Past  # what the material remembers at its begin
    length: Array  # [s]
    guessed: Bool[Array, ""]  # whether it starts at what is expected at its end
    rtol: Float[Array, ""]  # wanted error of the state there, relative to its displacement


@dataclasses.dataclass(frozen=True)
class AbstractDriven(abc.ABC):
    """A skin on a mesh, some of whose numbers change."""

    series: PronySeries  # how the material's stress fades

    @property
    def no_travels(self) -> Travels:
        """Of bodies that have not been pressed."""
        return Travels(jnp.zeros(0), jnp.zeros((0, 0)))

    @property
    def touched(self) -> bool:
        """Whether bodies are pressed on it."""
        return False

    @abc.abstractmethod
    def problem(self, values: Values, travels: Travels) -> Problem:
        """The problem at some values, of a membrane without a past."""

    def answering(self, values: Values, travels: Travels, response: Response) -> Problem:
        """The same of a membrane with a past."""
        return answering(self.problem(values, travels), response)

    def level(self, values: Values) -> Lanes:
        """Factor on the loads of the problem."""
        return jnp.reshape(values.get(FACTOR, jnp.ones(())), 1)

    def balanced(
        self, start: State, travels: Travels, step: Step
    ) -> tuple[Equilibrium, Travels]:
        """The equilibrium at the end of a step.

        `start`: from which the path begins. `travels`: of bodies that are pressed by forces, to
        begin with. `step`: what changes.
        """
        past = step.past.seen(self.series, step.length)
        problem = self.answering(step.values, travels, past)
        level = self.level(step.values)
        y = BorderedVector(start.q, start.pressure if problem.oil.trapped else None)
        # The residual is linear in dead loads, not in how far a body has come.
        begin = level if self.touched else jnp.where(step.guessed, level, start.factor)
        # A membrane with a past has no equilibrium without loads at hand: paths that are
        # lost begin anew where they began.
        path = problem, y, begin, level, LoadStepping(rtol=step.rtol)
        root = follow(*path, near=True, rest=y, rest_level=begin)
        return Equilibrium.of(problem, root), travels


@dataclasses.dataclass(frozen=True)
class DrivenSkin(AbstractDriven):
    """A scene on a mesh, some of whose numbers change."""

    scene: Structure  # with the instantaneous response of its material
    plan: AbstractPlan  # of the mesh
    inputs: Inputs  # the scene's numbers
    fixed: tuple[SceneParts, Problem] | None  # parts and problem where a factor alone changes

    @classmethod
    def of(cls, scene: Structure, plan: AbstractPlan, inputs: Inputs, names: Any) -> Self:
        """A skin of which the values of some names change."""
        skin = cls(series_of(scene.scene, inputs), scene, plan, inputs, None)
        if set(names) != {FACTOR}:
            return skin
        return dataclasses.replace(skin, fixed=skin._built(inputs))

    @property
    def pressed(self) -> list[int]:
        """Which loads are bodies that are pressed by a force."""
        return [driven.load for driven in driven_by_force(self.scene.scene)]

    @property
    def no_travels(self) -> Travels:
        """Of bodies that have not been pressed."""
        count = len(self.pressed)
        return Travels(jnp.zeros(count), POWER * jnp.eye(count))

    def _built(self, inputs: Inputs) -> tuple[SceneParts, Problem]:
        parts = scene_parts(self.scene.scene, inputs)
        return parts, problem_of(parts, self.plan, wall=self.scene.wall)

    @property
    def touched(self) -> bool:
        """See the base class."""
        return bool(self.scene.scene.bodies)

    def parts(self, values: Values, travels: Travels) -> tuple[SceneParts, Problem]:
        """Parts and problem at some values."""
        if self.fixed is not None:
            return self.fixed
        # Without a force a body is off the skin, which may have come out beyond first touch.
        off = -self.scene.scene.geometry.mean_gap
        own = jnp.where(travels.length == 0, off, travels.length)
        lengths = {f"load.{i}.depth": own[k] for k, i in enumerate(self.pressed)}
        changed = {key: x for key, x in values.items() if key != FACTOR}
        return self._built({**self.inputs, **changed, **lengths})

    def problem(self, values: Values, travels: Travels) -> Problem:
        """See the base class."""
        return self.parts(values, travels)[1]

    def balanced(
        self, start: State, travels: Travels, step: Step
    ) -> tuple[Equilibrium, Travels]:
        """The equilibrium, and travels at which bodies carry their forces; see the base."""
        find = super().balanced

        def found(start: State, travels: Travels) -> Equilibrium:
            return find(start, travels, step)[0]

        if not self.pressed:
            return found(start, travels), travels

        def forces(travels: Travels, at: Equilibrium) -> Array:
            parts, problem = self.parts(step.values, travels)
            stress = membrane_of(problem).deviator(at.state.q)
            after = step.past.after(self.series, step.length, stress).relaxed(self.series)
            return self.forces(parts, answering(problem, after), at.state)

        wanted = jnp.stack([step.values[f"load.{i}.force"] for i in self.pressed])
        thickness = self.scene.scene.geometry.mean_thickness
        return _under_forces(found, forces, start, wanted, (travels, step.before), thickness)

    def forces(self, parts: SceneParts, problem: Problem, state: State) -> Array:
        """What bodies that are pressed by forces carry, as reports tell it [N].

        `parts`, `problem`: of the skin or, of a symmetric pad, of the half or quarter of it.
        """
        _, shown = seen(problem, state)
        bodies = iter(parts.bodies)
        rows = []
        for i, load in enumerate(self.scene.scene.loads):
            if load.kind == "body":
                body = next(bodies)
                if i in self.pressed:
                    touch = corrected_touch(problem.mechanics, body, shown, state)
                    own = body_observables(touch, body, state.factor, parts.skin.geometry)
                    rows.append(own["force_N"][0])
        return parts_of(problem.mechanics) * jnp.stack(rows)


def series_of(skin: SkinSpec, inputs: Inputs) -> PronySeries:
    """How a skin's stress fades; without terms where it does not."""
    given = skin.material.relaxation
    count = 0 if given is None else len(given.g)

    def terms(key: str) -> Array:
        values = [inputs[f"material.relaxation.{key}.{i}"] for i in range(count)]
        return jnp.stack([jnp.asarray(x, float) for x in values] or [jnp.zeros(())])[:count]

    return PronySeries(terms("g"), terms("tau"))


def membrane_of(problem: Problem) -> Shell | Solid | Pad:
    """The membrane of a problem, which is one of those that may remember."""
    assert isinstance(problem.mechanics, Shell | Solid | Pad)
    return problem.mechanics


def answering(problem: Problem, response: Response) -> Problem:
    """The problem of a membrane with a past."""
    share = jnp.reshape(response.share, 1)
    membrane = dataclasses.replace(
        membrane_of(problem), response=Response(share, response.rest)
    )
    return dataclasses.replace(problem, mechanics=membrane)


def seen(problem: Problem, state: State) -> tuple[Verification, State]:
    """What the tangent says of a state, and the state to report."""
    check, change = verify(problem, state)
    if change is None:
        return check, state
    return check, jax.tree.map(lambda a, b: a + b, state, change)


class _Search(NamedTuple):
    """A search for travels; the last good try has the suffix `_before`."""

    x: Float[Array, " body"]
    slope: Float[Array, "body body"]
    start: State
    x_before: Float[Array, " body"]
    y_before: Float[Array, " body"]
    tried: Bool[Array, ""]
    error: Float[Array, ""]
    best: Equilibrium
    best_x: Float[Array, " body"]
    iterations: Int[Array, " lane"]
    runs: Int[Array, ""]
    done: Bool[Array, ""]


def _under_forces(
    found: Any,  # the equilibrium at given travels, from a start
    forces: Any,  # what an equilibrium says of them
    start: State,  # for the first travels
    wanted: Array,  # forces [N]
    # travels to begin with, and those of an equilibrium nearby
    expected: tuple[Travels, Travels],
    thickness: float,  # of the membrane [m]
) -> tuple[Equilibrium, Travels]:
    """Travels at which bodies carry given forces; those without a force are at first touch."""
    travels, before = expected
    known = jnp.all((before.length != 0) | (wanted <= 0))
    loaded = wanted > 0
    target = jnp.log(jnp.where(loaded, wanted, 1.0))
    never = jnp.asarray(np.inf)

    def lengths(x: Array) -> Travels:
        return Travels(jnp.where(loaded, LEAST * thickness * jnp.sinh(x), 0.0), travels.slope)

    def numbers(lengths: Array) -> Array:
        begin = jnp.where(lengths != 0, lengths / thickness, FIRST)
        return jnp.arcsinh(begin / LEAST)

    def attempt(at: _Search) -> _Search:
        own = lengths(at.x)
        now = found(at.start, own)
        carried = forces(own, now)
        good = (now.result[0] == 0) & jnp.all((carried > 0) | ~loaded)
        y = jnp.where(loaded, jnp.log(jnp.where(carried > 0, carried, 1.0)), 0.0)
        error = jnp.where(good, jnp.max(jnp.abs(y - target)), never)
        # Not touched yet, or too far at once.
        aside = at.x + jnp.where(loaded, jnp.where(carried > 0, -1.0, 1.0), 0.0)
        aside = jnp.where(at.tried | known, (at.x + at.x_before) / 2, aside)
        dx, dy = at.x - at.x_before, y - at.y_before
        size = dx @ dx
        learn = at.tried & (size > 0)
        more = jnp.outer(dy - at.slope @ dx, dx) / jnp.where(size > 0, size, 1.0)
        slope = at.slope + jnp.where(good & learn, more, 0.0)
        stride = jnp.clip(jnp.linalg.solve(slope, target - y), -LONGEST, LONGEST)
        better = error < at.error
        stands = good & ~better & (at.error < _LOOSE)
        best = jax.tree.map(lambda a, b: jnp.where(better, a, b), now, at.best)
        return _Search(
            jnp.where(good, at.x + jnp.where(loaded, stride, 0.0), aside),
            slope,
            jax.tree.map(lambda a, b: jnp.where(good, a, b), now.state, at.start),
            jnp.where(good, at.x, at.x_before),
            jnp.where(good, y, at.y_before),
            at.tried | good,
            jnp.where(better, error, at.error),
            best,
            jnp.where(better, at.x, at.best_x),
            at.iterations + now.iterations,
            at.runs + 1,
            (error < _TOLERANCE) | stands | ~jnp.any(loaded),
        )

    x, near = (numbers(moved.length) for moved in expected)
    none = jax.tree.map(jnp.zeros_like, jax.eval_shape(found, start, lengths(x)))
    count, false = jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    search = _Search(
        x, travels.slope, start, near, x, false, never, none, x, none.iterations, count, false
    )
    end = jax.lax.while_loop(lambda at: ~at.done & (at.runs < _MOST_TRAVELS), attempt, search)
    lost = index_of("no_convergence")
    result = jnp.where(end.error < _LOOSE, end.best.result, lost)
    best = end.best._replace(
        result=result.astype(end.best.result.dtype), iterations=end.iterations
    )
    return best, Travels(lengths(end.best_x).length, end.slope)
