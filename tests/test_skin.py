"""The forward model: against a solve of its own mesh, in lanes, and its derivatives."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import EPDM, GEOMETRY, compilations, quick

from suas_jax.config import continuous_inputs, load_skin, scene_from_dict
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import content_key
from suas_jax.scene.error_estimate import bounded
from suas_jax.scene.forward import SensorOutput, forward, load_jacobian
from suas_jax.scene.loads import Loads, loads_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.skin import skin_of
from suas_jax.sensing.field import Film, field_capacitance, wall_charge

PAD = Path(__file__).parent.parent / "configs" / "skins" / "suas-pad.toml"
LIST = {
    "stray": "3 fF",
    "lsb": "0.305 fF",
    "taxels": [
        {"angle": f"{a} deg", "axial": "1 mm", "diameter": "4 mm"} for a in (-50, 2, 28, 61)
    ],
}
TRIANGLE = {
    "capacitance": "concentric",
    "stray": "20 fF",
    "lsb": "0.305 fF",
    "layers": [{"thickness": "50 um", "relative_permittivity": 3.3}],
    "layout": "roboskin",
    "modules": [
        {
            "angle": "20 deg",
            "axial": "3 mm",
            "rotation": "25 deg",
            "pitch": "6.533 mm",
            "diameter": "4 mm",
        }
    ],
}
LINE = {"kind": "line", "angle": "31 deg", "force": "14 N", "direction": "12 deg"}
PRESSURE = {"kind": "pressure", "pressure": "0.5 kPa"}
COMPRESSIBLE = {"model": "compressible", "bulk_modulus": "2 MPa", "relative_permittivity": 2.2}


def a_scene(*loads: dict, electrodes: dict = LIST, oil: dict | None = None) -> object:
    return scene_from_dict(
        {
            "geometry": GEOMETRY,
            "material": EPDM,
            "oil": oil or {"model": "incompressible", "relative_permittivity": 2.2},
            "electrodes": electrodes,
            "load": list(loads),
        }
    )


run = quick(forward)
EVERY = a_scene(LINE, PRESSURE, electrodes=TRIANGLE, oil=COMPRESSIBLE)


def so_of(inputs: dict) -> jax.Array:
    """Readings of the scene with every kind of input."""
    return forward(skin_of(EVERY, inputs, elements=16), loads_of(EVERY, inputs)).so[:, 0]


def every_input() -> dict[str, jax.Array]:
    # Of the type that sums of them have: another one would be another program.
    return {path: jnp.asarray(x, float) for path, x in continuous_inputs(EVERY).items()}


@pytest.mark.long  # solve and derivatives in one; test_gradients, readings in test_sensing
def test_derivatives_of_every_so_along_all_inputs_are_those_of_differences() -> None:
    inputs = every_input()
    signs = iter(np.random.default_rng(0).choice([-1.0, 1.0], len(inputs)))
    along = {path: next(signs) * jnp.abs(x) for path, x in inputs.items()}
    both = quick(lambda at, along: jax.jvp(so_of, (at,), (along,)))

    def beside(step: float) -> np.ndarray:
        return np.asarray(both({p: x + step * along[p] for p, x in inputs.items()}, along)[0])

    so, slope = both(inputs, along)
    h = 1e-4
    want = (8 * (beside(h) - beside(-h)) - (beside(2 * h) - beside(-2 * h))) / (12 * h)
    np.testing.assert_allclose(slope, want, rtol=0, atol=1e-6 * float(jnp.max(jnp.abs(so))))


@pytest.mark.long  # all columns at once; along one direction above
def test_derivatives_of_every_so_by_every_input_are_those_of_differences() -> None:
    inputs = every_input()
    jacobian = quick(jax.jacfwd(so_of))(inputs)
    paths, offsets = list(inputs), np.array([-2.0, -1.0, 1.0, 2.0])
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / 12
    steps = {path: 1e-4 * abs(float(x)) for path, x in inputs.items()}
    stacked = {}
    for i, (path, x) in enumerate(inputs.items()):
        column = np.full((len(paths), 4), float(x))
        column[i] += offsets * steps[path]
        stacked[path] = jnp.asarray(column.ravel())
    values = np.asarray(quick(jax.vmap(so_of))(stacked)).reshape(len(paths), 4, -1)
    level = np.abs(values[0, 0])
    for i, path in enumerate(paths):
        want = weights @ values[i] / steps[path]
        scale = np.maximum(np.abs(want), level / abs(float(inputs[path])))
        error = np.abs(np.asarray(jacobian[path]) - want) / scale
        assert np.all(error < 1e-6), (path, error)
    # In plane strain nothing depends on where a taxel is along the axis.
    idle = {path for path in paths if not np.any(jacobian[path])}
    assert idle == {"electrodes.modules.0.axial"}


@pytest.fixture(scope="module")
def pad() -> object:
    return skin_of(a_scene())


def loads(*, lanes: int = 7) -> Loads:
    # None at a station, where a load's derivative jumps by 1e-5 from element to element.
    angle = np.deg2rad(np.linspace(-65, 65, lanes) + 1.0)
    return Loads.line(angle, np.linspace(4, 16, lanes), np.linspace(-0.2, 0.3, lanes))


@pytest.fixture(scope="module")
def batch(pad: object) -> SensorOutput:
    return run(pad, loads())


@pytest.mark.long  # a program with a start; starts in test_equilibrium
def test_converged_everywhere_and_undisturbed_by_a_start(
    pad: object, batch: SensorOutput
) -> None:
    assert not np.any(batch.result)
    assert not np.any(batch.readings.touching)
    again = run(pad, loads(), batch.state)
    np.testing.assert_allclose(again.so, batch.so, rtol=1e-9)


@pytest.mark.long  # the same program, compiled as users have it
def test_called_with_numbers_it_compiles_once(pad: object, batch: SensorOutput) -> None:
    first = forward(pad, loads())
    np.testing.assert_allclose(first.so, batch.so, rtol=1e-9)
    lighter = dataclasses.replace(loads(), force=0.9 * loads().force)
    with compilations() as compiled:
        second = forward(pad, lighter)
    assert not compiled
    assert not np.any(second.result)
    assert np.all(np.asarray(second.oil_pressure) < np.asarray(batch.oil_pressure))


def test_what_numbers_call_is_kept_between_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program is kept where its name says what it is."""
    called: list[Callable] = []
    monkeypatch.setattr(COMPILED, "run", lambda function, *_: called.append(function))
    forward(skin_of(a_scene()), loads())
    load_jacobian(skin_of(a_scene()), loads())
    assert len({content_key(function) for function in called}) == 2


@pytest.mark.long  # a fine mesh; a solve in test_sensing
def test_its_mesh_serves_loads_anywhere_on_the_arc(batch: SensorOutput) -> None:
    fine = run(skin_of(a_scene(), elements=128), loads())
    np.testing.assert_allclose(batch.so, fine.so, rtol=1e-3)
    # The outermost loads lie two elements from a clamp, whose field the correction takes there.
    np.testing.assert_allclose(batch.oil_pressure, fine.oil_pressure, rtol=6e-4)
    np.testing.assert_allclose(batch.oil_pressure[1:-1], fine.oil_pressure[1:-1], rtol=1e-4)


def test_the_pad_is_symmetric(pad: object, batch: SensorOutput) -> None:
    cases = loads()
    mirrored = Loads(-cases.angle, cases.force, -cases.turn, cases.external_pressure)
    other = run(pad, mirrored)
    np.testing.assert_allclose(other.oil_pressure, batch.oil_pressure, rtol=1e-11)


@pytest.mark.long
def test_load_jacobian_is_that_of_differences(pad: object) -> None:
    cases = loads()
    output, jacobian = quick(load_jacobian)(pad, cases)
    assert jacobian.shape == (3, 1, 4, 7)
    for kind, (name, step) in enumerate((("angle", 1e-5), ("force", 1e-3), ("turn", 1e-4))):

        def moved(by: float, name: str = name) -> np.ndarray:
            columns = {k: getattr(cases, k) for k in ("angle", "force", "turn")}
            columns[name] = columns[name] + by
            found = run(pad, Loads(**columns, external_pressure=cases.external_pressure))
            return np.asarray(found.so)

        rise = 8 * (moved(step) - moved(-step)) - (moved(2 * step) - moved(-2 * step))
        want = rise / (12 * step)
        error = np.abs(np.asarray(jacobian[kind, 0]) - want)
        assert np.all(error <= 1e-6 * np.max(np.abs(want), 0)), (name, error)
    np.testing.assert_allclose(output.so, run(pad, cases).so, rtol=1e-10)


def test_spread_and_vertical_loads_act_as_in_a_solve() -> None:
    spread = {"kind": "line", "angle": "20 deg", "force": "12 N", "spread": "8 mm"}
    vertical = {"kind": "line", "angle": "-30 deg", "force": "5 N", "direction": "vertical"}
    spec = a_scene(spread, vertical)
    found = loads_of(spec)
    assert found.angle.shape == (9, 1)
    assert float(found.force.sum()) == pytest.approx(17.0, rel=1e-14)
    # One direction over the arc: radial at its middle.
    direction = found.angle[:8, 0] - found.turn[:8, 0]
    np.testing.assert_allclose(direction, np.deg2rad(20), rtol=1e-13)
    assert float(found.angle[8, 0] - found.turn[8, 0]) == pytest.approx(0.0, abs=1e-15)


def test_a_skin_without_electrodes_is_refused() -> None:
    spec = scene_from_dict(
        {"geometry": GEOMETRY, "material": EPDM, "oil": {"model": "incompressible"}}
    )
    with pytest.raises(ValueError, match=r"no \[electrodes\]"):
        skin_of(spec)
    with pytest.raises(ValueError, match=r"electrodes\.strays.*electrodes\.stray\b"):
        skin_of(a_scene(), {"electrodes.strays": 1.0})
    with pytest.raises(ValueError, match=r"electrodes\.strays"):
        skin_of(load_skin(PAD), {"electrodes.strays": 1.0})


def test_loads_of_the_other_kind_are_refused() -> None:
    section, whole = skin_of(a_scene()), skin_of(load_skin(PAD), contact=False)
    with pytest.raises(ValueError, match=r"Loads\.patch"):
        forward(whole, Loads.line(0.1, 1.0))
    with pytest.raises(ValueError, match=r"Loads\.line"):
        section.problem(Loads.patch(0.1, 0.0, 1.0, 6e-3))
    with pytest.raises(ValueError, match="one number"):
        skin_of(a_scene(), elements=(4, 4))
    with pytest.raises(ValueError, match=r"skin\.around"):
        jax.eval_shape(lambda angle: forward(whole, Loads.patch(angle, 0.0, 1.0, 6e-3)), 0.1)


def test_the_discs_of_a_scene_are_its_loads() -> None:
    down = {"kind": "patch", "angle": "20 deg", "axial": "-5 mm", "force": "3 N"}
    down |= {"direction": "vertical", "tilt": "10 deg", "diameter": "8 mm"}
    turned = {**down, "direction": "15 deg", "angle": "-40 deg", "tilt": "0 deg"}
    table = {"geometry": {**GEOMETRY, "ends": "clamped"}, "material": EPDM}
    table |= {"oil": {"model": "incompressible"}, "load": [down, turned, PRESSURE]}
    spec = scene_from_dict(table)
    found, parts = loads_of(spec), scene_parts(spec, continuous_inputs(spec))
    section = parts.skin.geometry.section
    for own, other in zip(found.patches(), parts.forces, strict=True):
        np.testing.assert_allclose(own.direction(section), other.direction(section), atol=1e-15)
        np.testing.assert_array_equal(own.axial, other.axial)
        assert float(own.diameter[0]) == 8e-3
    assert float(found.external_pressure[0]) == 500.0
    square = {k: v for k, v in down.items() if k != "diameter"} | {"size": ["6 mm", "6 mm"]}
    with pytest.raises(ValueError, match="round patches"):
        loads_of(scene_from_dict({**table, "load": [square]}))


@pytest.mark.long  # two programs as users have them; halves in test_lanes
def test_many_lanes_are_those_of_few(pad: object) -> None:
    """Half of them in a second thread, and chunk by chunk; an odd number of them."""
    some = loads(lanes=513)
    found, picked = forward(pad, some), np.array([0, 61, 256, 257, 512])
    few = jax.tree.map(lambda x: x[..., picked] if x.shape[-1] == 513 else x, some)
    alone = forward(pad, few)
    assert found.so.shape == (4, 513)
    np.testing.assert_allclose(found.so[:, picked], alone.so, rtol=1e-8)
    np.testing.assert_array_equal(found.result, 0)


def test_the_error_of_the_model_is_bounded_and_named() -> None:
    skin = skin_of(a_scene())
    problem = skin.problem(Loads.line(0.3, [0.0, *6 * [10.0]]))
    shape = problem.mechanics.rest().shape[:2]
    q = np.zeros((*shape, 7))
    q[1, 8:20] = -2e-4 * np.array([0, 1, 1, 1, 1, 1, 1])
    pressure, factor = jnp.array([0.0, 2e3, 2e3, 2e3, 1e-3, 2e3, 2e3]), jnp.ones(7)
    root = State(jnp.asarray(q), pressure, factor)
    # At rest, in displacement, in pressure, through the wall, of a pressure that is none; in
    # displacement below the limit and above it.
    change = np.zeros_like(q)
    change[1, 16] = [0, 2e-5, 0, -5.5e-3, 0, 6e-5, 8e-5]
    more = jnp.array([0.0, 0.0, 2e3, 0.0, 1.0, 0.0, 0.0])
    shown = State(root.q + change, pressure + more, factor)
    judged = quick(bounded)
    found = judged(problem, root, shown, jnp.zeros(7, jnp.int32))
    floor = problem.mechanics.omitted_floor
    expected = [floor, floor + 0.4 * 0.1 + 0.01, floor + 0.4 + 1.0]
    np.testing.assert_allclose(found.error[:3], expected, rtol=1e-12)
    assert [NAMES[k] for k in found.result] == [
        "converged",
        "converged",
        "beyond_model",
        "beyond_model",
        "converged",
        "converged",
        "beyond_model",
    ]
    assert floor + 0.08 <= found.error[4] < 0.1
    free = dataclasses.replace(problem, mechanics=problem.mechanics.with_wall(None))
    through = found.error[3] - judged(free, root, shown, found.result).error[3]
    assert float(through) > 0.1


# The field in the film.

charge = quick(wall_charge, jax.jit)


def film(angle: np.ndarray, gap: Callable[[np.ndarray], np.ndarray], wall: float) -> Film:
    return Film(
        jnp.asarray(angle)[:, None], jnp.asarray(gap(angle))[:, None], jnp.array([wall])
    )


@pytest.mark.long  # `forward` of an ellipse; the verdict is that of single scenes
def test_a_state_that_loads_buckle_is_named_and_one_beside_it_is_not() -> None:
    # An ellipse 70 mm high sways under 2.6 to 2.7 N at its crown.
    high = GEOMETRY | {"section": "ellipse", "inner_semi_axes": ["57.5 mm", "70 mm"]}
    high.pop("inner_radius")
    scene = scene_from_dict(
        {
            "geometry": high,
            "material": EPDM,
            "oil": {"model": "incompressible", "relative_permittivity": 2.2},
            "electrodes": LIST,
        }
    )
    angle, force = np.array([0.0, 0.0, 0.1]), np.array([2.6, 2.7, 2.7])
    found = run(skin_of(scene), Loads.line(angle, force))
    named = [NAMES[i] for i in np.asarray(found.result)]
    assert named == ["converged", "unstable", "converged"]


def test_field_between_coaxial_cylinders() -> None:
    angle = np.linspace(-1, 1, 81)
    found = charge(film(angle, lambda a: np.full_like(a, 5e-3), 0.0525), np.ones(81, bool))
    assert float(found.sum()) == pytest.approx(2 / np.log(57.5 / 52.5), rel=1e-12)


def test_field_between_eccentric_cylinders_converges_with_the_square_of_the_step() -> None:
    a, b, c = 0.0525, 0.0575, 0.003

    def gap(angle: np.ndarray) -> np.ndarray:
        return c * np.cos(angle) + np.sqrt(b**2 - (c * np.sin(angle)) ** 2) - a

    exact = np.pi / np.arccosh((a**2 + b**2 - c**2) / (2 * a * b))
    errors = []
    for n in (80, 160):
        angle = np.linspace(0, np.pi, n + 1)
        found = charge(film(angle, gap, a), np.ones(n + 1, bool))
        errors.append(float(found.sum()) / exact - 1)
    assert abs(errors[1]) < 3e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


def test_a_bare_strip_gathers_the_field_beyond_its_edges() -> None:
    # Half of a strip line: conformal map, C = 2 K(k) / K(k'), k = tanh(pi w / (4 d)).
    from scipy.special import ellipk

    k = np.tanh(np.pi * 6 / (4 * 5))
    exact = 2 * ellipk(k**2) / ellipk(1 - k**2)
    wall, n = 1e3, 160
    angle = np.linspace(-0.03, 0.03, n + 1) / wall
    driven = np.abs(angle * wall) <= 0.003 + 1e-9
    found = charge(film(angle, lambda a: np.full_like(a, 5e-3), wall), driven)
    # Fifth degree resolves the edges to 1.5 %; degree 16 on a finer mesh to 0.2 %.
    assert float(found.sum()) == pytest.approx(exact, rel=0.02)
    assert exact > 1.7 * 6 / 5


def test_formulas_against_the_field(pad: object, batch: SensorOutput) -> None:
    state = jax.tree.map(lambda x: x[..., 4:5], batch.state)
    lane = jax.tree.map(lambda x: x[..., 4:5], loads())

    find = quick(lambda held, m, q: field_capacitance(held, m, q, 360))
    field = np.asarray(find(pad.electrodes, pad.problem(lane).mechanics, state.q))[:, 0] - 3e-15
    plate = np.asarray(batch.readings.capacitance)[:, 4] - 3e-15
    # The parallel plate is low by half the gap over the radius; the concentric formula is
    # right but for the slope of the gap.
    assert np.all((plate < field) & (plate > 0.92 * field))
    gap = np.asarray(batch.readings.gap)[:, 4]
    factor = gap / (0.0525 * np.log1p(gap / 0.0525))
    np.testing.assert_allclose(plate * factor, field, rtol=1e-2)


def test_numbers_of_a_skin_may_be_inputs_of_a_program() -> None:
    """Of a program that takes all of a skin, its plain numbers are arrays without lanes."""
    spec = load_skin(PAD.with_stem("suas"))
    arrays, static = eqx.partition(skin_of(spec, contact=False, elements=8), eqx.is_array_like)

    def so(arrays: object) -> object:
        return forward(eqx.combine(arrays, static), Loads.line(0.1, 5.0)).so

    assert jax.eval_shape(so, arrays).shape == (8, 1)
