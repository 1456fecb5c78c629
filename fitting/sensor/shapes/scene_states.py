"""The membrane's shape in states that are solved one by one: on pads, and under bodies.

Every state is a scene: round contacts of known force or displacement on a pad, or rigid bodies
of known travel. Scenes that differ in numbers alone share one program. A state keeps its mesh,
over which its load slides, and starts from its last equilibrium when constants have changed.
"""

import dataclasses
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.constants import PUSH, with_constants
from fitting.sensor.shapes.deformations import NoDeformation, place_text
from fitting.sensor.shapes.state_programs import (
    Inputs,
    Moving,
    SolvedState,
    solve_state,
    state_slopes,
)
from suas_jax.config import (
    BodyLoadSpec,
    LineLoadSpec,
    PatchLoadSpec,
    SceneSpec,
    SkinSpec,
    SolveSpec,
)
from suas_jax.config.consistency import contradictions
from suas_jax.config.input_errors import stresses_of
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.correction import corrected, uncorrected
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.pad.model import PadMesh
from suas_jax.mechanics.registry import MODELS
from suas_jax.mechanics.shape import AbstractFace
from suas_jax.numerics.lanes import number
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Structure, plan_for
from suas_jax.scene.program import at_rest, inputs_of
from suas_jax.scene.skin import PAD_ELEMENTS
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.plain import plain_geometry
from suas_jax.skin.section import AbstractSection

DIAMETER = 6e-3
"""Of contacts whose diameter no column gives [m]."""
KnownLoad = BodyLoadSpec | LineLoadSpec | PatchLoadSpec
_ACCURACY = 1e-7  # of a displacement that is met [m]
_SECANTS = 12
_FIRST = 1e-4  # first force of a secant, in terms of the largest stress and the thickness

# Derivatives of a unit as built are found at its drawing and once more, near the unit; the
# steps that follow are small.
_AS_BUILT_ROUNDS = 2


class Solved(NamedTuple):
    """Solved states."""

    face: AbstractFace  # the deformed inner faces
    force: Floats  # on each load, given or found [load, state] [N]
    displacement: Floats  # of the material under each load, inwards [load, state] [m]
    # derivatives of the faces' arrays by the constants that move the membrane, along a leading
    # axis; None where there are none
    slope: AbstractFace | None


class SceneStates:
    """Solves known states one by one.

    Raises ValueError: a load on a pad is turned or lies off it, or several displacements are
    known at once.
    """

    def __init__(
        self,
        spec: SkinSpec,
        told: KnownLoads,  # the loads as they were told, around which meshes are made
        progress: Callable[[str], None] = lambda text: None,  # called with what is being done
        *,
        whole_slopes: bool = True,  # whether those of what the shell leaves out count
    ) -> None:
        if np.any(told.turn):
            raise ValueError("known loads on a pad are radial: leave the direction out")
        if (np.isfinite(told.displacement).sum(0) > 1).any():
            raise ValueError("on a pad only one displacement at a time can be a known input")
        # Gains move no membrane, and are hundreds of numbers.
        electrodes = spec.sensing.with_equal_channels()
        spec = spec.model_copy(update={"electrodes": electrodes})
        self._spec, self._told, self._progress = spec, told, progress
        self._whole_slopes = whole_slopes
        given = {name: getattr(spec, name) for name in spec.model_fields_set}
        first = self._loads(told, 0)
        whole = SceneSpec(**given, load=first, solve=SolveSpec(symmetry=False))
        self._scene, self._numbers = Structure(whole), inputs_of(whole)
        self._plans = self._planned(whole)
        self._last: dict[int, State] = {}
        self._slopes: dict[int, list[AbstractFace]] = {}
        self._nearby: dict[bytes, State] = {}  # by the mesh, of states not solved before

    def _loads(self, loads: KnownLoads, k: int) -> tuple[KnownLoad, ...]:
        """The loads of a state as a scene has them."""
        return tuple(scene_load(self._spec, loads, i, k) for i in range(len(loads.angle)))

    def _planned(self, scene: SceneSpec) -> list[AbstractPlan]:
        """Meshes of all states with as many elements and load points each."""
        # Checking the electrodes takes long, and no mesh depends on them.
        bare = scene.model_copy(update={"electrodes": None})
        states = [self._loads(self._told, k) for k in range(self._told.states)]
        for loads in states:
            for key, why in contradictions({"geometry": scene.geometry, "loads": loads}):
                raise ValueError(f"known {key}: {why}; check the log's columns")
        scenes = [bare.model_copy(update={"loads": loads}) for loads in states]
        model = MODELS[scene.geometry.dimension]["shell"]
        counts: tuple[int, ...] = PAD_ELEMENTS  # one program serves all logs of a pad
        if self._told.bodies:
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
        index: np.ndarray,  # which states
        loads: KnownLoads,  # of these states, errors of presses included
        held: Inputs,  # SI values by TOML path, without the constants that move the membrane
        moving: Mapping[str, float],  # those constants by name
        latent: tuple[str, ...],
        oil: AbstractOil | None,  # how the fluid answers, if not as the skin file says
        *,
        slopes: bool = True,  # whether derivatives are wanted
    ) -> Solved:
        """Find the shape of the membrane in some states, and its derivatives.

        `latent` are kinds of errors of the first load that derivatives are wanted by, too.
        Raises NoDeformation: a state has no equilibrium, or its displacement is not met.
        """
        both = Moving.of({**moving, **dict.fromkeys(latent, 0.0)})
        held = {path: x for path, x in held.items() if path in self._numbers}
        inputs = self._numbers | with_constants(self._spec, held, moving, moving.values())
        found, by = [], []
        told: list[Inputs] = []
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
            told.append(self._numbers | dict(held) | own)
            self._last[int(k)] = self._nearby[_mesh(self._plans[k])] = one.state

        def slope(row: int) -> AbstractFace:
            one = found[row]
            return self._slope(int(index[row]), loads, row, told[row], both, oil, one)

        if both.names and slopes:
            # A program keeps one core busy: states share out the others.
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                for row, own_slope in enumerate(pool.map(slope, range(len(index)))):
                    self._progress(f"derivatives of state {row + 1} of {len(index)}")
                    by.append(own_slope)

        def joined(parts: list[Any]) -> Any:
            return jax.tree.map(lambda *x: np.concatenate(x, -1), *parts)

        return Solved(
            joined([one.face for one in found]),
            joined([one.force for one in found]),
            joined([one.displacement for one in found]),
            joined(by) if by else None,
        )

    def _slope(
        self,
        k: int,
        loads: KnownLoads,
        row: int,
        known: Inputs,
        moving: Moving,
        oil: AbstractOil | None,
        one: SolvedState,
    ) -> AbstractFace:
        """Derivatives of one state; as built, those near the unit are kept."""
        before = self._slopes.setdefault(k, [])
        if PUSH in moving.names and len(before) == _AS_BUILT_ROUNDS:
            return before[-1]
        wanted = np.isfinite(loads.displacement[:, row : row + 1]).astype(float)
        pressed = loads.pressed[:, row].astype(float)
        arguments = known, loads.angle[:, row], one.force, wanted, loads.inner, pressed
        found: AbstractFace = COMPILED.run(
            state_slopes,
            self._scene,
            self._plans[k],
            jax.tree.map(jnp.asarray, arguments),
            moving,
            oil,
            one.state,
            corrected if self._whole_slopes else uncorrected,
            once=True,
            long=True,
        )
        before.append(found)
        return found

    def _state(
        self, k: int, loads: KnownLoads, row: int, inputs: Inputs, oil: AbstractOil | None
    ) -> SolvedState:
        """The equilibrium of one state."""

        def run(changed: Inputs, start: State | None) -> SolvedState:
            numbers = {**inputs, **changed}
            rest = at_rest(self._plans[k])
            found: SolvedState | None = None
            for begin in (start, rest):
                if begin is not None and (found is None or number(found.result) != 0):
                    found = COMPILED.run(
                        solve_state,
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
            _insist(found, loads, row, plain_geometry(self._spec.geometry).section)
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
        self, run: Callable[[Inputs, State | None], SolvedState], i: int, wanted: float
    ) -> SolvedState:
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


def scene_load(spec: SkinSpec, loads: KnownLoads, i: int, k: int) -> KnownLoad:
    """Load i of state k as a scene has it."""
    flat = spec.geometry.dimension == 2
    section = plain_geometry(spec.geometry).section
    own: Any = {"arc": float(section.arc(loads.angle[i, k])[0]), "axial": loads.axial[i, k]}
    if loads.bodies:
        own |= {"radius": loads.radius[i, k], "depth": loads.depth[i, k]}
        return BodyLoadSpec(shape="cylinder" if flat else "sphere", **own)
    own["force"] = np.nan_to_num(loads.force[i, k])
    if flat:
        own.pop("axial")
        return LineLoadSpec(**own, direction=loads.turn[i, k])
    return PatchLoadSpec(**own, diameter=loads.diameter[i, k] or DIAMETER)


def _mesh(plan: AbstractPlan) -> bytes:
    """What tells meshes apart that share a program."""
    return b"".join(np.asarray(x).tobytes() for x in jax.tree.leaves(plan))


def _insist(found: SolvedState, loads: KnownLoads, row: int, section: AbstractSection) -> None:
    """Refuse a state without equilibrium, or one in which a body presses on the wall."""
    result, through = int(number(found.result)), loads.bodies and number(found.gap) <= 0
    if not result and not through:
        return
    amounts = 1e3 * loads.depth[:, row] if loads.bodies else np.ravel(found.force)
    unit = "mm deep" if loads.bodies else "N"
    where = ", ".join(
        f"{amount:.4g} {unit} at {place_text(section, a)}, {1e3 * z:.4g} mm axially"
        for amount, a, z in zip(amounts, loads.angle[:, row], loads.axial[:, row], strict=True)
    )
    if not result:
        raise NoDeformation(
            f"a body {where} presses the membrane onto the wall; leave such rows out"
        )
    name = NAMES[result]
    raise NoDeformation(f"{where}: {name}; check the columns' units. {advice(name)}")
