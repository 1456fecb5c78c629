"""The deformed lumped shell, recovered from its unknowns: positions, stretches, energy."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax._types import Lanes, StationVector
from suas_jax.element import hermite
from suas_jax.geometry import outward, tangent
from suas_jax.mechanics.base import Profile
from suas_jax.mechanics.shell import Shell
from suas_jax.mechanics.shell_points import fibre_height


class _MidLine(NamedTuple):
    """Displacement of the mid-line and its first two derivatives by arc length."""

    angle: Array
    u: tuple[Array, Array]
    u1: tuple[Array, Array]
    u2: tuple[Array, Array]


def profile(shell: Shell, q: StationVector, samples: int) -> Profile:
    """The deformed section at evenly spaced points of every element.

    Args:
        shell: the membrane.
        q: its unknowns.
        samples: intervals an element is divided in.
    """
    xi = np.linspace(0, 1, samples + 1)[:, None, None]
    qe = shell._gather(q)[:, :, None]  # [shape, component, 1, element, lane]
    length = shell.lengths
    start, span = shell.angles[:-1], shell.angles[1:] - shell.angles[:-1]
    derivatives = []
    for order in range(3):
        shapes = hermite(xi, order)
        value = sum(n * q for n, q in zip(shapes, qe, strict=True))
        derivatives.append((value[0] / length**order, value[1] / length**order))
    return _recover(shell, _MidLine(start + xi * span, *derivatives))


def at_angle(shell: Shell, q: StationVector, angle: Lanes) -> Profile:
    """The deformed section at one reference angle per lane; leading axes of length one.

    Args:
        shell: the membrane.
        q: its unknowns.
        angle: from the symmetry axis, within the discretised arc [rad].
    """
    start, end = shell.angles[:-1], shell.angles[1:]
    count = start.shape[0]
    inside = jnp.clip(jnp.sum(start <= angle, 0) - 1, 0, count - 1)
    pick = (jnp.arange(count)[:, None] == inside).astype(start.dtype)
    first, last = jnp.sum(pick * start, 0), jnp.sum(pick * end, 0)
    xi = (angle - first) / (last - first)
    qe = jnp.sum(shell._gather(q) * pick, 2)
    length = shell.mid_radius * (last - first)
    derivatives = []
    for order in range(3):
        shapes = hermite(xi, order)
        value = sum(n * q for n, q in zip(shapes, qe, strict=True)) / length**order
        derivatives.append((value[0][None, None], value[1][None, None]))
    return _recover(shell, _MidLine(angle[None, None], *derivatives))


def _recover(shell: Shell, line: _MidLine) -> Profile:
    radius, thickness = shell.mid_radius, shell.thickness
    t, n = tangent(line.angle), outward(line.angle)
    x1, y1 = t[0] + line.u1[0], t[1] + line.u1[1]
    x2, y2 = line.u2[0] - n[0] / radius, line.u2[1] - n[1] / radius
    along = t[0] * line.u1[0] + t[1] * line.u1[1]
    stretch = 2 * along + line.u1[0] ** 2 + line.u1[1] ** 2
    a = 1 + stretch
    c = x2 * y1 - y2 * x1
    bending = (
        along / radius
        - (n[0] * line.u2[0] + n[1] * line.u2[1])
        + (line.u2[0] * line.u1[1] - line.u2[1] * line.u1[0])
    )
    curvature = (bending - stretch / radius) / a
    size = jnp.sqrt(a)
    normal = jnp.stack([-y1, x1]) / size

    def face(offset: Array) -> tuple[Float[Array, "2 ..."], Array]:
        """Displacement and hoop stretch of the fibre at a reference offset."""
        m = offset + offset**2 / (2 * radius)
        moved = jnp.stack(line.u) + fibre_height(m, a, c) * normal - offset * n
        green = (stretch + 2 * m * curvature) / (1 + offset / radius) ** 2
        return moved, jnp.sqrt(1 + green)

    inner, inner_stretch = face(-thickness / 2)
    outer, outer_stretch = face(thickness / 2)
    return Profile(
        angle=line.angle,
        mid_displacement=jnp.stack(line.u),
        inner_displacement=inner,
        outer_displacement=outer,
        inner_stretch=inner_stretch,
        outer_stretch=outer_stretch,
        energy_density=shell.energy_density(stretch, curvature) / thickness,
    )


def mirrored(half: StationVector) -> StationVector:
    """Unknowns of the whole arc from those of the left half of a symmetric one."""
    # x and the derivative of y by arc length change sign; so do, at the clamp, the
    # normal but not the tangential slope.
    signs = np.array([-1.0, 1.0, 1.0, -1.0])[:, None, None]
    return jnp.concatenate([half, signs * half[:, -2::-1]], 1)


def prolonged(shell: Shell, q: StationVector) -> StationVector:
    """The same deformation on a mesh with every element divided in two."""
    v0, s0, v1, s1 = shell._gather(q)
    middle = jnp.concatenate(
        [(v0 + v1) / 2 + (s0 - s1) / 8, (1.5 * (v1 - v0) - (s0 + s1) / 4) / shell.lengths]
    )
    pairs = jnp.stack([q[:, :-1], middle], 2)
    woven = pairs.reshape(4, -1, q.shape[-1])
    return jnp.concatenate([woven, q[:, -1:]], 1)
