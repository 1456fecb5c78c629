"""Lines and arcs with common tangents."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.config.sections.path import PathSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.charted import AbstractCurve


class Path(AbstractCurve):
    """Pieces of given length and turn, by arc length; the clamps lie at y = 0 on average."""

    length: Float[Array, "piece lane"]  # of each piece [m]
    turn: Float[Array, "piece lane"]  # clockwise, over each piece [rad]
    start: Lanes  # direction of the first piece, counter-clockwise from +x [rad]
    # whether the right half is the mirror image of the left one
    mirrored: bool = eqx.field(static=True, default=False)

    @property
    def symmetric(self) -> bool:
        """See the base class."""
        return self.mirrored

    @classmethod
    def of(cls, spec: PathSpec, value: Callable[[str], Lanes]) -> "Path":
        """See the base class."""
        length, turn = [], []
        for k, piece in enumerate(spec.path):
            if piece.line is not None:
                length.append(value(f"path.{k}.line"))
                turn.append(jnp.zeros_like(length[-1]))
            else:
                turn.append(value(f"path.{k}.angle"))
                length.append(value(f"path.{k}.radius") * jnp.abs(turn[-1]))
        if spec.mirror:
            length, turn = length + length[::-1], turn + turn[::-1]
        sizes, turns = (jnp.stack(jnp.broadcast_arrays(*x)) for x in (length, turn))
        return cls(sizes, turns, value("start"), spec.mirror)

    @property
    def kinks(self) -> tuple[int, ...]:
        """Where pieces meet; at a mirrored crown a piece meets itself."""
        count = self.length.shape[0]
        crown = count // 2 if self.mirrored else 0
        return tuple(k for k in range(1, count) if k != crown)

    def edges(self) -> Float[Array, "edge lane"]:
        """Arc lengths of the ends of the pieces [m]."""
        return jnp.concatenate([jnp.zeros_like(self.length[:1]), jnp.cumsum(self.length, 0)])

    def position(self, parameter: Array, interval: Array) -> Float[Array, "2 *shape"]:
        """See the base class."""
        first = self.edges()[:-1]
        heading = jnp.cumsum(self.turn, 0) - self.turn - self.start
        steps = _chord(self.length, heading, self.turn)
        ends = jnp.cumsum(steps, 1)
        origin = (ends - steps) - ends[:, -1:] / 2
        piece = interval[..., 0]
        along = parameter - first[piece]
        turn = self.turn[piece] * along / self.length[piece]
        return origin[:, piece] + _chord(along, heading[piece], turn)


def _chord(length: Array, heading: Array, turn: Array) -> Float[Array, "2 *shape"]:
    """From the beginning of an arc to its end: along the mean direction."""
    size = length * jnp.sinc(turn / (2 * np.pi))
    middle = heading + turn / 2
    return size * jnp.stack([jnp.cos(middle), -jnp.sin(middle)])
