"""Units, specifications, shipped files, and the continuous inputs of a scene."""

import math
import pathlib
import pickle
import subprocess
import sys
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from skins import GEOMETRY

from suas_jax.config import (
    CompressibleOilSpec,
    ConfigError,
    ElectrodesSpec,
    LineLoadSpec,
    MooneyRivlinSpec,
    SceneSpec,
    SolveSpec,
    continuous_inputs,
    format_quantity,
    load_preset,
    load_scene,
    load_skin,
    parse_quantity,
    preset_names,
    scene_from_dict,
    structure,
    with_inputs,
    with_solve,
)
from suas_jax.config.quantities import DIMENSIONS, to_si
from suas_jax.config.sections.circle import CircleSpec

CONFIGS = pathlib.Path(__file__).parent.parent / "configs"
SCENES = sorted((CONFIGS / "scenes").glob("*.toml"))
SKINS = sorted((CONFIGS / "skins").glob("*.toml"))


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("57.5 mm", "length", 57.5e-3),
        ("57.5mm", "length", 57.5e-3),
        (" 5.75e1 mm ", "length", 57.5e-3),
        ("5 µm", "length", 5e-6),  # micro sign
        ("5 μm", "length", 5e-6),  # Greek mu
        ("2 inches", "length", 0.0508),
        ("−4.4 MPa", "stress", -4.4e6),  # minus sign
        ("2 N/mm2", "stress", 2e6),
        ("2 N/mm^2", "stress", 2e6),
        ("2 N·mm⁻²", "stress", 2e6),
        ("1 kgf/cm2", "stress", 98066.5),
        ("1 bar", "pressure", 1e5),
        ("10.051 kN/m3", "specific weight", 10051.0),
        ("900 kg/m^3", "density", 900.0),
        ("0.305 fF", "capacitance", 3.05e-16),
        ("45 deg", "angle", math.pi / 4),
        ("45°", "angle", math.pi / 4),
        ("1 rad", "angle", 1.0),
        ("0 N", "force", 0.0),
        ("2.2", "number", 2.2),
        ("0.1 %", "number", 1e-3),
        ("60 mil", "length", 1.524e-3),
        ("16 ozf", "force", 4.4482216152605),
    ],
)
def test_parse_quantity(text, dimension, value):
    assert parse_quantity(text, dimension) == value


@pytest.mark.parametrize("unit", ["degC", "celsius", "°C", "degreeC"])
def test_every_name_of_celsius_and_fahrenheit_counts_from_its_zero(unit):
    fahrenheit = unit.replace("C", "F").replace("celsius", "fahrenheit")
    for celsius, also in ((0.0, 32.0), (100.0, 212.0), (-40.0, -40.0)):
        kelvin = pytest.approx(celsius + 273.15, abs=1e-12)
        assert parse_quantity(f"{celsius} {unit}", "temperature") == kelvin
        assert parse_quantity(f"{also} {fahrenheit}", "temperature") == kelvin
    assert parse_quantity(f"1.8 {fahrenheit}", "warming") == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "dimension", "text"),
    [
        (57.5e-3, "length", "57.5 mm"),
        (1.0, "length", "1 m"),
        (0.0, "length", "0 mm"),
        (math.pi / 2, "angle", "90 deg"),
        (1e-3, "angle", "0.0572958 deg"),
        (-4.4e6, "stress", "-4.4 MPa"),
        (3.05e-16, "capacitance", "0.305 fF"),
        (-2e-7, "length", "-0.2 um"),
        (2.2, "number", "2.2"),
    ],
)
def test_format_quantity(value, dimension, text):
    assert format_quantity(value, dimension) == text
    assert parse_quantity(text, dimension) == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize(
    "dimension", sorted(set(DIMENSIONS) - {"temperature"})
)  # zero is elsewhere
def test_a_unit_that_messages_show_is_read_back_as_it_was_meant(dimension):
    kind = DIMENSIONS[dimension]
    assert format_quantity(0.0, dimension) == f"0 {kind.usual}".strip()
    for name, size in kind.units:
        assert parse_quantity(f"1 {name}", dimension) == pytest.approx(size, rel=1e-15)
        assert format_quantity(size, dimension) == f"1 {name}".strip()


def test_quantities_beyond_all_measure_are_refused():
    assert parse_quantity("1" + 197 * " " + "mm", "length") == 1e-3  # 200 characters
    with pytest.raises(ValueError, match="has 201 characters"):
        parse_quantity("1" + 198 * " " + "mm", "length")
    with pytest.raises(ValueError, match="too large to compute with; a length"):
        parse_quantity("1e307 km", "length")
    with pytest.raises(ValueError, match="must be a finite number; a number"):
        to_si(10**400, "number")
    # A unit of length, but one of 1e-405 m: no number of these is told from zero.
    with pytest.raises(ValueError, match="unknown unit"):
        parse_quantity("1 fm9 fm9 fm9/m9/m9/m8", "length")


@settings(max_examples=300, deadline=None, database=None)
@given(st.text(max_size=12) | st.text("0123456789.,e+-/*^ ()mMkPaNdg°µ%", max_size=12))
def test_any_text_is_a_finite_quantity_or_an_explained_error(text):
    for dimension in DIMENSIONS:
        try:
            value = parse_quantity(text, dimension)
        except ValueError as error:
            explained = str(error)
        else:
            explained = "expected" if math.isfinite(value) else "not finite"
        assert "expected" in explained or "no comma" in explained


def test_every_shipped_file_is_covered():
    assert {path.stem for path in SKINS} == {
        *("suas", "suas-pad", "suas-rubber"),
        *("suas-ellipse", "suas-flat-topped"),
    }
    assert preset_names() == ["epdm-paper", "neo-hookean-epdm", "rubber-table1"]
    assert len(SCENES) == 17


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_shipped_scene_survives_a_round_trip(path):
    scene = load_scene(path)
    rebuilt = SceneSpec.model_validate(scene.model_dump(by_alias=True))
    assert rebuilt == scene
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene
    assert continuous_inputs(again) == continuous_inputs(scene)
    assert with_inputs(scene, continuous_inputs(scene)) == scene


@pytest.mark.parametrize("path", SKINS, ids=lambda path: path.stem)
def test_shipped_skin_loads(path):
    skin = load_skin(path)
    assert skin.geometry.oil_gap == 5e-3
    assert skin.electrodes is not None


def test_the_papers_skin_has_the_papers_numbers():
    scene = load_scene(CONFIGS / "scenes/case_b.toml")
    assert scene.geometry == CircleSpec(
        inner_radius=57.5e-3,
        thickness=1.5e-3,
        half_angle=math.pi / 2,
        width=0.123,
        oil_gap=5e-3,
    )
    own = scene.material.model_dump(include={"C1", "C2", "C3"})
    assert own == {"C1": 20.7e6, "C2": -4.4e6, "C3": 77e3}
    assert isinstance(scene.material, MooneyRivlinSpec)
    assert scene.loads == (LineLoadSpec(angle=math.pi / 4, force=20.7),)
    assert scene.solve == SolveSpec(model="shell", rtol=2e-3, oil_pressure=10e3)
    assert scene.skin == load_skin(CONFIGS / "skins/suas.toml")


@pytest.mark.parametrize("name", ["epdm-paper", "neo-hookean-epdm", "rubber-table1"])
def test_preset_file_is_its_material_table(name):
    text = (CONFIGS / "materials" / f"{name}.toml").read_text(encoding="utf-8")
    assert load_preset(name) == tomllib.loads(text)["material"]
    assert "Caveats" in text


SCENE = {
    "geometry": GEOMETRY,
    "material": {
        "law": "ogden",
        "convention": "mu/alpha",
        "mu": ["0.63 MPa", "1.2 kPa"],
        "alpha": [1.3, 5],
    },
    "oil": {"model": "compressible", "bulk_modulus": "1.5 GPa", "relative_permittivity": 2.2},
    "electrodes": {
        "stray": "1 fF",
        "taxels": [{"angle": "0 deg"}, {"angle": "10 deg", "axial": "1 mm"}],
    },
    "environment": {"depth": "20 m"},
    "load": [
        {
            "kind": "line",
            "angle": "9 deg",
            "force": "2 N",
            "spread": "5 mm",
            "direction": "1 rad",
        },
        {"kind": "line", "angle": "0 deg", "force": "0 N", "direction": "vertical"},
        {"kind": "pressure", "pressure": "1 kPa"},
    ],
    "solve": {"rtol": 1e-4, "oil_pressure": "3 kPa", "elements": 8, "mesh": [60, 2]},
}


def test_continuous_inputs_are_those_that_the_file_gives():
    inputs = continuous_inputs(scene_from_dict(SCENE))
    assert inputs == pytest.approx(
        {
            "geometry.inner_radius": 57.5e-3,
            "geometry.thickness": 1.5e-3,
            "geometry.half_angle": math.pi / 2,
            "geometry.width": 0.123,
            "geometry.oil_gap": 5e-3,
            "material.alpha.0": 1.3,
            "material.alpha.1": 5.0,
            "material.mu.0": 0.63e6,
            "material.mu.1": 1.2e3,
            "oil.bulk_modulus": 1.5e9,
            "oil.relative_permittivity": 2.2,
            "electrodes.stray": 1e-15,
            "electrodes.taxels.0.angle": 0.0,
            "electrodes.taxels.1.angle": math.pi / 18,
            "electrodes.taxels.1.axial": 1e-3,
            "environment.depth": 20.0,
            "load.0.angle": math.pi / 20,
            "load.0.force": 2.0,
            "load.0.direction": 1.0,
            "load.0.spread": 5e-3,
            "load.1.angle": 0.0,
            "load.1.force": 0.0,
            "load.2.pressure": 1e3,
            "solve.oil_pressure": 3e3,
        },
        rel=1e-14,
    )


def test_inputs_of_a_preset_are_those_of_its_law():
    inputs = continuous_inputs(load_scene(CONFIGS / "scenes/case_a.toml"))
    assert {key: inputs[key] for key in inputs if key.startswith("material")} == {
        "material.C1": 20.7e6,
        "material.C2": -4.4e6,
        "material.C3": 77e3,
    }


def test_structure_holds_everything_but_the_continuous_inputs():
    scene = scene_from_dict(SCENE)
    moved = with_inputs(
        scene, {"load.0.force": 3.0, "material.mu.1": 1e3, "geometry.width": 0.1}
    )
    assert (moved.loads[0].force, moved.material.mu, moved.geometry.width) == (
        3.0,
        (0.63e6, 1e3),
        0.1,
    )
    assert moved != scene
    assert structure(moved) == structure(scene)
    assert hash(structure(moved)) == hash(structure(scene))
    assert hash(moved) == hash(with_inputs(scene, continuous_inputs(moved)))
    discrete = dict(structure(scene))
    assert discrete["material.convention"] == "mu/alpha"
    assert discrete["load.1.direction"] == "vertical"
    assert discrete["electrodes.taxels.0.diameter"] == 4e-3
    assert discrete["solve.mesh.0"] == 60
    assert not discrete.keys() & continuous_inputs(scene).keys()
    assert structure(with_solve(scene, rtol=1e-2)) != structure(scene)


def test_with_inputs_refuses_what_is_no_input():
    scene = scene_from_dict(SCENE)
    with pytest.raises(ValueError, match=r'did you mean "material\.mu\.1"'):
        with_inputs(scene, {"material.mu1": 1.0})
    with pytest.raises(ValueError, match="greater than zero"):
        with_inputs(scene, {"geometry.thickness": -1.0})


def test_with_solve_changes_and_removes_keys():
    scene = scene_from_dict(SCENE)
    assert with_solve(scene, model="shell", mesh=None).solve == SolveSpec(
        model="shell", rtol=1e-4, oil_pressure=3e3, elements=8
    )
    with pytest.raises(ConfigError, match=r"^--rtol: solve\.rtol = 7: must be between"):
        with_solve(scene, source="--rtol", rtol=7)
    vented = load_scene(CONFIGS / "scenes/vented.toml")
    with pytest.raises(ConfigError, match=r"oil_pressure = 1000\.0: vented oil"):
        with_solve(vented, oil_pressure=1e3)


def test_specifications_are_immutable_hashable_and_in_si_units():
    oil = CompressibleOilSpec(bulk_modulus="1.5 GPa")
    assert oil == CompressibleOilSpec(bulk_modulus=1.5e9)
    assert hash(oil) == hash(CompressibleOilSpec(bulk_modulus=1.5e9))
    with pytest.raises(ValidationError, match="frozen"):
        oil.bulk_modulus = 1.0
    assert ElectrodesSpec(taxels=[{"angle": 0.0}]).lsb == 3.05e-16


def test_contradictions_are_refused_in_python_too():
    skin = load_skin(CONFIGS / "skins/suas.toml")
    with pytest.raises(ValueError, match=r"load\.0\.angle: lies off the skin"):
        SceneSpec(**dict(skin), loads=[LineLoadSpec(angle=2.0, force=1.0)])
    with pytest.raises(ValueError, match=r"arc: lies off .* 90\.3208 mm of arc"):
        SceneSpec(**dict(skin), loads=[LineLoadSpec(arc=0.1, force=1.0)])


def test_configuration_starts_neither_jax_nor_the_units_library():
    code = (
        "import sys, suas_jax.config as c; assert not {'jax', 'pint'} & set(sys.modules);"
        f"c.load_scene({str(SCENES[0])!r}); assert not {{'jax', 'dask'}} & set(sys.modules);"
        "assert 'pint' in sys.modules; import dask.base"  # which was hidden from Pint alone
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
