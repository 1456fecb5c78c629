"""A whole skin under a rigid body as test specimen: travel in, force and oil pressure read.

The corrected shell of a section or of a pad is solved at every travel, or at a few if a
polynomial through them is as good. A section's travels are the lanes of one call, a pad's are
solved one after the other. Derivatives are those of the equilibrium: nothing that led to it is
differentiated.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fitting.material.data.errors import DataError
from fitting.material.experiments.prediction import AbstractExperiment
from fitting.material.experiments.skin_curve import Specimen
from suas_jax.config import SceneSpec, continuous_inputs, with_inputs, with_solve
from suas_jax.config.fields import Spec
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.friction import equilibrium_with_friction
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.mechanics.model import Meshes
from suas_jax.mechanics.registry import MODELS
from suas_jax.numerics.lanes import number
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import problem_of
from suas_jax.scene.indentation import IndentationCurve, Point
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import SceneParts, law_of, scene_parts
from suas_jax.scene.program import inputs_of, prepared, structure_of
from suas_jax.scene.report import plain
from suas_jax.scene.solve import Solution, solve
from suas_jax.scene.structure import Structure

ZERO = "zero of the travel"
"""Name of what is not an input of the scene: where the body first touches."""
_NODES = 13  # travels that stand for more of them, and every second for the error
_SMOOTH = 1e-4  # of the largest reading: largest error by what is between them
_NEAR = 1.4  # factor of the modulus within which the scene's own states are starts

Found = TypeVar("Found")


class BodyCurve(AbstractExperiment):
    """Readings of a skin under a series of travels of a body."""

    costly: ClassVar[bool] = True

    sized_by: ClassVar = "channel"
    meshes: Meshes  # of the solve
    inputs: dict[str, Array]  # the scene's numbers by TOML path, SI; its material is replaced
    travel: Float[Array, " level"]  # beyond first touch, where the skin is solved [m]
    start: State  # states near the solutions, one a level
    weight: Float[Array, "n level"]  # of the solved states in a reading
    channel: Int[Array, " n"]  # 0 for the force [N], 1 for oil pressure [Pa]
    scene: Structure = eqx.field(static=True)  # skin and body

    @property
    def equilibria(self) -> int:
        """Equilibria that one prediction takes."""
        return len(self.travel)

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Forces [N] and pressures [Pa]; NaN where there is no equilibrium."""
        known = jax.lax.stop_gradient(law)

        def one(travel: Array, start: State) -> tuple[Array, Array]:
            problem = problem_of(
                self._parts(known, travel), self.meshes.solved, wall=self._wall
            )
            found = equilibrium_with_friction(problem, start)
            return self.read(law, travel, found.state), found.result

        both, result = self._each(one)
        return self._between(jnp.where(result == 0, both, jnp.nan))

    def read(self, law: AbstractLaw, travel: Array, state: State) -> Float[Array, "2 lane"]:
        """Force [N] and pressure [Pa] of known states, with their derivatives."""
        parts = self._parts(law, travel)
        problem = problem_of(parts, self.meshes.whole, wall=self._wall)
        if self.meshes.solved.symmetric:
            part = problem_of(parts, self.meshes.solved, wall=self._wall).mechanics
            state = state._replace(q=jax.lax.stop_gradient(part.mirrored(state.q)))
        root, shown, mechanics = corrected(problem, state)
        held = problem.mechanics
        problem = dataclasses.replace(problem, mechanics=mechanics)
        loads = load_observables(parts, problem, shown, held, root)
        force = next(load["force_N"] for load in loads if "depth_m" in load)
        return jnp.stack(jnp.broadcast_arrays(force, shown.pressure))

    def at_start(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings of the starts, taken as the equilibria of a law."""
        both = self._each(lambda travel, start: self.read(law, travel, start))
        return self._between(both)

    def _between(self, both: Float[Array, "2 level"]) -> Float[Array, " n"]:
        """Readings from those of the solved states, which count where they have a weight."""
        known = jnp.where(self.weight == 0, 0.0, both[self.channel])
        return jnp.sum(self.weight * known, 1)

    @property
    def _wall(self) -> bool:
        return self.scene.wall

    def _parts(self, law: AbstractLaw, travel: Array) -> SceneParts:
        in_lane = jax.tree.map(lambda x: jnp.asarray(x)[..., None], law)
        parts = scene_parts(self.scene.scene, self.inputs, in_lane)
        return parts._replace(
            bodies=[dataclasses.replace(body, travel=travel) for body in parts.bodies]
        )

    def _each(self, function: Callable[[Array, State], Found]) -> Found:
        """Call a function of travels and states in lanes: all at once, or one by one."""
        if self.scene.scene.geometry.dimension == 2:
            return function(self.travel, self.start)

        def one(case: tuple[Array, State]) -> Found:
            found = function(*jax.tree.map(lambda x: x[..., None], case))
            alone: Found = jax.tree.map(lambda x: x[..., 0], found)
            return alone

        cases = jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), (self.travel, self.start))
        together: Found = jax.tree.map(
            lambda x: jnp.moveaxis(x, 0, -1), jax.lax.map(one, cases)
        )
        return together


@dataclasses.dataclass(frozen=True)
class BodySpecimen(Specimen):
    """A body's curve, and what the skin's other inputs do to it; see `Specimen`."""

    curve: BodyCurve
    inputs: tuple[str, ...]  # names of the inputs, and of the travel's zero
    # change of the readings where an input grows by its whole size, the filling by one, the
    # mounting by one, the travel's zero by a metre, shape [n, input]
    slopes: np.ndarray


def body_specimen(
    scene: SceneSpec, travel: np.ndarray, channel: np.ndarray, value: np.ndarray
) -> BodySpecimen:
    """The forward model of an indentation curve, and the sizes of its material.

    The scene's own material is only where sizes come from. Each reading has its travel [m],
    channel (0 for the force, 1 for oil pressure) and value [N, Pa], each [n].
    Raises DataError: the skin doesn't bear these travels with the scene's material.
    """
    depth = next(f"load.{i}.depth" for i, load in enumerate(scene.loads) if load.kind == "body")
    deepest = float(np.max(travel))
    spec = with_inputs(with_solve(scene, model="shell"), {depth: deepest})
    found = solve(spec)
    if not found.converged:
        raise DataError(
            f"--scene: pressed {1e3 * deepest:.4g} mm deep with its own material the skin's "
            f"status is {found.report['status']}: {found.report['message']}"
        )
    # A section's travels are lanes: they cost little.
    most = _NODES if scene.geometry.dimension == 3 else len(travel)
    levels, weight = nodes_of(travel, most)
    points = _followed(found.scene, found, depth, levels)
    if len(levels) < len(np.unique(travel)) and not _is_smooth(levels, _readings(points)):
        levels, weight = nodes_of(travel, len(travel))
        points = _followed(found.scene, found, depth, levels)
    scaled, scale = found.scene, 1.0
    for _ in range(2):
        known = _readings(points)
        ratio = float(np.median(value / (weight * known[channel]).sum(1)))
        if not ratio > 0.0:
            raise DataError(
                "--data indentation: force or oil pressure has the opposite sign of the "
                "model's; both are positive where the body pushes inwards"
            )
        if 1 / _NEAR < ratio < _NEAR:
            break
        scale *= ratio
        scaled = with_inputs(found.scene, _scaled(found.scene, scale))
        points = _followed(scaled, found, depth, levels, [point.part for point in points])
    known_scene = prepared(scaled, "shell", found.plan.counts)
    curve = BodyCurve(
        known_scene.meshes,
        {path: jnp.asarray(x) for path, x in known_scene.inputs.items()},
        jnp.asarray(levels),
        jax.tree.map(lambda *x: jnp.concatenate(x, -1), *(point.part for point in points)),
        jnp.asarray(weight),
        jnp.asarray(channel),
        structure_of(scaled, wall=found.wall),
    )
    law = jax.tree.map(lambda x: x[..., 0], law_of(scaled, curve.inputs))
    last = plain(points[-1].report)
    ends = last["stretch_max"], 1 / last["stretch_min"]
    return BodySpecimen(
        curve,
        float(law.shear_modulus) * ratio,
        max(ends),
        found.report["error_estimate"] or 0.0,
        *_by_inputs(curve, law),
    )


def nodes_of(travel: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Travels at which to solve, and their weights in readings at others [n, level].

    The readings are a polynomial of the travel's root through Chebyshev's points, which follows
    a contact that begins at a point.

    Args:
        travel: of each reading [m], shape [n].
        most: up to so many different travels are solved as they are.
    """
    levels, lane = np.unique(travel, return_inverse=True)
    if len(levels) <= most:
        return levels, np.eye(len(levels))[lane.reshape(-1)]
    ends = np.sqrt(np.maximum(levels[[0, -1]], 0.0))
    nodes = ends[0] + (ends[1] - ends[0]) * (1 - np.cos(np.linspace(0, np.pi, most))) / 2
    return nodes**2, _between(nodes, np.sqrt(np.maximum(travel, 0.0)))


def _between(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Weights of values at nodes in the polynomial through them [x, node]."""
    from scipy.interpolate import barycentric_interpolate  # slow to import

    return np.asarray(barycentric_interpolate(nodes, np.eye(len(nodes)), x))


def _is_smooth(levels: np.ndarray, readings: np.ndarray) -> bool:
    """Whether a polynomial through every second state finds those between.

    With twice as many nodes its error is squared, relative to the largest reading.
    """
    root = np.sqrt(levels)
    found = readings[:, ::2] @ _between(root[::2], root).T
    apart = np.abs(found - readings).max(1) / np.abs(readings).max(1)
    return bool((apart**2 < _SMOOTH).all())


def _readings(points: list[Point]) -> np.ndarray:
    """Force [N] and oil pressure [Pa] of solved states [2, level]."""
    reports = [plain(point.report) for point in points]
    forces = [next(x["force_N"] for x in r["loads"] if "depth_m" in x) for r in reports]
    return np.array([forces, [report["oil_pressure_Pa"] for report in reports]])


def _scaled(scene: SceneSpec, scale: float) -> dict[str, float]:
    """The stress constants of the scene's material, times a factor."""
    declared = scene.material.declared()
    stresses = {f"material.{key}" for key, c in declared.items() if c.dimension == "stress"}
    return {
        path: scale * value
        for path, value in continuous_inputs(scene).items()
        if ".".join(path.split(".")[:2]) in stresses
    }


def _followed(
    scene: SceneSpec,
    found: Solution,
    depth: str,
    levels: np.ndarray,
    starts: Sequence[State] | None = None,
) -> list[Point]:
    """Solutions at all travels, on the mesh of the deepest one.

    Each starts from the state of the one before, or near a given one.
    Raises DataError: there is none at one of them.
    """
    model = MODELS[scene.geometry.dimension]["shell"]
    curve = IndentationCurve(scene, {depth: 1.0}, model, found.plan, found.wall)
    points = curve.follow(levels, found.plan.counts, starts)
    for level, point in zip(levels, points, strict=True):
        result = int(number(point.outcome["result"]))
        if result:
            raise DataError(
                f"--scene: at {1e3 * level:.4g} mm of travel: {NAMES[result]}. "
                f"{advice(NAMES[result])}"
            )
    return points


def _by_inputs(curve: BodyCurve, law: AbstractLaw) -> tuple[tuple[str, ...], np.ndarray]:
    """What the skin's inputs do to the readings; see `BodySpecimen`."""
    spec = curve.scene.scene
    tables: dict[str, Spec] = {}
    if spec.oil.trapped and spec.oil.fill is None:
        tables["oil"] = spec.oil.model_copy(update={"fill": 1.0})
    if spec.geometry.mounting is None:
        tables["geometry"] = spec.geometry.model_copy(update={"mounting": 0.0})
    spec = spec.model_copy(update=tables)
    inputs = inputs_of(spec) | {path: np.asarray(x) for path, x in curve.inputs.items()}
    nothing = {path: 0 * x for path, x in inputs.items()}
    names, changes = [], []
    for name in ("geometry.thickness", "geometry.oil_gap", "oil.fill", "geometry.mounting"):
        own = {path for path in inputs if path == name or path.startswith(f"{name}.value.")}
        whole = name in ("oil.fill", "geometry.mounting")
        if own:
            names.append(name)
            sizes = {path: nothing[path] + 1 if whole else inputs[path] for path in own}
            changes.append({**nothing, **sizes})
    directions = {path: np.stack([c[path] for c in [*changes, nothing]]) for path in nothing}
    zero = np.eye(len(names) + 1)[-1]
    known = {path: jnp.asarray(x) for path, x in inputs.items()}
    scene = Structure(spec, wall=curve.scene.wall)
    named = dataclasses.replace(curve, inputs=known, scene=scene)
    slopes = COMPILED.run(_slopes, named, law, directions, zero, once=True)
    return (*names, ZERO), np.asarray(slopes).T


@eqx.filter_jit
def _slopes(
    curve: BodyCurve, law: AbstractLaw, directions: dict[str, Array], zero: Array
) -> Float[Array, "input n"]:
    def along(direction: dict[str, Array], shift: Array) -> Array:
        def changed(step: Array) -> Array:
            inputs = {path: x + step * direction[path] for path, x in curve.inputs.items()}
            travel = curve.travel + step * shift
            return dataclasses.replace(curve, inputs=inputs, travel=travel).at_start(law)

        nought = jnp.zeros(())
        return jax.jvp(changed, (nought,), (nought + 1,))[1]

    return jax.vmap(along)(directions, zero)
