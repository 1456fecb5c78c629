"""Round contacts on a pad to sensor output: the forward model in three dimensions.

::

    patches -> a mesh graded around them                       `PadSkin.plan`
            -> equilibrium, and what transverse shear adds     `readings_along`, `readings`

Meshes of one size differ in numbers alone, so one compiled program serves contacts anywhere.
States carry the first-order effect of transverse shear, which the thin shell leaves out.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.balance import Problem, State, border_of, residual
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mesh.pad_plan import Footprint, PadPlan, plan_pad
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bordered_solve import BorderedVector, eliminate
from suas_jax.runtime.precision import require_float64
from suas_jax.scene.parts import skin_parts
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.pad_loads import PadLoad

ELEMENTS = (24, 20)
"""Elements of a pad's mesh along the arc and along the axis, unless told otherwise."""
# Points of a disc along its radius and around it: exact to what the elements resolve.
_DISC = (4, 12)
# Displacement by the last Newton correction before the shear is added, relative.
_CLOSE = 1e-2
_MOST_CORRECTIONS = 12


class Patches(eqx.Module):
    """Radial forces, each even over a disc of the undeformed outer face.

    Attributes:
        angle: of the centres, from the symmetry axis [rad].
        axial: of the centres, from the middle of the pad [m].
        force: inwards [N].
        diameter: of the discs [m].
    """

    angle: Float[Array, " patch"]
    axial: Float[Array, " patch"]
    force: Float[Array, " patch"]
    diameter: Float[Array, " patch"]


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
        elements: of its meshes, along the arc and along the axis.
    """

    geometry: SkinGeometry
    law: AbstractLaw
    oil: AbstractOil
    electrodes: Electrodes
    elements: tuple[int, int] = eqx.field(static=True, default=ELEMENTS)

    def plan(self, patches: Patches, slots: int | None = None) -> PadPlan:
        """A mesh graded around contacts; every such mesh serves the same compiled program.

        Args:
            patches: with known numbers.
            slots: patches that the problem will have, if more.
        """
        g = self.geometry
        outer = float(g.outer_radius[0])
        columns = (patches.angle, patches.axial, patches.diameter)
        footprints = [
            Footprint(float(a), float(z), float(d) / 2 / outer, float(d) / 2, True)
            for a, z, d in zip(*(np.asarray(x) for x in columns), strict=True)
        ]
        sizes = (g.half_angle, g.width, g.mid_radius, g.thickness)
        half, width, radius, thickness = (float(x[0]) for x in sizes)
        plan = plan_pad(half, width, radius, thickness, footprints, elements=self.elements)
        count = slots or len(footprints)
        return dataclasses.replace(plan, spread=(_DISC,) * count, discs=(True,) * count)

    def problem(self, patches: Patches, plan: PadPlan) -> Problem:
        """The discrete problem of some contacts on a mesh."""
        pad = Pad.build(self.geometry, self.law, plan, self.loads(patches))
        return Problem(pad, self.oil, jnp.zeros(1))

    def loads(self, patches: Patches) -> list[PadLoad]:
        """Contacts as the mechanics takes them."""
        zero = jnp.zeros(1)
        return [
            PadLoad(a[None], z[None], f[None], zero, zero, diameter=d[None])
            for a, z, f, d in zip(
                patches.angle, patches.axial, patches.force, patches.diameter, strict=True
            )
        ]


def pad_skin_of(
    spec: SkinSpec,
    inputs: Mapping[str, ArrayLike] | None = None,
    *,
    elements: tuple[int, int] = ELEMENTS,
) -> PadSkin:
    """Build a pad from its specification.

    Args:
        spec: a skin with clamped ends and [electrodes].
        inputs: SI values by TOML path that replace the specification's own.
        elements: of its meshes.

    Raises:
        ValueError: the skin has no electrodes, or is one in plane strain.
        Float64Error: float64 is off.
    """
    require_float64()
    if spec.geometry.dimension != 3:
        raise ValueError('a pad needs geometry.ends = "clamped"; this skin is in plane strain')
    parts = skin_parts(spec, {**continuous_inputs(spec), **(inputs or {})})
    return PadSkin(parts.geometry, parts.law, parts.oil, parts.sensing(), elements)


def with_shear(
    problem: Problem, y: BorderedVector, level: Lanes
) -> tuple[State, BorderedVector, Bool[Array, " lane"]]:
    """Newton's method from a state nearby, and the first-order effect of the omitted energy.

    The last correction's factors serve the omitted energy, too.

    Args:
        problem: membrane, oil and loads; one lane.
        y: a state near the equilibrium.
        level: factor on the loads.

    Returns:
        The state with what the shell leaves out, the shell's own, and whether it was found.
    """
    mechanics = problem.mechanics

    def omitted(y: BorderedVector) -> Array:
        found = mechanics.omitted_gradient(y.stations)
        return jnp.zeros_like(y.stations) if found is None else found

    def body(carry: tuple[Any, ...]) -> tuple[Any, ...]:
        y, _, last, count, _ = carry
        r, operator = residual(problem, y, level)
        more = jax.lax.cond(jnp.all(last), omitted, lambda y: jnp.zeros_like(y.stations), y)
        border = None if r.border is None else jnp.zeros_like(r.border)
        both = jax.tree.map(lambda *x: jnp.stack(x), r, BorderedVector(more, border))
        solved = jax.vmap(lambda right: eliminate(operator, right).solution)(both)
        first, second = (jax.tree.map(lambda x, i=i: x[i], solved) for i in (0, 1))
        new = jax.tree.map(lambda a, b: a - b, y, first)
        size = mechanics.displacement_size(first.stations)
        scale = mechanics.displacement_size(new.stations)
        close = size <= _CLOSE * scale
        changed = jax.tree.map(jnp.add, new, second)
        return new, changed, close, count + 1, last & close

    def going(carry: tuple[Any, ...]) -> Array:
        _, _, _, count, done = carry
        return ~jnp.all(done) & (count < _MOST_CORRECTIONS)

    no = jnp.zeros(y.stations.shape[-1:], bool)
    y, changed, _, _, done = jax.lax.while_loop(going, body, (y, y, no, jnp.array(0), no))
    state = State(changed.stations, border_of(changed), level)
    return state, y, done & jnp.all(jnp.isfinite(changed.stations), (0, 1))


def _read(skin: PadSkin, problem: Problem, state: State, found: Array) -> PadReadings:
    so = skin.electrodes.read(problem.mechanics, state.q).so[..., 0]
    gap = problem.mechanics.shape(state.q).smallest_gap(skin.geometry).value
    return PadReadings(so, state.pressure[0], gap[0], found[0])


def readings_along(
    skin: PadSkin,
    patches: Patches,
    plan: PadPlan,
    levels: Float[Array, " level"],
    weights: Float[Array, "level level"],
) -> PadReadings:
    """Readings along a path of loads that starts at rest.

    Args:
        skin: the pad.
        patches: contacts with their largest forces.
        plan: the mesh.
        levels: factors on the forces, in the order to visit.
        weights: of the states before, rest first, in the state that the next one starts
            from, see `extrapolation`.
    """
    problem = skin.problem(patches, plan)
    rest = problem.mechanics.rest()
    border = jnp.zeros(1) if problem.oil.trapped else None
    history = jax.tree.map(
        lambda x: jnp.zeros((len(levels), *x.shape)), BorderedVector(rest, border)
    )

    def visit(history: BorderedVector, step: tuple[Array, ...]) -> tuple[Any, PadReadings]:
        index, level, weight = step
        start = jax.tree.map(lambda x: jnp.tensordot(weight, x, 1), history)
        state, y, found = with_shear(problem, start, level[None])
        kept = jax.tree.map(
            lambda h, x: jax.lax.dynamic_update_index_in_dim(h, x, index + 1, 0), history, y
        )
        return kept, _read(skin, problem, state, found)

    steps = (jnp.arange(len(levels)), levels, weights)
    return jax.lax.scan(visit, history, steps)[1]


def extrapolation(levels: np.ndarray, order: int = 3) -> np.ndarray:
    """Weights of the states at rest and at earlier levels in a polynomial at the next one.

    Args:
        levels: factors on the loads, in the order to visit.
        order: most of the polynomial.

    Returns:
        A row a level, a column for rest and each level but the last.
    """
    weights = np.zeros((len(levels), len(levels)))
    places = np.concatenate([[0.0], levels])
    for i, level in enumerate(levels):
        used = range(max(0, i - order), i + 1)
        for k in used:
            others = [places[j] for j in used if j != k]
            weights[i, k] = np.prod([(level - x) / (places[k] - x) for x in others])
    return weights


def readings(skin: PadSkin, patches: Patches, plan: PadPlan) -> PadReadings:
    """Readings of contacts, solved from rest; no derivatives.

    Args:
        skin: the pad.
        patches: the contacts; those without a force change nothing.
        plan: the mesh.
    """
    problem = skin.problem(patches, plan)
    found = equilibrium(problem)
    return _read(skin, problem, corrected(problem, found.state)[1], found.result == 0)
