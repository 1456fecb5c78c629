"""Round contacts on a pad to sensor output: the forward model in three dimensions.

::

    config  -> geometry, law, oil, electrodes        `pad_skin_of`, once a pad
    patches -> a mesh graded around them             `PadSkin.meshes`
            -> equilibrium -> gap -> capacitance -> SO        `pad_forward`

Meshes of one size differ in numbers alone, so one compiled program serves contacts anywhere.
States carry the first-order effect of transverse shear, which the thin shell leaves out.
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from suas_jax.config import SkinSpec
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import corrected, corrected_contact
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.equilibrium.validity import kept_in_domain
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mesh.pad_plan import Footprint, PadPlan, plan_pad
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.precision import require_float64
from suas_jax.scene.error_estimate import bounded
from suas_jax.scene.forward import SensorOutput, known_inputs
from suas_jax.scene.parts import skin_parts
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.sensing.taxels import check_taxels
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.pad_loads import PadLoad
from suas_jax.skin.prestress import ContainedOil
from suas_jax.skin.wall import Wall

ELEMENTS = (24, 20)
"""Elements of a pad's mesh along the arc and along the axis, unless told otherwise."""
# Points of a disc along its radius and around it: exact to what the elements resolve.
_DISC = (4, 12)


class Patches(eqx.Module):
    """Forces, each even over a disc of the undeformed outer face; radial unless told otherwise.

    A lane axis holds cases side by side; one case needs none.

    Attributes:
        angle: of the centres, from the symmetry axis [rad].
        axial: of the centres, from the middle of the pad [m].
        force: inwards [N].
        diameter: of the discs [m].
        turn: counter-clockwise rotation of the forces from the inward radial in the section's
            plane [rad]; None for none.
        tilt: of the forces out of that plane towards +axial [rad]; None for none.
    """

    angle: Float[Array, "patch *lane"]
    axial: Float[Array, "patch *lane"]
    force: Float[Array, "patch *lane"]
    diameter: Float[Array, "patch *lane"]
    turn: Float[Array, "patch *lane"] | None = None
    tilt: Float[Array, "patch *lane"] | None = None

    @classmethod
    def poke(
        cls, angle: ArrayLike, axial: ArrayLike, force: ArrayLike, diameter: ArrayLike
    ) -> "Patches":
        """One patch a lane; each number is one for all lanes, or one a lane.

        Args:
            angle: [rad].
            axial: [m].
            force: [N].
            diameter: [m].

        Raises:
            Float64Error: float64 is off.
        """
        require_float64()
        columns = [
            jnp.atleast_1d(jnp.asarray(x, float)) for x in (angle, axial, force, diameter)
        ]
        return cls(*(x[None] for x in jnp.broadcast_arrays(*columns)))


class PadReadings(NamedTuple):
    """What a pad says about its contacts; a leading axis over load levels where there are.

    Attributes:
        so: continuous sensor output [counts]; NaN where the membrane touches the electrode.
        pressure: of the oil, above ambient [Pa].
        min_gap: smallest between membrane and wall [m].
        found: whether the equilibrium was found.
    """

    so: Float[Array, "*level taxel"]
    pressure: Float[Array, "*level"]
    min_gap: Float[Array, "*level"]
    found: Bool[Array, "*level"]


class PadSkin(eqx.Module):
    """A pad: everything but its loads, differentiable in every array.

    Attributes:
        geometry: dimensions.
        law: the membrane's material.
        oil: how the oil answers.
        electrodes: taxels and converter's scale.
        wall: what holds the membrane; None where it passes through.
        elements: of its meshes, along the arc and along the axis.
    """

    geometry: SkinGeometry
    law: AbstractLaw
    oil: AbstractOil
    electrodes: Electrodes
    wall: Wall | None = None
    elements: tuple[int, int] = eqx.field(static=True, default=ELEMENTS)

    @property
    def prestressed(self) -> bool:
        """Whether rest is another state than the undeformed one."""
        return self.geometry.growth is not None or isinstance(self.oil, ContainedOil)

    def plan(self, patches: Patches, slots: int | None = None) -> PadPlan:
        """A mesh graded around contacts; every such mesh serves the same compiled program.

        Args:
            patches: with known numbers.
            slots: patches that the problem will have, if more.
        """
        g = self.geometry
        outer = float(g.outer_size[0])
        columns = (patches.angle, patches.axial, patches.diameter)
        footprints = [
            Footprint(float(a), float(z), float(d) / 2 / outer, float(d) / 2, True)
            for a, z, d in zip(*(np.asarray(x) for x in columns), strict=True)
        ]
        sizes = (g.half_angle, g.width, g.mid_size, g.thickness)
        half, width, radius, thickness = (float(x[0]) for x in sizes)
        plan = plan_pad(half, width, radius, thickness, footprints, elements=self.elements)
        count = slots or len(footprints)
        return dataclasses.replace(plan, spread=(_DISC,) * count, discs=(True,) * count)

    def meshes(self, patches: Patches) -> PadPlan:
        """The meshes of cases in lanes, each graded around its own contacts, for `pad_forward`.

        Args:
            patches: with known numbers, in lanes.
        """
        count = patches.force.shape[1]
        lanes = [jax.tree.map(lambda x, i=i: x[:, i], patches) for i in range(count)]
        return jax.tree.map(lambda *x: np.stack(x), *(self.plan(lane) for lane in lanes))

    def problem(self, patches: Patches, plan: PadPlan) -> Problem:
        """The discrete problem of some contacts on a mesh."""
        pad = Pad.build(self.geometry, self.law, plan, self.loads(patches))
        return Problem(pad.with_wall(self.wall), self.oil, jnp.zeros(1))

    def loads(self, patches: Patches) -> list[PadLoad]:
        """Contacts as the mechanics takes them."""
        zero = jnp.zeros_like(patches.angle)
        turn = zero if patches.turn is None else patches.turn
        tilt = zero if patches.tilt is None else patches.tilt
        numbers = (patches.angle, patches.axial, patches.force, turn, tilt, patches.diameter)
        return [
            PadLoad(a[None], z[None], f[None], t[None], i[None], diameter=d[None])
            for a, z, f, t, i, d in zip(*numbers, strict=True)
        ]


def pad_skin_of(
    spec: SkinSpec,
    inputs: Mapping[str, ArrayLike] | None = None,
    *,
    elements: tuple[int, int] = ELEMENTS,
    contact: bool = True,
) -> PadSkin:
    """Build a pad from its specification.

    Args:
        spec: a skin with clamped ends and [electrodes].
        inputs: SI values by TOML path that replace the specification's own.
        elements: of its meshes.
        contact: whether the wall holds the membrane, if the specification says so.

    Raises:
        ValueError: the skin has no electrodes, is one in plane strain, or a path is none of
            its inputs.
        Float64Error: float64 is off.
    """
    require_float64()
    if spec.geometry.dimension != 3:
        raise ValueError('a pad needs geometry.ends = "clamped"; this skin is in plane strain')
    if spec.electrodes is not None:
        check_taxels(spec.electrodes, spec.geometry)
    parts = skin_parts(spec, known_inputs(spec, inputs))
    wall = parts.wall if contact else None
    return PadSkin(parts.geometry, parts.law, parts.oil, parts.sensing(), wall, elements)


def pad_forward(
    skin: PadSkin, patches: Patches, meshes: PadPlan, start: State | None = None
) -> SensorOutput:
    """Contacts to sensor output, any number of cases at once.

    Differentiable by every array of the skin and of the patches, in forward and reverse
    mode, through the implicit derivative of the equilibrium and of what transverse shear
    adds to it. Called with numbers it runs a compiled program, kept between runs: one serves
    contacts anywhere, as many at once and as many lanes. A case that doesn't converge is
    named in `result`; nothing is raised.

    Args:
        skin: the pad.
        patches: what acts on it, with a lane axis.
        meshes: one a lane, `PadSkin.meshes`.
        start: state of a neighbouring equilibrium on the same mesh in every lane, such as
            the last frame's; without it the solution starts from rest.

    Raises:
        Float64Error: float64 is off.
    """
    require_float64()
    output: SensorOutput = COMPILED.run_or_trace(_pad_forward, skin, patches, meshes, start)
    return output


@eqx.filter_jit
def _pad_forward(
    skin: PadSkin, patches: Patches, meshes: PadPlan, start: State | None
) -> SensorOutput:
    def one(arguments: tuple[Patches, PadPlan, State | None]) -> SensorOutput:
        patches, plan, start = arguments
        start = jax.tree.map(lambda x: x[..., None], start)
        output = _solve(skin, patches, plan, start)
        return jax.tree.map(lambda x: x[..., 0], output)

    of_cases = jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), (patches, start))
    outputs = jax.lax.map(one, (of_cases[0], meshes, of_cases[1]))
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), outputs)


def _solve(
    skin: PadSkin, patches: Patches, plan: PadPlan, start: State | None = None
) -> SensorOutput:
    """One case."""
    problem = skin.problem(patches, plan)
    found = equilibrium(problem, start, wall_on_demand=True)
    root, shown, pad = corrected(problem, found.state)
    gap = pad.shape(shown.q).smallest_gap(skin.geometry).value
    force = jnp.zeros_like(gap)
    if skin.wall is not None:
        contact = corrected_contact(pad, shown, root)
        force = jnp.sum(contact.area * contact.pressure, (0, 1))
    readings = skin.electrodes.read(pad, shown.q)
    result = kept_in_domain(pad, shown.q, found.result)
    trust = bounded(problem, root, shown, result)
    return SensorOutput(readings, shown.pressure, force, gap, root, *trust)


def read(skin: PadSkin, problem: Problem, state: State, found: Array) -> PadReadings:
    """The readings of a state in one lane."""
    so = skin.electrodes.read(problem.mechanics, state.q).so[..., 0]
    gap = problem.mechanics.shape(state.q).smallest_gap(skin.geometry).value
    outcome = kept_in_domain(problem.mechanics, state.q, (~found).astype(jnp.int32))
    return PadReadings(so, state.pressure[0], gap[0], outcome[0] == 0)


def readings(skin: PadSkin, patches: Patches, plan: PadPlan) -> PadReadings:
    """Readings of contacts, solved from rest.

    Args:
        skin: the pad.
        patches: the contacts; those without a force change nothing.
        plan: the mesh.
    """
    output = _solve(skin, patches, plan)
    so, pressure, gap = output.so[..., 0], output.oil_pressure[0], output.min_gap[0]
    result = output.result[0]
    found = (result == 0) | (result == index_of("beyond_model"))  # as in a table of states
    return PadReadings(so, pressure, gap, found)
