"""The whole pad as a thin shell: a half-cylinder clamped along its edges, in three dimensions.

Kirchhoff-Love, incompressible (Kiendl et al. 2015), cubic B-splines in both directions. The
displacement is interpolated over the exact cylinder, so the undeformed state is free of
stress to the last digit.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.relaxation import Response
from suas_jax.mechanics.base import AbstractMechanics, Assembly, Displacements
from suas_jax.mechanics.contact.face import BodyContact, ContactState
from suas_jax.mechanics.pad.contact import ContactFace
from suas_jax.mechanics.pad.faces import SAMPLES, Faces, PadShape, unbent
from suas_jax.mechanics.pad.lane import PadLane
from suas_jax.mechanics.pad.loads import pad_load_points
from suas_jax.mechanics.pad.net import Net, NetTopology
from suas_jax.mechanics.pad.net_lane import AbstractLane, LaneParts
from suas_jax.mechanics.pad.refinement import (
    breaks_on_both_sides,
    image_in_part,
    on_other_elements,
    points_on_both_sides,
    values_on_both_sides,
)
from suas_jax.mechanics.shape import AbstractFace
from suas_jax.mesh.pad_plan import PadPlan
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.block_banded import BlockBanded
from suas_jax.numerics.lanes import by_lane, lane_count
from suas_jax.skin.body import Body, Grip, PlacedBody
from suas_jax.skin.geometry import Sheet, SkinGeometry
from suas_jax.skin.loads import PadLoad, PadLoadPoints
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall


class Pad(AbstractMechanics):
    """Discretised pad, or the half or quarter of a symmetric one.

    The unknowns of a station are the displacements of the control values across it, in the
    tangential, normal and axial directions of their column.
    """

    per_width: ClassVar[bool] = False
    corrected: ClassVar[bool] = True
    omitted_at_wall: ClassVar[float] = 0.02  # from the solid, see docs/pad_method.md
    # order four at least; the finer solution's own error is a sixteenth
    error_shares: ClassVar[tuple[float, ...]] = (16 / 15,)
    law: AbstractLaw  # the membrane's material
    section: AbstractSection  # the undeformed membrane across the axis
    net: Net  # the control values between breakpoints along the arc and along the axis
    points: PadLoadPoints  # the loads as points on the outer face [N]
    film_volume: Lanes  # volume of the undeformed oil film under the part covered [m^3]
    wall: Wall | None
    growth: Growth | None
    bodies: tuple[Body, ...]
    # whether the part ends at the crown's plane, and at the middle's
    mirrored_planes: tuple[bool, bool] = eqx.field(static=True, default=(False, False))
    # quadrature points along either side of an element
    gauss: int = eqx.field(static=True, default=3)
    layers: int = eqx.field(static=True, default=3)  # quadrature points through the thickness
    relief: Sheet | None = None  # of the outer face; see `SkinGeometry`
    # of a material with a past at the quadrature points, see `Layers`; None of an elastic one
    response: Response | None = None
    # that a state to be read is a correction of, as by shear; None where it is none
    equilibrium: StationVector | None = None

    @property
    def topology(self) -> NetTopology:
        """How the splines end."""
        return self.net.topology

    @property
    def mid_extent(self) -> Lanes:
        """Area of the mid-surface that is covered [m^2]."""
        angles, axial = self.net.angles, self.net.axial
        return self.section.size * (angles[-1] - angles[0]) * (axial[-1] - axial[0])

    def rest(self) -> StationVector:
        """Zero displacement."""
        return jnp.zeros((*self.topology.free.shape, lane_count(self)), self.net.angles.dtype)

    def unknowns(self) -> int:
        """Free control displacements."""
        return int(self.free.sum())

    @property
    def free(self) -> np.ndarray:
        """Mask of the unknowns that may move, of the shape of a station vector."""
        return self.topology.free

    def contact_energy(self, q: StationVector, factor: Lanes | float = 1.0) -> Lanes:
        """Energy of contact with wall and bodies [J]; see the base class."""
        energy = jnp.zeros(q.shape[-1:], q.dtype)
        if self.wall is not None:
            energy = self._at_face(q, self.wall, ContactFace.energy)
        for body in self.bodies:
            energy = energy + self._at_face(q, body.placed(factor), ContactFace.energy)
        return energy

    def _at_face(
        self, q: StationVector, obstacle: Obstacle, asked: Callable[[ContactFace], Any]
    ) -> Any:
        """What is asked of the inner face against a wall, of the outer one against a body."""

        def one(both: tuple[Pad, Obstacle], q: Array) -> Any:
            return asked(both[0].one_lane().face_against(both[1], q))

        return by_lane((self, obstacle), one, q)

    def _by_lane(self, asked: Callable[..., Any], *arguments: Array) -> Any:
        """What is asked of each lane alone, with its own arguments."""
        return by_lane(self, lambda pad, *own: asked(pad.one_lane(), *own), *arguments)

    def touched(
        self, q: StationVector, body: PlacedBody, shift: Array | float = 0.0
    ) -> BodyContact:
        """The outer face against a body [arc, axial, lane]; see the base class.

        Of elements that no contact is near the gap is a bound from below, which is not the
        smallest; the position is zero.
        """
        del shift  # there is none
        return self._at_face(q, body, ContactFace.touched)

    def pushed(
        self, q: StationVector, body: PlacedBody, shift: Array | float = 0.0
    ) -> Float[Array, "3 lane"]:
        """From the elements near it, without the grid of all points; see the base class."""
        del shift  # there is none
        return self._at_face(q, body, ContactFace.pushed)

    def grip(self, q: StationVector, body: PlacedBody) -> Grip | None:
        """See the base class."""
        if body.body.friction is None:
            return None
        return self._at_face(q, body, ContactFace.grip)

    def contact(self, q: StationVector, wall: Wall) -> ContactState:
        """The inner face against a wall [arc, axial, lane]; see the base class."""
        return self._at_face(q, wall, ContactFace.state)

    def displacement_size(self, q: StationVector) -> Lanes:
        """Largest component of a control value's displacement [m]."""
        return jnp.max(jnp.abs(q), (0, 1))

    def one_lane(self) -> AbstractLane:
        """The sums of a pad of one lane, scalars kept as arrays of one number."""
        response = self.response
        if response is not None:
            response = Response(response.share, response.rest[..., 0])
        return PadLane(self._lane_parts(), response)

    def _lane_parts(self) -> LaneParts:
        points = jax.tree.map(lambda x: x[..., 0], self.points)
        quadrature = (self.gauss, self.layers)
        net = self.net.lane(0)
        return LaneParts(
            self.law, net, self.section, points, quadrature, self.growth, self.relief
        )

    def deviator(self, q: StationVector) -> Float[Array, "4 layer point lane"]:
        """Instantaneous stress that the material remembers; see `fibres.deviator`."""
        return self._by_lane(PadLane.deviator, q)

    def strain_energy(self, q: StationVector) -> Lanes:
        """Strain energy [J]."""
        return self._by_lane(lambda lane, q: lane.strain_energy(q), q)

    def _energies(self, q: StationVector) -> tuple[Lanes, Lanes, Lanes]:
        """See `AbstractLane.energies`."""
        return self._by_lane(lambda lane, q: lane.energies(q), q)

    def volume_change(self, q: StationVector) -> Lanes:
        """Enclosed volume less its value at rest [m^3]."""
        return self._energies(q)[1]

    def work(self, q: StationVector) -> Lanes:
        """Work of the loads, which act at the rigid-normal point r + (t/2) n [J]."""
        return self._energies(q)[2]

    def assemble(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Assembly:
        """Residual, tangent and border at a trial state; see the base class."""

        def one(pad: Pad, q: Array, pressure: Array, factor: Array) -> tuple[Array, ...]:
            return pad.one_lane().assemble(q, pressure, factor, pad.wall, pad.bodies)

        found = by_lane(self, one, q, pressure, factor)
        residual, bands, gradient, load, volume, *contact = found
        operator = BlockBanded(
            jnp.moveaxis(bands, -1, 0),
            self.topology.free_by_station,
            self.topology.scalars * self.topology.arc.stations * self.topology.axial.stations,
        )
        return Assembly(residual, operator, gradient, load, volume, *contact)

    def imbalance(
        self, q: StationVector, pressure: Lanes, factor: Lanes
    ) -> tuple[StationVector, Lanes]:
        """Residual and volume change: derivatives of the potential; see the base class."""

        def potential(q: StationVector) -> tuple[Array, Lanes]:
            energy, more, work = self._energies(q)
            stored = energy + self.contact_energy(q, factor)
            return jnp.sum(stored - pressure * more - factor * work), more

        gradient, more = jax.grad(potential, has_aux=True)(q)
        return gradient * self.topology.free[..., None], more

    def stored_energy(self, q: StationVector) -> Lanes:
        """Strain energy of the state that is reported, to first order; see the base class."""
        root = self.equilibrium
        if root is None:
            return self.strain_energy(q)
        stored, more = jax.jvp(self.strain_energy, (root,), (q - root,))
        return stored + more - self._by_lane(PadLane.relaxed_energy, root)

    def around(self, equilibrium: StationVector) -> Self:
        """See the base class; kinks of a correction are not strains."""
        return dataclasses.replace(self, equilibrium=equilibrium) if self.corrected else self

    @classmethod
    def build(
        cls,
        geometry: SkinGeometry,  # dimensions, with a lane axis
        law: AbstractLaw,  # material, its constants with a lane axis
        plan: PadPlan,
        loads: Sequence[PadLoad],  # in the order of the plan
        degree: int | None = None,  # see `NetTopology`
    ) -> Self:
        """Discretise a skin."""
        angles, axial = plan.breakpoints(geometry)
        parts = (1 + plan.mirrored[0]) * (1 + plan.mirrored[1])
        return cls(
            law=law,
            section=geometry.section,
            net=Net.of(NetTopology(*plan.axes, degree), geometry.section, angles, axial),
            points=pad_load_points(plan, geometry, loads),
            film_volume=geometry.film_area * geometry.width / parts,
            wall=None,
            bodies=(),
            mirrored_planes=plan.mirrored,
            growth=geometry.growth,
            relief=geometry.relief,
            layers=3 if degree is None else degree + 1,
        )

    def with_more_fibres(self) -> Self:
        """See the base class."""
        return dataclasses.replace(self, layers=2 * self.layers)

    @property
    def parts(self) -> int:
        """How many of the modelled part make the whole pad: energies are a part's."""
        return (1 + self.mirrored_planes[0]) * (1 + self.mirrored_planes[1])

    def _planes(self) -> list[int]:
        return [plane for plane, mirrored in enumerate(self.mirrored_planes) if mirrored]

    def whole(self) -> "Pad":
        """The pad on both sides of its mirror planes, its loads likewise."""
        points = self.points
        breaks = [self.net.angles, self.net.axial]
        for plane in self._planes():
            points = points_on_both_sides(points, plane)
            breaks[plane] = breaks_on_both_sides(breaks[plane])
        arc, axial = (
            axis.unfolded() if mirrored else axis
            for axis, mirrored in zip(
                (self.topology.arc, self.topology.axial), self.mirrored_planes, strict=True
            )
        )
        return dataclasses.replace(
            self,
            points=points,
            film_volume=self.film_volume * self.parts,
            net=Net.of(
                dataclasses.replace(self.topology, arc=arc, axial=axial), self.section, *breaks
            ),
            mirrored_planes=(False, False),
        )

    def mirrored(self, q: StationVector) -> StationVector:
        """Unknowns of the whole pad from those of a half or a quarter."""
        x = self.topology.by_direction(q)  # [arc, axial, local, lane]
        for plane in self._planes():
            x = values_on_both_sides(x, plane, self.topology.vectors)
        return self.whole().topology.to_stations(x)

    def mirrored_stress(
        self, stress: Float[Array, "*terms 4 layer point lane"]
    ) -> Float[Array, "*terms 4 layer whole lane"]:
        """What the whole pad remembers from what a half or a quarter does; see `deviator`."""
        part, whole = self.one_lane(), self.whole().one_lane()
        *terms, _, lanes = stress.shape

        def other_way(lane: AbstractLane, x: Array) -> Array:
            """From the order of a lane's points to arc before axis, or back."""
            along_arc = lane.topology.along_arc
            return x if along_arc else jnp.swapaxes(jnp.swapaxes(x, -5, -4), -3, -2)

        x = stress.reshape(*terms, part.gauss, part.gauss, *part.elements, lanes)
        x = other_way(part, x)
        # Shear has the other sign on the other side.
        signs = np.array([1.0, 1.0, -1.0, 1.0]).reshape(4, *[1] * 6)
        for plane in self._planes():
            image = signs * jnp.flip(x, (plane - 5, plane - 3))
            x = jnp.concatenate([x, image], plane - 3)
        # What remembers nothing has no terms, from which no size follows.
        return other_way(whole, x).reshape(*terms, math.prod(x.shape[-5:-1]), lanes)

    def faces(
        self,
        q: StationVector,
        angle: Float[Array, "point #lane"],
        axial: Float[Array, "point #lane"],
    ) -> Faces:
        """The deformed pad at places.

        `angle`: reference angles, within the modelled part [rad]. `axial`: reference positions
        along the axis, likewise [m].
        """
        return self._by_lane(lambda lane, *given: lane.faces(*given), q, angle, axial)

    def sampled(self, q: StationVector, samples: int) -> Faces:
        """The deformed pad on a grid: evenly spaced points of every element.

        A first-order correction does not bend it; see `unbent`.

        `samples`: intervals an element is divided in, in each direction.
        Returns arrays [arc, axial, lane], components leading.
        """
        angle, axial = (_divided(x, samples) for x in (self.net.angles, self.net.axial))
        shape = (angle.shape[0], axial.shape[0])

        def gridded(x: Array) -> Array:
            return x.reshape(*x.shape[:-2], *shape, x.shape[-1])

        def of(q: StationVector) -> Faces:
            found = self._by_lane(lambda lane, *given: lane.sampled(*given), q, angle, axial)
            return jax.tree.map(gridded, found)

        return of(q) if self.equilibrium is None else unbent(of(q), of(self.equilibrium))

    def height_at(
        self,
        q: StationVector,  # unknowns of the whole pad
        angle: Float[Array, "ray #lane"],
        axial: Float[Array, "ray #lane"],
    ) -> Float[Array, "ray lane"]:
        """Height of the deformed inner face over the undeformed one along rays [m].

        `angle`: of the rays, normals of the undeformed section [rad]. `axial`: their current
        positions along the axis [m].
        """
        return self._by_lane(AbstractLane.height_at, q, angle, axial)

    def shape(self, q: StationVector) -> PadShape:
        """The deformed pad, sampled; see the base class."""
        return PadShape(self.sampled(q, SAMPLES))

    def face(self, q: StationVector) -> "PadFace":
        """The deformed inner face along rays; see the base class."""
        return PadFace(self, q)

    def under(self, q: StationVector, loads: Sequence[PadLoad]) -> Displacements:
        """How the pad moves under loads' centres, or under their images in mirror planes."""
        places = jnp.broadcast_arrays(*(y for x in loads for y in (x.angle, x.axial)))
        angle, axial = jnp.stack(places[::2]), jnp.stack(places[1::2])
        sign, angle, axial = image_in_part(self.mirrored_planes, angle, axial)
        at = self.faces(q, angle, axial)
        return Displacements(sign * at.mid_displacement, sign * at.inner_displacement)

    def to_comparison_mesh(self, q: StationVector, counts: tuple[int, ...]) -> StationVector:
        """The same deformation on elements half as long in both directions."""
        del counts  # there is one
        return self._on_other_elements(q, finer=True)

    def _on_other_elements(self, q: StationVector, *, finer: bool) -> StationVector:
        def moved(lane: AbstractLane, q: Array) -> Array:
            return on_other_elements(lane.net, lane.section, q, finer=finer)

        return self._by_lane(moved, q)

    def omitted_energy(self, q: StationVector, factor: Lanes) -> Lanes:
        """Energy of shear, clamps and of loads where the membrane thins; see `omitted` [J]."""
        return self._by_lane(PadLane.omitted_energy, q, factor)

    def omitted_gradient(self, q: StationVector, factor: Lanes) -> StationVector | None:
        """Derivative of the omitted energy by the unknowns that are free; see the base."""
        free = self.topology.free[..., None]
        return jax.grad(lambda q: jnp.sum(self.omitted_energy(q, factor)))(q) * free


class PadFace(AbstractFace):
    """The inner face of a deformed pad."""

    varies_along_axis: ClassVar[bool] = True
    pad: Pad  # the whole pad
    q: StationVector  # its unknowns

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], geometry: SkinGeometry
    ) -> list[Float[Array, "taxel lane"]]:
        """Gaps along several rays for each taxel: one search for all; see the base class."""
        angle = jnp.concatenate([angle for angle, _ in rays])
        axial = jnp.concatenate([axial for _, axial in rays])
        return jnp.split(self.height(angle, axial) + geometry.gap(angle, axial), len(rays))

    def height(
        self, angle: Float[Array, "ray #lane"], axial: Float[Array, "ray #lane"]
    ) -> Float[Array, "ray lane"]:
        """By Newton's method; see the base class."""
        return self.pad.height_at(self.q, angle, axial)


class KnownFace(AbstractFace):
    """The inner face where the rays' heights are known."""

    varies_along_axis: ClassVar[bool] = True
    heights: Float[Array, "ray lane"]  # of all taxels' rays, as `PadFace.gaps` joins them [m]

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], geometry: SkinGeometry
    ) -> list[Float[Array, "taxel lane"]]:
        """See the base class."""
        own = jnp.split(self.heights, len(rays))
        return [h + geometry.gap(*ray) for h, ray in zip(own, rays, strict=True)]

    def height(
        self, angle: Float[Array, "ray #lane"], axial: Float[Array, "ray #lane"]
    ) -> Float[Array, "ray lane"]:
        """Of all rays together alone; see the base class."""
        del angle, axial
        return self.heights


def parts_of(membrane: AbstractMechanics) -> int:
    """How many of what is followed over time make the whole skin; see `Pad.parts`."""
    return membrane.parts if isinstance(membrane, Pad) else 1


def _divided(breaks: Float[Array, "breakpoint #lane"], samples: int) -> Array:
    """Points between breakpoints, evenly spaced in every element."""
    inside = np.arange(samples)[None, :, None] / samples
    steps = jnp.diff(breaks, axis=0)[:, None]
    points = (breaks[:-1, None] + inside * steps).reshape(-1, breaks.shape[-1])
    return jnp.concatenate([points, breaks[-1:]])
