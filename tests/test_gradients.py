"""Derivatives of equilibria by every continuous input, the mesh plan held."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import LAWS, built, find, line, quick, scene

from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.equilibrium import differentiable, equilibrium
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector, eliminate
from suas_jax.scene.build import build_problem, plan_for
from suas_jax.scene.gradient import _of_travels

ELEMENTS = 6
PUSH = {"kind": "pressure", "pressure": "700 Pa"}
COMPRESSIBLE = {"model": "compressible", "bulk_modulus": "3 MPa"}
SCENES: dict[str, SceneSpec] = {
    "mooney-rivlin, turned load, trapped oil": scene(
        line(25, 12, direction="10 deg"), half_angle=1.4
    ),
    "ogden, spread load, compressible oil": scene(
        line(-20, 9, spread="6 mm"), PUSH, material=LAWS["ogden"], oil=COMPRESSIBLE
    ),
    "yeoh, two loads, oil pressure given": scene(
        line(40, 3), line(-10, 2), material=LAWS["yeoh"], oil_pressure=4000.0
    ),
    "neo-hookean, vertical load, vented oil": scene(
        line(30, 3, direction="vertical"),
        PUSH,
        material=LAWS["neo-hookean"],
        oil={"model": "vented"},
    ),
}
TRAPPED = next(iter(SCENES))
# One in all ways: a principal-stretch law, compressible oil, a spread load and a pressure.
QUICK = "ogden, spread load, compressible oil"
every_scene = pytest.mark.parametrize(
    "name",
    [name if name == QUICK else pytest.param(name, marks=pytest.mark.long) for name in SCENES],
)
QUANTITIES = ("oil pressure", "load factor", "x", "y", "work", "strain energy")

Inputs = dict[str, Any]
jitted = functools.partial(quick, jit=jax.jit)


class Programs(NamedTuple):
    """Compiled functions of one scene's inputs."""

    inputs: Inputs
    batch: Callable[[Inputs], jax.Array]
    forward: Callable[[Inputs], tuple[Inputs, jax.Array]]
    reverse: Callable[[Inputs, jax.Array], Inputs]


def quantities_of(spec: SceneSpec) -> Callable[[Inputs], jax.Array]:
    """Oil pressure, load factor, a displacement, work and energy of a scene's inputs."""
    plan = plan_for(spec, "shell", (ELEMENTS,))

    def values(inputs: Inputs) -> jax.Array:
        problem = build_problem(spec, plan, inputs)
        q, pressure, factor = equilibrium(problem).state
        mechanics = problem.mechanics
        entries = [
            pressure,
            factor,
            q[0, 4],
            q[1, 4],
            mechanics.work(q),
            mechanics.strain_energy(q),
        ]
        return jnp.stack(entries)[:, 0]

    return values


@functools.cache
def programs(name: str) -> Programs:
    """Compiled once for all tests."""
    spec = SCENES[name]
    values = quantities_of(spec)

    def twice(inputs: Inputs) -> tuple[jax.Array, jax.Array]:
        found = values(inputs)
        return found, found

    return Programs(
        {path: jnp.asarray(x) for path, x in continuous_inputs(spec).items()},
        jitted(jax.vmap(values)),
        jitted(jax.jacfwd(twice, has_aux=True)),
        jitted(jax.grad(lambda inputs, weights: weights @ values(inputs))),
    )


def differences(program: Programs, inputs: Inputs, steps: dict[str, float]) -> Inputs:
    """Derivatives by central differences of fourth order, all in one batch."""
    paths = list(steps)
    offsets = np.array([-2.0, -1.0, 1.0, 2.0])
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / 12
    stacked = {}
    for path, value in inputs.items():
        column = np.full((len(paths), 4), value)
        if path in steps:
            column[paths.index(path)] += offsets * steps[path]
        stacked[path] = jnp.asarray(column.ravel())
    values = np.asarray(program.batch(stacked)).reshape(len(paths), 4, -1)
    slopes = np.einsum("o,poq->pq", weights, values)
    return {path: slopes[i] / steps[path] for i, path in enumerate(paths)}


def assert_derivatives(program: Programs, inputs: Inputs) -> None:
    """Compare with differences, to a share of the gradient or of quantity over input."""
    jacobian, values = program.forward(inputs)
    assert np.all(np.isfinite(values))
    steps = {path: 1e-3 * abs(float(value)) for path, value in inputs.items()}
    expected = differences(program, inputs, steps)
    assert set(jacobian) == set(expected) == set(inputs)
    for path, want in expected.items():
        scale = np.maximum(np.abs(want), np.abs(values / inputs[path]))
        error = np.abs(np.asarray(jacobian[path]) - want)
        assert np.all(error <= 1e-6 * scale), (path, error / scale)


@every_scene
def test_derivatives_by_every_input_are_those_of_differences(name: str) -> None:
    program = programs(name)
    assert_derivatives(program, program.inputs)
    # None is without effect, but for the gap where the oil keeps its volume or is open.
    jacobian, _ = program.forward(program.inputs)
    idle = {path for path, slope in jacobian.items() if not np.any(slope)}
    assert idle == (set() if "compressible" in name else {"geometry.oil_gap"})


@pytest.mark.parametrize(
    "name", [list(SCENES)[1], pytest.param(list(SCENES)[2], marks=pytest.mark.long)]
)
def test_forward_and_reverse_agree(name: str) -> None:
    program = programs(name)
    forward, values = program.forward(program.inputs)
    weights = np.array([1.0, -0.7, 0.4, 1.3, -0.2, 0.6])
    weights = jnp.asarray(weights / np.where(values == 0, 1, values))
    reverse = program.reverse(program.inputs, weights)
    for path, value in program.inputs.items():
        terms = np.abs(weights * forward[path])
        scale = np.max(terms) + 1 / abs(float(value))
        assert abs(float(weights @ forward[path] - reverse[path])) < 1e-10 * scale


@pytest.mark.long  # a program each; every input above
@pytest.mark.parametrize("path", ["load.0.force", "geometry.oil_gap"])
def test_derivatives_by_one_input_alone(path: str) -> None:
    # Some equations don't depend on it: their change is an absent tangent, not a number.
    program, spec = programs(TRAPPED), SCENES[TRAPPED]
    values = quantities_of(spec)

    def alone(value: jax.Array) -> jax.Array:
        return values({**program.inputs, path: value})

    got = jitted(jax.jacfwd(alone))(program.inputs[path])
    want, found = program.forward(program.inputs)
    scale = np.maximum(np.abs(want[path]), np.abs(found / program.inputs[path]))
    assert np.all(np.abs(got - want[path]) <= 1e-10 * scale)


@pytest.mark.long  # another scene; all of them above
def test_line_loads_tell_only_the_sum_of_the_first_two_constants() -> None:
    program = programs(TRAPPED)
    jacobian, _ = program.forward(program.inputs)
    np.testing.assert_allclose(jacobian["material.C1"], jacobian["material.C2"], rtol=1e-11)


@quick
def compliance(shell: Shell) -> BorderedVector:
    """Small displacements and oil pressure under the loads, from the tangent at rest."""
    zero = jnp.zeros(1)
    a = shell.assemble(shell.rest(), zero, zero)
    tangent = BorderedBlockTridiagonal(a.tangent, -a.volume_gradient, zero)
    return eliminate(tangent, BorderedVector(a.load, zero)).solution


@pytest.mark.long  # reverse mode of another scene; near rest below
def test_derivatives_without_any_load() -> None:
    program, spec = programs(TRAPPED), SCENES[TRAPPED]
    inputs = {**program.inputs, "load.0.force": jnp.asarray(0.0)}
    linear = np.array([0, 2, 3])  # the quantities that start linearly
    plan = plan_for(spec, "shell", (ELEMENTS,))
    unit = built(spec, plan, {**inputs, "load.0.force": 1.0})
    answer = compliance(unit.mechanics)
    want = [answer.border[0], *answer.stations[:2, 4, 0]]
    forward, values = program.forward(inputs)
    assert not np.any(np.asarray(values)[linear])
    np.testing.assert_allclose(np.asarray(forward["load.0.force"])[linear], want, rtol=1e-11)
    for path, slope in forward.items():
        if path != "load.0.force":
            assert not np.any(np.asarray(slope)[linear])
    for index, slope in zip(linear, want, strict=True):
        weights = jnp.zeros(len(QUANTITIES)).at[index].set(1.0)
        reverse = program.reverse(inputs, weights)
        np.testing.assert_allclose(reverse["load.0.force"], slope, rtol=1e-11)
        assert not any(np.any(x) for path, x in reverse.items() if path != "load.0.force")


def test_derivatives_of_a_principal_stretch_law_near_rest() -> None:
    # All stretches coincide at rest: no digit may be lost next to it.
    program = programs("ogden, spread load, compressible oil")
    small = {"load.0.force": jnp.asarray(1e-6), "load.1.pressure": jnp.asarray(1e-5)}
    assert_derivatives(program, {**program.inputs, **small})


# Second derivatives, along one direction of a few inputs.

CURVED = ("material.mu", "geometry.thickness", "load.0.force", "load.0.angle")


@pytest.mark.long  # second derivatives of an equilibrium
def test_second_derivatives() -> None:
    spec = scene(line(25, 12), material=LAWS["neo-hookean"])
    plan, inputs = plan_for(spec, "shell", (ELEMENTS,)), continuous_inputs(spec)
    point = {path: jnp.asarray(inputs[path]) for path in CURVED}
    direction = {path: 0.1 * (i + 1) * x for i, (path, x) in enumerate(point.items())}

    def at_known_state(some: Inputs, state: State) -> jax.Array:
        problem = build_problem(spec, plan, {**inputs, **some})
        q, pressure, _ = differentiable(problem, state)
        return pressure[0] / 1e4 + q[1, 4, 0] / 1e-3

    @jitted
    def forward(some: Inputs, state: State) -> tuple[Inputs, Inputs]:
        return jax.jvp(lambda x: jax.grad(at_known_state)(x, state), (some,), (direction,))

    def at(h: float) -> tuple[Inputs, State]:
        some = jax.tree.map(lambda x, d: x + h * d, point, direction)
        return some, find(built(spec, plan, {**inputs, **some})).state

    h = 2e-3
    weighted = [forward(*at(k * h))[0] for k in (-2, -1, 1, 2)]
    want = jax.tree.map(lambda a, b, c, d: (a - 8 * b + 8 * c - d) / (12 * h), *weighted)
    found = forward(*at(0.0))[1]
    largest = max(abs(float(want[path] * point[path])) for path in CURVED)
    for path in CURVED:
        scale = max(abs(float(want[path])), largest / float(point[path]))
        assert abs(float(found[path] - want[path])) < 1e-6 * scale


# Batches.

LANES = 140  # more than one chunk


@pytest.mark.long  # 140 lanes with derivatives; lanes in test_skin
def test_batches_equal_loops() -> None:
    program = programs(TRAPPED)
    spread = jnp.linspace(0, 1, LANES)
    varied = {
        "load.0.force": 0.01 + 40 * spread**2,
        "material.C1": 20e6 * (1 + 0.3 * jnp.sin(20 * spread)),
    }
    shared = {path: x for path, x in program.inputs.items() if path not in varied}
    values = quantities_of(SCENES[TRAPPED])
    weights = jnp.array([1e-4, 0.0, 1e3, 1e3, 0.0, 0.0])

    def both(some: Inputs, base: Inputs) -> tuple[jax.Array, jax.Array]:
        found = values({**base, **some})
        return weights @ found, found

    axes = (dict.fromkeys(varied, 0), None)
    slopes, got = jitted(jax.vmap(jax.grad(both, has_aux=True), axes))(varied, shared)
    assert got.shape == (LANES, len(QUANTITIES))
    for lane in range(0, LANES, 9):
        inputs = {**shared, **{path: x[lane] for path, x in varied.items()}}
        _, want = program.forward(inputs)
        np.testing.assert_allclose(got[lane], want, rtol=1e-11)
        reverse = program.reverse(inputs, weights)
        for path in varied:
            scale = abs(float(reverse[path])) + 1 / abs(float(inputs[path]))
            assert abs(float(slopes[path][lane] - reverse[path])) <= 1e-11 * scale


def test_a_body_under_no_force_leaves_the_derivatives_of_other_forces() -> None:
    slopes = jnp.array([[6.0, 0.0], [3.0, 0.0], [0.0, 0.0]])  # the second body is off the skin
    np.testing.assert_allclose(_of_travels(slopes), [2.0, 0.0])
