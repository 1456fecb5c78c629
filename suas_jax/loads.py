"""What acts on the membrane from outside."""

import equinox as eqx
from jaxtyping import Array, Float


class LoadPoints(eqx.Module):
    """Dead forces at points of the outer face, the form every mechanics takes loads in.

    Attributes:
        select: one where a point lies in an element, else zero.
        xi: local coordinate in that element, 0 to 1.
        force: Cartesian components per width [N/m].
    """

    select: Float[Array, "element point #lane"]
    xi: Float[Array, "point #lane"]
    force: Float[Array, "2 point #lane"]
