"""The solid as a model that scenes can ask for."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx

from suas_jax.config import SceneSpec
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.model import AbstractModel, AbstractPlan, Counts
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.mesh.plan import MeshPlan, load_points
from suas_jax.mesh.section import plan_section
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad

_MOST_ELEMENTS = 1024
_MOST_LAYERS = 8
# Decay length of what a load or clamp does to the section around it, in thicknesses.
_LOCAL_FIELD = 0.25
# Length of the shortest elements relative to their height.
_SMALLEST = 0.5


class SolidPlan(AbstractPlan):
    """Elements along the arc and through the thickness.

    Attributes:
        arc: where they lie along the arc.
        layers: how many through the thickness.
    """

    dimension: ClassVar[int] = 2
    arc: MeshPlan
    layers: int = eqx.field(static=True)

    @property
    def model(self) -> str:
        """See the base class."""
        return SolidModel.name

    @property
    def counts(self) -> Counts:
        """Elements along the arc and through the thickness."""
        return (self.arc.elements, self.layers)

    @property
    def symmetric(self) -> bool:
        """Whether it covers the left half only."""
        return self.arc.symmetric

    def reduced(self) -> "SolidPlan":
        """The left half where stations and loads are symmetric."""
        return SolidPlan(self.arc.half(), self.layers) if self.arc.mirrors_itself else self

    def comparison(self) -> "SolidPlan":
        """A coarser one, pairs of elements joined: a finer one would cost too much."""
        layers = self.layers // 2 if self.layers % 2 == 0 else self.layers
        return SolidPlan(self.arc.coarsened(), layers)


class SolidModel(AbstractModel):
    """Elements along the arc and through the thickness."""

    dimension: ClassVar[int] = 2
    name: ClassVar[str] = "solid"
    setting: ClassVar[str] = "mesh"

    def first(self, scene: SceneSpec) -> Counts:
        """Two layers, and enough elements for every interval between loads."""
        intervals = 2 * (1 + len(scene.loads))
        # Twice as many elements cost less than a second program to compile.
        return (max(64 if scene.rtol > 2e-3 else 128, 8 * intervals), 2)

    def first_of_sweep(self, scene: SceneSpec) -> Counts:
        """The same as for a solve."""
        return self.first(scene)

    def finer(self, counts: Counts) -> Counts | None:
        """Twice as many elements in both directions."""
        elements, layers = counts
        if 2 * elements > _MOST_ELEMENTS:
            return None
        return (2 * elements, min(2 * layers, _MOST_LAYERS))

    def plan(self, scene: SceneSpec, counts: Counts, decay: float) -> SolidPlan:
        """Pairs of elements that the coarser comparison mesh joins; see the base class."""
        elements, layers = counts
        geometry = scene.geometry
        thickness = geometry.thickness / (geometry.inner_radius + geometry.thickness)
        local = (_LOCAL_FIELD * thickness, 2 * _SMALLEST * thickness / layers)
        pairs = plan_section(scene, (elements + 1) // 2, decay, local)
        return SolidPlan(pairs.refined(elements), layers)

    def build(
        self,
        plan: AbstractPlan,
        geometry: SkinGeometry,
        law: AbstractLaw,
        loads: Sequence[LineLoad],
    ) -> Solid:
        """The solid on a mesh; see the base class."""
        assert isinstance(plan, SolidPlan)
        angles, points = load_points(plan.arc, geometry, loads)
        layers, symmetric = plan.layers, plan.symmetric
        return Solid.build(geometry, law, angles, points, layers=layers, symmetric=symmetric)


SOLID = SolidModel()
