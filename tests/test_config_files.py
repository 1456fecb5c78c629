"""Files that can't be read, skins that aren't there, and how a scene overrides its skin."""

import codecs

import pytest
from test_config_errors import OGDEN, SCENE, edited, message_of, says, write

from fitting.cli import contract
from fitting.cli.options import material_note
from suas_jax.config import (
    ConfigError,
    MooneyRivlinSpec,
    NeoHookeanSpec,
    VentedOilSpec,
    load_preset,
    load_scene,
    load_skin,
    scene_from_dict,
    structure,
)
from suas_jax.config.errors import Mistake

SKIN = {name: SCENE[name] for name in ("geometry", "material", "oil", "electrodes")}

# Bytes of the file, and what the message must say.
UNREADABLE = {
    "empty": (b"", "the file is empty"),
    "comment": (b"# to do\n", "the file is empty"),
    "latin-1": (b'a = 1\nskin = "caf\xe9"\n', "not UTF-8|0xe9 at line 2, column 12|UTF-8"),
    "latin-1 after a mark": (codecs.BOM_UTF8 + b"a = \xe9", "0xe9 at line 1, column 5"),
    "utf-16": ("a = 1".encode("utf-16"), "UTF-16|save it as UTF-8"),
    "unquoted quantity": (b"[a]\nx = 1.5 mm\n", 'line 2, column 9|x = 1.5 mm|"1.5 mm"'),
    "unquoted word": (b"[a]\nmodel = shell\n", 'line 2, column 9|"shell"'),
    "curly quotes": ("a = “1.5 mm”\n".encode(), "line 1, column 5|straight quotes"),
    "duplicate key": (b"a = 1\na = 2\n", "line 2, column 6|overwrite|already taken"),
    "duplicate table": (b"[a]\nx = 1\n[a]\ny = 1\n", "line 3, column 3|declare [a] twice"),
    "table, then list": (b"[load]\nx = 1\n[[load]]\n", "line 3"),
    "open string": (b'a = 1\nb = "1 mm', "line 2, column 10"),
    "nested": (b"a = " + b"[" * 100_000, "too deeply"),
    "control character": (b"a = 1\0", "line 1"),
}


@pytest.mark.parametrize("name", UNREADABLE)
@pytest.mark.parametrize("loader", [load_scene, load_skin])
def test_unreadable_file(tmp_path, name, loader):
    raw, wanted = UNREADABLE[name]
    path = tmp_path / "file.toml"
    path.write_bytes(raw)
    message = message_of(path, loader)
    says(message, "file.toml: ", *wanted.split("|"))
    assert len(message.splitlines()) == 1


def test_missing_file_and_directory(tmp_path):
    write(tmp_path / "case_a.toml", SCENE)
    says(message_of(tmp_path / "case-a.toml"), 'no such file; did you mean "case_a.toml"?')
    (tmp_path / "folder.toml").mkdir()
    says(message_of(tmp_path / "folder.toml"), "is a directory")
    says(message_of(tmp_path / "nowhere" / "a.toml"), "no such file")


# A line at the top of the file in place of tables, and what the message must say.
WRONG_TYPES = [
    ("load", "load = 5", "load = 5: write loads as tables [[load]]"),
    ("load", '[load]\nkind = "line"', "load = |write loads as tables [[load]], in double"),
    ("load", 'load = ["20 N"]', 'load.0 = "20 N": a table is expected: [[load]]'),
    ("geometry", 'geometry = "half-cylinder"', "geometry = |a table is expected: [geometry]"),
    ("material", 'material = "epdm"', 'material = "epdm": a table is expected: [material]'),
    ("oil", "oil = 3", "oil = 3: a table is expected: [oil]"),
    ("solve", "[[solve]]", "solve = [{}]: a table is expected: [solve]"),
    ("solve", "solve = true", "solve = true: a table is expected"),
    ("solve", "thickness = 1", "thickness = 1: unknown key; it belongs in [geometry]"),
    ("solve", "oilgap = 1", "oilgap = 1: unknown key or table|allowed: skin, geometry"),
    ("solve", "[solver]", 'solver = {}: unknown key or table; did you mean "solve"?'),
    ("load", '[[loads]]\nkind = "line"', 'loads = |did you mean "load"?'),
    ("oil", "skin = 5", "skin = 5: the path of a skin file is expected"),
    ("oil", 'skin = ""', 'skin = "": the path of a skin file is expected'),
    ("oil", 'skin = "."', 'skin = ".": is a directory'),
    ("oil", 'skin = "skn.toml"', 'skin = "skn.toml": no such file; did you mean "skin.toml"?'),
    ("oil", 'skin = "a\\u0000b"', 'skin = "a\\u0000b": '),
]


@pytest.mark.parametrize(("replaced", "text", "wanted"), WRONG_TYPES)
def test_wrong_type_of_table(tmp_path, replaced, text, wanted):
    write(tmp_path / "skin.toml", SKIN)
    kept = {n: table for n, table in SCENE.items() if n.split(".")[0] != replaced}
    path = write(tmp_path / "scene.toml", kept)
    # Keys at the top come before every table, and tables after.
    body = path.read_text()
    path.write_text(f"{body}\n{text}" if text.startswith("[") else f"{text}\n{body}")
    says(message_of(path), f"scene.toml: {wanted.split('|')[0]}", *wanted.split("|")[1:])


def test_a_missing_skin_is_the_only_problem(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text('skin = "scenes.toml"\n[solve]\noil_pressure = "1 kPa"\n')
    message = message_of(path)
    assert len(message.splitlines()) == 1
    assert "did you mean" not in message


def test_all_mistakes_are_reported_at_once(tmp_path):
    changes = {
        "geometry.thickness": "1.5",
        "geometry.half_angle": '"90 rad"',
        "material.law": '"x"',
        "oil.modle": "1",
        "load.0.force": "1",
        "load.1.kind": "1",
        "solve.rtol": "7",
    }
    lines = message_of(write(tmp_path / "scene.toml", edited(changes))).splitlines()
    assert [line.split(": ")[1].split(" = ")[0] for line in lines] == list(changes)


def test_a_right_load_is_checked_beside_a_wrong_one(tmp_path):
    tables = edited({"load.0.force": "1"})
    tables["load.2"] = {**SCENE["load.0"], "angle": '"100 deg"'}
    message = message_of(write(tmp_path / "scene.toml", tables))
    says(message, "load.0.force = 1", "the unit is missing")
    says(message, 'load.2.angle = "100 deg"', "off the skin")


def test_a_scene_is_no_skin_file(tmp_path):
    message = message_of(write(tmp_path / "scene.toml", SCENE), load_skin)
    says(message, "load = ", "not a part of a skin file")
    says(message, "solve = ", "not a part of a skin file")
    (tmp_path / "named.toml").write_text('skin = "suas.toml"\n[oil]\nmodel = 1')
    message = message_of(tmp_path / "named.toml", load_skin)
    says(message, 'skin = "suas.toml"', "is a scene; give the skin file that it names")
    assert message.count("\n") == 0


def test_a_message_names_the_file_that_holds_the_mistake(tmp_path):
    (tmp_path / "skins").mkdir()
    (tmp_path / "scenes").mkdir()
    bad = edited({"geometry.width": "123", "geometry.oil_gap": None, "oil.modell": "1"})
    write(tmp_path / "skins" / "skin.toml", {name: bad[name] for name in SKIN})
    scene = tmp_path / "scenes" / "scene.toml"
    scene.write_text('skin = "../skins/skin.toml"\n[geometry]\nthickness = 2\n')
    with pytest.raises(ConfigError) as caught:
        load_scene(scene)
    at = {mistake.key: mistake.file for mistake in caught.value.mistakes}
    skin = str(tmp_path / "skins" / "skin.toml")
    assert at == {
        "geometry.thickness": str(scene),
        "geometry.width": skin,
        "geometry.oil_gap": skin,
        "oil.modell": skin,
    }
    (tmp_path / "skins" / "skin.toml").write_text("[geometry\n")
    with pytest.raises(ConfigError, match=r"skin\.toml: line 1"):
        load_scene(scene)


def test_what_numbers_show_after_loading_is_told_of_the_file_that_was_given(
    tmp_path, monkeypatch
):
    skin, scene = write(tmp_path / "skin.toml", SKIN), tmp_path / "scene.toml"
    scene.write_text('skin = "skin.toml"\n[geometry]\nthickness = "2 mm"\n')
    keys = ("geometry.oil_gap", "geometry.thickness")
    for given, files in ((scene, [skin, scene]), (skin, [skin, skin])):
        monkeypatch.setattr("sys.argv", ["suas", "solve", str(given), "--json"])
        error = ConfigError(Mistake("skin", key, "is wrong") for key in keys)
        told = contract._in_words(error)[1]
        pairs = zip(files, keys, strict=True)
        assert told == "\n".join(f"{file}: {key}: is wrong" for file, key in pairs)


@pytest.mark.parametrize("mark", [b"", codecs.BOM_UTF8])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_byte_order_mark_and_line_ends(tmp_path, mark, end):
    path = write(tmp_path / "scene.toml", SCENE)
    expected = load_scene(path)
    path.write_bytes(mark + path.read_bytes().replace(b"\n", end))
    assert load_scene(path) == expected


@pytest.fixture
def scene_with(tmp_path):
    """Load a scene that names a skin file and has inline tables of its own."""
    write(tmp_path / "skin.toml", SKIN)

    def load(**tables):
        path = write(tmp_path / "scene.toml", tables)
        path.write_text(f'skin = "skin.toml"\n{path.read_text()}')
        return load_scene(path)

    return load


def test_geometry_is_overridden_key_by_key(scene_with):
    geometry = scene_with(geometry={"thickness": '"2 mm"'}).geometry
    assert (geometry.thickness, geometry.inner_radius) == (2e-3, 57.5e-3)


def test_material_is_overridden_by_constant_or_as_a_whole(scene_with):
    assert scene_with(material={"C2": '"-4 MPa"'}).material == MooneyRivlinSpec(
        C1=20.7e6, C2=-4e6
    )
    other = scene_with(material={"law": '"neo-hookean"', "mu": '"1 MPa"'})
    assert other.material == NeoHookeanSpec(mu=1e6)
    assert scene_with(material={"preset": '"epdm-paper"'}).material.C3 == 77e3
    assert scene_with(material=OGDEN).material.alpha == (1.3, 5.0, -2.0)


def test_oil_keeps_its_permittivity_when_the_model_changes(scene_with, tmp_path):
    oil = scene_with(oil={"model": '"compressible"', "bulk_modulus": '"1.5 GPa"'}).oil
    assert (oil.model, oil.bulk_modulus, oil.relative_permittivity) == (
        "compressible",
        1.5e9,
        2.2,
    )
    compressible = {**SCENE["oil"], "model": '"compressible"', "bulk_modulus": '"1 GPa"'}
    write(tmp_path / "yielding.toml", {**SKIN, "oil": compressible})
    path = tmp_path / "vented.toml"
    path.write_text('skin = "yielding.toml"\n[oil]\nmodel = "vented"\n')
    oil = load_scene(path).oil
    assert oil == VentedOilSpec(relative_permittivity=2.2)
    path.write_text('skin = "yielding.toml"\n[oil]\nbulk_modulus = "2 GPa"\n')
    assert load_scene(path).oil.bulk_modulus == 2e9


def test_electrodes_are_overridden_by_key_or_with_the_layout(scene_with):
    electrodes = scene_with(electrodes={"noise": "3"}).electrodes
    assert (electrodes.noise, len(electrodes.taxels)) == (3.0, 1)
    modules = '[{ angle = "10 deg", rotation = "180 deg" }, { angle = "40 deg" }]'
    electrodes = scene_with(electrodes={"layout": '"roboskin"', "modules": modules}).electrodes
    assert (electrodes.taxels, len(electrodes.modules)) == ((), 2)
    assert electrodes.modules[0].pitch == pytest.approx(6.533e-3)


def test_what_is_to_be_known_of_a_preset_is_said(scene_with, capsys):
    """On stderr and in JSON, until a file has constants of its own; no program knows it."""
    paper = scene_with(material={"preset": '"epdm-paper"'})
    assert "1.2 MPa" in material_note(paper)["material_note"]
    assert "fast compression test" in capsys.readouterr().err
    own = scene_with(material={"preset": '"epdm-paper"', "C1": '"5 MPa"', "C2": '"1 MPa"'})
    assert (own.material.note, material_note(own)) == (None, {})
    constants = {"C1": '"20.7 MPa"', "C2": '"-4.4 MPa"', "C3": '"77 kPa"'}
    bare = scene_with(material={"law": '"mooney-rivlin"', **constants})
    assert structure(paper) == structure(bare)


def test_preset_constants_can_be_overridden_from_the_scene(tmp_path):
    write(tmp_path / "skin.toml", {**SKIN, "material": {"preset": '"epdm-paper"'}})
    path = tmp_path / "scene.toml"
    path.write_text('skin = "skin.toml"\n[material]\nC1 = "21 MPa"\n')
    assert load_scene(path).material == MooneyRivlinSpec(C1=21e6, C2=-4.4e6, C3=77e3)


def test_a_scene_from_a_dictionary_follows_the_rules_of_files(tmp_path):
    write(tmp_path / "skin.toml", SKIN)
    data = {"skin": "skin.toml", "load": [{"kind": "line", "angle": "0 deg", "force": "1 N"}]}
    assert scene_from_dict(data, base=tmp_path).loads[0].force == 1.0
    data["load"][0]["force"] = 1.0
    with pytest.raises(ConfigError, match=r"^here: load\.0\.force = 1\.0: the unit is missing"):
        scene_from_dict(data, base=tmp_path, file="here")


def test_an_unknown_preset_is_refused_by_name():
    with pytest.raises(ConfigError, match='did you mean "rubber-table1"'):
        load_preset("rubber_table1")


def test_an_environment_may_be_empty(tmp_path):
    scene = load_scene(write(tmp_path / "scene.toml", edited({"environment": {}})))
    assert scene.environment is not None
    assert scene.environment.depth is None
