"""Every mistake a person makes in a table is answered with the place, the value and advice."""

import copy
import re

import pytest

from suas_jax.config import ConfigError, load_scene

BALL = {"kind": '"body"', "shape": '"cylinder"', "radius": '"10 mm"', "angle": '"10 deg"'}
# TOML literals by table and key, so that a test can write any value, right or wrong.
SCENE = {
    "geometry": {
        "inner_radius": '"57.5 mm"',
        "thickness": '"1.5 mm"',
        "half_angle": '"90 deg"',
        "width": '"123 mm"',
        "oil_gap": '"5 mm"',
    },
    "material": {"law": '"mooney-rivlin"', "C1": '"20.7 MPa"', "C2": '"-4.4 MPa"'},
    "oil": {"model": '"incompressible"', "relative_permittivity": "2.2"},
    "electrodes": {"layout": '"list"', "taxels": '[{ angle = "0 deg", axial = "0 mm" }]'},
    "environment": {"depth": '"20 m"'},
    "load.0": {"kind": '"line"', "angle": '"45 deg"', "force": '"20.7 N"'},
    "load.1": {"kind": '"pressure"', "pressure": '"1 kPa"'},
    "solve": {"model": '"auto"', "rtol": "1e-3"},
}
OGDEN = {
    "law": '"ogden"',
    "convention": '"mu/alpha"',
    "mu": '["0.63 MPa", "1.2 kPa", "-10 kPa"]',
    "alpha": "[1.3, 5.0, -2.0]",
}
ROBOSKIN = {"layout": '"roboskin"', "modules": '[{ angle = "0 deg" }]'}


def write(path, tables):
    """Write tables of literals as a TOML file; a literal of None leaves its key out."""
    lines = []
    for name, table in tables.items():
        lines.append(f"[[{name.split('.')[0]}]]" if "." in name else f"[{name}]")
        lines += [f"{key} = {value}" for key, value in table.items() if value is not None]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def message_of(path, loader=load_scene):
    """Load a bad file, check that every line of the error names it, and give the text."""
    with pytest.raises(ConfigError) as caught:
        loader(path)
    message = str(caught.value)
    assert all(str(path.parent) in line for line in message.splitlines())
    assert not re.search("pydantic|https?://|validation error|Input should", message)
    return message


def says(message, *pieces):
    """Check that one line of the message holds all the pieces."""
    lines = message.splitlines()
    assert any(all(piece in line for piece in pieces) for line in lines), message


def edited(changes):
    """Copy the scene with other literals at dotted paths, or other tables at dotless ones."""
    tables = copy.deepcopy(SCENE)
    for place, literal in changes.items():
        if place in tables:
            tables[place] = literal
        else:
            table, key = place.rsplit(".", 1)
            tables[table][key] = literal
    return {name: table for name, table in tables.items() if table is not None}


def test_the_scene_under_test_is_right(tmp_path):
    load_scene(write(tmp_path / "scene.toml", SCENE))
    load_scene(write(tmp_path / "scene.toml", edited({"material": OGDEN})))
    load_scene(write(tmp_path / "scene.toml", edited({"electrodes": ROBOSKIN})))


# Place, literal, and what the message must say besides.
VALUES = [
    # quantities
    ("geometry.thickness", "1.5", 'the unit is missing; a length|for example "1.5 mm"'),
    ("geometry.thickness", '"1.5"', 'the unit is missing; a length|for example "1.5 mm"'),
    ("geometry.thickness", '"1.5 MPa"', '"MPa" is a unit of pressure; a length|"1.5 mm"'),
    ("geometry.thickness", '"1.5 mmm"', 'unknown unit "mmm" (did you mean "mm"?)|a length'),
    ("geometry.thickness", '"1,5 mm"', 'a decimal point and no comma: "1.5 mm"'),
    ("geometry.thickness", '"1,500.5 mm"', 'no comma: "1500.5 mm"'),
    ("geometry.thickness", '"1,234,567 mm"', 'no comma: "1234567 mm"'),
    ("geometry.thickness", '"3/2 mm"', "not a number followed by a unit; a length"),
    ("geometry.thickness", '"thick"', "not a number with a unit; a length"),
    ("geometry.thickness", '"mm"', "the number is missing; a length"),
    ("geometry.thickness", '""', "is empty; a length"),
    ("geometry.thickness", "true", "a length with its unit"),
    ("geometry.thickness", "[1.5]", "a length with its unit"),
    ("geometry.thickness", "2024-05-01", "a length with its unit"),
    ("geometry.thickness", '"nan mm"', "finite"),
    ("geometry.thickness", '"-inf mm"', "finite"),
    ("geometry.thickness", '"1e999 mm"', "finite"),
    ("geometry.thickness", "nan", "finite"),
    ("geometry.thickness", '"-1.5 mm"', "greater than zero"),
    ("geometry.thickness", '"0 mm"', "greater than zero"),
    ("geometry.half_angle", '"25 %"', '"%" is a pure number; an angle'),
    ("material.C1", '"20.7 Mpa"', 'unknown unit "Mpa" (did you mean "MPa"?)'),
    ("material.C1", '"10 kN/m3"', '"kN/m3" is a unit of specific weight; a stress'),
    ("material.C1", '"20.7 mm"', '"mm" is a unit of length; a stress'),
    ("electrodes.stray", "0", 'the unit is missing; a capacitance|for example "0 fF"'),
    ("environment.depth", "20", "the unit is missing; a length"),
    ("load.0.force", "20.7", 'the unit is missing; a force|"20.7 N"'),
    ("load.0.force", '"20.7 kg"', '"kg" is a unit of mass; a force'),
    ("load.1.pressure", "1000", 'the unit is missing; a pressure|"1000 kPa" or "1000 Pa"'),
    ("oil.relative_permittivity", "nan", "finite"),
    ("oil.relative_permittivity", "true", "a number without a unit"),
    ("oil.relative_permittivity", '"2 mm"', "a number without a unit"),
    # ranges
    ("geometry.thickness", '"60 mm"', "less than inner_radius (57.5 mm)"),
    ("geometry.half_angle", '"180 deg"', "between zero and 180 deg"),
    ("geometry.half_angle", '"0.5 deg"', "no longer than the membrane is thick"),
    ("geometry.oil_gap", '"58 mm"', "less than inner_radius (57.5 mm)"),
    ("material.C2", '"-21 MPa"', "C1 + C2|greater than zero|C1 is 20.7 MPa"),
    ("oil.relative_permittivity", "0.5", "not be less than 1"),
    ("oil.bulk_modulus", '"1 GPa"', 'no meaning with model = "incompressible"'),
    ("electrodes.lsb", '"0 fF"', "greater than zero"),
    ("electrodes.stray", '"-1 fF"', "not be less than zero"),
    ("electrodes.noise", "-2", "not be less than zero"),
    ("environment.depth", '"-20 m"', "not be less than zero"),
    ("load.0.angle", '"120 deg"', "off the skin|90 deg"),
    ("load.0.angle", '"-90 deg"', "off the skin|clamped edges"),
    ("load.0.spread", '"93 mm"', "clamped edge at 90 deg|less than 92.677 mm"),
    ("load.0.spread", '"-5 mm"', "greater than zero"),
    ("solve.rtol", "0", "between zero and 1"),
    ("solve.rtol", "1", "between zero and 1"),
    ("solve.oil_pressure", '"0 kPa"', "must not be zero"),
    ("solve.elements", "0", "a whole number of at least 1"),
    ("solve.elements", "16.0", "a whole number"),
    ("solve.elements", "true", "a whole number"),
    ("solve.mesh", "[600]", "two numbers|[600, 4]"),
    ("solve.mesh", "600", "a list in square brackets"),
    # words
    ("material.law", '"mooney"', 'unknown law; did you mean "mooney-rivlin"?|ogden'),
    ("material.law", "3", 'unknown law|"mooney-rivlin", "neo-hookean", "ogden", '),
    ("oil.model", '"incompresible"', 'did you mean "incompressible"?|vented'),
    ("electrodes.capacitance", '"parallel"', 'did you mean "parallel-plate"?|concentric'),
    ("electrodes.layout", '"grid"', 'allowed: "list" or "roboskin"'),
    ("load.1.kind", '"presure"', 'unknown kind; did you mean "pressure"?'),
    (
        "load.0.direction",
        '"radail"',
        'did you mean "radial"?|"vertical", or an angle such as "10 deg"',
    ),
    ("load.0.direction", "10", 'the unit is missing; an angle|"10 deg"'),
    ("load.0.direction", '"10 mm"', '"mm" is a unit of length; an angle'),
    ("solve.model", '"beam"', 'allowed: "auto", "shell" or "solid"'),
    ("solve.model", "[]", 'allowed: "auto", "shell" or "solid"'),
    # keys
    ("geometry.thicknes", '"1.5 mm"', 'unknown key; did you mean "thickness"?'),
    ("material.c2", '"-4.4 MPa"', 'unknown key; did you mean "C2"?'),
    (
        "material.Jm",
        "80",
        'no meaning with law = "mooney-rivlin"; take it out, or set law = "gent"',
    ),
    (
        "material.C4",
        '"1 kPa"',
        "unknown key|allowed: law, response, relaxation, softening, density, expansion, "
        "bulk_modulus, correlation, note, C1, C2 or C3",
    ),
    ("solve.skin", '"a.toml"', "belongs at the top level of the file, before the first"),
    ("solve.oil_gap", '"5 mm"', "belongs in [geometry]"),
    ("load.1.force", '"3 N"', 'has no meaning with kind = "pressure"|set kind = "line"'),
    # lists of tables
    ("electrodes.taxels", "3", "a list in square brackets|taxels = ["),
    ("electrodes.taxels", "[]", 'missing or empty; layout = "list"'),
    ("electrodes.modules", '[{ angle = "0 deg" }]', 'belongs to layout = "roboskin"'),
]


@pytest.mark.parametrize(("place", "literal", "wanted"), VALUES)
def test_value(tmp_path, place, literal, wanted):
    message = message_of(write(tmp_path / "scene.toml", edited({place: literal})))
    says(message, f"scene.toml: {place} = {literal}: ", *wanted.split("|"))
    assert len(message.splitlines()) == 1


# Changes, the place that the message must name, and what it must say besides.
TABLES = [
    ({"geometry.width": None}, "geometry.width", 'missing; add it|width = "123 mm"'),
    ({"material.law": None}, "material.law", "missing; add it|mooney-rivlin|preset"),
    ({"material.C1": None}, "material.C1", 'missing; add it|C1 = "20.7 MPa"'),
    ({"material": {**OGDEN, "convention": None}}, "material.convention", "2mu/alpha^2"),
    ({"oil.model": None}, "oil.model", "missing; add it|incompressible|vented"),
    ({"oil.relative_permittivity": None}, "oil.relative_permittivity", "[electrodes] needs"),
    ({"oil.model": '"compressible"'}, "oil.bulk_modulus", 'missing|"1.5 GPa"'),
    ({"electrodes.taxels": None}, "electrodes.taxels", 'missing or empty; layout = "list"'),
    ({"electrodes.layout": '"roboskin"'}, "electrodes.modules", "missing or empty"),
    ({"electrodes.layout": '"roboskin"'}, "electrodes.taxels", 'belongs to layout = "list"'),
    (
        {"load.0.kind": None},
        "load.0.kind",
        'missing; add it|"line", "patch", "pressure" or "body"',
    ),
    ({"load.0.angle": None}, "load.0.angle", "missing; add it|deg"),
    ({"load.0.force": None}, "load.0.force", 'missing; add it|force = "20.7 N"'),
    ({"load.1.pressure": None}, "load.1.pressure", 'missing; add it|"1 kPa"'),
    ({"geometry": None}, "geometry", "the table [geometry] is missing|skin = "),
    ({"material": None}, "material", "the table [material] is missing"),
    ({"oil": None}, "oil", "the table [oil] is missing"),
    ({"material.C1": '"1 Pa"', "material.C2": '"-2 Pa"'}, "material.C2", "C1 is 1 Pa"),
    ({"material.C1": '"-1 Pa"', "material.C2": None}, "material.C1", "C1 is -1 Pa|C2 is 0"),
    (
        {"material": {**OGDEN, "mu": '["1 Pa"]'}},
        'material.mu = ["1 Pa"]',
        "mu has 1|alpha has 3",
    ),
    (
        {"material": {**OGDEN, "mu": '"1 Pa"'}},
        'material.mu = "1 Pa"',
        'a list in square|["0.63 MPa"',
    ),
    ({"material": {**OGDEN, "alpha": "[]"}}, "material.alpha = []", "at least one term"),
    ({"material": {**OGDEN, "alpha": "[1, 0, 1]"}}, "material.alpha.1 = 0", "not be zero"),
    ({"material": {**OGDEN, "alpha": "[1, 2, true]"}}, "material.alpha.2 = true", "a number"),
    ({"material": {**OGDEN, "alpha": "[1, 2, 3]"}}, 'material.mu.2 = "-10 kPa"', "alpha is 3"),
    ({"material": {**OGDEN, "convention": '"2mu/alpha^2"'}}, "material.mu.2", "than zero"),
    ({"material": {**OGDEN, "convention": '"ogden"'}}, "material.convention", '"mu/alpha" or'),
    (
        {"material": {"law": '"neo-hookean"', "mu": '"0 Pa"'}},
        'material.mu = "0 Pa"',
        "than zero",
    ),
    ({"material": {"law": '"yeoh"', "C1": '"-1 Pa"'}}, 'material.C1 = "-1 Pa"', "than zero"),
    (
        {"material": {"preset": '"epdm"'}},
        'material.preset = "epdm"',
        "epdm-paper|rubber-table1",
    ),
    ({"material": {"preset": "1"}}, "material.preset = 1", "unknown preset"),
    ({"material": {"preset": '"../x"'}}, 'material.preset = "../x"', "unknown preset"),
    ({"material.preset": '"epdm-paper"'}, "material.law", "already sets it"),
    (
        {"material": {"preset": '"epdm-paper"', "mu": '"1 Pa"'}},
        'material.mu = "1 Pa"',
        "unknown key|allowed: C1, C2, C3, response, relaxation, softening, density, expansion, "
        "bulk_modulus, correlation or note|"
        'preset = "epdm-paper"',
    ),
    (
        {"material": {"preset": '"epdm-paper"', "C2": '"-30 MPa"'}},
        'material.C2 = "-30 MPa"',
        "C1 is 20.7 MPa",
    ),
    (
        {"electrodes.taxels": '[{ angle = "-95 deg" }]'},
        'electrodes.taxels.0.angle = "-95 deg"',
        "off the skin|90 deg",
    ),
    (
        {"electrodes.taxels": '[{ angle = "0 deg", axial = "62 mm" }]'},
        'electrodes.taxels.0.axial = "62 mm"',
        "off the skin|61.5 mm",
    ),
    (
        {"electrodes.taxels": '[{ angel = "0 deg" }]'},
        'electrodes.taxels.0.angel = "0 deg"',
        'did you mean "angle"?',
    ),
    (
        {"electrodes.taxels": '["0 deg"]'},
        'electrodes.taxels.0 = "0 deg"',
        'a table in braces|{ angle = "0 deg" }',
    ),
    (
        {"electrodes": {**ROBOSKIN, "modules": '[{ angle = "85 deg" }]'}},
        'electrodes.modules.0.angle = "85 deg"',
        "a corner taxel, at 95.6|off the skin",
    ),
    (
        {"electrodes.taxels": '[{ angle = "0 deg", diameter = "400 mm" }]'},
        "electrodes.taxels.0.diameter",
        "is larger than the skin, 123 mm wide",
    ),
    (
        {"electrodes": {**ROBOSKIN, "modules": '[{ angle = "0 deg", numbering = [1, 1] }]'}},
        "electrodes.modules.0.numbering = [1, 1]",
        '"paper"|1 to 10',
    ),
    ({"solve.mesh": "[600, 0]"}, "solve.mesh.1 = 0", "a whole number"),
    ({"solve": {"model": '"solid"', "elements": "4"}}, "solve.elements = 4", "use mesh"),
    ({"solve": {"model": '"shell"', "mesh": "[9, 1]"}}, "solve.mesh = [9, 1]", "use elements"),
    (
        {"environment": {"specific_weight": '"10 kN/m3"'}},
        'environment.specific_weight = "10 kN/m3"',
        'depth = "20 m"',
    ),
    (
        {"oil.model": '"vented"', "solve.oil_pressure": '"10 kPa"'},
        'solve.oil_pressure = "10 kPa"',
        "vented",
    ),
    (
        {"load.0": None, "load.1": None, "solve.oil_pressure": '"10 kPa"'},
        'solve.oil_pressure = "10 kPa"',
        "there is no load",
    ),
    (
        {"load.0.force": '"0 N"', "load.1": None, "solve.oil_pressure": '"10 kPa"'},
        'solve.oil_pressure = "10 kPa"',
        "all loads are zero",
    ),
    (
        {f"load.{i}": BALL | {"force": f'"{i + 1} N"'} for i in (0, 1)},
        'load.1.force = "2 N"',
        "load.0|the sum of both forces",
    ),
]


@pytest.mark.parametrize(("changes", "place", "wanted"), TABLES)
def test_table(tmp_path, changes, place, wanted):
    message = message_of(write(tmp_path / "scene.toml", edited(changes)))
    says(message, f"scene.toml: {place}", *wanted.split("|"))
