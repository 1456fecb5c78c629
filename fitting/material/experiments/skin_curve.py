"""A whole skin as test specimen: what drives it in, what is read of it out.

Forces drive it, and displacement and oil pressure are read; or a rigid body's travel, and force
and oil pressure are read. The corrected shell of a section or of a pad is solved at every level
of what drives it. A section's levels are the lanes of one call, a pad's are solved one after
the other; walkers of a sampler are lanes, too. Derivatives are those of the equilibrium:
nothing that led to it is differentiated.
"""

import dataclasses
from collections.abc import Callable
from typing import ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fitting.material.experiments.prediction import AbstractExperiment
from suas_jax.config import LineLoadSpec, SceneSpec, with_inputs, with_solve
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.friction import equilibrium_with_friction
from suas_jax.mechanics.model import Meshes
from suas_jax.numerics.lanes import by_lane
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Structure, problem_of
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import SceneParts, law_of, scene_parts
from suas_jax.scene.program import prepared, structure_of
from suas_jax.scene.solve import solve

ELEMENTS = 16
_TELLS = 0.1  # of a channel's largest reading, from which its size tells one of the material


class SkinCurve(AbstractExperiment):
    """Readings of a skin under a series of levels: shares of its loads, or a body's travels."""

    sized_by: ClassVar = "channel"
    meshes: Meshes  # of the solve
    inputs: dict[str, Array]  # the scene's numbers by TOML path, SI; its material is replaced
    # where the skin is solved: travels beyond first touch [m], or shares of its loads
    level: Float[Array, " level"]
    start: State  # states from which the solutions are sought, one a level
    weight: Float[Array, "n level"]  # of the solved states in a reading
    # 0 for the force under a body [N], or the displacement under the first load [m]; 1 for oil
    # pressure [Pa]
    channel: Int[Array, " n"]
    scene: Structure = eqx.field(static=True)  # skin and loads

    @property
    def effort(self) -> dict[str, bool]:
        """Compiling takes longer than a whole fit's use of it; see the base class."""
        return {"once": True, "long": self.meshes.whole.solves_long}

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings, SI units; NaN where there is no equilibrium."""
        return self._between(self.solved(law)[0])

    def solved(self, law: AbstractLaw) -> tuple[Float[Array, "2 level"], State]:
        """Both channels of all levels, NaN where there is no equilibrium, and the states."""
        known = jax.lax.stop_gradient(law)

        def one(level: Array, start: State) -> tuple[Array, State]:
            problem = problem_of(
                self._parts(known, level), self.meshes.solved, wall=self.scene.wall
            )
            found = equilibrium_with_friction(problem, start)
            both = self.read(law, level, found.state)
            return jnp.where(found.result == 0, both, jnp.nan), found.state

        return self._each(one)

    def read(self, law: AbstractLaw, level: Array, state: State) -> Float[Array, "2 lane"]:
        """Both channels of known states, with their derivatives."""
        parts, wall = self._parts(law, level), self.scene.wall
        problem = problem_of(parts, self.meshes.whole, wall=wall)
        if self.meshes.solved.symmetric:
            part = problem_of(parts, self.meshes.solved, wall=wall).mechanics
            state = state._replace(q=jax.lax.stop_gradient(part.mirrored(state.q)))
        root, shown, mechanics = corrected(problem, state)
        held = problem.mechanics
        problem = dataclasses.replace(problem, mechanics=mechanics)
        loads = load_observables(parts, problem, shown, held, root)
        key = "force_N" if parts.bodies else "displacement_m"
        first = next(load[key] for load in loads if key in load)
        return jnp.stack(jnp.broadcast_arrays(first, shown.pressure))

    def settled(self, law: AbstractLaw) -> Self:
        """The same curve, solved from the states of a law: fast for laws near to it."""
        both, state = self._run(law)
        if np.isnan(both).any():
            return self
        return dataclasses.replace(self, start=state)

    def readings_of(self, law: AbstractLaw) -> Float[np.ndarray, " n"]:
        """What `predict` says, by a program that is kept."""
        return np.asarray(self._between(self._run(law)[0]))

    def _run(self, law: AbstractLaw) -> tuple[Array, State]:
        """What `solved` says."""
        found: tuple[Array, State] = COMPILED.run(_solved, self, law, **self.effort)
        return found

    def _between(self, both: Float[Array, "2 level"]) -> Float[Array, " n"]:
        """Readings from those of the solved states, which count where they have a weight."""
        known = jnp.where(self.weight == 0, 0.0, both[self.channel])
        return jnp.sum(self.weight * known, 1)

    def _parts(self, law: AbstractLaw, level: Array) -> SceneParts:
        in_lane = jax.tree.map(lambda x: jnp.asarray(x)[..., None], law)
        parts = scene_parts(self.scene.scene, self.inputs, in_lane)
        if parts.bodies:
            moved = [dataclasses.replace(body, travel=level) for body in parts.bodies]
            return parts._replace(bodies=moved)
        forces = [dataclasses.replace(load, force=level * load.force) for load in parts.forces]
        return parts._replace(forces=forces, pressures=[level * p for p in parts.pressures])

    def _each(
        self, function: Callable[[Array, State], tuple[Array, State]]
    ) -> tuple[Array, State]:
        """Call a function of levels and states in lanes: all at once, or one by one."""
        if self.scene.scene.geometry.dimension == 2:
            return function(self.level, self.start)

        def one(case: tuple[Array, State]) -> tuple[Array, State]:
            alone: tuple[Array, State] = jax.tree.map(lambda x: x[..., 0], function(*case))
            return alone

        together: tuple[Array, State] = by_lane((self.level, self.start), one)
        return together


@eqx.filter_jit
def _solved(curve: SkinCurve, law: AbstractLaw) -> tuple[Array, State]:
    return curve.solved(law)


@dataclasses.dataclass(frozen=True)
class Specimen:
    """A skin's curve with what its own material says about sizes."""

    curve: SkinCurve  # the readings' forward model
    modulus: float  # shear modulus that the readings suggest [Pa]
    stretch: float  # largest stretch of the membrane, or its inverse, where it is driven most
    # standard deviation of the corrected shell's own error there, relative to the readings,
    # which all share it
    model_error: float
    inputs: tuple[str, ...] = ()  # names of the skin's inputs whose effect is known
    # change of the readings where an input grows by its whole size, the filling by one, the
    # mounting by one, the travel's zero by a metre, shape [n, input]
    slopes: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))


def ratio_of(value: np.ndarray, other: np.ndarray, channel: np.ndarray) -> float:
    """Typical value over another, both [n]; NaN where the others are zero.

    Those of rest say nothing: a skin has a pressure there, of either sign, and no force.
    """
    size = np.abs(other)
    largest = np.array([size[channel == c].max(initial=0.0) for c in range(2)])
    tells = size > _TELLS * largest[channel]
    return float(np.median(value[tells] / other[tells])) if tells.any() else float("nan")


def specimen(
    scene: SceneSpec, force: np.ndarray, channel: np.ndarray, value: np.ndarray
) -> Specimen:
    """The forward model of a skin's curve under forces, and the sizes of its material.

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
    known = prepared(spec, "shell", counts)
    curve = SkinCurve(
        known.meshes,
        {path: jnp.asarray(x) for path, x in known.inputs.items()},
        jnp.asarray(levels / top),
        jax.tree.map(lambda x: jnp.repeat(x, len(levels), axis=-1), known.rest),
        jnp.asarray(np.eye(len(levels))[lane.reshape(-1)]),
        jnp.asarray(channel),
        structure_of(spec, wall=False),
    )
    law = jax.tree.map(lambda x: x[..., 0], law_of(spec, curve.inputs))
    readings = curve.readings_of(law)
    alone = solve(with_solve(spec, model="shell", elements=ELEMENTS, mesh=None, rtol=None))
    if np.isnan(readings).any() or not alone.converged:
        raise ValueError(
            f"--scene: with its own material this skin carries no {top:.4g} N; correct the "
            f"scene's material, loads or the force column"
        )
    ratio = ratio_of(readings, value, channel)
    if not ratio > 0.0:
        raise ValueError(
            "--data skin: displacement or pressure has the opposite sign of the model's; both "
            "are positive where the load pushes inwards (--scene gives the direction)"
        )
    return Specimen(
        curve,
        float(law.shear_modulus) * ratio,
        max(alone.report["stretch_max"], 1 / alone.report["stretch_min"]),
        alone.report["model_error"] or 0.0,
    )
