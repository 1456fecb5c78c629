"""The whole forward model: a skin and its loads to sensor output.

::

    config -> geometry, law, oil, electrodes        `skin_of`, once a skin
    loads  -> equilibrium -> gap -> capacitance -> SO        `forward`

`solve` makes a mesh for each scene and estimates its error. A `Skin` has one even mesh for
loads anywhere on the arc: a load lies inside an element and slides from one to the next,
so one compiled program serves every load, in batches, and loads may pass one another. With
the default 32 elements SO is within 1e-3 of the converged shell at the load and 5e-5 in the
mean over the pad (`benchmarks/sensing_accuracy.py`), which is the shell's own model error.
"""

import difflib
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from suas_jax.config import SceneSpec, SkinSpec, continuous_inputs
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import corrected, corrected_contact
from suas_jax.equilibrium.equilibrium import equilibrium, lanes_together
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.numerics.lanes import in_chunks, in_halves, lane_count
from suas_jax.numerics.quadrature import gauss_legendre
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.precision import require_float64
from suas_jax.scene.error_estimate import bounded
from suas_jax.scene.parts import scene_parts, skin_parts
from suas_jax.sensing.electrodes import Electrodes, Readings
from suas_jax.sensing.taxels import check_taxels
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad, LoadPoints
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.wall import Wall

ELEMENTS = 32
"""Elements of a skin's mesh along the whole arc, unless told otherwise."""
_MANY_LANES = 512  # from which on a second thread is worth its while
SPREAD_POINTS = 8
"""Point loads that stand for one that is spread over an arc."""


class Loads(eqx.Module):
    """Line loads, any number at once, and any number of cases side by side in lanes.

    Attributes:
        angle: where they act, from the symmetry axis [rad].
        force: total over the width, positive inwards [N].
        turn: counter-clockwise rotation of the force from the inward radial [rad].
        external_pressure: uniform on the outer face, above ambient [Pa].
    """

    angle: Float[Array, "load #lane"]
    force: Float[Array, "load #lane"]
    turn: Float[Array, "load #lane"]
    external_pressure: Lanes

    @classmethod
    def line(cls, angle: ArrayLike, force: ArrayLike, turn: ArrayLike = 0.0) -> "Loads":
        """One line load a lane.

        Args:
            angle: one value, or one a lane [rad].
            force: likewise [N].
            turn: likewise, from the inward radial [rad].

        Raises:
            Float64Error: float64 is off.
        """
        require_float64()
        row = [jnp.atleast_1d(jnp.asarray(x, float))[None] for x in (angle, force, turn)]
        return cls(row[0], row[1], row[2], jnp.zeros(1))

    def in_lanes(self) -> "Loads":
        """The same with every array as wide as the widest."""
        lanes = max(x.shape[-1] for x in jax.tree.leaves(self))
        return jax.tree.map(lambda x: jnp.broadcast_to(x, (*x.shape[:-1], lanes)), self)


class SensorOutput(NamedTuple):
    """What a skin says about its loads; every entry has a lane axis.

    Attributes:
        readings: gap, capacitance and SO of every taxel.
        oil_pressure: above ambient [Pa].
        wall_force: that the wall carries [N]; zero where the skin has none.
        min_gap: smallest between membrane and wall, over all of the skin [m].
        state: the shell's equilibrium, to start a neighbouring one from.
        error: bound of the relative error that the thin shell makes in pressure and
            displacement; that of the mesh is not in it.
        result: index of the outcome (`suas_jax.equilibrium.outcomes`), 0 where converged.
            `beyond_model` names a state whose `error` exceeds 0.3, or that went through the
            wall. Where no equilibrium
            was found, everything else belongs to the last one before the failure.
    """

    readings: Readings
    oil_pressure: Lanes
    wall_force: Lanes
    min_gap: Lanes
    state: State
    error: Lanes
    result: Int[Array, " lane"]

    @property
    def so(self) -> Float[Array, "taxel lane"]:
        """Continuous sensor output [counts]; NaN where nothing parts taxel and membrane."""
        return self.readings.so


class Skin(eqx.Module):
    """A skin: everything but its loads, differentiable in every array.

    Attributes:
        geometry: dimensions.
        law: the membrane's material.
        oil: how the oil answers.
        electrodes: taxels and converter's scale.
        wall: what holds the membrane; None where it passes through.
        elements: of the even mesh along the whole arc.
    """

    geometry: SkinGeometry
    law: AbstractLaw
    oil: AbstractOil
    electrodes: Electrodes
    wall: Wall | None = None
    elements: int = eqx.field(static=True, default=ELEMENTS)

    def problem(self, loads: Loads) -> Problem:
        """The discrete problem of some loads: each a point inside an element."""
        angles = jnp.linspace(-1, 1, self.elements + 1)[:, None] * self.geometry.half_angle
        element = jnp.sum(loads.angle >= angles[1:-1, None], 0)
        select = (np.arange(self.elements)[:, None, None] == element).astype(angles.dtype)
        start, end = (jnp.sum(select * side[:, None], 0) for side in (angles[:-1], angles[1:]))
        line = LineLoad(loads.angle, loads.force, loads.turn)
        force = loads.force * line.direction(self.geometry.section) / self.geometry.width
        points = LoadPoints(select, (loads.angle - start) / (end - start), force)
        shell = Shell.build(
            self.geometry, self.law, angles, points, symmetric=False, wall=self.wall
        )
        return Problem(shell, self.oil, loads.external_pressure)


def forward(skin: Skin, loads: Loads, start: State | None = None) -> SensorOutput:
    """Loads to sensor output.

    Differentiable by every array of the skin and of the loads, in forward and reverse mode,
    through the implicit derivative of the equilibrium. Called with numbers it runs a compiled
    program, kept between runs: one serves all loads of the same shape, and a lane is cheaper
    than a call; half of many lanes go through a second thread. What is made of it is best
    compiled whole (``suas_jax.jit(jax.grad(loss))``).
    A load that doesn't converge is named in `result`, a taxel that touches the wall in
    `readings.touching`; nothing is raised.

    Args:
        skin: the skin.
        loads: what acts on it.
        start: state of a neighbouring equilibrium, such as the last frame's; without it
            the solution starts from rest, which takes about three times as long.

    Raises:
        Float64Error: float64 is off.
    """
    require_float64()

    def run(skin: Skin, loads: Loads, start: State | None) -> SensorOutput:
        output: SensorOutput = COMPILED.run_or_trace(_forward, skin, loads, start)
        return output

    known = not any(
        isinstance(x, jax.core.Tracer) for x in jax.tree.leaves((skin, loads, start))
    )
    if known and lane_count((skin, loads, start)) >= _MANY_LANES:
        return in_halves(run, skin, loads, start)
    return run(skin, loads, start)


@eqx.filter_jit
def _forward(skin: Skin, loads: Loads, start: State | None) -> SensorOutput:
    return _output(skin, loads, start)


@eqx.filter_custom_jvp
def _output(skin: Skin, loads: Loads, start: State | None) -> SensorOutput:
    """All of it chunk by chunk: what is read of many lanes at once leaves the cache."""
    arrays, static = eqx.partition((skin, loads, start), eqx.is_array)
    arrays = jax.tree.map(jnp.atleast_1d, arrays)  # lanes come last

    def one(arrays: Any) -> SensorOutput:
        skin, loads, start = eqx.combine(arrays, static)
        found = equilibrium(skin.problem(loads), start, wall_on_demand=True, omitted=True)
        return _read(skin, loads, found.state, found.result, found.change)

    return in_chunks(one, arrays, lanes_together(4 * (skin.elements + 1)))


@_output.def_jvp
def _(primals: Any, tangents: Any) -> tuple[SensorOutput, SensorOutput]:
    skin, loads, _ = primals
    output = _output(*primals)

    def read(skin: Skin, loads: Loads) -> SensorOutput:
        return _read(skin, loads, output.state, output.result)

    return output, eqx.filter_jvp(read, (skin, loads), tangents[:2])[1]


def _read(
    skin: Skin,
    loads: Loads,
    state: State,
    result: Int[Array, " lane"],
    change: BorderedVector | None = None,
) -> SensorOutput:
    """What an equilibrium says, with its derivatives; see `Equilibrium` for the arguments."""
    problem = skin.problem(loads)
    root, shown, shell = corrected(problem, state, change)
    readings = skin.electrodes.read(shell, shown.q)
    force = jnp.zeros_like(shown.pressure)
    if skin.wall is None:
        contact = shell.contact(shown.q, Wall.of(skin.geometry, skin.law.shear_modulus))
    else:
        contact = corrected_contact(problem.mechanics, shown, root)
        force = jnp.sum(contact.area * contact.pressure, (0, 1)) * skin.geometry.width
    min_gap = jnp.min(contact.gap, (0, 1))
    trust = bounded(problem, root, shown, result)
    return SensorOutput(readings, shown.pressure, force, min_gap, root, *trust)


def load_jacobian(
    skin: Skin, loads: Loads, start: State | None = None
) -> tuple[SensorOutput, Float[Array, "kind load taxel lane"]]:
    """Sensor output and its exact derivatives by angle, force and turn of every load.

    All columns share one factorisation of the tangent. Compiled as `forward` is.

    Args:
        skin: the skin.
        loads: what acts on it.
        start: state of a neighbouring equilibrium.

    Returns:
        The output, and the derivatives of SO by (angle [rad], force [N], turn [rad]).

    Raises:
        Float64Error: float64 is off.
    """
    require_float64()
    found: tuple[SensorOutput, Array] = COMPILED.run_or_trace(_jacobian, skin, loads, start)
    return found


@eqx.filter_jit
def _jacobian(skin: Skin, loads: Loads, start: State | None) -> tuple[SensorOutput, Array]:
    loads = loads.in_lanes()
    count, lanes = loads.angle.shape

    def so(loads: Loads) -> tuple[Array, SensorOutput]:
        output = _forward(skin, loads, start)
        return output.so, output

    _, push, output = jax.linearize(so, loads, has_aux=True)
    unit = jnp.broadcast_to(
        jnp.eye(3 * count).reshape(3, count, 3, count, 1), (3, count, 3, count, lanes)
    )
    zero = jnp.zeros_like(loads.external_pressure)
    column = jax.vmap(jax.vmap(lambda e: push(Loads(e[0], e[1], e[2], zero))))
    return output, column(unit)


def skin_of(
    spec: SkinSpec,
    inputs: Mapping[str, ArrayLike] | None = None,
    *,
    elements: int = ELEMENTS,
    contact: bool = True,
) -> Skin:
    """Build a skin from its specification.

    Args:
        spec: a skin, or a scene, with [electrodes].
        inputs: SI values by TOML path (see `continuous_inputs`) that replace the
            specification's own: pass traced numbers here to differentiate by them.
        elements: of the mesh along the whole arc.
        contact: whether the wall holds the membrane, if the specification says so. Without
            it programs compile in half the time; states at the wall are still told by
            `Readings.touching`.

    Raises:
        ConfigError: the section can't be, or a taxel lies off it.
        ValueError: the skin has no electrodes, or a path is none of its inputs.
        Float64Error: float64 is off.
    """
    require_float64()
    spec.require_plane_strain("`skin_of`")
    numbers = known_inputs(spec, inputs)
    if spec.electrodes is not None:
        check_taxels(spec.electrodes, spec.geometry)
    parts = skin_parts(spec, numbers)
    wall = parts.wall if contact else None
    return Skin(parts.geometry, parts.law, parts.oil, parts.sensing(), wall, elements)


def known_inputs(
    spec: SkinSpec, inputs: Mapping[str, ArrayLike] | None
) -> dict[str, ArrayLike]:
    """A skin's numbers by TOML path, some of them replaced.

    Args:
        spec: the skin.
        inputs: what replaces them; None for nothing.

    Raises:
        ValueError: a path is none of its inputs.
    """
    own: dict[str, ArrayLike] = dict(continuous_inputs(spec))
    for path in inputs or ():
        if path not in own:
            near = difflib.get_close_matches(path, own, 1)
            hint = f'; did you mean "{near[0]}"?' if near else ""
            raise ValueError(f'"{path}" is no continuous input of this skin{hint}')
    return {**own, **(inputs or {})}


def loads_of(scene: SceneSpec, inputs: Mapping[str, ArrayLike] | None = None) -> Loads:
    """The loads of a scene, those spread over an arc as a few points of one direction.

    Args:
        scene: its [[load]] tables.
        inputs: SI values by TOML path that replace the scene's own.

    Raises:
        Float64Error: float64 is off.
    """
    require_float64()
    scene.require_plane_strain("`loads_of`")
    scene.require_no_bodies("`loads_of`")
    parts = scene_parts(scene, {**continuous_inputs(scene), **(inputs or {})})
    section = parts.skin.geometry.section
    angles, forces, turns = [], [], []
    for load in parts.forces:
        assert isinstance(load, LineLoad)  # all there is in plane strain
        points, weights = np.zeros(1), np.ones(1)
        if load.spread is not None:
            points, weights = gauss_legendre(SPREAD_POINTS, -1.0, 1.0)
            weights = weights / 2
        # A vertical force is the inward radial one turned by its angle.
        along = section.direction(load.angle)
        turn = along if load.vertical else load.turn
        half = jnp.zeros(1)
        if load.spread is not None:
            start, end = load.breakpoints(section)
            half = (end - start) / 2
        for x, weight in zip(points, weights, strict=True):
            angles.append(load.angle + x * half)
            forces.append(load.force * weight)
            turns.append(turn + section.direction(angles[-1]) - along)

    def stacked(rows: list[Array]) -> Array:
        return jnp.stack(rows) if rows else jnp.zeros((0, 1))

    return Loads(stacked(angles), stacked(forces), stacked(turns), parts.external_pressure)
