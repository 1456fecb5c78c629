"""The deformed pad, sampled on a grid over all elements: what a user reads off it.

Extremes are taken at the vertex of a paraboloid through neighbouring samples, so that they
can be differentiated.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import LogStretches
from suas_jax.constitutive.stability import drucker_modulus
from suas_jax.mechanics.pad.faces import Faces, hoop_stretch, principal_stretches
from suas_jax.mechanics.shape import AbstractShape
from suas_jax.mechanics.shell.shape import CRUSHED
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.extremes import first_largest
from suas_jax.skin.section import AbstractSection

SAMPLES = 4
"""Intervals along either side of an element in which extremes are sought."""

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
