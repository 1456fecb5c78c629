"""The membrane's shape in states that are solved one by one: on pads, and under bodies.

Every state is a scene: round contacts of known force or displacement on a pad, or rigid bodies
of known travel. Scenes that differ in numbers alone share one program. A state keeps its mesh,
over which its load slides, and starts from its last equilibrium when constants have changed.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.arrays import Floats
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.constants import AXIAL, PLACE, PUSH, with_constants
from fitting.sensor.shapes.deformations import NoDeformation
from fitting.sensor.shapes.shape_slopes import Moving, slopes_of
from fitting.sensor.shapes.taxel_face import taxel_face
from suas_jax.config import BodyLoadSpec, PatchLoadSpec, SceneSpec, SkinSpec, SolveSpec
from suas_jax.config.input_errors import stresses_of
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import Corrected, corrected
from suas_jax.equilibrium.equilibrium import differentiable, equilibrium
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.mechanics.face import AbstractFace
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.pad.model import PadMesh
from suas_jax.mechanics.registry import MODELS
from suas_jax.numerics.lanes import number
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import plan_for, problem_of
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import SceneParts, scene_parts
from suas_jax.scene.program import at_rest, inputs_of
from suas_jax.scene.structure import Structure
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.plain import plain_geometry

DIAMETER = 6e-3
"""Of contacts whose diameter no column gives [m]."""
_ACCURACY = 1e-7  # of a displacement that is met [m]
_SECANTS = 12
_FIRST = 1e-4  # first force of a secant, in terms of the largest stress and the thickness

Inputs = Mapping[str, Any]


class Solved(NamedTuple):
    """Solved states.

    Attributes:
        face: the deformed inner faces.
        force: on each load, given or found [load, state] [N].
        displacement: of the material under each load, inwards [load, state] [m].
        slope: derivatives of the faces' arrays by the constants that move the membrane, along
            a leading axis; None where there are none.
    """

    face: AbstractFace
    force: Floats
    displacement: Floats
    slope: AbstractFace | None


class _Read(NamedTuple):
    """What a program says of one state, beside what `Solved` has.

    Attributes:
        state: the equilibrium.
        change: what the state that is read adds to it, see `corrected`.
        gap: the smallest [m].
        result: index of the outcome.
    """

    state: State
    change: State
    face: AbstractFace
    force: Array
    displacement: Array
    gap: Array
    result: Array


class SceneStates:
    """Solves known states one by one.

    Args:
        spec: the skin.
        told: the loads as they were told, around which meshes are made.
        progress: called with what is being done.

    Raises:
        ValueError: a load on a pad is turned, or several displacements are known at once.
    """

    def __init__(
        self,
        spec: SkinSpec,
        told: KnownLoads,
        progress: Callable[[str], None] = lambda text: None,
    ) -> None:
        if np.any(told.turn):
            raise ValueError("known loads on a pad are radial: leave the direction out")
        if (np.isfinite(told.displacement).sum(0) > 1).any():
            raise ValueError("on a pad only one displacement at a time can be a known input")
        self._spec, self._told, self._progress = spec, told, progress
        self._section = plain_geometry(spec.geometry).section
        given = {name: getattr(spec, name) for name in spec.model_fields_set}
        first = self._loads(told, 0)
        whole = SceneSpec(**given, load=first, solve=SolveSpec(symmetry=False))
        self._scene, self._numbers = Structure(whole), inputs_of(whole)
        self._plans = self._planned(whole)
        self._last: dict[int, State] = {}
        self._nearby: dict[bytes, State] = {}  # by the mesh, of states not solved before

    def _loads(self, loads: KnownLoads, k: int) -> tuple[BodyLoadSpec | PatchLoadSpec, ...]:
        """The loads of a state as a scene has them."""
        found: list[BodyLoadSpec | PatchLoadSpec] = []
        for i in range(len(loads.angle)):
            arc = float(self._section.arc(loads.angle[i, k])[0])
            place = {"arc": arc, "axial": float(loads.axial[i, k])}
            if loads.bodies:
                shape = "cylinder" if self._spec.geometry.dimension == 2 else "sphere"
                own = {"radius": float(loads.radius[i, k]), "depth": float(loads.depth[i, k])}
                found.append(BodyLoadSpec(shape=shape, **place, **own))
            else:
                diameter = float(loads.diameter[i, k]) or DIAMETER
                force = float(np.nan_to_num(loads.force[i, k]))
                found.append(PatchLoadSpec(diameter=diameter, force=force, **place))
        return tuple(found)

    def _planned(self, scene: SceneSpec) -> list[AbstractPlan]:
        """Meshes of all states with as many elements and load points each."""
        # Checking the electrodes takes long, and no mesh depends on them.
        bare = scene.model_copy(update={"electrodes": None})
        scenes = [
            bare.model_copy(update={"loads": self._loads(self._told, k)})
            for k in range(self._told.states)
        ]
        model = MODELS[scene.geometry.dimension]["shell"]
        most = np.max([model.first(each) for each in scenes], 0)
        counts = tuple(int(n) for n in most)
        plans = [plan_for(each, "shell", counts) for each in scenes]
        if not isinstance(plans[0], PadMesh):
            return plans
        pads = [plan.plan for plan in plans if isinstance(plan, PadMesh)]
        points = np.array([pad.spread for pad in pads]).reshape(len(pads), -1, 2).max(0)
        spread = tuple((int(a), int(b)) for a, b in points)
        return [PadMesh(dataclasses.replace(pad, spread=spread)) for pad in pads]

    def solve(
        self,
        index: np.ndarray,
        loads: KnownLoads,
        held: Inputs,
        moving: Mapping[str, float],
        latent: tuple[str, ...],
        oil: AbstractOil | None,
    ) -> Solved:
        """Find the shape of the membrane in some states, and its derivatives.

        Args:
            index: which states.
            loads: of these states, errors of presses included.
            held: SI values by TOML path, without the constants that move the membrane.
            moving: those constants by name.
            latent: kinds of errors of the first load that derivatives are wanted by, too.
            oil: how the fluid answers, if not as the skin file says.

        Raises:
            NoDeformation: a state has no equilibrium, or its displacement is not met.
        """
        both = Moving.of({**moving, **dict.fromkeys(latent, 0.0)})
        inputs = self._numbers | with_constants(self._spec, held, moving, moving.values())
        found, slopes = [], []
        for row, k in enumerate(index):
            self._progress(f"deforming the membrane, state {row + 1} of {len(index)}")
            own = {
                f"load.{i}.{key}": np.asarray(getattr(load, key))
                for i, load in enumerate(self._loads(loads, row))
                for key in ("arc", "axial", "diameter", "force", "radius", "depth")
                if getattr(load, key, None) is not None
            }
            one = self._state(int(k), loads, row, inputs | own, oil)
            found.append(one)
            self._last[int(k)] = self._nearby[_mesh(self._plans[k])] = one.state
            if both.names:
                wanted = np.isfinite(loads.displacement[:, row : row + 1]).astype(float)
                known = self._numbers | dict(held) | own
                arguments = known, loads.angle[:, row], one.force, wanted, loads.inner
                slopes.append(
                    COMPILED.run(
                        _slopes,
                        self._scene,
                        self._plans[k],
                        jax.tree.map(jnp.asarray, arguments),
                        both,
                        oil,
                        one.state,
                        one.change,
                        once=True,
                        long=True,
                    )
                )

        def joined(parts: list[Any]) -> Any:
            return jax.tree.map(lambda *x: np.concatenate(x, -1), *parts)

        return Solved(
            joined([one.face for one in found]),
            joined([one.force for one in found]),
            joined([one.displacement for one in found]),
            joined(slopes) if slopes else None,
        )

    def _state(
        self, k: int, loads: KnownLoads, row: int, inputs: Inputs, oil: AbstractOil | None
    ) -> _Read:
        """The equilibrium of one state."""

        def run(changed: Inputs, start: State | None) -> _Read:
            numbers = {**inputs, **changed}
            rest = at_rest(self._plans[k])
            found: _Read | None = None
            for begin in (start, rest):
                if begin is not None and (found is None or number(found.result) != 0):
                    found = COMPILED.run(
                        _solved,
                        self._scene,
                        self._plans[k],
                        {path: jnp.asarray(x) for path, x in numbers.items()},
                        loads.inner,
                        oil,
                        begin,
                        once=True,
                        long=True,
                    )
            assert found is not None
            _insist(found, loads, row)
            return found

        wanted = loads.displacement[:, row]
        rests = np.nan_to_num(wanted) == 0
        if rests.all():
            near = (
                self._nearby.get(_mesh(self._plans[k])) if np.any(loads.force[:, row]) else None
            )
            return run({}, self._last.get(k, near))
        i = int(np.flatnonzero(~rests)[0])
        return self._met(run, i, float(wanted[i]))

    def _met(
        self, run: Callable[[Inputs, State | None], _Read], i: int, wanted: float
    ) -> _Read:
        """The state in which load i has moved as wanted, by the secant method."""
        stress = max(stresses_of(self._spec).values())
        first = _FIRST * stress * self._spec.geometry.mean_thickness**2
        before, offset, force = 0.0, -wanted, np.sign(wanted) * first
        start: State | None = None
        for _ in range(_SECANTS):
            found = run({f"load.{i}.force": force}, start)
            start = found.state
            moved = float(np.asarray(found.displacement)[i, 0])
            missing = moved - wanted
            if abs(missing) < _ACCURACY:
                return found
            slope = (missing - offset) / (force - before)
            before, offset = force, missing
            # The pad softens under load: a step doubles the displacement at most.
            limit = max(abs(moved), 0.1 * abs(wanted)) * 2 / abs(slope)
            force = before + float(np.clip(-missing / slope, -limit, limit))
        raise NoDeformation(
            f"load {i}: no force moves the pad by {1e3 * wanted:.4g} mm; check the column's "
            "unit and sign"
        )


def _mesh(plan: AbstractPlan) -> bytes:
    """What tells meshes apart that share a program."""
    return b"".join(np.asarray(x).tobytes() for x in jax.tree.leaves(plan))


def _insist(found: _Read, loads: KnownLoads, row: int) -> None:
    """Refuse a state without equilibrium, or one in which a body presses on the wall."""
    result, through = int(number(found.result)), loads.bodies and number(found.gap) <= 0
    if not result and not through:
        return
    amounts = 1e3 * loads.depth[:, row] if loads.bodies else np.ravel(found.force)
    unit = "mm deep" if loads.bodies else "N"
    where = ", ".join(
        f"{amount:.4g} {unit} at {np.rad2deg(a):.4g} deg, {1e3 * z:.4g} mm axially"
        for amount, a, z in zip(amounts, loads.angle[:, row], loads.axial[:, row], strict=True)
    )
    if not result:
        raise NoDeformation(
            f"a body {where} presses the membrane onto the wall; leave such rows out"
        )
    name = NAMES[result]
    raise NoDeformation(f"{where}: {name}. {advice(name)}; check the columns' units")


def _problem(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, oil: AbstractOil | None
) -> tuple[SceneParts, Problem]:
    parts = scene_parts(scene.scene, inputs)
    if oil is not None:
        parts = parts._replace(skin=parts.skin._replace(oil=oil))
    return parts, problem_of(parts, plan)


def _read(
    parts: SceneParts, problem: Problem, found: Corrected, inner: Array
) -> tuple[AbstractFace, Array, Array]:
    """Inner face, forces and displacements of the loads in a known state."""
    root, shown, mechanics = found
    seen = dataclasses.replace(problem, mechanics=mechanics)
    entries = load_observables(parts, seen, shown, problem.mechanics, root)
    keys = ("force_N", "displacement_m", "inner_displacement_m")
    force, mid, below = (jnp.stack([x[key] for x in entries]) for key in keys)
    face = mechanics.face(shown.q)
    if face.varies_along_axis:
        face = taxel_face(face, parts.skin.sensing(), parts.skin.geometry)
    return face, force, jnp.where(inner[:, None], below, mid)


@eqx.filter_jit
def _solved(
    scene: Structure,
    plan: AbstractPlan,
    inputs: Inputs,
    inner: Array,
    oil: AbstractOil | None,
    start: State,
) -> _Read:
    parts, problem = _problem(scene, plan, inputs, oil)
    found = equilibrium(problem, start)
    whole = corrected(problem, found.state)
    change = jax.tree.map(lambda a, b: a - b, whole.state, whole.root)
    read = _read(parts, problem, whole, inner)
    gap = problem.mechanics.shape(found.state.q).smallest_gap(parts.skin.geometry).value
    return _Read(found.state, change, *read, gap, found.result)


@eqx.filter_jit
def _slopes(
    scene: Structure,
    plan: AbstractPlan,
    known: tuple[Inputs, Array, Array, Array, Array],
    moving: Moving,
    oil: AbstractOil | None,
    state: State,
    change: State,
) -> AbstractFace:
    """See `slopes_of`; known are numbers, angles [load], forces, what is wanted, inner.

    What `corrected` adds is kept: a hundredth of the shape, whose derivative would cost most.
    """
    inputs, angle, force, wanted, inner = known
    section = plain_geometry(scene.scene.geometry).section

    def shape(values: Array, force: Array) -> tuple[Array, AbstractFace]:
        own = with_constants(scene.scene, inputs, moving.names, values)
        own["load.0.arc"] = section.arc(angle[:1] + moving.shift(PLACE, values))[0]
        own["load.0.axial"] = own["load.0.axial"] + moving.shift(AXIAL, values)
        for i in range(len(force)):
            if f"load.{i}.force" in own:
                push = 1 + moving.shift(PUSH, values) if i == 0 else 1
                own[f"load.{i}.force"] = push * force[i, 0]
        parts, problem = _problem(scene, plan, own, oil)
        root = differentiable(problem, state)
        shown = jax.tree.map(lambda a, b: a + b, root, change)
        whole = Corrected(root, shown, problem.mechanics.around(root.q))
        face, _, moved = _read(parts, problem, whole, inner)
        return moved, eqx.filter(face, eqx.is_inexact_array)

    return slopes_of(shape, moving.values, force, wanted)
