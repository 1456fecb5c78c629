"""The deformed lumped shell, recovered from its unknowns: positions, stretches."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.base import Profile
from suas_jax.mechanics.shell.points import kinematics
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.lanes import mix
from suas_jax.numerics.polynomials import hermite
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection, Frame

# Stretch given to a fibre of no length left, on the inner side of a fold.
CRUSHED = 1e-6


class MidLine(NamedTuple):
    """Displacement of the mid-line and its first two derivatives by arc length."""

    at: Frame  # the undeformed mid-line
    u: tuple[Array, Array]  # displacement [m]
    u1: tuple[Array, Array]  # its derivative
    u2: tuple[Array, Array]  # its second one [1/m]


def sampled(
    qe: Float[Array, "4 2 element lane"],  # element unknowns [shape, component]
    angles: Float[Array, "station #lane"],
    section: AbstractSection,
    samples: int,  # intervals an element is divided in
) -> MidLine:
    """The mid-line at evenly spaced points of every element.

    `angles`: of the stations [rad].
    """
    xi = np.linspace(0, 1, samples + 1)
    start, span = angles[:-1], angles[1:] - angles[:-1]
    shapes = np.stack([hermite(xi, order).T for order in range(3)])
    values = mix(shapes.reshape(-1, 4), qe).reshape(3, samples + 1, *qe.shape[1:])
    length = section.size * span
    derivatives = [(u[:, 0] / length**k, u[:, 1] / length**k) for k, u in enumerate(values)]
    return MidLine(section.frame(start + xi[:, None, None] * span), *derivatives)


def at(
    qe: Float[Array, "4 2 element lane"],  # element unknowns [shape, component]
    angles: Float[Array, "station #lane"],
    section: AbstractSection,
    angle: Lanes,  # where [rad]
) -> MidLine:
    """The mid-line at one reference angle per lane; leading axes of length one.

    `angles`: of the stations [rad].
    """
    start, end = angles[:-1], angles[1:]
    count = start.shape[0]
    inside = jnp.clip(jnp.sum(start <= angle, 0) - 1, 0, count - 1)
    pick = (jnp.arange(count)[:, None] == inside).astype(start.dtype)
    first, last = jnp.sum(pick * start, 0), jnp.sum(pick * end, 0)
    xi = ((angle - first) / (last - first))[None, None]
    here = jnp.sum(qe * pick, 2)[:, :, None, None]
    length, derivatives = section.size * (last - first), []
    for order in range(3):
        value = jnp.sum(hermite(xi, order)[:, None] * here, 0) / length**order
        derivatives.append((value[0], value[1]))
    return MidLine(section.frame(angle[None, None]), *derivatives)


def lever(offset: Array, curvature: Array, growth: Growth | None = None) -> Array:
    """Z + Z^2 / (2 R) of a fibre at reference offset Z, times det G where it has grown [m]."""
    plain = offset + offset**2 * curvature / 2
    return plain if growth is None else growth.volume * plain


def reach(
    size: Array, curl: Array, offset: Array, curvature: Array, growth: Growth | None
) -> Array:
    """Distance of a fibre from the mid-line, over the length of the tangent [m].

    zeta solves l (zeta + k zeta^2 / 2) = m with l = sqrt(a), k = c / l^3. A membrane folded
    more sharply than its thickness allows has no solution: see CRUSHED.

    `size`: a = |r'|^2. `curl`: c = x'' y' - x' y''. `offset`: of the fibre at rest, outwards
    [m]. `curvature`: of the undeformed mid-line [1/m]. `growth`: of the membrane; None where it
    fits its seat.
    """
    m = lever(offset, curvature, growth)
    root = jnp.sqrt(jnp.maximum(1 + 2 * m * curl / size**2, CRUSHED**2))
    return 2 * m / size / (1 + root)


def recovered(
    line: MidLine,  # the mid-line
    section: AbstractSection,
    growth: Growth | None,  # of the membrane; None where it fits its seat
) -> Profile:
    """The section around a mid-line, its normals staying normal."""
    n, k, thickness = line.at.normal, line.at.curvature, line.at.thickness
    ((x1, y1), (x2, y2)), stretch, curvature = kinematics(line.u1, line.u2, line.at)
    size, curl = x1**2 + y1**2, x2 * y1 - y2 * x1

    def face(offset: Array) -> tuple[Float[Array, "2 ..."], Array]:
        """Displacement and hoop stretch of the fibre at a reference offset."""
        moved = reach(size, curl, offset, k, growth) * jnp.stack([-y1, x1]) - offset * n
        m = lever(offset, k, growth)
        green = stretch + 2 * m * curvature
        if growth is not None:
            green = green + 2 * (m - lever(offset, k)) * k
        stretched = jnp.sqrt(jnp.maximum(1 + green / (1 + offset * k) ** 2, CRUSHED**2))
        if growth is not None:
            stretched = stretched * jnp.exp(-growth.hoop)
        return jnp.stack(line.u) + moved, stretched

    inner, inner_stretch = face(-thickness / 2)
    outer, outer_stretch = face(thickness / 2)
    return Profile(
        angle=line.at.angle,
        rest=section.inner_face(line.at.angle),
        mid_displacement=jnp.stack(line.u),
        inner_displacement=inner,
        outer_displacement=outer,
        inner_stretch=inner_stretch,
        outer_stretch=outer_stretch,
    )


def turn(r1: tuple[Array, Array], change: tuple[Array, Array]) -> Array:
    """Angle by which a tangent r'(s) turns under a small change of it, counter-clockwise."""
    (x1, y1), (dx, dy) = r1, change
    return (x1 * dy - y1 * dx) / (x1**2 + y1**2)


def carried(
    offset: Float[Array, "2 ..."], shift: Float[Array, "2 ..."], angle: Array
) -> Float[Array, "2 ..."]:
    """Change of a point at an offset from one that is shifted, their distance kept [m]."""
    return shift + angle * jnp.stack([-offset[1], offset[0]])


def shifted(shape: Profile, line: MidLine, change: MidLine) -> Profile:
    """A section after a small change of its mid-line that bends and thins nothing.

    `shape`: the section. `line`: its mid-line. `change`: of the mid-line.
    """
    t, n, thickness = line.at.tangent, line.at.normal, line.at.thickness
    angle = turn((t[0] + line.u1[0], t[1] + line.u1[1]), change.u1)
    shift, middle = jnp.stack(change.u), shape.mid_displacement

    def moved(face: Array, offset: Array) -> Array:
        return face + carried(face - middle + offset * n, shift, angle)

    return shape._replace(
        mid_displacement=middle + shift,
        inner_displacement=moved(shape.inner_displacement, -thickness / 2),
        outer_displacement=moved(shape.outer_displacement, thickness / 2),
    )


def mirrored(half: StationVector) -> StationVector:
    """Unknowns of the whole arc from those of the left half of a symmetric one."""
    # x and the derivative of y by arc length change sign; so do, at the clamp, the
    # normal but not the tangential slope.
    signs = np.array([-1.0, 1.0, 1.0, -1.0])[:, None, None]
    return jnp.concatenate([half, signs * half[:, -2::-1]], 1)


def prolonged(
    q: StationVector,  # unknowns of the stations
    qe: Float[Array, "4 2 element lane"],  # element unknowns [shape, component]
    lengths: Float[Array, "element #lane"],
) -> StationVector:
    """The same deformation on a mesh with every element divided in two.

    `lengths`: of the elements [m].
    """
    v0, s0, v1, s1 = qe
    middle = jnp.concatenate(
        [(v0 + v1) / 2 + (s0 - s1) / 8, (1.5 * (v1 - v0) - (s0 + s1) / 4) / lengths]
    )
    pairs = jnp.stack([q[:, :-1], middle], 2)
    woven = pairs.reshape(4, -1, q.shape[-1])
    return jnp.concatenate([woven, q[:, -1:]], 1)
