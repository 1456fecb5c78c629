"""A scene solved again for other numbers: one compiled program, whatever the numbers are.

A section has an even mesh in which loads slide (`suas_jax.scene.forward`); a pad has a mesh
graded around its loads, of one size for all of their places.
"""

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.arrays import Floats
from fitting.view.grid import Grid
from suas_jax.config import (
    ElectrodesSpec,
    GeometrySpec,
    SceneSpec,
    TaxelSpec,
    continuous_inputs,
    with_inputs,
    with_solve,
)
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.mechanics.pad.model import PAD, PadMesh
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.section import section_of
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import Keyed
from suas_jax.scene.build import plan_for, problem_of
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import loads_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.skin import skin_of
from suas_jax.scene.structure import Inputs, Structure

PAD_ELEMENTS = (16, 12)
"""Elements of a pad's mesh along the arc and along the axis, unless the scene says so."""
_SAMPLES = 8  # intervals of a section's element


class Solved(NamedTuple):
    """A scene's answer.

    Attributes:
        displacement: of the inner face's points of the grid [point, 3] [m].
        so: sensor output [taxel] [counts]; NaN where nothing parts taxel and membrane.
        oil_pressure: above ambient [Pa].
        min_gap: smallest between membrane and wall [m].
        status: name of the outcome.
    """

    displacement: Floats
    so: Floats
    oil_pressure: float
    min_gap: float
    status: str


class AbstractSceneModel(abc.ABC):
    """A scene as a function of its continuous inputs.

    Args:
        scene: with all its inputs stated, and loads as they are (no wanted oil pressure).
        grid: of the points that are asked for.
    """

    def __init__(self, scene: SceneSpec, grid: Grid) -> None:
        self.scene, self.grid = scene, grid
        self._inputs = continuous_inputs(scene)

    def __call__(self, values: Mapping[str, float]) -> Solved:
        """Solve for other inputs.

        Raises:
            ValueError: a value is not allowed.
        """
        changed = with_inputs(self.scene, values)
        inputs = {k: jnp.asarray(v, np.float64) for k, v in {**self._inputs, **values}.items()}
        return self._solved(changed, inputs)

    @abc.abstractmethod
    def _solved(self, scene: SceneSpec, inputs: Inputs) -> Solved:
        """Solve a scene whose numbers are also given as arrays."""


def scene_model(scene: SceneSpec, grid: Grid) -> AbstractSceneModel:
    """The model of a scene, by its dimension."""
    return (PadSceneModel if scene.geometry.dimension == 3 else SectionSceneModel)(scene, grid)


class _Section(Keyed):
    """A section's scene compared by what decides the compiled program."""

    def __init__(self, scene: SceneSpec) -> None:
        self.scene, self.key = scene, Structure(scene).key


@eqx.filter_jit
def _section(section: _Section, inputs: Inputs) -> tuple[Array, ...]:
    names = section.scene.skin
    own = {k: v for k, v in inputs.items() if not k.startswith("load.")}
    skin, loads = skin_of(names, own), loads_of(section.scene, inputs)
    output = forward(skin, loads)
    shown = corrected(skin.problem(loads), output.state)
    shape = section_of(shown.mechanics).profile(shown.state.q, _SAMPLES)
    moved = jnp.moveaxis(shape.inner_displacement[..., 0], 0, -1)  # [sample, element, 2]
    return (
        shape.angle[..., 0].T.ravel(),
        jnp.swapaxes(moved, 0, 1).reshape(-1, 2),
        output.so[:, 0],
        output.oil_pressure[0],
        output.min_gap[0],
        output.result[0],
    )


class SectionSceneModel(AbstractSceneModel):
    """A section in plane strain, by the corrected shell."""

    def __init__(self, scene: SceneSpec, grid: Grid) -> None:
        super().__init__(_with_a_taxel(scene), grid)

    def _solved(self, scene: SceneSpec, inputs: Inputs) -> Solved:
        found = COMPILED.run(_section, _Section(self.scene), inputs)
        angle, moved, so, pressure, gap, result = (np.asarray(x) for x in found)
        sides = [np.interp(self.grid.angle, angle, moved[:, k]) for k in (0, 1)]
        displacement = np.stack([*sides, np.zeros_like(sides[0])], 1)
        return Solved(displacement, so, float(pressure), float(gap), NAMES[int(result)])


def _with_a_taxel(scene: SceneSpec) -> SceneSpec:
    """The scene, with a taxel where it has none: the forward model has some."""
    if scene.electrodes is not None:
        return scene
    return scene.model_copy(
        update={"electrodes": ElectrodesSpec(taxels=(TaxelSpec(**crown(scene.geometry)),))}
    )


def crown(geometry: GeometrySpec) -> dict[str, Any]:
    """The middle of a section, as its scenes state places."""
    return {"angle": 0.0} if geometry.has_angle else {"arc": 0.0}


@eqx.filter_jit
def _pad(
    scene: Structure, plan: PadMesh, inputs: Inputs, angle: Array, axial: Array
) -> tuple[Array, ...]:
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan, wall=scene.wall)
    found = equilibrium(problem)
    shown = corrected(problem, found.state).state
    pad = problem.mechanics
    assert isinstance(pad, Pad)
    moved = pad.faces(shown.q, angle[:, None], axial[:, None]).inner_displacement[..., 0]
    gap = pad.shape(shown.q).smallest_gap(parts.skin.geometry).value
    so = jnp.zeros(0)
    if parts.skin.electrodes is not None:
        so = parts.skin.electrodes.read(pad, shown.q).so[:, 0]
    return moved.T, so, shown.pressure[0], gap[0], found.result[0]


class PadSceneModel(AbstractSceneModel):
    """A pad in three dimensions, by the thin shell corrected for shear."""

    def __init__(self, scene: SceneSpec, grid: Grid) -> None:
        super().__init__(scene, grid)
        pattern = with_solve(scene, model="auto", rtol=None, elements=None, mesh=None)
        self._structure = Structure(pattern, wall=scene.wall.contact)
        # No mesh depends on the electrodes, which take long to check.
        self._bare = with_solve(scene.model_copy(update={"electrodes": None}), symmetry=False)
        self._counts = PAD.given(scene) or PAD_ELEMENTS
        self._spread: tuple[tuple[int, int], ...] | None = None

    def _solved(self, scene: SceneSpec, inputs: Inputs) -> Solved:
        angle, axial = (jnp.asarray(x) for x in self.grid.points)
        found = COMPILED.run(_pad, self._structure, self._plan(scene), inputs, angle, axial)
        moved, so, pressure, gap, result = (np.asarray(x) for x in found)
        return Solved(moved, so, float(pressure), float(gap), NAMES[int(result)])

    def _plan(self, scene: SceneSpec) -> PadMesh:
        """A mesh graded around the loads, with no fewer load points than any before it."""
        bare = self._bare.model_copy(update={"loads": scene.loads, "geometry": scene.geometry})
        plan: Any = plan_for(bare, PAD.name, self._counts)
        assert isinstance(plan, PadMesh)
        spread = self._spread or plan.plan.spread
        self._spread = tuple(
            (max(a, c), max(b, d))
            for (a, b), (c, d) in zip(spread, plan.plan.spread, strict=True)
        )
        return PadMesh(dataclasses.replace(plan.plan, spread=self._spread))
