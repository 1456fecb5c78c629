"""Static condensation of the solid's elements: what an element needs no neighbour for.

An element couples nine nodes and three pressures. The displacement u of its centre and its
two linear pressures q are coupled to each other by an invertible matrix B, and stand alone
otherwise::

    [ k   B^T ] [u]        u = B^-1 (g - V x),     q = B^-T (f - k u - K x)
    [ B    0  ] [q]

so both follow from the other nodes' displacements x exactly: incompressibility asks for no
penalty. Each such pair brings two positive and two negative eigenvalues, whatever the
material does.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

_CENTRE = 8  # among the nodes of an element


class Condensed(NamedTuple):
    """Condensed elements; node axes count the eight outer nodes."""

    stiffness: Array  # [node, component, node, component, layer, element, lane]
    mean: Array  # coupling of the displacements to the constant pressure
    # W, the centre's displacement that a displacement of the other nodes enforces
    follow: Array
    coupling: Array  # of the centre to the others [2, node, component, ...]
    centre: Array  # k, the centre's own stiffness
    inverse: Array  # B^-1 [component, mode, ...]
    penalty: Array  # factor on the square of an element's change of volume

    @classmethod
    def of(
        cls,
        stiffness: Float[Array, "9 9 3 layer element lane"],
        constraint: Float[Array, "9 3 2 layer element lane"],
        penalty: Float[Array, "layer element #lane"],
    ) -> "Condensed":
        """Eliminate the centres and the linear pressures; see `ElementTangent`.

        `stiffness`: blocks (xx, yy, xy) of the nine nodes' matrix. `constraint`: derivative of
        the pressures' equations by the displacements. `penalty`: factor on the square of an
        element's change of volume.
        """
        k, v = stiffness, constraint
        xx, yy, xy = (k[:, :, i] for i in range(3))
        own = k[_CENTRE, _CENTRE]
        centre = jnp.stack([jnp.stack([own[0], own[2]]), jnp.stack([own[2], own[1]])])
        coupling = jnp.stack(
            [
                jnp.stack([xx[_CENTRE, :8], xy[_CENTRE, :8]], 1),
                jnp.stack([xy[:8, _CENTRE], yy[:8, _CENTRE]], 1),
            ]
        )
        (a, b), (c, d) = ([v[_CENTRE, mode, i] for i in range(2)] for mode in (1, 2))
        inverse = jnp.stack([jnp.stack([d, -b]), jnp.stack([-c, a])]) / (a * d - b * c)
        linear = jnp.moveaxis(v[:8, 1:], 1, 0)
        follow = jnp.stack(
            [inverse[i, 0] * linear[0] + inverse[i, 1] * linear[1] for i in (0, 1)]
        )
        half = coupling - 0.5 * jnp.stack(
            [centre[i, 0] * follow[0] + centre[i, 1] * follow[1] for i in (0, 1)]
        )
        mean = v[:8, 0]
        weighted = penalty * mean

        def block(i: int, j: int, outer: Array) -> Array:
            total = outer[:8, :8] + weighted[:, None, i] * mean[None, :, j]
            for e in range(2):
                total = total - follow[e, :, None, i] * half[e, None, :, j]
                total = total - half[e, :, None, i] * follow[e, None, :, j]
            return total

        blocks = [
            [block(0, 0, xx), block(0, 1, xy)],
            [block(1, 0, jnp.swapaxes(xy, 0, 1)), block(1, 1, yy)],
        ]
        full = jnp.stack([jnp.stack(row, 2) for row in blocks], 1)
        return cls(full, mean, follow, coupling, centre, inverse, penalty)

    def reduced(self, force: Array, pressure: Array) -> tuple[Array, Array]:
        """What the elimination does to right-hand sides.

        `force`: right-hand sides of the centres [component, right, layer, element, lane].
        `pressure`: those of the pressures [mode, right, ...].
        Returns the centres' displacements while the outer nodes are held, and what the outer
        nodes' equations lose [node, component, right, ...].
        """
        fixed = _dot(self.inverse[:, :, None], pressure[1:])
        held = force - _dot(self.centre[:, :, None], fixed)
        change = (
            sum(
                self.coupling[i][:, :, None] * fixed[i] + self.follow[i][:, :, None] * held[i]
                for i in range(2)
            )
            - (self.penalty * self.mean)[:, :, None] * pressure[0]
        )
        return fixed, change

    def recovered(self, outer: Array, fixed: Array, force: Array) -> tuple[Array, Array]:
        """What was eliminated: displacements of the centres, and linear pressures.

        `outer`: displacements of the outer nodes [node, component, right, ...]. `fixed`: see
        `reduced`. `force`: right-hand sides of the centres.
        """
        centre = fixed - jnp.stack(
            [jnp.sum(w[:, :, None] * outer, (0, 1)) for w in self.follow]
        )
        left_over = force - _dot(self.centre[:, :, None], centre)
        left_over = left_over - jnp.stack(
            [jnp.sum(c[:, :, None] * outer, (0, 1)) for c in self.coupling]
        )
        linear = _dot(jnp.swapaxes(self.inverse, 0, 1)[:, :, None], left_over)
        return centre, linear


def _dot(a: Array, b: Array) -> Array:
    """Sum over the two entries of the second axis of a and the first of b."""
    return a[:, 0] * b[0] + a[:, 1] * b[1]
