"""What a skin carries before anything touches it: warmth, water, filling, mounting."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fitting.datasheet.sheet import data_sheet
from fitting.force_range.bound import force_range
from fitting.inverse_load.model.evaluation import NoRestError
from suas_jax.config import (
    LAWS,
    AeratedOilSpec,
    CompressibleOilSpec,
    SceneSpec,
    continuous_inputs,
    input_errors,
    scene_from_dict,
    with_solve,
)
from suas_jax.config.errors import ConfigError
from suas_jax.config.input_errors import as_assembled, value_of
from suas_jax.config.tolerance import deviation_of
from suas_jax.constitutive.deformation import HeldFibre, LogStretches, PlaneStrain
from suas_jax.constitutive.laws.ogden import Ogden
from suas_jax.equilibrium import load_path
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.load_path import settled
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.mechanics.solid.points import free_strain
from suas_jax.scene.build import problem_of
from suas_jax.scene.gradient import gradient
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import prepared
from suas_jax.scene.solve import report_with, solve
from suas_jax.scene.sway import stressed_last
from suas_jax.scene.sweep import sweep
from suas_jax.skin.prestress import ContainedOil, Growth, Prestress, is_prestressed
from suas_jax.skin.registry import build_oil
from tests.skins import EPDM, GEOMETRY, find, line, status
from tests.skins import problem_of as problem_on

RUBBER, WALL, OIL = 1.6e-4, 7e-5, 9.6e-4  # expansions [1/K]
# A clamped half-cylinder buckles in an antisymmetric mode, which keeps the oil's volume.
RADIUS, THICKNESS, MODULUS = 0.05825, 0.0015, 32.6e6
BUCKLING = 8 * MODULUS * THICKNESS**3 / 3 / RADIUS**2  # hoop force [N/m]


def skin(
    *loads: dict[str, Any],
    fill: float = 1.0,
    mounting: float = 0.0,
    warming: float = 0.0,
    depth: float = 0.0,
    pressure: float = 0.0,
    expansions: tuple[float, float, float] = (RUBBER, WALL, OIL),
    model: str = "shell",
    **solid: Any,
) -> SceneSpec:
    """The paper's skin with everything named that gives it stress: all share one program."""
    rubber, wall, oil = expansions
    numbers = {"mesh": [100, 2]} if model == "solid" else {"elements": 32}
    loads = (*loads, {"kind": "pressure", "pressure": f"{pressure!r} Pa"})
    return scene_from_dict(
        {
            "geometry": {**GEOMETRY, "mounting": mounting},
            "material": EPDM | {"expansion": f"{rubber!r} / K", "bulk_modulus": "1e9 GPa"},
            "wall": {"expansion": f"{wall!r} / K", "bulk_modulus": "1e9 GPa"},
            "oil": {
                "model": "compressible",
                "bulk_modulus": "1 GPa",
                "fill": fill,
                "expansion": f"{oil!r} / K",
            },
            "environment": {"temperature": f"{20 + warming!r} degC", "depth": f"{depth!r} m"},
            "load": loads,
            "solve": {"model": model} | numbers | solid,
        }
    )


@functools.cache
def report(**changes: Any) -> dict[str, Any]:
    """The report of a skin under 5 N at the crown."""
    return solve(skin(line(0, changes.pop("force", 5.0)), **changes)).report


@pytest.mark.long  # a program without stress beside that with it
def test_a_skin_that_fits_is_the_one_without_stress() -> None:
    oil = {"model": "compressible", "bulk_modulus": "1 GPa"}
    loads = [line(0, 5), {"kind": "pressure", "pressure": "0 Pa"}]
    tables = {"geometry": GEOMETRY, "material": EPDM, "oil": oil, "load": loads}
    own = solve(scene_from_dict({**tables, "solve": {"model": "shell", "elements": 32}})).report
    assert "rest" not in own
    for key in ("oil_pressure_Pa", "strain_energy_J", "max_displacement_m", "stretch_max"):
        assert report()[key] == pytest.approx(own[key], rel=1e-9)
    assert report()["rest"]["max_displacement_m"] < 1e-15


def test_water_is_the_same_by_its_depth_and_by_its_pressure() -> None:
    """Rubber and wall keep their volume; 300 m of water squeeze the oil by 0.3 %."""
    water = 10.051e3 * 300
    deep, pressed = report(depth=300.0), report(pressure=water)
    assert deep["loads"][0]["displacement_m"] > 1.1 * report()["loads"][0]["displacement_m"]
    assert deep["oil_pressure_Pa"] + water == pytest.approx(
        pressed["oil_pressure_Pa"], rel=1e-9
    )
    for key in ("strain_energy_J", "max_displacement_m", "min_gap_m", "stretch_max"):
        assert deep[key] == pytest.approx(pressed[key], rel=1e-9)


@pytest.mark.parametrize(("depth", "force"), [(1000.0, 4.0), (2000.0, -10.0)])
def test_water_that_buckles_a_skin_at_rest_is_the_same_where_loads_hold_it(
    depth: float, force: float
) -> None:
    """1000 m squeeze the oil by 1 %, from whose rest no path leads to the second force."""
    deep = report(depth=depth, force=force)
    pressed = report(pressure=10.051e3 * depth, force=force)
    assert not deep["rest"]["stable"]
    for found in (deep, pressed):
        assert found["status"] == "converged"
        assert found["stable"]
        assert found["error_estimate"] < 2e-3
    assert "Without its loads the skin buckles" in deep["message"]
    for key in ("strain_energy_J", "max_displacement_m", "min_gap_m", "stretch_max"):
        assert deep[key] == pytest.approx(pressed[key], rel=1e-8)


@pytest.mark.long  # the program of a pad; the section's in the tests above
def test_water_on_a_pad_is_the_same_by_its_depth_and_by_its_pressure() -> None:
    water = 10.051e3 * 300
    patch = {"kind": "patch", "size": ["6 mm", "6 mm"], "force": "6 N", "angle": "0 deg"}

    def pad(depth: float, pressure: float) -> dict[str, Any]:
        table = {
            "geometry": {**GEOMETRY, "ends": "clamped"},
            "material": EPDM | {"bulk_modulus": "1e9 GPa"},
            "wall": {"bulk_modulus": "1e9 GPa"},
            "oil": {"model": "compressible", "bulk_modulus": "1 GPa"},
            "environment": {"depth": f"{depth!r} m"},
            "load": [patch, {"kind": "pressure", "pressure": f"{pressure!r} Pa"}],
            "solve": {"model": "shell", "elements": [16, 12]},
        }
        return solve(scene_from_dict(table)).report

    deep, pressed, dry = pad(300.0, 0.0), pad(0.0, water), pad(0.0, 0.0)
    assert deep["max_displacement_m"] > 1.02 * dry["max_displacement_m"]
    assert deep["oil_pressure_Pa"] + water == pytest.approx(
        pressed["oil_pressure_Pa"], rel=1e-8
    )
    for key in ("strain_energy_J", "max_displacement_m", "min_gap_m"):
        assert deep[key] == pytest.approx(pressed[key], rel=1e-6)


def ball_on_pad(**oil: float) -> SceneSpec:
    """A ball pressed into a pad on a coarse mesh."""
    ball = {"kind": "body", "shape": "sphere", "radius": "10 mm", "depth": "1 mm"}
    table = {
        "geometry": {**GEOMETRY, "ends": "clamped"},
        "material": EPDM,
        "oil": {"model": "incompressible", **oil},
        "load": [ball | {"angle": "0 deg"}],
        "solve": {"model": "shell", "elements": [8, 6]},
    }
    return scene_from_dict(table)


def test_rest_is_sought_of_a_pad_that_carries_stress_under_a_body() -> None:
    spec = ball_on_pad(fill=1.0005)
    known = prepared(spec, "shell", (8, 6))
    problem = problem_of(scene_parts(spec, known.inputs), known.meshes.solved, wall=False)
    rest = jax.eval_shape(lambda: settled(problem, 1, LoadStepping()))
    assert rest.y.stations.shape == (*known.meshes.solved.unknowns_shape, 1)


@pytest.mark.long  # two programs of a pad
def test_a_pad_that_fits_is_pressed_by_a_body_as_one_without_stress() -> None:
    plain, filled = (solve(ball_on_pad(**oil)).report for oil in ({}, {"fill": 1.0}))
    assert filled["rest"]["stable"]
    for key in ("oil_pressure_Pa", "strain_energy_J", "max_displacement_m", "min_gap_m"):
        assert filled[key] == pytest.approx(plain[key], rel=1e-8)


def test_less_oil_softens_and_more_stiffens() -> None:
    """Three thousandths of the film: 11 % of the displacement, by an independent solve."""
    moved = [report(fill=x)["loads"][0]["displacement_m"] for x in (0.997, 1.0, 1.003)]
    assert moved[0] / moved[1] == pytest.approx(1.111, abs=2e-3)
    assert moved[2] / moved[1] == pytest.approx(0.894, abs=2e-3)


def test_equal_expansions_leave_no_stress() -> None:
    warming, linear = 40.0, 1.6e-4
    by_volume = ((1 + linear * warming) ** 3 - 1) / warming
    found = report(force=0.0, warming=warming, expansions=(linear, linear, by_volume))
    assert found["stretch_min"] == pytest.approx(1, abs=1e-12)
    assert found["stretch_max"] == pytest.approx(1, abs=1e-12)
    assert abs(found["oil_pressure_Pa"]) < 1e-12 * MODULUS
    assert found["max_displacement_m"] < 1e-12 * RADIUS


def test_a_membrane_mounted_too_long_buckles_at_the_closed_form() -> None:
    """N = 4 mu t e in plane strain; e = 2 t^2 / (3 R^2) buckles the clamped half-cylinder."""
    mismatch = 2e-4
    rest = report(force=0.0, mounting=mismatch)["rest"]
    assert rest["hoop_force_N_per_m"] == pytest.approx(
        -4 * MODULUS * THICKNESS * mismatch, rel=0.02
    )
    assert rest["buckling_share"] == pytest.approx(
        -rest["hoop_force_N_per_m"] / BUCKLING, rel=0.01
    )
    assert rest["stable"]
    critical = 2 * THICKNESS**2 / (3 * RADIUS**2)
    for share, stable in ((0.95, True), (1.05, False)):
        found = report(force=0.0, mounting=share * critical)
        assert found["rest"]["stable"] == stable
        assert found["status"] == ("converged" if stable else "unstable")
        assert found["stable"] == stable


def test_a_membrane_comes_to_its_free_size_step_by_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At its full size at once a spline 0.4 % too long ended in a buckled state."""
    sizes = []

    def stepped(fn: Any, known: Any, mechanics: Any, y: Any, *_: Any) -> load_path.Found:
        sizes.append(float(mechanics.growth.hoop[0]))
        none = jnp.zeros(1, jnp.int32)
        return load_path.Found(y, jnp.zeros(1), none, none + 1, jnp.ones(1), none)

    monkeypatch.setattr(load_path, "_stepped", stepped)
    monkeypatch.setattr(load_path, "residual", lambda problem, y, level: (y, None))
    problem = problem_on(skin(mounting=4e-3), 8)
    with jax.disable_jit():
        rest = settled(problem, 1, LoadStepping())
    assert problem.mechanics.growth is not None
    full = float(problem.mechanics.growth.hoop[0])
    np.testing.assert_allclose(sizes, full * np.array([0.25, 0.5, 0.75, 1]), rtol=1e-12)
    assert rest.iterations[0] == 4


def test_a_membrane_mounted_too_short_stiffens_the_skin() -> None:
    rest = report(mounting=-5e-4)["rest"]
    assert rest["hoop_force_N_per_m"] > 0
    assert rest["buckling_share"] < 0
    assert rest["stiffness_change"] > 0.2
    assert report(mounting=-5e-4)["max_displacement_m"] < report()["max_displacement_m"]


@pytest.mark.long  # programs of curves; those of other curves are tested beside
def test_a_curve_over_oil_pressures_goes_on_above_the_one_at_rest() -> None:
    scene = skin(line(0, 5.0), fill=1.003)
    rest = solve(skin(fill=1.003)).report["oil_pressure_Pa"]
    wanted = rest * np.array([0.0, 0.5, 1.2, 1.5])
    points = sweep(scene, oil_pressures=wanted).points
    states = [point["status"] for point in points]
    assert states == ["converged", "unreachable_pressure", "converged", "converged"]
    np.testing.assert_allclose([p["oil_pressure_Pa"] for p in points[2:]], wanted[2:])
    force = points[3]["loads"][0]["force_N"]
    again = solve(skin(line(0, force), fill=1.003)).report
    assert again["oil_pressure_Pa"] == pytest.approx(wanted[3], rel=1e-6)


def test_no_reversed_load_reaches_a_pressure_for_a_skin_that_buckles_at_rest() -> None:
    critical = 2 * THICKNESS**2 / (3 * RADIUS**2)
    wanted = with_solve(skin(line(-24, 1.0), mounting=1.05 * critical), oil_pressure=50.0)
    found = find(problem_on(wanted, 32))
    assert float(found.state.factor[0]) < 0  # the path from rest leads there
    assert status(found) == "unreachable_pressure"


@pytest.mark.long  # programs of curves; its state at rest is named below
def test_no_force_has_a_range_on_a_skin_that_buckles_at_rest() -> None:
    buckled = skin(mounting=5e-3).model_dump(exclude_unset=True, by_alias=True)
    buckled["oil"]["relative_permittivity"] = 2.2
    electrodes = {"taxels": [{"angle": "-20 deg"}, {"angle": "20 deg"}], "noise": 2.0}
    spec = SceneSpec(**buckled | {"electrodes": electrodes}).skin
    with pytest.raises(NoRestError):
        force_range(spec, 3)
    with pytest.raises(NoRestError):
        data_sheet(spec, (5, 5))


@pytest.mark.long  # the solid's program; of the mechanics the states of strain are compared
def test_shell_and_solid_agree_under_stress() -> None:
    for changes in ({"warming": -20.0}, {"mounting": -1e-3, "fill": 0.995}):
        shell = report(**changes)
        solid = report(**changes, model="solid", mesh=(200, 2))
        moved = [x["loads"][0]["displacement_m"] for x in (shell, solid)]
        assert moved[0] == pytest.approx(moved[1], rel=1e-3)
        assert shell["oil_pressure_Pa"] == pytest.approx(solid["oil_pressure_Pa"], rel=1e-3)


@pytest.mark.long  # a program of derivatives, and solves of fine steps
def test_derivatives_are_those_of_differences() -> None:
    path = "loads.0.displacement_m"
    known = {"fill": 0.998, "mounting": -2e-4, "warming": -5.0, "depth": 50.0}
    slopes = gradient(solve(skin(line(0, 5), **known)), path)
    steps = {
        "oil.fill": ("fill", 1e-5),
        "geometry.mounting": ("mounting", 1e-6),
        "environment.temperature": ("warming", 1e-2),
        "environment.depth": ("depth", 1.0),
    }
    for key, (name, step) in steps.items():
        ends = [
            report(**(known | {name: known[name] + side * step}))["loads"][0]["displacement_m"]
            for side in (-1, 1)
        ]
        assert slopes[key] == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-5)


def test_every_quantity_is_an_input() -> None:
    wanted = {
        "oil.fill",
        "oil.expansion",
        "material.expansion",
        "material.bulk_modulus",
        "wall.expansion",
        "wall.bulk_modulus",
        "geometry.mounting",
        "environment.temperature",
        "environment.depth",
    }
    assert wanted <= set(continuous_inputs(skin()))


def test_what_is_not_named_costs_nothing() -> None:
    tables = {"geometry": GEOMETRY, "material": EPDM}
    water = {"environment": {"depth": "300 m", "temperature": "4 degC"}}
    for model in ("vented", "incompressible"):
        assert not is_prestressed(scene_from_dict({**tables, "oil": {"model": model}, **water}))
    stiff = {"model": "compressible", "bulk_modulus": "1 GPa"}
    assert not is_prestressed(scene_from_dict({**tables, "oil": stiff}))
    assert is_prestressed(scene_from_dict({**tables, "oil": stiff, **water}))


def prestress(spec: SceneSpec) -> Prestress:
    """That of a scene with its own numbers."""
    numbers = continuous_inputs(spec) | {
        "reference.temperature": spec.reference.temperature,
        "reference.pressure": spec.reference.pressure,
        "environment.specific_weight": 10.051e3,
        "environment.atmospheric_pressure": 101.3e3,
    }
    return Prestress.of(spec, lambda path: jnp.array([numbers[path]]))


def test_free_sizes_are_those_of_the_closed_form() -> None:
    """A free ring: (1 + alpha dT) (1 - dP / 3K), and of the wall the same."""
    table = {
        "geometry": GEOMETRY | {"mounting": "0.1 %"},
        "material": EPDM | {"expansion": "1.6e-4 / K", "bulk_modulus": "2 GPa"},
        "wall": {"expansion": "7e-5 / K", "bulk_modulus": "3 GPa"},
        "oil": {"model": "compressible", "bulk_modulus": "1.1 GPa"},
        "environment": {"depth": "300 m", "temperature": "4 degC"},
    }
    found = prestress(scene_from_dict(table))
    rise = 300 * 10.051e3
    rubber = (1 - 16 * 1.6e-4) * (1 - rise / 6e9)
    wall = (1 - 16 * 7e-5) * (1 - rise / 9e9)
    assert found.growth is not None
    assert float(jnp.exp(found.growth.radial)[0]) == pytest.approx(rubber / wall, rel=1e-14)
    assert float(jnp.exp(found.growth.hoop)[0]) == pytest.approx(1.001 * rubber / wall)
    assert float(found.growth.axial[0]) == pytest.approx(float(found.growth.radial[0]))
    assert found.scale is not None
    assert float(found.scale[0]) == pytest.approx(wall, rel=1e-14)


def oil_of(spec: CompressibleOilSpec | AeratedOilSpec) -> Any:
    """The model of an oil."""
    return build_oil(spec, lambda key: jnp.asarray(getattr(spec, key))[None])


def test_sealed_oil_follows_the_closed_form() -> None:
    """Volume fill (1 + beta dT) exp(-(p + dP)/K) of the film's when it was closed."""
    oil = ContainedOil(
        oil_of(CompressibleOilSpec(bulk_modulus=1e9)),
        jnp.log(jnp.array([0.998 * (1 + 9.6e-3)])),
        jnp.array([3e6]),
    )
    film, p = jnp.array([9e-4]), jnp.array([2e5])
    wanted = 9e-4 * (0.998 * (1 + 9.6e-3) * np.exp(-3.2e6 / 1e9) - 1)
    np.testing.assert_allclose(oil.expansion(p, film), wanted, rtol=1e-12)
    np.testing.assert_allclose(oil.compliance(p, film), -(9e-4 + wanted) / 1e9, rtol=1e-12)


def test_air_in_the_oil_grows_with_the_absolute_temperature() -> None:
    plain = oil_of(AeratedOilSpec(air_fraction=0.02, bulk_modulus=1e30))
    warm, volume = plain.warmed(jnp.log(jnp.array([1.0096])), jnp.array([303.15 / 293.15]))
    oil, p = ContainedOil(warm, volume, jnp.zeros(1)), 5e4
    wanted = 0.98 * 1.0096 + 0.02 * 303.15 / 293.15 * 101.3e3 / (101.3e3 + p)
    np.testing.assert_allclose(
        oil.expansion(jnp.array([p]), jnp.ones(1)), wanted - 1, rtol=1e-12
    )


GROWTH = Growth(jnp.array([2e-3]), jnp.array([-1e-3]), jnp.array([4e-3]))


@pytest.mark.parametrize("stretch", [0.7, 1.0, 1.3])
def test_laws_see_the_stretch_less_the_growth(stretch: float) -> None:
    """A fibre of the shell and a point of the solid against the three principal stretches."""
    law = Ogden([6.3e5, 0.012e5, -0.1e5], [1.3, 5.0, -2.0])
    h, a, r = (float(x[0]) for x in (GROWTH.hoop, GROWTH.axial, GROWTH.radial))
    hoop, axial = stretch / np.exp(h), np.exp(-a)
    wanted = law.energy(LogStretches(jnp.log(hoop), jnp.log(1 / hoop / axial)))
    fibre = HeldFibre(jnp.array(hoop**2 * axial - 1), jnp.array(-a))
    np.testing.assert_allclose(law.energy(fibre), wanted, rtol=1e-10)
    turn = 0.4
    t, n = np.array([np.cos(turn), -np.sin(turn)]), np.array([np.sin(turn), np.cos(turn)])
    across = np.exp(h + a + r) / stretch
    f = stretch * np.outer(t, t) + across * np.outer(n, n)
    free = np.array(jax.tree.map(lambda x: float(x[0]), free_strain(GROWTH, t[:, None])))
    state = PlaneStrain.from_displacement_gradient(
        jnp.asarray(f @ (np.eye(2) + free) - np.eye(2))
    )
    np.testing.assert_allclose(law.energy(state), wanted, rtol=1e-10)
    assert float(state.dilatation) == pytest.approx(np.expm1(3 * a), rel=1e-9)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"oil": {"model": "vented", "fill": 0.99}}, "oil.fill"),
    ({"oil": {"model": "incompressible", "fill": 0}}, "oil.fill"),
    ({"geometry": GEOMETRY | {"mounting": "80 %"}}, "geometry.mounting"),
    ({"geometry": GEOMETRY | {"mounting_axial": "0.1 %"}}, "geometry.mounting_axial"),
    ({"environment": {"temperature": "-300 degC"}}, "environment.temperature"),
    ({"environment": {"temperature": "4"}}, "environment.temperature"),
    ({"wall": {"expansion": "7e-5 mm"}}, "wall.expansion"),
    (
        {"wall": {"expansion": "0.01 / K"}, "environment": {"temperature": "90 degC"}},
        "wall.expansion",
    ),
    (
        {"wall": {"bulk_modulus": "1 MPa"}, "environment": {"depth": "300 m"}},
        "wall.bulk_modulus",
    ),
    ({"reference": {"pressure": "-1 Pa"}}, "reference.pressure"),
]


@pytest.mark.parametrize(("change", "key"), WRONG)
def test_what_can_t_be_is_refused_by_its_key(change: dict[str, Any], key: str) -> None:
    table = {"geometry": GEOMETRY, "material": EPDM, "oil": {"model": "incompressible"}}
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        scene_from_dict(table | change)


def test_temperatures_are_read_in_celsius_and_kelvin() -> None:
    def read(text: str) -> float:
        table = {"geometry": GEOMETRY, "material": EPDM, "oil": {"model": "incompressible"}}
        spec = scene_from_dict(table | {"environment": {"temperature": text}})
        assert spec.environment is not None
        assert spec.environment.temperature is not None
        return spec.environment.temperature

    assert read("20 degC") == read("293.15 K") == read("20 °C") == 293.15
    assert read("20 degC +- 5 K").deviation == 5.0  # type: ignore[attr-defined]


def test_a_substance_brings_its_typical_figures_and_their_deviation() -> None:
    table = {
        "geometry": GEOMETRY,
        "material": EPDM | {"expansion": "EPDM"},
        "oil": {"model": "compressible", "bulk_modulus": "silicone-oil"},
        "wall": {"expansion": "PLA"},
    }
    spec = scene_from_dict(table)
    assert spec.wall.expansion == 7e-5
    assert len(input_errors(spec)) == 3  # the defaults: nothing is warm or deep
    warm = scene_from_dict(table | {"environment": {"temperature": "30 degC"}})
    assert {"material.expansion", "oil.bulk_modulus"} <= set(input_errors(warm).names)
    with pytest.raises(ConfigError, match='"PLA", "PETG"'):
        scene_from_dict(table | {"wall": {"expansion": "silicone-oil"}})


def test_an_assembly_is_doubted_where_its_file_is_silent() -> None:
    table = {
        "geometry": GEOMETRY,
        "material": EPDM | {"expansion": "EPDM"},
        "oil": {"model": "incompressible"},
    }
    plain = scene_from_dict(table)
    silent = as_assembled(plain)
    errors = input_errors(silent)
    sizes = dict(zip(errors.names, np.abs(errors.directions).max(1), strict=True))
    assert sizes["oil.fill"] == 3e-3
    assert sizes["geometry.mounting"] == 5e-4
    assert sizes["environment.temperature"] == 5.0
    assert value_of(errors.spec, "environment.temperature") == 293.15
    assert set(input_errors(plain).names) < set(errors.names)
    told = as_assembled(
        scene_from_dict(table | {"oil": {"model": "incompressible", "fill": "0.998 +- 0.001"}})
    )
    assert (told.oil.fill, deviation_of(told.oil.fill)) == (0.998, 1e-3)
    exact = scene_from_dict(table | {"geometry": GEOMETRY | {"thickness": "1.5 mm +- 0"}})
    assert as_assembled(exact) is exact
    vented = as_assembled(scene_from_dict(table | {"oil": {"model": "vented"}}))
    assert "oil.fill" not in input_errors(vented).names


@pytest.mark.parametrize(("hardness", "modulus"), [("60 A", 1.2e6), ("90 A", 6.94e6)])
def test_a_hardness_is_a_first_guess_of_the_modulus(hardness: str, modulus: float) -> None:
    table = {"geometry": GEOMETRY, "oil": {"model": "incompressible"}}
    spec = scene_from_dict(table | {"material": {"shore": hardness}})
    assert isinstance(spec.material, LAWS["neo-hookean"])
    assert spec.material.mu == pytest.approx(modulus, rel=0.01)
    assert spec.material.mu.deviation == pytest.approx(0.5 * spec.material.mu)
    for wrong in ({"shore": "60 D"}, {"shore": 60}, {"shore": "60 A", "preset": "epdm-paper"}):
        with pytest.raises(ConfigError, match=r"material\.shore"):
            scene_from_dict(table | {"material": wrong})


def under_a_cylinder(angle: float, depth: str, temperature: float) -> SceneSpec:
    """A skin that its own warmth presses along the arc: beyond 24 degrees it sways at rest."""
    body = {"kind": "body", "shape": "cylinder", "radius": "10 mm", "depth": depth}
    tables = {
        "geometry": GEOMETRY,
        "material": {"law": "neo-hookean", "mu": "10 MPa", "expansion": f"{RUBBER!r} / K"},
        "oil": {"model": "incompressible", "expansion": f"{OIL!r} / K"},
        "environment": {"temperature": f"{temperature!r} degC"},
        "load": [body | {"angle": f"{angle!r} deg"}],
    }
    return with_solve(scene_from_dict(tables), model="shell", elements=32)


def ended(name: str) -> Any:
    """What a program ends with: an outcome, and where it started from."""
    return [name, None, None, name, {"result": np.array([index_of(name)])}]


@pytest.mark.parametrize(("reach", "runs"), [(1 / 16, 17), (1 / 40, 64 + 3)])
def test_bodies_come_before_the_stress_where_the_way_from_rest_is_lost(
    reach: float, runs: int
) -> None:
    """In steps of the stress that are made shorter where one leads nowhere."""
    scene = under_a_cylinder(20, "1 mm", 28.0)
    inputs = {k: np.asarray(x) for k, x in continuous_inputs(scene).items()}
    cold, warm = (x + 273.15 for x in (20.0, 28.0))
    tried, last = [], [cold]

    def run(inputs: Any, start: Any) -> Any:
        at = float(inputs["environment.temperature"])
        tried.append((at, start))
        if at - last[-1] > 1.01 * reach * (warm - cold):
            return ended("no_convergence")
        last.append(at)
        return ended("converged")

    rest: Any = "rest"
    found = stressed_last(scene, inputs, rest, run, ended("no_convergence"))
    assert found[0] == "converged"
    assert tried[0] == (cold, "rest")
    assert {start for _, start in tried[1:]} == {"converged"}
    assert tried[-1][0] == pytest.approx(warm, abs=1e-12)
    assert len(tried) == runs

    def never(*_: Any) -> Any:
        raise AssertionError("no other path leads past the wall")

    assert stressed_last(scene, inputs, rest, never, ended("squeezed"))[0] == "squeezed"


@pytest.mark.long  # a program for bodies
def test_a_body_holds_a_skin_whose_warmth_alone_would_make_it_sway() -> None:
    """The way from rest is lost at 24 degrees; forces fall on as the skin is warmed."""
    forces = [
        solve(under_a_cylinder(20, "1 mm", at)).report["loads"][0]["force_N"]
        for at in (22.0, 23.0, 24.0)
    ]
    assert np.diff(forces) == pytest.approx([-0.1049, -0.1042], rel=0.01)
    curve = sweep(under_a_cylinder(20, "1 mm", 24.0), depths=[0.0, 5e-4, 1e-3]).points
    assert [point["status"] for point in curve] == 3 * ["converged"]


@pytest.mark.long  # a program of derivatives
def test_derivatives_under_a_body_of_a_stressed_skin_are_those_of_differences() -> None:
    spec = under_a_cylinder(20, "2 mm", 22.0)
    found = solve(spec)
    slopes, inputs = gradient(found, "loads.0.force_N"), continuous_inputs(spec)
    for path in (
        "load.0.radius",
        "load.0.angle",
        "load.0.depth",
        "geometry.thickness",
        "geometry.oil_gap",
        "material.mu",
        "material.expansion",
        "oil.expansion",
        "environment.temperature",
    ):
        step = 1e-4 * inputs[path]
        ends = [
            report_with(found, {path: inputs[path] + side * step}, judged=True)
            for side in (-1, 1)
        ]
        low, high = (end["loads"][0]["force_N"] for end in ends if end is not None)
        assert slopes[path] == pytest.approx((high - low) / (2 * step), rel=1e-4)
