"""Solve a scene: choose model and mesh, find the equilibrium, estimate its error, report."""

import dataclasses
import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from suas_jax.config import SceneSpec, with_solve
from suas_jax.config.errors import ConfigError, Mistake
from suas_jax.config.quantities import format_quantity
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.buckling import stress_effect
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.equilibrium.validity import ON_CLAMP
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.numerics.lanes import number
from suas_jax.runtime.compiled import COMPILED, require_float64
from suas_jax.runtime.compiling import COMPILE_TIME
from suas_jax.scene.build import Inputs, Structure, build_problem, decay_angle
from suas_jax.scene.choice import Attempt, Tried, choose
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of, meshes_of, prepared, run_program, structure_of
from suas_jax.scene.report import plain, report_of
from suas_jax.scene.travel import travels_of
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.prestress import is_prestressed
from suas_jax.skin.section import outward

_KEPT = ("oil_pressure_Pa", "hoop_force_N_per_m", "max_displacement_m", "min_gap_m")
_ALONG_EDGE = 801  # places along a pad's clamped edge


@eqx.filter_jit
def _effect(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, rest: State
) -> dict[str, Any]:
    effect = stress_effect(build_problem(scene.scene, plan, inputs), rest)
    return effect._asdict()


def rest_of(scene: SceneSpec, found: Attempt, *, once: bool) -> dict[str, Any]:
    """Solve a scene without its loads, on the mesh that it was solved on.

    Returns the keys of `REST_KEYS`; a rest that was not found is unstable, and has no more.
    """
    idle = with_solve(scene, oil_pressure=None)
    plan, meshes, inputs, start = prepared(idle, found.plan.model, found.plan.counts)
    nothing = {
        path: np.zeros(())
        for i in range(len(scene.loads))
        for path in (f"load.{i}.force", f"load.{i}.pressure")
        if path in inputs
    }
    away = {
        f"load.{i}.depth": np.asarray(-idle.geometry.width)
        for i, load in enumerate(scene.loads)
        if load.kind == "body"
    }
    nothing |= away
    static = structure_of(idle, wall=found.wall)
    report, state, _, _, outcome = run_program(
        static, meshes, inputs | nothing, start, once=once, travels_given=True
    )
    if number(outcome["result"]) != 0:
        return {"stable": False}
    seen = plain(report)
    effect = plain(
        COMPILED.run(_effect, static, plan, inputs_of(idle) | away, state, once=True)
    )
    pushed = any(load.kind in ("line", "patch") for load in scene.loads)
    return {
        "stable": seen["stable"],
        **{key: seen[key] for key in _KEPT[:2]},
        "buckling_share": effect["share"],
        "stiffness_change": effect["stiffness_change"] if pushed else None,
        **{key: seen[key] for key in _KEPT[2:]},
        "displacement_m": [load.get("displacement_m") for load in seen["loads"]],
        "so": seen.get("taxels", {}).get("so", []),
    }


@dataclasses.dataclass(frozen=True)
class Solution:
    """A solved scene.

    Attributes:
        report: the quantities of `suas solve --json`, SI units in the key names.
        state: the equilibrium on the whole membrane.
        shown: the state that the report describes: the equilibrium, where the mechanics is
            `corrected` with the first-order effect of what it leaves out.
        plan: its mesh.
        scene: what was solved.
        wall: whether the wall was there.
        part: the equilibrium on the part of the mesh that is solved.
        coarsest: the smallest mesh tried on the way, whose program is at hand.
        once: whether its program was compiled to run once.
    """

    report: dict[str, Any]
    state: State
    shown: State
    plan: AbstractPlan
    scene: SceneSpec
    wall: bool
    part: State
    coarsest: Tried
    once: bool = True

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was found."""
        return bool(self.report["status"] == "converged")

    @property
    def inputs(self) -> dict[str, np.ndarray]:
        """The scene's numbers as its programs take them, travels that were found among them."""
        return inputs_of(self.scene) | travels_of(self.scene, self.report)

    def problem(self) -> Problem:
        """The discrete problem on the whole arc."""
        return build_problem(self.scene, self.plan, self.inputs, wall=self.wall)

    def read(self, reading: Callable[[Problem, State, State], Any]) -> Any:
        """What a function reads of the solved states, as NumPy arrays, by one program.

        It is given the problem on the whole membrane, the equilibrium and the state to report;
        the program is kept where its module knows the function by name.
        """
        scene = structure_of(self.scene, wall=self.wall)
        states = self.state, self.shown
        found = COMPILED.run(_read, scene, self.plan, self.inputs, reading, *states, once=True)
        return jax.tree.map(np.asarray, found)


@eqx.filter_jit
def _read(
    scene: Structure,
    plan: AbstractPlan,
    inputs: Inputs,
    reading: Callable[[Problem, State, State], Any],
    state: State,
    shown: State,
) -> Any:
    return reading(build_problem(scene.scene, plan, inputs, wall=scene.wall), state, shown)


def solve(scene: SceneSpec, *, repeat: int = 1) -> Solution:
    """Find the equilibrium of a scene.

    The mesh is the one the scene asks for (`elements`, `mesh`), or is refined until the
    estimated error meets `rtol`. Where the model is left open too (`auto`), it is the
    shell unless what its correction leaves out is more than `rtol` allows, or no mesh of it
    meets `rtol`.

    Args:
        scene: what to solve.
        repeat: how often to run; the solve time is the median. More than one run is worth
            a program that takes longer to compile and less time to run.

    Returns:
        The solution; a failed solve is named in its report, not raised.

    Raises:
        ConfigError: a body would end over a clamped edge, whatever the solution.
        Float64Error: float64 is off.
    """
    require_float64()
    compiled_before = COMPILE_TIME.seconds
    check_bodies(scene)
    decay_angle(scene)  # its small program is compiled, and kept, outside the time measured
    seconds, once = [], repeat == 1
    for run in range(repeat + (repeat > 1)):
        begin, compiling = time.perf_counter(), COMPILE_TIME.seconds
        found, reason = choose(scene, once=once)
        elapsed = time.perf_counter() - begin - (COMPILE_TIME.seconds - compiling)
        if run > 0 or repeat == 1:  # of several, the first one compiles
            seconds.append(elapsed)
    outcome = plain(found.outcome) | {"model": found.plan.model, "reason": reason}
    rest = rest_of(scene, found, once=once) if is_prestressed(scene) else None
    if rest is not None and not rest["stable"]:
        if found.converged and found.stable:
            outcome["reason"] += " Without its loads the skin buckles by what it carries."
        else:
            outcome["result"] = index_of("unstable")
    report = report_of(scene, plain(found.report), outcome, rest)
    report["timings_s"] = {
        "compile": COMPILE_TIME.seconds - compiled_before,
        "solve": statistics.median(seconds),
    }
    states = found.state, found.shown, found.plan
    return Solution(report, *states, found.scene, found.wall, found.part, found.coarsest, once)


def report_with(
    solution: Solution, inputs: Mapping[str, float], *, judged: bool = False
) -> dict[str, Any] | None:
    """What a solution's scene reports with other numbers; None where no solution was found.

    `solution`: of the scene; nothing is compiled anew. `inputs`: SI values by TOML path that
    replace the scene's own. `judged`: whether errors are wanted, on the solution's own mesh;
    without them it is the smallest mesh that was tried.
    """
    scene = solution.scene
    plan, start = (solution.plan, solution.part) if judged else solution.coarsest
    arrays = solution.inputs | {k: np.asarray(v, float) for k, v in inputs.items()}
    static, once = structure_of(scene, wall=solution.wall), solution.once
    report, *_, outcome = run_program(
        static, meshes_of(scene, plan), arrays, start, once=once, judged=judged
    )
    return plain(report) if number(outcome["result"]) == 0 else None


def check_bodies(scene: SceneSpec) -> None:
    """Refuse travels that end over a clamped edge, which needs no solution to be known.

    Where a body that is pulled along by a force ends is not known before.
    Raises ConfigError: names the travel and what is possible there.
    """
    bodies = [(i, load) for i, load in enumerate(scene.loads) if load.kind == "body"]
    travels = {i: x.depth for i, x in bodies if x.depth is not None and not x.pulled}
    if not travels:
        return
    static = structure_of(scene, wall=False)
    rooms = COMPILED.run(_rooms, static, inputs_of(scene), once=True)
    over, wrong = ON_CLAMP * scene.geometry.mean_thickness, []
    for (i, _), room in zip(bodies, map(float, rooms), strict=True):
        depth = travels.get(i, 0.0)
        if depth <= max(room, 0.0) + over:
            continue
        most = "it meets one at first touch"
        if room > over:
            size = format_quantity(float(f"{room:.3g}"), "length")
            most = f"less than {size} is possible there"
        advice = (
            "the body would lie over a clamped edge, which does not give way: "
            f"{most}; press it less deep or elsewhere, or give it a smaller size"
        )
        shown = f'"{format_quantity(depth, "length")}"'
        wrong.append(Mistake("scene", f"load.{i}.depth", advice, shown))
    if wrong:
        raise ConfigError(wrong)


@eqx.filter_jit
def _rooms(scene: Structure, inputs: Inputs) -> list[Array]:
    """Travels at which the bodies of a scene meet a clamped edge [m]."""
    parts = scene_parts(scene.scene, inputs)
    edges = _clamped_edges(parts.skin.geometry, pad=scene.scene.geometry.dimension == 3)
    return [jnp.min(body.room(edges)) for body in parts.bodies]


def _clamped_edges(geometry: SkinGeometry, *, pad: bool) -> Array:
    """Places on the edges of the undeformed outer face [component, point, lane] [m]."""
    section, half = geometry.section, geometry.half_angle

    def face(share: Array) -> Array:
        angle = share[:, None] * half
        height = section.thickness(angle) / 2
        return section.mid_line(angle) + height * outward(section.direction(angle))

    ends, share = jnp.array([-1.0, 1.0]), jnp.linspace(-1.0, 1.0, _ALONG_EDGE)
    if not pad:
        return face(ends)
    axial, end = share[:, None] * geometry.width / 2, geometry.width / 2
    straight = [(face(jnp.full_like(share, k)), axial) for k in (-1.0, 1.0)]
    curved = [(face(share), jnp.broadcast_to(k * end, axial.shape)) for k in (-1.0, 1.0)]
    edges = [jnp.concatenate([x, z[None]]) for x, z in (*straight, *curved)]
    return jnp.concatenate(edges, 1)
