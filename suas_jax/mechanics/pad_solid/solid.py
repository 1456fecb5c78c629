"""The whole pad as a solid: total-Lagrangian, incompressible, in three dimensions.

Cubic B-splines along arc and axis, polynomials through the thickness; the pressure that keeps
the volume is of one degree less through the thickness and of the same splines, without slope
at clamps. The undeformed membrane is exact. As many degrees as an error asks for lead from a
shell that shears and thins to the continuum.
"""

import dataclasses
from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np

from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.pad_solid.lane import SolidLane
from suas_jax.mechanics.pad_solid.thickness import levels, shapes_at
from suas_jax.numerics.array_types import Lanes, StationVector


class PadSolid(Pad):
    """Discretised continuum, or the half or quarter of a symmetric one."""

    corrected: ClassVar[bool] = False
    # observed on a patch at the crown against meshes of twice the elements
    error_shares: ClassVar[tuple[float, ...]] = (0.03, 0.15)

    def one_lane(self) -> SolidLane:
        """See the base class."""
        return SolidLane(self._lane_parts())

    def displacement_size(self, q: StationVector) -> Lanes:
        """Largest component of a control value's displacement [m]."""
        x = self.topology.by_direction(q)[:, :, : 3 * self.topology.vectors]
        return jnp.max(jnp.abs(x), (0, 1, 2))

    def potential(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Lanes:
        """The mixed potential, multipliers included; see the base class."""
        held, more, work = self._energies(q)
        return held + self.contact_energy(q, factor) - pressure * more - factor * work

    def with_more_fibres(self) -> Self:
        """The same: a solid is not a sum over fibres."""
        return self

    def omitted_gradient(self, q: StationVector, factor: Lanes) -> None:
        """Nothing is left out."""
        del q, factor

    def to_comparison_mesh(self, q: StationVector, counts: tuple[int, ...]) -> StationVector:
        """On pairs of elements joined, or with a degree less; see the base class."""
        if counts[2] == self.degree:
            return self._on_other_elements(q, finer=False)
        topology, degree = self.topology, self.degree - 1
        x = topology.by_direction(q)
        moved = x[:, :, : 3 * topology.vectors]
        moved = moved.reshape(*x.shape[:2], topology.vectors, 3, -1)
        # Least squares over the levels: faces of the lower degree keep close to their places.
        table = np.linalg.pinv(shapes_at(degree, levels(self.degree)).T)
        moved = jnp.einsum("wv,azvcl->azwcl", table, moved)
        moved = moved.reshape(*x.shape[:2], 3 * (degree + 1), -1)
        pressure = x[:, :, 3 * topology.vectors : -1]
        lower = dataclasses.replace(topology, degree=degree)
        return lower.to_stations(jnp.concatenate([moved, pressure], 2))

    @property
    def degree(self) -> int:
        """Of the displacement through the thickness."""
        assert self.topology.degree is not None
        return self.topology.degree
