"""The pad's thin shell as a model that scenes can ask for."""

import functools
import math
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from suas_jax.config import BodyLoadSpec, LineLoadSpec, PatchLoadSpec, SceneSpec
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.model import AbstractModel, AbstractPlan, Counts, Meshes
from suas_jax.mechanics.pad.net import NetTopology
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.pad.refinement import nearest_splines
from suas_jax.mesh.pad_plan import (
    SHELL_SIZES,
    ElementSizes,
    Footprint,
    PadPlan,
    footprint,
    mirror_planes,
    plan_pad,
)
from suas_jax.mesh.section import measures
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import PadLoad

_MOST_ELEMENTS = 80  # along either direction
# More elements than a scene needs at first sight: half of them left too little of the tolerance
# to the shear's share and were solved on a second mesh.
_FIRST = 1.15
_FINER = 1.5  # order four: the error falls to a fifth
_NEAR = 0.15  # of a round body's radius, and of the pad's: what it touches, in order of size
_STRAIGHT = 1e-12  # rounding of a body's place, or turn


class PadMesh(AbstractPlan):
    """Elements along the arc and along the axis."""

    dimension: ClassVar[int] = 3
    solves_long: ClassVar[bool] = True
    plan: PadPlan  # where they lie
    # of a symmetric plan of the whole pad, the half or quarter that is solved
    part: PadPlan | None = None
    # through the thickness of a solid; None of a shell
    degree: int | None = eqx.field(static=True, default=None)

    @property
    def model(self) -> str:
        """See the base class."""
        return "shell" if self.degree is None else "solid"

    @property
    def counts(self) -> Counts:
        """Elements of the whole pad, along the arc and along the axis; a solid's degree."""
        return self.plan.elements if self.degree is None else (*self.plan.elements, self.degree)

    @property
    def unknowns_shape(self) -> tuple[int, int]:
        """See the base class."""
        dof, stations = self.net(self.degree).free.shape
        return dof, stations

    def net(self, degree: int | None) -> NetTopology:
        """The control net of a degree through the thickness."""
        return NetTopology(*self.plan.axes, degree)

    @property
    def symmetric(self) -> bool:
        """Whether it covers a half or a quarter."""
        return any(self.plan.mirrored)

    def reduced(self) -> "PadMesh":
        """The half or quarter where the loads are symmetric."""
        return self if self.part is None else PadMesh(self.part, degree=self.degree)

    def comparisons(self) -> tuple["PadMesh", ...]:
        """A shell's elements divided in four; a solid's joined, and a degree less.

        A finer solid would cost ten times the solve.
        """
        if self.degree is None:
            return (PadMesh(self.plan.refined()),)
        return PadMesh(self.plan.joined(), degree=self.degree), PadMesh(
            self.plan, degree=self.degree - 1
        )

    def meshes(self) -> Meshes:
        """The error is judged on the part that is solved, stability on the whole.

        A solid's stability is judged on pairs of elements joined, as a whole pad of all
        elements would cost several solves.
        """
        part, judged = self.reduced(), self
        if self.degree is not None:
            judged = PadMesh(self.plan.joined(), degree=self.degree)
        return Meshes(self, part, part.comparisons(), judged)


class PadModel(AbstractModel):
    """A Kirchhoff-Love shell of cubic splines, clamped along all four edges."""

    dimension: ClassVar[int] = 3
    name: ClassVar[str] = "shell"
    setting: ClassVar[str] = "elements"
    mechanics: ClassVar[type[Pad]] = Pad

    def first(self, scene: SceneSpec) -> Counts:
        """Elements sized by the membrane's bending length and by the loads."""
        return planned(scene, None, (False, False), scale=_FIRST).elements

    def finer(self, counts: Counts, excess: tuple[float, ...]) -> Counts | None:
        """More elements in both directions."""
        del excess  # the next mesh does for what the first one misses
        if max(counts) >= _MOST_ELEMENTS:
            return None
        return tuple(2 * math.ceil(_FINER * n / 2) for n in counts)

    def coarser(self, counts: Counts) -> Counts:
        """Two thirds, even; see the base class."""
        return tuple(max(4, 2 * (n // 3)) for n in counts)

    def plan(
        self, scene: SceneSpec, counts: Counts, decay: float, slid: Sequence[float] = ()
    ) -> PadMesh:
        """Elements gathered at edges and loads; see the base class."""
        del decay, slid  # bending decays over a length of the geometry alone
        elements, degree = (counts[0], counts[1]), counts[2] if counts[2:] else None
        mirrored = (False, False)
        if scene.solve.symmetry:
            planes = mirror_planes(_loads(scene))
            images = [_mirrors(body, place) for body, place in _bodies(scene)]
            planes = (
                planes[0] and all(image[0] for image in images),
                planes[1] and all(image[1] for image in images),
            )
            even = scene.geometry.mirrored_along_axis
            planes = planes[0] and measures(scene).symmetric, planes[1] and even
            arc, axial = (
                m and n % 2 == 0 and n >= 6 for m, n in zip(planes, elements, strict=True)
            )
            mirrored = (arc, axial)
        part = self._planned(scene, elements, mirrored)
        if not any(mirrored):
            return PadMesh(part, degree=degree)
        return PadMesh(part.unfolded(), part, degree)

    def carried(
        self, q: np.ndarray, origin: AbstractPlan, target: AbstractPlan
    ) -> np.ndarray | None:
        """Splines nearest to the given ones; see the base class."""
        assert isinstance(origin, PadMesh)
        assert isinstance(target, PadMesh)
        halves = zip(origin.plan.mirrored, target.plan.mirrored, strict=True)
        if any(half and not other for half, other in halves):  # few elements are not halved
            return None
        given, wanted = (mesh.net(target.degree) for mesh in (origin, target))
        values = np.asarray(origin.net(origin.degree).by_direction(jnp.asarray(q[..., 0])))
        values = values @ self._through(origin.degree, target.degree)
        breaks = [(mesh.plan.arc, mesh.plan.axial) for mesh in (origin, target)]
        return nearest_splines(values, given, wanted, *breaks)[..., None]

    def _through(
        self, old: int | None, new: int | None
    ) -> Float[np.ndarray, "old_width new_width"]:
        """Unknowns of a control value for one degree from those for another."""
        del old, new  # a shell has none
        return np.eye(3)

    def _planned(
        self, scene: SceneSpec, elements: tuple[int, int], mirrored: tuple[bool, bool]
    ) -> PadPlan:
        return planned(scene, elements, mirrored)

    def build(
        self,
        plan: AbstractPlan,
        geometry: SkinGeometry,
        law: AbstractLaw,
        loads: Sequence[PadLoad],
        bodies: Sequence[Body] = (),
    ) -> Pad:
        """The pad on a mesh; see the base class."""
        assert isinstance(plan, PadMesh)
        pad = self.mechanics.build(geometry, law, plan.plan, loads, plan.degree)
        return pad.with_bodies(bodies)


def planned(
    scene: SceneSpec,
    elements: tuple[int, int] | None,
    mirrored: tuple[bool, bool],
    scale: float = 1.0,
    sizes: ElementSizes = SHELL_SIZES,
) -> PadPlan:
    """Elements of the pad, or of the half or quarter of a symmetric one."""
    g, found = scene.geometry, measures(scene)
    outer = found.size + g.mean_thickness / 2
    places = [footprint(load, outer) for load in _loads(scene)]
    touched = [_touched(body, place, outer) for body, place in _bodies(scene)]
    skin = (found.half_angle, g.width, found.size, g.mean_thickness)
    return plan_pad(
        *skin,
        places,
        elements=elements,
        mirrored=mirrored,
        scale=scale,
        touched=touched,
        sizes=sizes,
    )


def _bodies(scene: SceneSpec) -> list[tuple[BodyLoadSpec, float]]:
    """Bodies and the angles that they come in at [rad]."""
    loads = [spec for spec in scene.loads if spec.kind != "pressure"]
    places = zip(loads, measures(scene).places, strict=True)
    return [(spec, place) for spec, place in places if spec.kind == "body"]


def _mirrors(body: BodyLoadSpec, angle: float) -> tuple[bool, bool]:
    """Whether a body is its own image in the crown's plane, and in the middle's."""
    straight = body.shape == "sphere" or abs(math.sin(2 * body.turn)) < _STRAIGHT
    along, axial = (straight and not dragged for dragged in body.dragged)
    return along and abs(angle) < _STRAIGHT, axial and abs(body.axial) < _STRAIGHT


def _touched(body: BodyLoadSpec, angle: float, outer: float) -> Footprint:
    """What a body may touch, as elements gather there."""
    arc, axial = (size / 2 for size in body.size or (0.0, body.length or 0.0))
    sine, cosine = abs(math.sin(body.turn)), abs(math.cos(body.turn))
    reach = min(_NEAR * (body.radius or 0.0), _NEAR * outer)
    arc, axial = arc * cosine + axial * sine + reach, arc * sine + axial * cosine + reach
    return Footprint(angle, body.axial, arc / outer, axial, disc=False)


def _loads(scene: SceneSpec) -> list[PadLoad]:
    """The dead loads of a scene with their numbers."""

    def value(spec: LineLoadSpec | PatchLoadSpec, name: str) -> Lanes:
        key, _, index = name.partition(".")
        found = getattr(spec, key)
        return jnp.full(1, float(found[int(index)] if index else found))

    loads = [spec for spec in scene.loads if spec.kind != "pressure"]
    places = zip(loads, measures(scene).places, strict=True)
    forces = [(spec, place) for spec, place in places if spec.kind != "body"]
    return [
        PadLoad.of(
            spec, jnp.full(1, angle), functools.partial(value, spec), scene.geometry.width
        )
        for spec, angle in forces
    ]


PAD = PadModel()
