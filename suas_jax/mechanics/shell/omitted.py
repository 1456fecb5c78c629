"""What the lumped shell leaves out, as energy: the source of its modelling error.

Normals that stay normal forbid transverse shear, loads that act at a fixed distance from the
mid-surface do no work where the membrane thins beneath them, and a clamp holds a line where
it should hold a face. To leading order in thickness over length all three are energies of the
shell's own resultants: normal force N, moment M and transverse force Q = dM/ds, per width, of
a membrane of shear modulus G, thickness t, under inward forces f per width on its outer face::

    E = 27/40 integral Q^2 / (G t) ds + sum over loads f (N / 8 + 3 M / (8 t)) / G
        + sum over clamps (c1 N^2 + c2 (M / t)^2 + c3 Q M / t + c4 N Q) / G

    relaxed potential = potential - E

To first order the solution of the relaxed problem is one more substitution with the tangent
at hand, K dq = dE/dq.

The first three constants are exact for an incompressible strip in plane strain. A moment thins
one half of it and thickens the other, so that its normals are sheared even where they stay
normal: parabolic shear stress does 51/40 Q^2 / (G t) of work on what is missing to it and
stores 3/5 of that unit, and 51/40 - 3/5 = 27/40. Under uniform pressure on one face this makes
the curvature of a straight beam that of the exact solution (S. P. Timoshenko, J. N. Goodier,
Theory of Elasticity, art. 22). A clamp's own field has no closed form: its four constants
belong to linear elasticity of the strip's end, the same for every membrane, and were fitted to
the solid. The end of a straight strip is its own mirror image, which leaves N alone; c4 is
small, and comes from curvature. What N does there is to thin a membrane that the clamp keeps
thick: one that has grown by G is too thick by itself, as under N - 4 G t log(g_r sqrt(g_a)).
``python -m benchmarks.shell_correction`` shows what all of it is good for.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.contact.face import Strip
from suas_jax.mechanics.shell.contact import ContactFace
from suas_jax.mechanics.shell.points import Moments, Points
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.lanes import mix
from suas_jax.skin.body import PlacedBody
from suas_jax.skin.loads import LoadPoints
from suas_jax.skin.prestress import Growth

SHEAR = 27 / 40
_LOAD_NORMAL, _LOAD_MOMENT = 1 / 8, 3 / 8
CLAMP_NORMAL, CLAMP_MOMENT = -0.0142, -0.077
CLAMP_MOMENT_SHEAR, CLAMP_NORMAL_SHEAR = 0.103, 0.0077
# Least curvature of what touches, times thickness, and least half width over it.
_FLAT, _NARROWEST = 1e-4, 1e-4
_SPREAD = 1.1  # of the line forces at the ends of a zone that lies flat, in thicknesses
_STEPS = 12
_TINY = 1e-100


class Resultants(NamedTuple):
    """Normal force [N/m] and moment [N] per width, at the Gauss points of every element."""

    normal: Float[Array, "gauss element lane"]
    moment: Float[Array, "gauss element lane"]

    def lines(self, xi: np.ndarray, weights: np.ndarray) -> list["LinesOverElements"]:
        """Both as lines over elements. `xi`, `weights`: the rule of the Gauss points."""
        return [LinesOverElements.through(x, xi, weights) for x in self]


def resultants(points: Points, first: tuple[Array, Array]) -> Resultants:
    """Normal force and moment from the energy's derivatives by A = l^2 - 1, b = k l - 1/R.

    `points`: the mid-line. `first`: derivatives of the energy per length by A and b.
    """
    size = jnp.sqrt(1 + points.stretch)
    return Resultants(2 * size * first[0], size * first[1])


def resultants_transposed(
    by: Resultants, points: Points, moments: Moments
) -> tuple[Array, Array]:
    """Derivatives by A and b of what has given derivatives by the resultants.

    `by`: the derivatives by normal force and moment. `points`: the mid-line. `moments`: first
    and second derivatives of the energy per length by A and b.
    """
    size = jnp.sqrt(1 + points.stretch)
    (by_a, by_b), (by_aa, by_ab, by_bb) = moments
    by_stretch = by.normal * (2 * size * by_aa + by_a / size)
    by_stretch = by_stretch + by.moment * (size * by_ab + by_b / (2 * size))
    return by_stretch, by.normal * 2 * size * by_ab + by.moment * size * by_bb


class LinesOverElements(NamedTuple):
    """Values that change linearly along every element: mean, and rise from end to end."""

    mean: Float[Array, "element lane"]
    rise: Float[Array, "element lane"]

    @classmethod
    def through(
        cls, values: Float[Array, "gauss element lane"], xi: np.ndarray, weights: np.ndarray
    ) -> "LinesOverElements":
        """The best fit to values at Gauss points."""
        mean, rise = mix(np.stack([weights, 12 * weights * (xi - 0.5)]), values)
        return cls(mean, rise)

    def along(self, xi: np.ndarray) -> Float[Array, "point element lane"]:
        """Values at the same local coordinates of every element."""
        return self.mean + self.rise * (xi[:, None, None] - 0.5)

    def at_points(self, points: LoadPoints) -> Float[Array, "point lane"]:
        """Values under load points."""
        mean, rise = (jnp.sum(points.select * x[:, None], 0) for x in self)
        return mean + rise * (points.xi - 0.5)


def relaxed_energy(
    lines: list[LinesOverElements],  # normal force and moment
    lengths: Float[Array, "element #lane"],
    thickness: Float[Array, "#gauss #element #lane"],
    modulus: Lanes,  # small-strain shear modulus [Pa]
    clamped: tuple[bool, bool],  # whether the first and the last station are
    growth: Growth | None,  # of the membrane; None where it fits its seat
) -> Lanes:
    """The part of E by which the membrane itself is softer [J/m].

    `lengths`: of the elements [m]. `thickness`: of the membrane at the Gauss points [m].
    """
    normal, moment = lines
    shear = moment.rise / lengths
    total = SHEAR * jnp.sum(lengths * shear**2 / jnp.mean(thickness, 0), 0)
    # Outwards along the arc Q changes its sign with the side of the clamp.
    for element, side, held in ((0, 1.0, clamped[0]), (-1, -1.0, clamped[1])):
        if held:
            n = normal.mean[element] - side * normal.rise[element] / 2
            edge = thickness[0, 0] if element == 0 else thickness[-1, -1]
            if growth is not None:
                n = n - 4 * modulus * edge * (growth.radial + growth.axial / 2)
            m = (moment.mean[element] - side * moment.rise[element] / 2) / edge
            q = side * shear[element]
            total = total + CLAMP_NORMAL * n**2 + CLAMP_MOMENT * m**2
            total = total + q * (CLAMP_MOMENT_SHEAR * m + CLAMP_NORMAL_SHEAR * n)
    return total / modulus


def thinning(normal: Array, moment: Array, thickness: Array, modulus: Lanes) -> Array:
    """How far the outer half of the membrane thins under resultants [m].

    Loads beneath which it thins do that much work, bodies go that much further.
    """
    return (_LOAD_NORMAL * normal + _LOAD_MOMENT * moment / thickness) / modulus


def strip(
    face: ContactFace,
    # current curvature of the mid-line at its points [1/m]
    bend: Float[Array, "point element lane"],
    body: PlacedBody,
    modulus: Lanes,  # small-strain shear modulus [Pa]
) -> Strip:
    """Where the continuum would be touched, from the shell's own zone and curvature.

    A narrow strip of half width a is Hertz' on an incompressible half-space, with the force
    per width f and the curvature k of both surfaces together, which grows away from the
    force as the moment falls (K. L. Johnson, Contact Mechanics, section 4.2)::

        f = pi G a^2 (k + f a / (6 D)),    D = G t^3 / 3

    and its largest pressure is 2 f / (pi a). A zone in which the shell lies flat ends in line
    forces. They are spread over about the thickness, and the zone reaches a quarter of it
    further: both from the solid.
    """
    share = face.shares(face.inputs)
    force = jnp.sum(share, (0, 1))
    gap = face.gap(face.position(face.inputs))
    flat = jnp.sum(jnp.where(gap < 0, face.area, 0.0), (0, 1)) / 2
    thickness = face.section.mean_thickness
    some = jnp.maximum(force, _TINY)
    together = jnp.sum(share * bend, (0, 1)) / some + body.body.shape.curvature
    together = jnp.maximum(together, _FLAT / thickness)
    half = jnp.sqrt(some / (np.pi * modulus * together))
    for _ in range(_STEPS):  # Newton's, from above: the cubic is convex
        linear = np.pi * modulus * together * half**2
        cubic = np.pi * force * half**3 / (2 * thickness**3)
        slope = (2 * linear + 3 * cubic) / jnp.maximum(half, _TINY)
        half = half - (linear + cubic - force) / jnp.maximum(slope, _TINY)
    lies = flat > thickness / 2
    inside = jnp.sum(
        jnp.where(jnp.abs(_from_middle(face, share)) < flat / 2, share, 0.0), (0, 1)
    )
    level = inside / jnp.maximum(flat, _TINY)
    ends = level + (force / 2 - level * flat) / (_SPREAD * thickness)
    narrow = 2 * force / (np.pi * jnp.maximum(half, _NARROWEST * thickness))
    return Strip(
        jnp.where(lies, flat + thickness / 4, half),
        jnp.where(lies, ends, narrow),
        (half < thickness / 1.5) | (flat > 2 * thickness),
    )


def _from_middle(face: ContactFace, share: Array) -> Array:
    """Arc length of the mid-line from the middle of what is touched [m]."""
    along = face.section.size * face.at.angle
    return along - jnp.sum(share * along, (0, 1)) / jnp.maximum(jnp.sum(share, (0, 1)), _TINY)


def indentation(face: ContactFace, touched: Strip, modulus: Lanes) -> Lanes:
    """How far a body goes into the outer half of the membrane alone [m].

    That of a strip of width 2 a on an incompressible half-space, seen from half the thickness
    beneath (K. L. Johnson, Contact Mechanics, section 5.6), with the force per width f::

        f / (4 pi G) (2 ln(t / a) - 1)

    Its energy is half of that times f.

    `touched`: the strip. `modulus`: small-strain shear modulus [Pa].
    """
    force = jnp.sum(face.shares(face.inputs), (0, 1))
    thickness = face.section.mean_thickness
    half = jnp.maximum(touched.half, _NARROWEST * thickness)
    deep = jnp.maximum(2 * jnp.log(thickness / half) - 1, 0.0)
    return force / (4 * np.pi * modulus) * deep
