"""The whole pad as a solid, as a model that scenes can ask for.

Total-Lagrangian, incompressible, in three dimensions: cubic B-splines along arc and axis,
polynomials through the thickness; the pressure that keeps the volume is of one degree less
through the thickness and of the same splines, without slope at clamps. The undeformed membrane
is exact. As many degrees as an error asks for lead from a shell that shears and thins to the
continuum.
"""

import dataclasses
import math
from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from suas_jax.config import SceneSpec
from suas_jax.mechanics.model import Counts
from suas_jax.mechanics.pad.model import PadModel, planned
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.pad_solid.lane import SolidLane
from suas_jax.mechanics.pad_solid.points import levels, shapes_at
from suas_jax.mesh.pad_plan import ElementSizes, PadPlan
from suas_jax.numerics.array_types import Lanes, StationVector

_MOST_DEGREES = 4
_MOST_ELEMENTS = 96  # along either direction
_FINER = 1.4
# Fields at clamps and at edges of loads fade over a thickness; thin membranes have no
# elements that small, and hardly feel these fields.
_SIZES = ElementSizes(edge=0.15, load=0.2, largest=1.2, growth=0.35)
_LOOSE = 2e-3  # tolerances up to which quadratic polynomials don't do


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


class PadSolidModel(PadModel):
    """A continuum of cubic splines and polynomials through the thickness."""

    name: ClassVar[str] = "solid"
    setting: ClassVar[str] = "mesh"
    mechanics: ClassVar[type[Pad]] = PadSolid
    for_curves: ClassVar[bool] = False

    def first(self, scene: SceneSpec) -> Counts:
        """Elements as short as the thickness at clamps and loads; of a cubic at strict rtol."""
        arc, axial = planned(scene, None, (False, False), sizes=_SIZES).elements
        return arc, axial, 2 if scene.rtol > _LOOSE else 3

    def _planned(
        self, scene: SceneSpec, elements: tuple[int, int], mirrored: tuple[bool, bool]
    ) -> PadPlan:
        """Pairs of elements that a comparison mesh joins."""
        pairs = elements[0] // 2, elements[1] // 2
        return planned(scene, pairs, mirrored, sizes=_SIZES).refined()

    def finer(self, counts: Counts, excess: tuple[float, ...]) -> Counts | None:
        """More elements, or another degree, as the comparison meshes tell."""
        *elements, degree = counts
        along, across = excess if len(excess) == 2 else 2 * (sum(excess) / 2,)
        if across > along and degree < _MOST_DEGREES:
            degree += 1
        elif max(elements) < _MOST_ELEMENTS:
            elements = [4 * math.ceil(_FINER * n / 4) for n in elements]
        else:
            return None
        return (*elements, degree)

    def coarser(self, counts: Counts) -> Counts:
        """Two thirds of the elements, in fours; see the base class."""
        return *(max(8, 4 * (n // 6)) for n in counts[:2]), counts[2]

    def _through(
        self, old: int | None, new: int | None
    ) -> Float[np.ndarray, "old_width new_width"]:
        """Displacements at other levels, pressures with more modes; see the base class."""
        assert old is not None
        assert new is not None
        moved = np.kron(shapes_at(old, levels(new)), np.eye(3))
        return block_diag(moved, np.eye(old, new))


PAD_SOLID = PadSolidModel()
