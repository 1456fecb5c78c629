"""What moves with a section: its force on the membrane, and that force's derivative.

The flows of film, membrane and water are linear in the velocities of the unknowns
(`suas_jax.dynamics.inertia`): v = Y dq/dt. Their momentum and the film's friction act through
the transposed of Y. The oil's own acceleration is that of what flows, v dv/ds included.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.dynamics.inertia import THINNEST_FILM, Densities, Flow, flow_of, weights_of
from suas_jax.dynamics.motion import Near, Sampling
from suas_jax.numerics.array_types import StationVector


class MovingSection(NamedTuple):
    """What moves with a section close to a state."""

    at: Near  # faces and film there
    sampling: Sampling  # of the membrane
    given: Densities  # densities and viscosity

    @property
    def still(self) -> Flow:
        """Of a section at rest."""
        return flow_of(self.at.at, self.at.push(0 * self.at.q), self.sampling.water)

    def force(
        self,
        q: StationVector,  # unknowns
        velocity: StationVector,  # of them
        before: Flow,  # that a rate adds to
        length: Array,  # for so long [s]
    ) -> tuple[StationVector, Flow, Flow]:
        """Force on the unknowns, the flow and its rate."""
        at, given = self.at.outline(q), self.given

        def moved(velocity: Array) -> Flow:
            return flow_of(at, self.at.push(velocity), self.sampling.water)

        flow = moved(velocity)
        flow = flow._replace(film=flow.film / at.film)
        rate = jax.tree.map(lambda a, b: (a - b) / length, flow, before)
        weights = weights_of(at, self.sampling.section, self.sampling.water, given)
        pulls = jax.tree.map(jnp.multiply, weights.mass, rate)
        speed = jnp.pad(flow.film, 1) ** 2
        carried = given.oil / 2 * jnp.diff((speed[1:] + speed[:-1]) / 2)
        film = at.film * (pulls.film + weights.damping * flow.film) + carried
        (own,) = jax.linear_transpose(moved, velocity)(pulls._replace(film=film))
        return own, flow, rate

    def stiffness(
        self, velocity: StationVector, length: Array, free: np.ndarray
    ) -> Float[Array, "unknown unknown"]:
        """Derivative of the force by the free unknowns, where these change for some time."""
        near = self.at
        moved = near.by_unknowns(free)
        weights = weights_of(near.at, self.sampling.section, self.sampling.water, self.given)
        flow = flow_of(near.at, jnp.moveaxis(moved, 0, -1), self.sampling.water)
        passing = flow_of(near.at, near.push(velocity), self.sampling.water).film
        film = near.at.film
        closes = jnp.where(near.at.gap > THINNEST_FILM, near.closing(moved), 0.0).T
        closes = (closes[1:] + closes[:-1]) / 2
        by_flow = weights.mass.film / length**2 + weights.damping / length
        by_film = -(weights.mass.film / length + 3 * weights.damping) * passing / film
        rows = by_flow[:, None] * flow.film + by_film[:, None] * closes
        # All three faces: their rotation is part of the mass that short steps balance.
        own = flow.membrane.reshape(-1, len(free))
        mass = (weights.mass.membrane / length**2).reshape(-1, 1)
        water = (weights.mass.water / length**2)[:, None] * flow.water
        matrix: Array = flow.film.T @ rows + flow.water.T @ water
        return matrix + own.T @ (mass * own)
