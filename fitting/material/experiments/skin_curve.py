"""A whole skin as test specimen: force in, displacement and oil pressure read.

Every force of the curve is one lane of the corrected shell's equilibrium, and so is every
walker or start: an ensemble is one call. Displacement is the mid-surface's under the first
line load of the scene, along that load; several loads grow together, their pattern kept.
"""

import dataclasses
from typing import ClassVar, NamedTuple, Self, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fitting.material.experiments.prediction import AbstractExperiment
from suas_jax.config import LineLoadSpec, SceneSpec, continuous_inputs, with_inputs, with_solve
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import Equilibrium, Problem, State, equilibrium
from suas_jax.mechanics.section import section_of
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import plan_for, problem_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.solve import solve

ELEMENTS = 16
_SAMPLES = 4


class SkinCurve(AbstractExperiment):
    """Readings of a skin under a series of forces."""

    costly: ClassVar[bool] = True

    sized_by: ClassVar = "lane"
    problem: Problem  # the skin, one lane a force; its law is replaced
    angle: Float[Array, " 1"]  # where the displacement is read [rad]
    direction: Float[Array, "2 1"]  # unit vector along which it is read
    lane: Int[Array, " n"]  # which force a reading belongs to
    channel: Int[Array, " n"]  # 0 for displacement [m], 1 for oil pressure [Pa]
    start: State  # states from which the solution is sought

    @property
    def equilibria(self) -> int:
        """Equilibria that one prediction takes."""
        return int(self.problem.external_pressure.shape[-1])

    def solve(self, law: AbstractLaw) -> tuple[Problem, Equilibrium]:
        """Equilibria of all forces for a law with scalar constants."""
        in_lane = jax.tree.map(lambda x: jnp.asarray(x)[..., None], law)
        problem = eqx.tree_at(lambda p: p.mechanics.law, self.problem, in_lane)
        return problem, equilibrium(problem, self.start, omitted=True)

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Displacements [m] and pressures [Pa]; NaN where there is no equilibrium."""
        return self.read(*self.solve(law))

    def read(self, problem: Problem, found: Equilibrium) -> Float[Array, " n"]:
        """Readings of solved states; NaN where there is no equilibrium."""
        _, shown, shell = corrected(problem, found.state, found.change)
        shape = section_of(shell).at_angle(shown.q, self.angle)
        moved = jnp.sum(shape.mid_displacement[:, 0, 0] * self.direction, 0)
        both = jnp.stack([moved, shown.pressure])
        both = jnp.where(found.result == 0, both, jnp.nan)
        return both[self.channel, self.lane]

    def settled(self, law: AbstractLaw) -> Self:
        """The same curve, solved from the states of a law: fast for laws near to it."""
        found = _solved(self, law)
        if np.any(np.asarray(found.result) != 0):
            return self
        return eqx.tree_at(lambda c: c.start, self, found.state)


class _Solved(NamedTuple):
    """What a law does in a curve: states, outcomes, readings, inner hoop stretches."""

    state: State
    result: Array
    readings: Array
    inner_stretch: Array


def _solved(curve: SkinCurve, law: AbstractLaw) -> _Solved:
    found: _Solved = COMPILED.run(_program, curve, law, once=True)
    return found


@eqx.filter_jit
def _program(curve: SkinCurve, law: AbstractLaw) -> _Solved:
    problem, found = curve.solve(law)
    shell = cast(Shell, problem.mechanics)
    stretch = shell.profile(found.state.q, _SAMPLES).inner_stretch
    return _Solved(found.state, found.result, curve.read(problem, found), stretch)


@dataclasses.dataclass(frozen=True)
class Specimen:
    """A skin curve with what its own material says about sizes."""

    curve: AbstractExperiment  # the readings' forward model
    modulus: float  # shear modulus that the readings suggest [Pa]
    stretch: float  # largest hoop stretch on the inner face under the largest force
    # standard deviation of the corrected shell's own error under the largest force, relative to
    # displacement and pressure; all readings share it
    model_error: float


def specimen(
    scene: SceneSpec, force: np.ndarray, channel: np.ndarray, value: np.ndarray
) -> Specimen:
    """The forward model of a skin's curve, and the sizes of its material.

    The scene's own material is only where sizes come from. Each reading has its force, the sum
    of the loads' magnitudes [N], channel (0 for displacement, 1 for oil pressure) and value [m,
    Pa].
    Raises ValueError: the skin doesn't carry these forces with the scene's material.
    """
    scene.require_plane_strain("A skin as test specimen")
    elements = scene.solve.elements
    counts = (elements if isinstance(elements, int) else ELEMENTS,)
    lines = [(i, load) for i, load in enumerate(scene.loads) if isinstance(load, LineLoadSpec)]
    total = sum(abs(load.force) for _, load in lines)
    levels, lane = np.unique(force, return_inverse=True)
    top = float(np.max(np.abs(levels)))
    spec = with_solve(scene, oil_pressure=None)
    spec = with_inputs(spec, {f"load.{i}.force": load.force * top / total for i, load in lines})
    plan = plan_for(spec, "shell", counts).reduced()
    parts = scene_parts(spec, continuous_inputs(spec))
    problem = problem_of(parts, plan)
    shell = problem.mechanics
    assert isinstance(shell, Shell)
    share = jnp.asarray(levels / top)
    problem = eqx.tree_at(
        lambda p: (cast(Shell, p.mechanics).points.force, p.external_pressure),
        problem,
        (shell.points.force * share, problem.external_pressure * share),
    )
    load = parts.forces[0]
    angle, direction = load.angle, load.direction(shell.section)
    if plan.symmetric and float(angle[0]) > 0.0:
        # Only the left half is solved: read the mirror image there.
        angle, direction = -angle, direction * jnp.array([[-1.0], [1.0]])
    rest, zero = shell.rest(), jnp.zeros(len(levels))
    start = State(jnp.broadcast_to(rest, (*rest.shape[:-1], len(levels))), zero, zero)
    curve = SkinCurve(problem, angle, direction, jnp.asarray(lane), jnp.asarray(channel), start)
    law = jax.tree.map(lambda x: x[..., 0], problem.mechanics.law)
    found = _solved(curve, law)
    if np.any(np.asarray(found.result) != 0):
        raise ValueError(
            f"--scene: with its own material this skin carries no {top:.4g} N; correct the "
            f"scene's material, loads or the force column"
        )
    ratio = np.median(np.asarray(found.readings) / value)
    if not ratio > 0.0:
        raise ValueError(
            "--data skin: displacement or pressure has the opposite sign of the model's; both "
            "are positive where the load pushes inwards (--scene gives the direction)"
        )
    largest = float(np.exp(np.max(np.abs(np.log(np.asarray(found.inner_stretch))))))
    alone = solve(with_solve(spec, model="shell", elements=ELEMENTS, mesh=None, rtol=None))
    error = alone.report["model_error"] or 0.0
    return Specimen(curve, float(law.shear_modulus) * float(ratio), largest, error)
