"""The solid as a model that scenes can ask for."""

import math
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import numpy as np

from suas_jax.config import SceneSpec
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.model import AbstractModel, AbstractPlan, Counts
from suas_jax.mechanics.solid.carry import carried
from suas_jax.mechanics.solid.layout import Layout
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
_STRICT = 2e-4  # tolerance that two layers rarely meet
# Steps in which meshes are refined, and the order of convergence by which one is chosen: what
# estimates fall with in scenes that take several (1.5 to 2).
_FACTORS = (1.5, 2.0, 3.0, 4.0)
_ORDER = 1.8


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
    def unknowns_shape(self) -> tuple[int, int]:
        """See the base class."""
        layout = Layout(self.arc.elements, self.layers)
        return (layout.size, layout.elements + 1)

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
        """Enough elements for every interval between loads, and for most scenes.

        Twice as many cost less than a second program to compile.
        """
        least = 8 * 2 * (1 + len(scene.loads))
        if scene.rtol <= _STRICT:
            return (max(256, least), 4)
        return (max(64 if scene.rtol > 2e-3 else 128, least), 2)

    def first_of_sweep(self, scene: SceneSpec) -> Counts:
        """The same as for a solve."""
        return self.first(scene)

    def finer(self, counts: Counts, excess: float) -> Counts | None:
        """So many more elements in both directions that the error should be as allowed.

        Every mesh on the way there would cost a program of its own.
        """
        elements, layers = counts
        wanted = excess ** (1 / _ORDER)
        factor = next((f for f in _FACTORS if f >= wanted), _FACTORS[-1])
        factor = min(factor, _MOST_ELEMENTS / elements)
        if factor < _FACTORS[0]:
            return None
        pairs = math.ceil(factor * layers / 2)  # the comparison mesh joins them
        return (int(factor * elements), min(2 * pairs, _MOST_LAYERS))

    def plan(self, scene: SceneSpec, counts: Counts, decay: float) -> SolidPlan:
        """Pairs of elements that the coarser comparison mesh joins; see the base class."""
        elements, layers = counts
        geometry = scene.geometry
        thickness = geometry.thickness / (geometry.inner_radius + geometry.thickness)
        local = (_LOCAL_FIELD * thickness, 2 * _SMALLEST * thickness / layers)
        pairs = plan_section(scene, (elements + 1) // 2, decay, local)
        return SolidPlan(pairs.refined(elements), layers)

    def carried(self, q: np.ndarray, origin: AbstractPlan, target: AbstractPlan) -> np.ndarray:
        """Displacements and pressures interpolated; see the base class."""
        assert isinstance(origin, SolidPlan)
        assert isinstance(target, SolidPlan)
        ends = [(x.arc.stations @ x.arc.values, x.layers) for x in (origin, target)]
        return carried(q, *ends)

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
