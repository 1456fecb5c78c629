"""What the equilibrium asks of any mechanics.

A mechanics is a discretised membrane with its loads: a pytree whose leaves are arrays
with a trailing lane axis and whose structure (number of stations, blocks) is static.
In plane strain everything is per unit of width along the axis until results are reported.
"""

import abc
import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.contact.face import BodyContact, ContactState, Strip
from suas_jax.mechanics.shape import AbstractFace, AbstractShape
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.block_tridiagonal import AbstractTangent
from suas_jax.skin.body import Body, Grip, PlacedBody
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Wall


class Assembly(NamedTuple):
    """One evaluation of the membrane at a trial state."""

    # internal force less the oil's net pressure times the volume gradient less the load factor
    # times the load vector [N/m]
    residual: StationVector
    tangent: AbstractTangent  # the residual's derivative by the unknowns
    volume_gradient: StationVector  # derivative of the enclosed volume by the unknowns
    # derivative of the loads' work at unit load factor by the unknowns [N/m]
    load: StationVector
    volume_change: Lanes  # enclosed volume less its value at rest, per width [m^2]
    # derivative of the residual by the factor on the travel of
    # bodies, its sign changed; None without bodies
    by_travel: StationVector | None = None
    contact: StationVector | None = None  # force of the bodies on the unknowns; None without


class Profile(NamedTuple):
    """A deformed section at points along the arc [sample, element, lane]."""

    angle: Array  # reference angle, as sections define it [rad]
    rest: Array  # undeformed position of the inner face [m], components leading
    mid_displacement: Array  # of the mid-surface [m]
    inner_displacement: Array  # of the inner face's material point at the same angle [m]
    outer_displacement: Array  # of the outer face's [m]
    inner_stretch: Array  # hoop stretch of the inner face, from free of stress
    outer_stretch: Array  # hoop stretch of the outer face


class Displacements(NamedTuple):
    """How the membrane moves at places of every lane, components leading."""

    mid_displacement: Array  # of the mid-surface [m]
    inner_displacement: Array  # of the inner face's material point at the same place [m]


class AbstractMechanics(eqx.Module):
    """A membrane: strain energy, enclosed volume, the work of its loads.

    Methods take a state: its unknowns `q`, of the part that is discretised or, to be shown, of
    the whole membrane; the net pressure on the inner face, oil less external [Pa]; and the
    dimensionless `factor` on all dead loads and on the travel of bodies. A `body` is placed.
    """

    # whether energies, forces and volumes are per unit of width; else they are totals
    per_width: ClassVar[bool]
    # whether what is reported has the first-order effect of the omitted energy
    corrected: ClassVar[bool] = False
    # share of the first-order effect of what is left out that the rest rarely exceeds; for
    # plane strain from a study of random scenes, see docs/errors_method.md
    omitted_margin: ClassVar[float] = 0.2
    # relative error that may remain where first-order effects cancel by chance
    omitted_floor: ClassVar[float] = 5e-5
    # relative error that remains where the wall carries all of the loads, less where it carries
    # a share of them
    omitted_at_wall: ClassVar[float] = 0.0
    law: eqx.AbstractVar[AbstractLaw]  # the membrane's material
    section: eqx.AbstractVar[AbstractSection]  # the undeformed membrane across its axis
    film_volume: eqx.AbstractVar[Lanes]  # volume of the undeformed oil film per width [m^2]
    # what holds the inner face; None where the membrane passes through it
    wall: eqx.AbstractVar[Wall | None]
    # free size of the membrane over that of its seat; None where it fits
    growth: eqx.AbstractVar[Growth | None]
    bodies: eqx.AbstractVar[tuple[Body, ...]]  # what is pressed on the outer face

    @property
    @abc.abstractmethod
    def error_shares(self) -> tuple[float, ...]:
        """Error of a solution over its difference to each comparison mesh; they add up."""

    @property
    def length_scale(self) -> Lanes:
        """The thickness: displacement beyond which linearisation can't be trusted [m]."""
        return self.section.mean_thickness

    @property
    @abc.abstractmethod
    def mid_extent(self) -> Lanes:
        """Length of the mid-line that is covered [m]; in three dimensions the area [m^2]."""

    @abc.abstractmethod
    def rest(self) -> StationVector:
        """Unknowns of the undeformed state."""

    @abc.abstractmethod
    def unknowns(self) -> int:
        """Number of unknowns that are free to move, the oil's pressure not counted."""

    @abc.abstractmethod
    def assemble(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Assembly:
        """Residual and its derivatives at a trial state."""

    def imbalance(
        self, q: StationVector, pressure: Lanes, factor: Lanes
    ) -> tuple[StationVector, Lanes]:
        """Residual and volume change of `assemble`, for derivatives by anything."""
        a = self.assemble(q, pressure, factor)
        return a.residual, a.volume_change

    @abc.abstractmethod
    def strain_energy(self, q: StationVector) -> Lanes:
        """Strain energy per width [J/m]."""

    @abc.abstractmethod
    def volume_change(self, q: StationVector) -> Lanes:
        """Enclosed volume less its value at rest, per width [m^2]."""

    @abc.abstractmethod
    def work(self, q: StationVector) -> Lanes:
        """Work of the line loads at unit factor, per width [J/m]."""

    @abc.abstractmethod
    def contact_energy(self, q: StationVector, factor: Lanes | float = 1.0) -> Lanes:
        """Energy of contact with wall and bodies per width [J/m]; zero without them."""

    @abc.abstractmethod
    def contact(self, q: StationVector, wall: Wall) -> ContactState:
        """The inner face against a wall, which needn't be the mechanics' own.

        `wall`: where it is, and how it answers.
        """

    @abc.abstractmethod
    def touched(
        self, q: StationVector, body: PlacedBody, shift: Array | float = 0.0
    ) -> BodyContact:
        """The outer face against a body. `shift`: added to the gaps [m]."""

    def pushed(
        self, q: StationVector, body: PlacedBody, shift: Array | float = 0.0
    ) -> Float[Array, "component lane"]:
        """Force of the outer face on a body; see `BodyContact.push`. `shift`: see `touched`."""
        return self.touched(q, body, shift).push

    def gap_shift(self, q: StationVector, body: PlacedBody) -> Array | None:
        """What the omitted energy adds to the gaps to a body, to first order [m].

        None where the model leaves out nothing there.
        """
        del q, body
        return None

    def strip(self, q: StationVector, body: PlacedBody) -> Strip | None:
        """What a body touches of a membrane thinner than the zone of contact is wide.

        None where the points of the face tell it.
        """
        del q, body
        return None

    @abc.abstractmethod
    def displacement_size(self, q: StationVector) -> Lanes:
        """Largest component of displacement, the measure of convergence [m]."""

    @abc.abstractmethod
    def shape(self, q: StationVector) -> AbstractShape:
        """The deformed membrane, the whole of it, sampled."""

    @abc.abstractmethod
    def under(self, q: StationVector, loads: Sequence[Any]) -> Displacements:
        """How the membrane moves under the centres of loads [component, load, lane].

        `loads`: at least one, of those that the mechanics was built for.
        """

    @abc.abstractmethod
    def face(self, q: StationVector) -> AbstractFace:
        """The deformed inner face of the whole membrane, ready to be asked for gaps."""

    @abc.abstractmethod
    def mirrored(self, q: StationVector) -> StationVector:
        """Unknowns of the whole arc from those of the left half of a symmetric one."""

    @abc.abstractmethod
    def to_comparison_mesh(self, q: StationVector, counts: tuple[int, ...]) -> StationVector:
        """The same deformation on a mesh that errors are estimated with.

        `counts`: elements of that mesh, one of `AbstractPlan.comparisons`.
        """

    def with_wall(self, wall: Wall | None) -> Self:
        """The same membrane held by another wall, or by none."""
        return dataclasses.replace(self, wall=wall)

    def with_growth(self, growth: Growth | None) -> Self:
        """A membrane of another free size on the same seat."""
        return dataclasses.replace(self, growth=growth)

    def hoop_force(self, q: StationVector) -> Lanes:
        """Mean force along the arc per width of the membrane, positive in tension [N/m].

        What makes the membrane longer does work against it.
        """
        growth = self.growth or Growth.none()
        free, zero = self.with_wall(None), jnp.zeros_like(self.mid_extent)

        def potential(strain: Lanes) -> Lanes:
            return free.with_growth(growth.longer(strain)).potential(q, zero, zero)

        one = jnp.ones(q.shape[-1:], q.dtype)
        return -jax.jvp(potential, (0 * one,), (one,))[1] / self.mid_extent

    def with_bodies(self, bodies: Sequence[Body]) -> Self:
        """The same membrane, these bodies pressed on it."""
        return dataclasses.replace(self, bodies=tuple(bodies))

    @property
    def has_friction(self) -> bool:
        """Whether a body holds the skin by friction."""
        return any(body.friction is not None for body in self.bodies)

    def grip(self, q: StationVector, body: PlacedBody) -> Grip | None:
        """How a body's friction holds the outer face; None without friction."""
        del q, body
        return None

    def gripped(self, q: StationVector, factor: Lanes) -> Self:
        """The same membrane, the bound of friction that of a state."""
        bodies = [body.holding(None) for body in self.bodies]
        return self.with_bodies(
            [body.holding(self.grip(q, body.placed(factor))) for body in bodies]
        )

    def held(self, q: StationVector, factor: Lanes) -> Self:
        """The same membrane: bounds of friction that are not known are those of a state."""
        unknown = any(body.friction is not None and body.grip is None for body in self.bodies)
        return self.gripped(q, factor) if unknown else self

    @property
    def touches(self) -> bool:
        """Whether there is anything that a face may touch."""
        return self.wall is not None or bool(self.bodies)

    @property
    def travel(self) -> Lanes:
        """Longest way of a body from first touch to full load [m]."""
        ways = [largest(body.way) for body in self.bodies]
        return functools.reduce(jnp.maximum, ways, jnp.zeros_like(self.length_scale))

    def softened(self, factor: Array) -> Self:
        """The same membrane, what it may touch no stiffer than a share of the rigid limit."""
        wall = None if self.wall is None else self.wall.softened(factor)
        softer = self.with_wall(wall)
        if not self.bodies:
            return softer
        return softer.with_bodies([body.softened(factor) for body in self.bodies])

    def with_more_fibres(self) -> Self:
        """The same membrane, its energy summed up over twice as many fibres of the thickness.

        The membrane itself where it is not a sum over fibres.
        """
        return self

    def stored_energy(self, q: StationVector) -> Lanes:
        """Strain energy of the state that is reported, per width [J/m]."""
        return self.strain_energy(q)

    def omitted_gradient(self, q: StationVector, factor: Lanes) -> StationVector | None:
        """Derivative, by the free unknowns, of the energy that the model leaves out [N/m].

        None where it leaves out nothing.
        """
        del q, factor
        return None

    def around(self, equilibrium: StationVector) -> Self:
        """The same membrane, to read unknowns with that are a correction of an equilibrium."""
        del equilibrium
        return self

    def potential(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Lanes:
        """Total potential energy per width at given pressure and load factor [J/m].

        Its gradient by q is the residual of `assemble`, its Hessian the tangent.
        """
        stored = self.strain_energy(q) + self.contact_energy(q, factor)
        return stored - pressure * self.volume_change(q) - factor * self.work(q)


def largest(values: Float[Array, "*axes lane"]) -> Lanes:
    """Largest magnitude over all axes but the lanes."""
    return jnp.max(jnp.abs(values), tuple(range(values.ndim - 1)))
