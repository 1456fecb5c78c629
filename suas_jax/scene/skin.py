"""A skin as differentiable arrays: a section in plane strain, or a pad in three dimensions.

A `Skin` is made once, for loads anywhere. A section has one even mesh: loads slide from element
to element, so one program serves them all. A pad has a mesh graded around its loads
(`Skin.around`); those of one size differ in numbers alone.
"""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.config.inputs import check_inputs
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.balance import Problem
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.mesh.pad_plan import Footprint, PadPlan, plan_pad
from suas_jax.runtime.compiled import require_float64
from suas_jax.scene.loads import Loads
from suas_jax.scene.parts import skin_parts
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.sensing.taxels import check_taxels
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.prestress import ContainedOil
from suas_jax.skin.wall import Wall

ELEMENTS = 32
"""Elements of a section's mesh along the whole arc, unless told otherwise."""
PAD_ELEMENTS = (24, 20)
"""Elements of a pad's mesh along the arc and along the axis, unless told otherwise."""
# Points of a disc along its radius and around it: exact to what the elements resolve.
_DISC = (4, 12)


class Skin(eqx.Module):
    """A skin: everything but its loads, differentiable in every array.

    Attributes:
        geometry: dimensions.
        law: the membrane's material.
        oil: how the oil answers.
        electrodes: taxels and converter's scale.
        wall: what holds the membrane; None where it passes through.
        elements: of a section's even mesh along the whole arc; or two numbers, of a pad's
            mesh along the arc and along the axis.
        mesh: of a pad, its breakpoints with a lane axis, see `around`; None of a section, and
            of a pad whose mesh `forward` is to make.
    """

    geometry: SkinGeometry
    law: AbstractLaw
    oil: AbstractOil
    electrodes: Electrodes
    wall: Wall | None = None
    elements: int | tuple[int, int] = eqx.field(static=True, default=ELEMENTS)
    mesh: PadPlan | None = None

    @property
    def is_pad(self) -> bool:
        """Whether it is solved in three dimensions."""
        return isinstance(self.elements, tuple)

    @property
    def prestressed(self) -> bool:
        """Whether rest is another state than the undeformed one."""
        return self.geometry.growth is not None or isinstance(self.oil, ContainedOil)

    def around(self, loads: Loads) -> "Skin":
        """The pad with meshes graded around its loads, one a lane; a section as it is.

        Raises ValueError: a pad's dimensions or its loads' places are traced.
        """
        if not isinstance(self.elements, tuple):
            return self
        g = self.geometry
        sizes = (g.half_angle, g.width, g.mid_size, g.thickness, g.outer_size)
        places = loads.discs()
        if any(isinstance(x, jax.core.Tracer) for x in (*sizes, *places)):
            raise ValueError(
                "the mesh of a pad is made from known numbers: make it before derivatives are "
                "taken or programs compiled, by `skin.around(loads)`, and give it to "
                "`skin_of(..., mesh=skin.mesh)` where the skin itself is traced"
            )
        half, width, mid, thickness, outer = (float(np.asarray(x)[0]) for x in sizes)
        columns = np.broadcast_arrays(*(np.asarray(x) for x in places))
        plans = [
            plan_pad(
                half,
                width,
                mid,
                thickness,
                [Footprint(a, z, d / 2 / outer, d / 2, True) for a, z, d in rows.T.tolist()],
                elements=self.elements,
            )
            for rows in np.moveaxis(np.stack(columns), -1, 0)
        ]
        mesh: PadPlan = jax.tree.map(lambda *x: np.stack(x, -1), *plans)
        count = len(columns[0])
        mesh = dataclasses.replace(mesh, spread=(_DISC,) * count, discs=(True,) * count)
        return dataclasses.replace(self, mesh=mesh)

    def problem(self, loads: Loads) -> Problem:
        """The discrete problem of some loads, which a pad needs a mesh for.

        Args:
            loads: in lanes; on one mesh of a pad.

        Raises:
            ValueError: line loads on a pad, or patches on a section.
        """
        if isinstance(self.elements, int):
            angles = jnp.linspace(-1, 1, self.elements + 1)[:, None] * self.geometry.half_angle
            points = loads.points(angles, self.geometry)
            shell = Shell.build(
                self.geometry, self.law, angles, points, symmetric=False, wall=self.wall
            )
            return Problem(shell, self.oil, loads.external_pressure)
        assert self.mesh is not None, "a pad without a mesh: take `skin.around(loads)`"
        plan = jax.tree.map(lambda x: x[..., 0], self.mesh)
        pad = Pad.build(self.geometry, self.law, plan, loads.patches())
        return Problem(pad.with_wall(self.wall), self.oil, loads.external_pressure)


def skin_of(
    spec: SkinSpec,
    inputs: Mapping[str, ArrayLike] | None = None,
    *,
    elements: int | tuple[int, int] | None = None,
    contact: bool = True,
    mesh: PadPlan | None = None,
) -> Skin:
    """Build a skin from its specification.

    Args:
        spec: a skin, or a scene, with [electrodes]; a pad where its ends are clamped.
        inputs: SI values by TOML path (see `continuous_inputs`) that replace the
            specification's own: pass traced numbers here to differentiate by them.
        elements: of the mesh, see `Skin`; None for `ELEMENTS` or `PAD_ELEMENTS`.
        contact: whether the wall holds the membrane, if the specification says so. Without
            it programs compile in half the time; `Readings.touching` still names states at the
            wall.
        mesh: of a pad, see `Skin.around`.

    Raises:
        ConfigError: the section is impossible, or a taxel lies off it.
        ValueError: the skin has no electrodes, a path is none of its inputs, or elements are
            those of the other kind of skin.
        Float64Error: float64 is off.
    """
    require_float64()
    is_pad = spec.geometry.dimension == 3
    if elements is None:
        elements = PAD_ELEMENTS if is_pad else ELEMENTS
    if isinstance(elements, tuple) != is_pad:
        raise ValueError(
            f"elements = {elements}: a section (plane strain) takes one number, a pad "
            "(clamped ends) two, along the arc and along the axis"
        )
    if spec.electrodes is not None:
        check_taxels(spec.electrodes, spec.geometry)
    parts = skin_parts(spec, _inputs(spec, inputs))
    wall = parts.wall if contact else None
    return Skin(parts.geometry, parts.law, parts.oil, parts.sensing(), wall, elements, mesh)


def _inputs(spec: SkinSpec, inputs: Mapping[str, ArrayLike] | None) -> dict[str, ArrayLike]:
    """A skin's numbers by TOML path, some of them replaced."""
    own: dict[str, ArrayLike] = dict(continuous_inputs(spec))
    check_inputs(inputs or (), own, "skin")
    return {**own, **(inputs or {})}
