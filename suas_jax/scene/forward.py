"""The whole forward model, of sections and pads: a skin and its loads to sensor output.

::

    config -> geometry, law, oil, electrodes        `skin_of`, once a skin
    loads  -> mesh of a pad, graded around them     `Skin.around`
           -> equilibrium -> gap -> capacitance -> SO        `forward`

With the default 32 elements of a section SO is within 1e-3 of the converged shell at the load
and 5e-5 in the mean over the pad (`benchmarks/sensing_accuracy.py`), which is the shell's own
model error. States carry the first-order effect of transverse shear.
"""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.correction import Corrected, corrected, corrected_contact
from suas_jax.equilibrium.equilibrium import equilibrium, lanes_together
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.equilibrium.validity import kept_in_domain
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.numerics.lanes import by_lane, in_chunks, in_halves, lane_count, on_cpu
from suas_jax.runtime.compiled import COMPILED, require_float64
from suas_jax.scene.error_estimate import bounded
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin
from suas_jax.sensing.electrodes import Readings
from suas_jax.skin.wall import Wall

_MANY_LANES = 512  # from which on a second thread is worth its while
_VARIED = ("angle", "force", "turn", "axial", "tilt", "diameter")


class SensorOutput(NamedTuple):
    """What a skin says about its loads; every entry has a lane axis."""

    readings: Readings  # gap, capacitance and SO of every taxel
    oil_pressure: Lanes  # above ambient [Pa]
    wall_force: Lanes  # that the wall carries [N]; zero where the skin has none
    min_gap: Lanes  # smallest between membrane and wall, over all of the skin [m]
    state: State  # the shell's equilibrium, to start a neighbouring one on the same mesh from
    # bound of the relative error that the thin shell makes in pressure and displacement; that
    # of the mesh is not in it
    error: Lanes
    # index of the outcome (`suas_jax.equilibrium.outcomes`), 0 where converged. `beyond_model`
    # names a state whose `error` exceeds 0.3, or that went through the wall. Where no
    # equilibrium was found, everything else belongs to the last one before the failure.
    result: Int[Array, " lane"]

    @property
    def so(self) -> Float[Array, "taxel lane"]:
        """Continuous sensor output [counts]; NaN where nothing parts taxel and membrane."""
        return self.readings.so

    @property
    def solved(self) -> Bool[Array, " lane"]:
        """Whether an equilibrium was found, within what the model knows or beyond."""
        return (self.result == 0) | (self.result == index_of("beyond_model"))


def forward(skin: Skin, loads: Loads, start: State | None = None) -> SensorOutput:
    """Loads to sensor output, any number of cases at once.

    Differentiable by every array of the skin and of the loads, in forward and reverse mode,
    through the implicit derivative of the equilibrium. Called with numbers it runs a compiled
    program, kept between runs: one serves all loads of the same shape, and a lane is cheaper
    than a call; of many lanes of a section a second thread takes half. Compile a function of it
    whole (``suas_jax.jit(jax.grad(loss))``), after the mesh of a pad is made (`Skin.around`). A
    `start` needs a pad whose mesh is made, too.
    A load that doesn't converge is named in `result`, a taxel that touches the wall in
    `readings.touching`; nothing is raised.

    Args:
        skin: the skin.
        loads: what acts on it.
        start: state of a neighbouring equilibrium, such as the last frame's; without it
            the solution starts from rest, which takes about three times as long.

    Raises:
        ValueError: line loads on a pad or patches on a section, or a pad's mesh can't be
            made as its numbers are traced.
        Float64Error: float64 is off.
    """
    require_float64()

    def run(skin: Skin, loads: Loads, start: State | None) -> SensorOutput:
        output: SensorOutput = COMPILED.run_or_trace(_forward, skin, loads, start)
        return output

    skin = _meshed(skin, loads)
    known = not any(
        isinstance(x, jax.core.Tracer) for x in jax.tree.leaves((skin, loads, start))
    )
    halved = known and not skin.is_pad and on_cpu()
    if halved and lane_count((skin, loads, start)) >= _MANY_LANES:
        return in_halves(run, skin, loads, start)
    return run(skin, loads, start)


def _meshed(skin: Skin, loads: Loads) -> Skin:
    return skin.around(loads) if skin.is_pad and skin.mesh is None else skin


@eqx.filter_jit
def _forward(skin: Skin, loads: Loads, start: State | None) -> SensorOutput:
    if skin.is_pad:
        # Each lane leads its own way to its equilibrium.
        cases = _with_lanes((skin, loads, start))
        return by_lane(cases, lambda case: jax.tree.map(lambda x: x[..., 0], _solve(*case)))
    return _section(skin, loads, start)


def _with_lanes(case: tuple[Any, ...]) -> tuple[Any, ...]:
    """Every array with lanes, which come last."""
    return jax.tree.map(lambda x: jnp.atleast_1d(x) if eqx.is_array(x) else x, case)


def _solve(skin: Skin, loads: Loads, start: State | None) -> SensorOutput:
    # With a pad's few lanes another substitution costs less than its program's compilation.
    found = equilibrium(
        skin.problem(loads), start, wall_on_demand=True, omitted=not skin.is_pad
    )
    return _read(skin, loads, found.state, found.outcome, found.change)


@eqx.filter_custom_jvp
def _section(skin: Skin, loads: Loads, start: State | None) -> SensorOutput:
    """All of it chunk by chunk: what is read of many lanes at once leaves the cache."""
    arrays, static = eqx.partition(_with_lanes((skin, loads, start)), eqx.is_array)

    def one(arrays: Any) -> SensorOutput:
        return _solve(*eqx.combine(arrays, static))

    assert isinstance(skin.elements, int)
    return in_chunks(one, arrays, lanes_together(4 * (skin.elements + 1)))


@_section.def_jvp
def _(primals: Any, tangents: Any) -> tuple[SensorOutput, SensorOutput]:
    skin, loads, _ = primals
    output = _section(*primals)

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
    found = corrected(problem, state, change)
    root, shown, mechanics = found
    readings = skin.electrodes.read(mechanics, shown.q)
    min_gap, force = _at_wall(skin, found, problem.mechanics)
    if skin.is_pad:
        result = kept_in_domain(mechanics, shown.q, result)
    trust = bounded(problem, root, shown, result)
    return SensorOutput(readings, shown.pressure, force, min_gap, root, *trust)


def _at_wall(skin: Skin, found: Corrected, mechanics: AbstractMechanics) -> tuple[Lanes, Lanes]:
    """Smallest gap [m], and the force that the wall of some mechanics carries [N]."""
    root, shown, seen = found
    force, contact = jnp.zeros_like(shown.pressure), None
    if skin.wall is not None:
        contact = corrected_contact(mechanics, shown, root)
        own = jnp.sum(contact.area * contact.pressure, (0, 1))
        force = own if skin.is_pad else own * skin.geometry.width
    if skin.is_pad:
        return seen.shape(shown.q).smallest_gap(skin.geometry).value, force
    if contact is None:
        contact = seen.contact(shown.q, Wall.of(skin.geometry, skin.law.shear_modulus))
    return jnp.min(contact.gap, (0, 1)), force


def load_jacobian(
    skin: Skin, loads: Loads, start: State | None = None
) -> tuple[SensorOutput, Float[Array, "kind load taxel lane"]]:
    """Sensor output and its exact derivatives by angle, force and turn of every load.

    All columns share one factorisation of the tangent. Arguments, errors and compilation are
    those of `forward`.

    Returns:
        The output, and the derivatives of SO by (angle [rad], force [N], turn [rad]); of
        patches also by axial position [m], tilt [rad] and diameter [m].
    """
    require_float64()
    skin = _meshed(skin, loads)
    found: tuple[SensorOutput, Array] = COMPILED.run_or_trace(_jacobian, skin, loads, start)
    return found


@eqx.filter_jit
def _jacobian(skin: Skin, loads: Loads, start: State | None) -> tuple[SensorOutput, Array]:
    loads = loads.in_lanes()
    varied = {k: getattr(loads, k) for k in _VARIED if getattr(loads, k) is not None}
    kinds, (count, lanes) = len(varied), loads.angle.shape

    def so(varied: dict[str, Array]) -> tuple[Array, SensorOutput]:
        output = _forward(skin, dataclasses.replace(loads, **varied), start)
        return output.so, output

    _, push, output = jax.linearize(so, varied, has_aux=True)
    each = (kinds, count)
    unit = jnp.broadcast_to(
        jnp.eye(kinds * count).reshape(*each, *each, 1), (*each, *each, lanes)
    )
    column = jax.vmap(jax.vmap(lambda e: push(dict(zip(varied, e, strict=True)))))
    return output, column(unit)
