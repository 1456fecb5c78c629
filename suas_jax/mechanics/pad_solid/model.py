"""The pad's solid as a model that scenes can ask for."""

import math
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from suas_jax.config import SceneSpec
from suas_jax.mechanics.model import Counts
from suas_jax.mechanics.pad.model import PadModel, planned
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.pad_solid.solid import PadSolid
from suas_jax.mechanics.pad_solid.thickness import levels, shapes_at
from suas_jax.mesh.pad_plan import ElementSizes, PadPlan

_MOST_DEGREES = 4
_MOST_ELEMENTS = 96  # along either direction
_FINER = 1.4
# Fields at clamps and at edges of loads fade over a thickness; thin membranes have no
# elements that small, and hardly feel these fields.
_SIZES = ElementSizes(edge=0.15, load=0.2, largest=1.2, growth=0.35)
_LOOSE = 2e-3  # tolerances up to which quadratic polynomials don't do


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
