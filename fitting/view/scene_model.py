"""A scene solved again for other numbers by one compiled program; its loads on the page.

Section and pad go the same way: a mesh graded around the loads, of one size for all of their
places, and Newton's method from the last state, whose dent the mesh carries along.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import Contact
from fitting.view.picture import Grid
from suas_jax.config import SceneSpec, with_inputs, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.friction import equilibrium_with_friction
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.pad.model import PadMesh
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.registry import MODELS
from suas_jax.mechanics.section import section_of
from suas_jax.numerics.lanes import number
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.assessment import under_bodies
from suas_jax.scene.build import Inputs, Structure, decay_angle, problem_of
from suas_jax.scene.contact_zone import touched_by_bodies
from suas_jax.scene.force_search import under_forces
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import at_rest, inputs_of, structure_of
from suas_jax.scene.travel import driven_by_force, travels_of
from suas_jax.skin.body_shapes import AbstractShape
from suas_jax.skin.plain import plain_geometry

_ELEMENTS = {2: (32,), 3: (16, 12)}
"""Elements of the mesh along the arc, and of a pad along the axis, unless the scene says so."""
_SAMPLES = 8  # intervals of a section's element
_HALF_WIDTHS = "contact_half_width_m", "contact_half_width_axial_m"
_REACH = 0.4  # of a body that is drawn, in lengths of the section per angle
_RAYS, _RINGS = 48, 17  # of a surface: directions from the tip, and points along each
_HALVINGS = 40


class Solved(NamedTuple):
    """A scene's answer."""

    displacement: Floats  # of the inner face's points of the grid [point, 3] [m]
    so: Floats  # sensor output [taxel] [counts]; NaN where nothing parts taxel and membrane
    oil_pressure: float  # above ambient [Pa]
    min_gap: float  # smallest between membrane and wall [m]
    status: str  # name of the outcome
    # what is observed of each load, as `suas solve --json` prints it
    loads: list[dict[str, Any]]
    bodies: list[tuple[Floats, Floats]]  # tip of each body [3] [m], and its axes [3, 3]

    @property
    def converged(self) -> bool:
        """Whether an equilibrium was found."""
        return self.status == "converged"


def moved(mechanics: AbstractMechanics, q: Array, angle: Array, axial: Array) -> Array:
    """Displacement of points of the inner face [point, 3] [m]."""
    if isinstance(mechanics, Pad):
        return mechanics.faces(q, angle[:, None], axial[:, None]).inner_displacement[..., 0].T
    shape = section_of(mechanics).profile(q, _SAMPLES)
    places = shape.angle[..., 0].T.ravel()
    sides = [jnp.interp(angle, places, x[..., 0].T.ravel()) for x in shape.inner_displacement]
    return jnp.stack([*sides, jnp.zeros_like(angle)], 1)


@eqx.filter_jit
def _solve(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, start: State, points: Array
) -> tuple[dict[str, Any], State, State, State, dict[str, Any]]:
    """What is shown of a scene, in the form that `under_forces` takes."""
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan, wall=scene.wall)
    found = equilibrium_with_friction(problem, start)
    root, shown, seen = corrected(problem, found.state)
    reading = dataclasses.replace(problem, mechanics=seen)
    electrodes = parts.skin.electrodes
    report = {
        "loads": load_observables(parts, reading, shown, problem.mechanics, root),
        "moved": moved(problem.mechanics, shown.q, *points),
        "so": jnp.zeros(0) if electrodes is None else electrodes.read(seen, shown.q).so[:, 0],
        "oil_pressure": shown.pressure[0],
        "min_gap": seen.shape(shown.q).smallest_gap(parts.skin.geometry).value[0],
        "bodies": [
            ((body.origin + body.way)[..., 0], body.frame[..., 0]) for body in parts.bodies
        ],
    }
    touched = touched_by_bodies(problem, found.state)
    result = under_bodies(problem, found.state, found.outcome, touched)
    return report, found.state, shown, found.state, {"result": result}


class SceneModel:
    """A scene as a function of its continuous inputs.

    `scene`: with all its inputs stated, and loads as they are (no wanted oil pressure). `grid`:
    of the points that are asked for.
    """

    def __init__(self, scene: SceneSpec, grid: Grid) -> None:
        self.scene, self._points = scene, jnp.stack([jnp.asarray(x) for x in grid.points])
        # No mesh depends on the electrodes, which take long to check.
        bare = scene.model_copy(update={"electrodes": None})
        self._bare = with_solve(bare, symmetry=False)
        self._model = MODELS[scene.geometry.dimension]["shell"]
        self._counts = self._model.given(scene) or _ELEMENTS[scene.geometry.dimension]
        self._decay = decay_angle(self._bare)
        self._spread: tuple[tuple[int, int], ...] | None = None
        self._near: dict[bool, State] = {}  # last states, without and with the wall
        self._touching = False
        self._travels: dict[str, Any] = {}

    def __call__(self, values: Mapping[str, float]) -> Solved:
        """Solve for other inputs.

        The wall is left out until the membrane reaches it, as `solve` does.

        Raises ValueError: a value is not allowed.
        """
        bare = with_inputs(self._bare, values)
        inputs = {
            **inputs_of(self.scene),
            **{k: np.asarray(v, float) for k, v in values.items()},
        }
        held = self.scene.wall.contact
        solved = self._solved(bare, inputs, wall=self._touching)
        if held and not self._touching and not (solved.converged and solved.min_gap > 0):
            solved = self._solved(bare, inputs, wall=True)
        self._touching = held and solved.converged and solved.min_gap <= 0
        return solved

    def _solved(self, scene: SceneSpec, inputs: Inputs, *, wall: bool) -> Solved:
        plan = self._plan(scene)
        static = structure_of(self.scene, wall=wall)

        def run(inputs: Inputs, start: State) -> Any:
            return COMPILED.run(_solve, static, plan, inputs, start, self._points)

        start = self._near.pop(wall, None) or at_rest(plan)
        if driven_by_force(scene):
            found = under_forces(scene, {**inputs, **self._travels}, start, run)
        else:
            found = run(inputs, start)
        report, state, *_, outcome = jax.tree.map(np.asarray, found)
        loads = [{k: number(x) for k, x in load.items()} for load in report["loads"]]
        solved = Solved(
            report["moved"],
            report["so"],
            float(report["oil_pressure"]),
            float(report["min_gap"]),
            NAMES[int(outcome["result"][0])],
            loads,
            report["bodies"],
        )
        if solved.converged:
            self._near[wall] = state
            self._travels = travels_of(scene, {"loads": loads})
        return solved

    def _plan(self, scene: SceneSpec) -> AbstractPlan:
        """A mesh graded around the loads, with no fewer load points than any before it."""
        plan = self._model.plan(scene, self._counts, self._decay)
        if not isinstance(plan, PadMesh):
            return plan
        spread = self._spread or plan.plan.spread
        self._spread = tuple(
            (max(a, c), max(b, d))
            for (a, b), (c, d) in zip(spread, plan.plan.spread, strict=True)
        )
        return PadMesh(dataclasses.replace(plan.plan, spread=self._spread))


def known_contacts(
    scene: SceneSpec, grid: Grid, loads: Sequence[dict[str, Any]]
) -> dict[int, Contact]:
    """The scene's loads that have a place, by their number.

    `scene`: says how forces are directed. `loads`: what is observed of them.
    """
    found = {}
    for i, (spec, load) in enumerate(zip(scene.loads, loads, strict=True)):
        if spec.kind == "pressure":
            continue
        angle, arc = np.deg2rad(load["angle_deg"]), load.get("arc_m")
        way = "radial" if spec.kind == "body" else spec.direction
        turn = way if isinstance(way, float) else 0.0
        if way == "vertical":
            told = ("angle", angle) if arc is None else ("arc", arc)
            turn = grid.direction(float(grid.places.from_place(told[0], np.asarray(told[1]))))
        axial = None if spec.kind == "line" else load.get("axial_m")
        by_arc = not scene.geometry.has_angle
        found[i] = Contact(
            angle, load["force_N"], turn, None, axial=axial, arc=arc, by_arc=by_arc
        )
    return found


def body_rows(loads: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Travel, force and zone of contact of each body, for the page's table."""
    return [
        (f"body {i + 1}" if len(loads) > 1 else "body", _body(load))
        for i, load in enumerate(loads)
        if "depth_m" in load
    ]


def _body(load: dict[str, Any]) -> str:
    force, depth = load["force_N"], 1e3 * load["depth_m"]
    if force <= 0:
        return f"{depth:.3f} mm, touches nothing"
    zone = [2e3 * load[key] for key in _HALF_WIDTHS if key in load]
    over = " by ".join(f"{x:.1f}" for x in zone) + " mm"
    if not load["contact_resolved"]:
        over = "a zone smaller than the mesh"
    return f"{depth:.3f} mm, {force:.3f} N, over {over}"


def surfaces_of(scene: SceneSpec) -> list[list[list[float]]]:
    """Surfaces of a scene's bodies in their own frames, for each a grid [ray * ring, 3] [m].

    In plane strain there are two rays, along the section.
    """
    at_touch = {f"load.{i}.depth": np.zeros(()) for i, x in enumerate(scene.loads)}
    parts = scene_parts(scene, inputs_of(scene) | at_touch)
    reach = _REACH * float(plain_geometry(scene.geometry).outer_size[0])
    pad = scene.geometry.dimension == 3
    turn = np.linspace(0, 2 * np.pi, _RAYS + 1) if pad else np.array([np.pi, 0.0])
    ways = np.stack([np.cos(turn), np.sin(turn)][: 1 + pad])
    return [_surface(body.shape, ways, reach).tolist() for body in parts.bodies]


def _surface(shape: AbstractShape, ways: Floats, reach: float) -> Floats:
    """Points from the tip outwards, up to where the surface ends or leaves the picture."""

    def height(size: Floats) -> Floats:
        across = jnp.asarray(ways * size)[..., None]
        return np.asarray(shape.height(across))[..., 0]

    low, high = np.zeros(ways.shape[1]), np.full(ways.shape[1], reach)
    if not (height(high) <= reach).all():
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            inside = height(middle) <= reach
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        high = low
    shares = np.sin(np.linspace(0, np.pi / 2, _RINGS))  # denser where a ball is steep
    rings = [(share * high, height(share * high)) for share in shares]
    points = [np.stack([*(ways * size), *((2 - len(ways)) * [0 * h]), h]) for size, h in rings]
    return np.stack(points, -1).transpose(1, 2, 0).reshape(-1, 3)


def placed(bodies: list[tuple[Floats, Floats]]) -> list[dict[str, Any]]:
    """Where bodies are: tips and axes, in space."""
    found = []
    for tip, frame in bodies:
        flat = len(tip) == 2
        axes = [np.pad(row, (0, flat)).tolist() for row in frame]
        if flat:
            axes.insert(1, [0.0, 0.0, 1.0])
        found.append({"tip": np.pad(tip, (0, flat)).tolist(), "axes": axes})
    return found
