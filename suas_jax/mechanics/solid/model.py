"""The solid as a model that scenes can ask for."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Float

from suas_jax.config import SceneSpec
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.model import AbstractArcPlan, AbstractModel, AbstractPlan, Counts
from suas_jax.mechanics.solid.element import PRESSURES, located, node_weights
from suas_jax.mechanics.solid.layout import Layout, with_midpoints
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.mesh.plan import MeshPlan, load_points
from suas_jax.mesh.section import measures, plan_section
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad

Mesh = tuple[Float[np.ndarray, " station"], int]
"""Angles of the stations [rad], and layers."""


def carried(q: Float[np.ndarray, "row station 1"], origin: Mesh, target: Mesh) -> np.ndarray:
    """Interpolate displacements and pressures, each by its own shape functions.

    `q`: unknowns of a mesh that covers the other one. `origin`: that mesh. `target`: the mesh
    wanted.
    """
    old, new = (Layout(len(angles) - 1, layers) for angles, layers in (origin, target))
    along = located(origin[0], with_midpoints(target[0]))
    across = located(old.layer_ends, new.heights)
    stations, inside = q[: old.dof, :, 0], q[old.dof :, :-1, 0]
    lines = np.empty((old.nodes, 2, 2 * old.elements + 1))
    lines[:, :, ::2] = stations.reshape(old.nodes, 2, -1)
    lines[:, :, 1::2] = inside[: old.dof].reshape(old.nodes, 2, -1)
    by_node = node_weights(*across, old.layers), node_weights(*along, old.elements)
    moved = np.einsum("yb,bca,xa->ycx", by_node[0], lines, by_node[1], optimize=True)
    between = moved[:, :, 1::2].reshape(new.dof, -1)
    pressures = inside[old.dof :].reshape(PRESSURES, old.layers, old.elements)
    centres = [(element[1::2], xi[1::2]) for element, xi in (across, along)]
    (layer, eta), (element, xi) = centres
    mean, by_xi, by_eta = pressures[:, layer[:, None], element]
    mean = mean + by_xi * xi + by_eta * eta[:, None]
    lengths = [np.diff(angles) for angles, _ in (origin, target)]
    heights = [np.diff(layout.layer_ends) for layout in (old, new)]
    ratio = (heights[1] / heights[0][layer])[:, None]
    slopes = by_xi * lengths[1] / lengths[0][element], by_eta * ratio
    below = np.concatenate([between, np.stack([mean, *slopes]).reshape(-1, new.elements)])
    above = moved[:, :, ::2].reshape(new.dof, -1)
    return np.concatenate([above, np.pad(below, [(0, 0), (0, 1)])])[:, :, None]


_MOST_ELEMENTS = 1024
# Decay length of what a load or clamp does to the section around it, in thicknesses.
_LOCAL_FIELD = 0.125
# Length of the shortest elements relative to their height.
_SMALLEST = 0.5
# The same under bodies, whose force turns where elements longer than the zone of contact give
# way more in one place than in another: where that zone is unknown, and where it is known.
_SOMEWHERE, _KNOWN = (0.5, 0.1), (0.0625, 0.05)
# Tolerances above which 64 x 2 elements do for most scenes, and up to which 128 x 4 do not.
_LOOSE, _STRICT = 2e-3, 2e-4
_THIN = 0.03  # thickness over radius up to which two layers less do
# Steps in which meshes are refined, pairs of layers among them, and the orders by which errors
# fall along and across: what is seen in random scenes.
_FACTORS = (1.0, 1.5, 2.0, 3.0, 4.0)
_LAYERS = (2, 4, 6, 8)
_ORDER, _ORDER_ACROSS = 2.2, 2.0


class SolidPlan(AbstractArcPlan):
    """Elements along the arc and through the thickness."""

    model: ClassVar[str] = "solid"
    arc: MeshPlan  # where they lie along the arc
    layers: int = eqx.field(static=True)  # how many through the thickness

    @property
    def counts(self) -> Counts:
        """Elements along the arc and through the thickness."""
        return (self.arc.elements, self.layers)

    @property
    def unknowns_shape(self) -> tuple[int, int]:
        """See the base class."""
        layout = Layout(self.arc.elements, self.layers)
        return (layout.size, layout.elements + 1)

    def comparisons(self) -> tuple["SolidPlan", ...]:
        """Pairs of elements joined along the arc, and pairs of layers where they are even.

        Errors along and across often have opposite signs: joined in both directions at once,
        meshes may differ less than either is wrong. Finer ones would cost too much.
        """
        along = SolidPlan(self.arc.coarsened(), self.layers)
        if self.layers % 2:
            return (along,)
        return (along, SolidPlan(self.arc, self.layers // 2))


class SolidModel(AbstractModel):
    """Elements along the arc and through the thickness."""

    dimension: ClassVar[int] = 2
    name: ClassVar[str] = "solid"
    setting: ClassVar[str] = "mesh"

    def first(self, scene: SceneSpec) -> Counts:
        """Enough elements for every interval between loads, and for most scenes.

        Twice as many cost less than a second program to load, let alone to compile.
        """
        least = 8 * 2 * (1 + len(scene.loads))
        if scene.rtol > _LOOSE:
            return (max(64, least), 2)
        thick = scene.geometry.mean_thickness > _THIN * (
            measures(scene).size - scene.geometry.mean_thickness / 2
        )
        if scene.rtol > _STRICT:
            return (max(128, least), 4 if thick else 2)
        return (max(384, least), 6 if thick else 4)

    def finer(self, counts: Counts, excess: tuple[float, ...]) -> Counts | None:
        """The cheapest finer mesh whose error should be as allowed, or the finest.

        Every mesh on the way there would cost a program of its own.
        """
        elements, layers = counts
        along, across = excess if len(excess) == 2 else 2 * (sum(excess) / 2,)
        # Two layers are compared with one, which may hide what is wrong across; and shorter
        # elements alone don't resolve corners.
        least = 1.5 if layers < _LAYERS[1] else 1.0
        longest = _MOST_ELEMENTS / elements
        factors = {min(x, longest) for x in _FACTORS if x >= least and longest >= 1}
        finer = [
            (round(factor * elements), more)
            for factor in factors
            for more in _LAYERS
            if more >= min(factor * layers, _LAYERS[-1])
        ]
        finer = [mesh for mesh in finer if mesh != (elements, layers)]

        def left(mesh: Counts) -> float:
            long, thin = mesh[0] / elements, mesh[1] / layers
            return along / long**_ORDER + across / thin**_ORDER_ACROSS

        enough = [mesh for mesh in finer if left(mesh) <= 1]
        if enough:
            return min(enough, key=lambda mesh: mesh[0] * mesh[1] ** 2)  # as work goes
        return max(finer, default=None)

    def coarser(self, counts: Counts) -> Counts:
        """Half as many elements along, and layers; see the base class."""
        return counts[0] // 2, max(1, counts[1] // 2)

    def plan(
        self, scene: SceneSpec, counts: Counts, decay: float, slid: Sequence[float] = ()
    ) -> SolidPlan:
        """Pairs of elements that a comparison mesh joins; see the base class."""
        elements, layers = counts
        thick = scene.geometry.mean_thickness
        thickness = thick / (measures(scene).size + thick / 2)
        thinnest = Layout(elements, layers).layer_ends[1]
        field, smallest = _LOCAL_FIELD, _SMALLEST
        if scene.bodies:
            field, smallest = _KNOWN if slid else _SOMEWHERE
        local = (field * thickness, 2 * smallest * thickness * thinnest)
        pairs = plan_section(scene, (elements + 1) // 2, decay, local, slid)
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
        bodies: Sequence[Body] = (),
    ) -> Solid:
        """The solid on a mesh; see the base class."""
        assert isinstance(plan, SolidPlan)
        touched = [body.angle for body in bodies]
        angles, points = load_points(plan.arc, geometry, loads, touched)
        layers, symmetric = plan.layers, plan.symmetric
        solid = Solid.build(geometry, law, angles, points, layers=layers, symmetric=symmetric)
        return solid.with_bodies(bodies)


SOLID = SolidModel()
