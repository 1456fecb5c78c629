"""Contacts on a pad to sensor output: lanes, and exact derivatives by any number."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from suas_jax.config import load_skin, scene_from_dict
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.forward import SensorOutput, forward, load_jacobian
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import skin_of
from suas_jax.scene.solve import solve

# A pad's forward model takes a minute to compile: its parts in test_pad_mechanics and
# test_pad_formulas, lanes of the section in test_skin.
pytestmark = pytest.mark.long

ROOT = Path(__file__).parent.parent
SHIPPED = ROOT / "configs" / "skins" / "suas-pad.toml"
CONTINUUM = ROOT / "tests" / "data" / "pad_continuum.csv"
MESH = (10, 8)
SCENE = {
    "geometry": {
        "inner_radius": "57.5 mm",
        "thickness": "4 mm",
        "half_angle": "60 deg",
        "width": "100 mm",
        "oil_gap": "3 mm",
        "ends": "clamped",
    },
    "material": {"law": "mooney-rivlin", "C1": "0.8 MPa", "C2": "0.2 MPa"},
    "oil": {"model": "incompressible", "relative_permittivity": 2.2},
    "electrodes": {
        "lsb": "0.1 fF",
        "taxels": [
            {"angle": "9 deg", "axial": "8 mm"},
            {"angle": "-31 deg", "axial": "-20 mm"},
        ],
    },
}
POKES = [[0.1, 0.012, 4.0], [-0.4, -0.02, 2.0]]  # angle, axial, force
DIAMETER = 0.012
INPUTS = {"geometry.thickness": 4e-3, "material.C2": 2e5, "oil.relative_permittivity": 2.2}
QUICK = {**OPTIONS, "xla_backend_optimization_level": 0}
Numbers = tuple[dict[str, jax.Array], Loads]


def scene(poke: list[float]) -> dict:
    angle, axial, force = poke
    patch = {
        "kind": "patch",
        "diameter": f"{DIAMETER} m",
        "angle": f"{angle} rad",
        "axial": f"{axial} m",
        "force": f"{force} N",
    }
    return SCENE | {"load": [patch], "solve": {"elements": list(MESH)}}


@pytest.fixture(scope="module")
def numbers() -> Numbers:
    return {k: jnp.asarray(v, float) for k, v in INPUTS.items()}, Loads.patch(
        *np.transpose(POKES), DIAMETER
    )


@pytest.fixture(scope="module")
def run(numbers: Numbers) -> Callable[[Numbers, Numbers], tuple[SensorOutput, SensorOutput]]:
    """Output and its derivative along a direction."""
    spec = scene_from_dict(scene(POKES[0]))
    mesh = skin_of(spec, elements=MESH, contact=False).around(numbers[1]).mesh

    def output(numbers: Numbers) -> SensorOutput:
        inputs, patches = numbers
        skin = skin_of(spec, inputs, elements=MESH, contact=False, mesh=mesh)
        return forward(skin, patches)

    def both(at: Numbers, along: Numbers) -> tuple[SensorOutput, SensorOutput]:
        return eqx.filter_jvp(output, (at,), (along,))

    return eqx.filter_jit(both, compiler_options=QUICK)


def test_a_lane_is_the_solved_scene(run: Callable, numbers: Numbers) -> None:
    output = run(numbers, jax.tree.map(jnp.zeros_like, numbers))[0]
    assert output.result.tolist() == [0, 0]
    report = solve(scene_from_dict(scene(POKES[1]))).report
    assert float(output.oil_pressure[1]) == pytest.approx(report["oil_pressure_Pa"], rel=1e-6)
    so = [taxel["so"] for taxel in report["taxels"]]
    # The scene's own disc has other points, beneath which the membrane thins.
    np.testing.assert_allclose(output.so[:, 1], so, rtol=1e-5)


def test_derivatives_are_the_differences(run: Callable, numbers: Numbers) -> None:
    sizes = (numbers[0], Loads.patch(0.5, 0.05, [4.0, 2.0], DIAMETER))
    signs = iter(np.random.default_rng(1).choice([-1.0, 1.0], 20))
    along = jax.tree.map(lambda x: next(signs) * x, sizes)
    # A point of a disc that crosses an element's edge bends readings: by 1e-3 of their slope.
    slope, h = run(numbers, along)[1], 1e-6
    low, high = (
        run(jax.tree.map(lambda a, d, s=s: a + s * h * d, numbers, along), along)[0]
        for s in (-1.0, 1.0)
    )
    for name in ("so", "oil_pressure", "min_gap"):
        expected = (getattr(high, name) - getattr(low, name)) / (2 * h)
        np.testing.assert_allclose(getattr(slope, name), expected, rtol=1e-5)


def test_load_jacobian_has_every_number_of_a_patch() -> None:
    skin = skin_of(scene_from_dict(scene(POKES[0])), elements=MESH, contact=False)
    loads = Loads.patch(*POKES[0], DIAMETER, 0.1, 0.05)
    skin = skin.around(loads)
    run, jacobian = (
        eqx.filter_jit(f, compiler_options=QUICK) for f in (forward, load_jacobian)
    )
    slopes, h = jacobian(skin, loads)[1], 1e-6
    names = ("angle", "force", "turn", "axial", "tilt", "diameter")
    assert slopes.shape == (len(names), 1, 2, 1)
    for name, slope in zip(names, slopes[:, 0], strict=True):
        high, low = (
            run(skin, dataclasses.replace(loads, **{name: getattr(loads, name) + by})).so
            for by in (h, -h)
        )
        np.testing.assert_allclose(slope, (high - low) / (2 * h), rtol=1e-4, atol=1e-4)


def test_readings_are_those_of_a_continuum() -> None:
    """Discs on the shipped pad, whose membrane another program solved with hexahedra.

    They are stiffer than finer ones by 0.2 to 0.5 %.
    """
    rows = np.loadtxt(CONTINUUM, delimiter=",", skiprows=4)
    skin = skin_of(load_skin(SHIPPED), contact=False)
    solve = eqx.filter_jit(forward, compiler_options=QUICK)
    for poke in ([33.0, 22.5, 6.1], [-13.4, -9.6, 14.0], [0.0, 31.4, 10.6]):
        ((_, _, _, pressure, *so),) = rows[(rows[:, :3] == poke).all(1)]
        angle, axial, force = np.array(poke) * [np.pi / 180, 1e-3, 1.0]
        patches = Loads.patch(angle, axial, force, 6e-3)
        found = solve(skin.around(patches), patches)
        assert not int(found.result[0])
        assert float(found.oil_pressure[0]) == pytest.approx(pressure, rel=0.01)
        film = 1 / np.array(so)  # nearly the gaps
        assert np.abs(1 / found.so[:, 0] - film).max() < 0.01 * np.ptp(film)
