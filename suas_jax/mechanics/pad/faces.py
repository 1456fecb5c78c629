"""The deformed pad at places: its mid-surface and faces, stretches, energy.

What a user reads off it is sampled on a grid over all elements. Extremes are taken at the
vertex of a paraboloid through neighbouring samples, so that they can be differentiated.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import LogStretches
from suas_jax.constitutive.stability import drucker_modulus
from suas_jax.mechanics.pad.fibres import Layers, energy_density, fibre_strains
from suas_jax.mechanics.pad.mid_surface import Scalar, Surface, Vector, components
from suas_jax.mechanics.shape import AbstractShape
from suas_jax.mechanics.shell.shape import CRUSHED
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.extremes import first_largest
from suas_jax.numerics.length import length
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection

SAMPLES = 4
"""Intervals along either side of an element in which extremes are sought."""


class Faces(NamedTuple):
    """The deformed pad at points of its undeformed mid-surface; lanes come last."""

    angle: Float[Array, "*point"]  # reference angle [rad]
    axial: Float[Array, "*point"]  # reference position along the axis [m]
    # of the mid-surface [m], Cartesian components leading
    mid_displacement: Float[Array, "3 *point"]
    # of the inner face's material point at the same place [m]
    inner_displacement: Float[Array, "3 *point"]
    outer_displacement: Float[Array, "3 *point"]  # of the outer face's [m]
    # C - 1 of the inner face by unit vectors along arc and axis, entries (11, 22, 12)
    inner_strain: Float[Array, "3 *point"]
    outer_strain: Float[Array, "3 *point"]  # of the outer face
    # strain energy per volume, mean over the thickness [J/m^3]
    energy_density: Float[Array, "*point"]


def face_displacement(
    s: Surface, offset: Array, growth: Growth | None
) -> tuple[Vector, Scalar]:
    """Displacement of the fibres at a reference offset, and how far from the mid-surface.

    A fibre lies at zeta with J (zeta + H zeta^2 + K zeta^3 / 3) = M, the volume of the
    membrane below it kept. The cubic term is small: one step of Newton's method from the
    quadratic's root accounts for it.

    `s`: the mid-surface at points. `offset`: Z [m]. `growth`: of the membrane; None where it
    fits its seat.
    Returns the displacement [m] and zeta [m].
    """
    square = s.m[0] ** 2 + s.m[1] ** 2 + s.m[2] ** 2
    size = jnp.sqrt(square)
    lever = (offset + offset**2 * s.rest.curvature / 2) / size
    if growth is not None:
        lever = growth.volume * lever
    a11, a22, a12 = 1 + s.metric[0], 1 + s.metric[1], s.metric[2]
    h11, h22, h12 = s.rest.curvature + s.bending[0], s.bending[1], s.bending[2]
    mean = (a22 * h11 + a11 * h22 - 2 * a12 * h12) / (2 * square * size)
    gauss = (h11 * h22 - h12 * h12) / square**2
    # A membrane folded more sharply than its thickness allows has no root: see CRUSHED.
    root = jnp.sqrt(jnp.maximum(1 + 4 * mean * lever, CRUSHED**2))
    zeta = 2 * lever / (1 + root)
    zeta = zeta - gauss * zeta**3 / 3 / jnp.maximum(root, 0.1)
    lift = zeta / size
    moved = (u - lift * m - offset * n for u, m, n in zip(s.u, s.m, s.n, strict=True))
    return components(moved), zeta


def faces(
    law: AbstractLaw,
    s: Surface,  # the mid-surface at points
    place: tuple[Array, Array],  # reference angle and axial position of the points
    fibres: Layers,  # through the thickness, for the energy
) -> Faces:
    """The deformed pad around its mid-surface, normals staying normal."""
    thickness, curvature, growth = s.rest.thickness, s.rest.curvature, fibres.growth

    def strain(offset: Array) -> Array:
        lever = offset + offset**2 * curvature / 2
        one = Layers(fibres.weight[:1], lever[None], 1 + offset[None] * curvature)
        return jnp.stack(fibre_strains(s, one.grown(growth))[0])[:, 0]

    below, above = -s.rest.below, s.rest.above
    return Faces(
        *place,
        mid_displacement=jnp.stack(s.u),
        inner_displacement=jnp.stack(face_displacement(s, below, growth)[0]),
        outer_displacement=jnp.stack(face_displacement(s, above, growth)[0]),
        inner_strain=strain(below),
        outer_strain=strain(above),
        energy_density=energy_density(law, s, fibres) / thickness,
    )


def unbent(shown: Faces, equilibrium: Faces) -> Faces:
    """Faces of a state that is a first-order correction of an equilibrium.

    The correction stretches the mid-surface, which shows in the mean of both faces, but does
    not bend it: beneath loads and at clamps a membrane that shears has kinks, which are no
    strains. The energy density is the equilibrium's.
    """
    strains = [(x.inner_strain, x.outer_strain) for x in (shown, equilibrium)]
    after, before = ((inner + outer) / 2 for inner, outer in strains)
    inner, outer = (x + (after - before) for x in strains[1])
    energy = equilibrium.energy_density
    return shown._replace(inner_strain=inner, outer_strain=outer, energy_density=energy)


def principal_stretches(strain: Float[Array, "3 *point"]) -> Float[Array, "2 *point"]:
    """Smallest and largest stretch in the plane from C - 1, entries (11, 22, 12)."""
    mean = (strain[0] + strain[1]) / 2
    radius = length(jnp.stack([(strain[0] - strain[1]) / 2, strain[2]]))
    return jnp.sqrt(jnp.maximum(1 + jnp.stack([mean - radius, mean + radius]), CRUSHED**2))


def hoop_stretch(strain: Float[Array, "3 *point"]) -> Float[Array, "*point"]:
    """Stretch along the arc from C - 1, entries (11, 22, 12)."""
    return jnp.sqrt(jnp.maximum(1 + strain[0], CRUSHED**2))


Grid = Float[Array, "arc axial lane"]


class PadShape(AbstractShape):
    """Samples of a deformed pad."""

    samples: Faces  # both faces and the mid-surface on a grid [arc, axial, lane]

    @staticmethod
    def peak(values: Grid, *companions: Array) -> tuple[Lanes, ...]:
        """Neighbouring samples joined by a paraboloid; see the base class."""
        arc, axial, lanes = values.shape
        best = first_largest(values.reshape(-1, lanes))
        a, b = jnp.unravel_index(best, (arc, axial))
        a, b = jnp.clip(a, 1, arc - 2), jnp.clip(b, 1, axial - 2)

        def around(f: Array, a: Array, b: Array) -> Array:
            return jax.lax.dynamic_slice(f, (a - 1, b - 1), (3, 3))

        def local(f: Array) -> tuple[Array, ...]:
            f = jnp.broadcast_to(f, values.shape)
            near = jax.vmap(around, (-1, 0, 0), -1)(f, a, b)
            middle = near[1, 1]
            slopes = (near[2, 1] - near[0, 1]) / 2, (near[1, 2] - near[1, 0]) / 2
            bends = near[2, 1] + near[0, 1] - 2 * middle, near[1, 2] + near[1, 0] - 2 * middle
            twist = (near[2, 2] - near[2, 0] - near[0, 2] + near[0, 0]) / 4
            return middle, *slopes, *bends, twist

        fields = [local(f) for f in (values, *companions)]
        _, gx, gy, bx, by, twist = fields[0]
        determinant = bx * by - twist**2
        hill = (bx < 0) & (determinant > 0)
        safe = jnp.where(hill, determinant, 1.0)
        x = jnp.where(hill, (twist * gy - by * gx) / safe, jnp.sign(gx))
        y = jnp.where(hill, (twist * gx - bx * gy) / safe, jnp.sign(gy))
        x, y = jnp.clip(x, -1.0, 1.0), jnp.clip(y, -1.0, 1.0)
        return tuple(
            middle + gx * x + gy * y + (bx * x**2 + by * y**2) / 2 + twist * x * y
            for middle, gx, gy, bx, by, twist in fields
        )

    @property
    def places(self) -> tuple[Grid, Grid]:
        """See the base class."""
        return self.samples.angle, self.samples.axial

    def inner_face(self, section: AbstractSection) -> tuple[Grid, Grid, Grid]:
        """See the base class."""
        grid = self.samples
        place = section.inner_face(grid.angle) + grid.inner_displacement[:2]
        angle, height = section.foot(place, grid.angle)
        return height, angle, grid.axial + grid.inner_displacement[2]

    def inner_stretch(self) -> Grid:
        """See the base class."""
        return hoop_stretch(self.samples.inner_strain)

    def material_stable(self, law: AbstractLaw) -> Bool[Array, " lane"]:
        """See the base class."""
        strains = jnp.stack([self.samples.inner_strain, self.samples.outer_strain], 1)
        low, high = principal_stretches(strains)
        modulus = drucker_modulus(law, low, high)
        return jnp.all((modulus > 0) & (low > CRUSHED), (0, 1, 2))

    def in_domain(self, law: AbstractLaw) -> Bool[Array, " lane"]:
        """See the base class."""
        strains = jnp.stack([self.samples.inner_strain, self.samples.outer_strain], 1)
        low, high = jnp.log(principal_stretches(strains))
        # A hoop stretch is reported alone: strained least, the other two are equal.
        hoop = jnp.log(jnp.stack(self.stretch_range()))
        on_faces = law.has_energy(LogStretches(low, high))
        return jnp.all(on_faces, (0, 1, 2)) & jnp.all(
            law.has_energy(LogStretches(hoop, -hoop / 2)), 0
        )
