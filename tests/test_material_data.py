"""Data files as test machines write them: read right, or answered with what is wrong."""

import json
import pathlib

import numpy as np
import openpyxl
import pytest
from machine_files import FILES, MODULUS, MachineFile
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.material.data.cells import decimal_mark, number
from fitting.material.data.columns import quantity_of
from fitting.material.data.errors import DataError
from fitting.material.experiments.data_checks import (
    branches,
    contradictions,
    refuse_without_information,
    warnings_of,
)
from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import StressTest

STRETCH = np.array([1.0, 1.2, 1.5, 2.0])
NOMINAL = 4e5 * (STRETCH - STRETCH**-2)


def written(folder: pathlib.Path, text: str | bytes, name: str = "data.csv") -> pathlib.Path:
    file = folder / name
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return file


def rows(*columns: np.ndarray, between: str = ",", decimal: str = ".") -> str:
    return "".join(
        between.join(f"{x:.10g}".replace(".", decimal) for x in row) + "\n"
        for row in zip(*columns, strict=True)
    )


@pytest.mark.parametrize(
    "text",
    [
        "stretch_1,nominal_stress_MPa\n" + rows(STRETCH, NOMINAL / 1e6),
        "# a comment\n\nstrain,engineering stress [kPa]\n" + rows(STRETCH - 1, NOMINAL / 1e3),
        "strain,sigma_eng [kPa],sigma_kPa\n"
        + rows(STRETCH - 1, NOMINAL / 1e3, 0 * NOMINAL + 1),
        "strain,sigma_nominal_MPa\n" + rows(STRETCH - 1, NOMINAL / 1e6),
        "Epsilon_eng,Sigma_True (MPa)\n" + rows(STRETCH - 1, NOMINAL * STRETCH / 1e6),
        "epsilon_true,stress_true_MPa\n" + rows(np.log(STRETCH), NOMINAL * STRETCH / 1e6),
        "Strain (%)\tNominal Stress (psi)\n"
        + rows(100 * (STRETCH - 1), NOMINAL / 6894.757293168361, between="\t"),
        "log_strain;true_stress_kgf/cm2\n"
        + rows(np.log(STRETCH), NOMINAL * STRETCH / 98066.5, between=";", decimal=","),
        "green_strain,pk2_kPa\n" + rows((STRETCH**2 - 1) / 2, NOMINAL / STRETCH / 1e3),
        "Report;7\nOperator;A\nExtension;Force\n(mm);(kgf)\n"
        + rows(25 * (STRETCH - 1), NOMINAL * 12e-6 / 9.80665, between=";", decimal=","),
        "Strain (mm/mm),Engineering stress\n,MPa\n"
        + rows(100 * (STRETCH - 1), NOMINAL / 1e6).replace(",", "%,"),
        "Green-Lagrange strain E11,PK2 S11 [kPa]\n"
        + rows((STRETCH**2 - 1) / 2, NOMINAL / STRETCH / 1e3),
        '"Travel\n(mm)","Reading\n\n[N]"\n' + rows(25 * (STRETCH - 1), NOMINAL * 12e-6),
        "time_s,displacement_mm,force_N\n" + rows(STRETCH, 25 * (STRETCH - 1), NOMINAL * 12e-6),
    ],
)
@pytest.mark.parametrize("encode", ["utf-8", "utf-8-sig", "utf-16"])
def test_measures_units_and_locales(tmp_path: pathlib.Path, text: str, encode: str) -> None:
    file = written(tmp_path, text.replace("\n", "\r\n").encode(encode))
    specimen = {"length": "25 mm", "width": "6 mm", "thickness": "2 mm"}
    data = load_dataset("uniaxial", file, specimen)
    np.testing.assert_allclose(data.stretch_1, STRETCH, rtol=1e-8)
    # Readings keep their measure; the combination of stresses that they are says which.
    tau = NOMINAL * STRETCH
    power = {"nominal": 1, "cauchy": 0, "second_pk": 2}[data.measure]
    np.testing.assert_allclose(data.value, tau / STRETCH**power, rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(data.factors[2], STRETCH**-power, rtol=1e-8)


@pytest.mark.parametrize(
    ("text", "decimal", "value"),
    [
        *(("-12.5", None, -12.5), ("1,5", None, 1.5), (".5", None, 0.5), ("5.", None, 5.0)),
        *(("1.234,5", None, 1234.5), ("1,234.5", None, 1234.5), ("+1e-3", None, 1e-3)),
        *(("1d3", None, 1e3), ("1D3", None, 1e3), ("\N{MINUS SIGN}2", None, -2.0)),
        *(("12 345,6", ",", 12345.6), ("1'234.5", ".", 1234.5), ("1.234", ",", 1234.0)),
        *(("1,234,567", ".", 1234567.0), ("123,456", ".", 123456.0)),
        # No group of three digits: a cell of another spelling than the rest of the table.
        *(("0,123", ".", 0.123), ("-0,250", ".", -0.25), ("0.123", ",", 0.123)),
        *(("1,234,567", None, 1234567.0), ("1.234.567", None, 1234567.0)),
        *(("1,5", ".", 1.5), ("1234,567", ".", 1234.567), ("2.5", ",", 2.5)),
        *(("1,23,456", ".", np.nan), ("1,234.5,6", ".", np.nan), ("1,2.5", ".", np.nan)),
        *(("1.2.3", ".", np.nan), ("1e999", None, np.nan), ("abc", None, np.nan)),
    ],
)
def test_numbers_as_people_write_them(text: str, decimal: str | None, value: float) -> None:
    np.testing.assert_equal(number(text, decimal), value)


@pytest.mark.parametrize(
    ("cells", "mark"),
    [
        *((["1,5"], ","), (["1.5"], "."), ([], "."), (["7", "abc"], ".")),
        *((["1,234.5"], "."), (["1.234,5"], ","), (["1,234,567"], "."), (["1.234.567"], ",")),
        # "1,234" may be either; the other cells tell.
        *((["1,234"], ","), (["1,234", "5.6"], "."), (["1,234", "5,6"], ","), (["1.234"], ".")),
        *((["1,5", "7", "8"], ","), (["1,234,567", "1,234"], ".")),
        *((["1,5", "2.5"], "."), (["1,5", "2,5", "3.5"], ","), (["1,234", "1.5", "2,5"], ".")),
    ],
    ids=str,
)
def test_the_decimal_mark_is_that_of_the_cells_that_leave_no_choice(
    cells: list[str], mark: str
) -> None:
    assert decimal_mark(cells) == mark


@pytest.mark.parametrize("case", FILES, ids=lambda case: case.name)
def test_files_of_machines_are_read_or_refused_with_a_way_out(
    tmp_path: pathlib.Path, case: MachineFile
) -> None:
    file = written(tmp_path, case.content, f"data{case.suffix}")
    if case.refused:
        with pytest.raises(DataError) as caught:
            load_dataset(case.mode, file, case.specimen, columns=case.columns)
        assert all(part in str(caught.value) for part in case.refused)
        return
    data = load_dataset(case.mode, file, case.specimen, columns=case.columns)
    labels = list(dict.fromkeys(data.specimen))
    assert len(labels) == len(case.factors)
    for label, factor in zip(labels, case.factors, strict=True):
        own = data.specimen == label
        np.testing.assert_allclose(data.stretch_1[own], case.stretch, rtol=1e-5)
        modulus = data.value[own] / data.unit_stress[own]
        np.testing.assert_allclose(modulus, factor * MODULUS, rtol=1e-4)


def test_missing_values_are_counted(tmp_path: pathlib.Path) -> None:
    text = "stretch,nominal_stress_kPa,use\n1.1,10,1\nNaN,20,1\n1.3,,1\n1.4,40,0\n1.5,50,1\n"
    data = load_dataset("uniaxial", written(tmp_path, text))
    assert data.size == 2
    assert data.dropped == {"missing value": 2, "masked": 1}
    assert any("2 (missing value), 1 (masked)" in warning for warning in warnings_of(data))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("stretch,nominal_stress_MPa\n", "no row below"),
        ("1.1,0.2\n1.2,0.3\n", "line 1: numbers without a line of column names"),
        ("stretch,nominal_stress\n1.1,0.2\n", 'column "nominal_stress" states no unit'),
        ("stretch,nominal_stress_foo\n1.1,0.2\n", 'unknown unit "foo"; allowed: Pa, kPa'),
        ("stretch,nominal_stress_mm\n1.1,0.2\n", "not a unit of stress"),
        ("stretch,Force [MN]\n1.1,2\n", '"force=Force [MN] mN" or "force=Force [MN] 1e6 N"'),
        ("stretch,nominal_stress_MPa\n1.1,0.2\n-0.5,0.3\n", 'line 3, column "stretch": -0.5'),
        ("strain_%,nominal_stress_MPa\n5,0.2\n-120,0.3\n", 'line 3, column "strain_%": -120'),
        ("stretch,nominal_stress_MPa\n1.1,0.2\n1.2,abc\n", '"abc" is not a number'),
        ("stretch,nominal_stress_MPa\n1.1,0.2,7\n", "line 2: 3 fields, but 2 columns"),
        ("stretch,nominal_stress_MPa\n1,1,0,2\n1,2,0,3\n", "decimal commas look like"),
        ("stretch,stretch,nominal_stress_MPa\n1.1,1.1,0.2\n", '"stretch" stands twice'),
        ("stretch,colour\n1.1,3\n", 'has "stretch", "colour"'),
        ("stretch,nominal_stress_MPa\nNaN,0.2\n", "no row holds both"),
        ("displacement_mm,force_N\n1,2\n", "needs the specimen's"),
        ("stretch,nominal_stress_MPa,sigma_MPa\n1.1,0.2,0\n", "must be greater than zero"),
        ("stretch,nominal_stress_MPa,weight\n1.1,0.2,-1\n", "must not be negative"),
        (b"PK\x03\x04\x00\x00", "is not text; export the sheet as CSV"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: pathlib.Path, text: str, message: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(DataError) as caught:
        load_dataset("uniaxial", file)
    assert message in str(caught.value)
    assert str(file) in str(caught.value)


def test_unloading_is_found_and_shuffling_is_not(tmp_path: pathlib.Path) -> None:
    out, back = np.linspace(1.0, 2.5, 20), np.linspace(2.45, 1.2, 12)
    stretch = np.concatenate([out, back])
    stress = 400.0 * (stretch - stretch**-2) * np.where(np.arange(32) < 20, 1.0, 0.8)
    head = "stretch,nominal_stress_kPa\n"
    cycle = load_dataset("uniaxial", written(tmp_path, head + rows(stretch, stress)))
    found = [text for text in warnings_of(cycle) if "unloading branch" in text]
    assert len(found) == 1
    assert "12 readings (lines 22 to 33)" in found[0]
    assert "20 % lower" in found[0]
    order = np.random.default_rng(0).permutation(32)
    shuffled = written(tmp_path, head + rows(stretch[order], stress[order]))
    assert not any(
        "unloading" in text for text in warnings_of(load_dataset("uniaxial", shuffled))
    )
    falling = written(tmp_path, head + rows(out[::-1], stress[:20][::-1]))
    assert not any(
        "unloading" in text for text in warnings_of(load_dataset("uniaxial", falling))
    )
    # Rows alone may stand in any order; with times a fall is an unloading.
    head, times = f"time_s,{head}", np.arange(20.0)
    for time, said in ((times, True), (times[::-1], False)):
        file = written(tmp_path, head + rows(time, out[::-1], stress[:20][::-1]))
        warnings = warnings_of(load_dataset("uniaxial", file))
        assert any("unloading curve" in text for text in warnings) is said


def test_unloading_is_found_wherever_it_stands(tmp_path: pathlib.Path) -> None:
    """Before the loading, and in a file from its end: by falling times, or as no rubber's."""
    stretch = np.concatenate([np.linspace(1.0, 2.5, 20), np.linspace(2.45, 1.0, 19)])
    back = np.arange(39) >= 20
    stress = 400.0 * (stretch - stretch**-2) * np.where(back, 0.8, 1.0)
    head = "stretch,nominal_stress_kPa\n"

    def said(order: np.ndarray, *time: np.ndarray) -> tuple[np.ndarray, str]:
        """Whether each reading is found to be of unloading, and the warning."""
        columns = [x[order] for x in (*time, stretch, stress)]
        file = written(tmp_path, ("time_s," if time else "") + head + rows(*columns))
        data = load_dataset("uniaxial", file)
        (text,) = (text for text in warnings_of(data) if "go back" in text or "branch" in text)
        return branches(data).unloading, text

    first = np.roll(np.arange(39), 19)
    unloading, text = said(first)
    np.testing.assert_array_equal(unloading, back[first])
    assert "20 % lower" in text
    turned = np.arange(39)[::-1]
    unloading, text = said(turned, np.arange(39.0))
    np.testing.assert_array_equal(unloading, back[turned])
    assert "20 % lower" in text
    assert "25 % higher" in said(turned)[1]
    assert "listed from the end" in said(turned)[1]
    sweep = np.linspace(1.5, 0.6, 40)  # through rest, from tension to compression
    file = written(tmp_path, head + rows(sweep, 400.0 * (sweep - sweep**-2)))
    assert not branches(load_dataset("uniaxial", file)).unloading.any()


def test_a_mistaken_unit_is_doubted(tmp_path: pathlib.Path) -> None:
    stretch = np.linspace(1.05, 5.0, 15)
    stress = 0.4 * (stretch - stretch**-2)
    head = "stretch,nominal_stress_MPa\n"
    right = load_dataset("uniaxial", written(tmp_path, head + rows(stretch, stress), "a.csv"))
    wrong = load_dataset(
        "pure_shear", written(tmp_path, head + rows(stretch, stress * 10.197), "b.csv")
    )
    assert not any("unit" in text for text in warnings_of(right))
    assert any("unit is doubtful" in text and "kgf/cm2" in text for text in warnings_of(wrong))
    assert any("b.csv" in text for text in contradictions([right, wrong]))
    stress[8:] *= 1e3
    mixed = load_dataset("uniaxial", written(tmp_path, head + rows(stretch, stress), "c.csv"))
    assert any("from line 9 to line 10" in text for text in warnings_of(mixed))


def test_command_line(tmp_path: pathlib.Path) -> None:
    stretch = np.linspace(0.7, 2.0, 15)
    file = written(
        tmp_path,
        "stretch,nominal_stress_kPa\n" + rows(stretch, 400.0 * (stretch - stretch**-2)),
    )
    run = CliRunner()
    options = ["fit", "material", "--law", "neo-hookean", "--data", f"uniaxial={file}"]
    result = run.invoke(app, [*options, "--json", "--plot", str(tmp_path / "fit.png")])
    assert result.exit_code == 0
    report = json.loads(result.stdout)
    np.testing.assert_allclose(report["parameters"]["mu"], 4e5, rtol=1e-6)
    assert report["units"] == {"mu": "Pa"}
    assert report["modes"]["uniaxial"]["n"] == 15
    assert (tmp_path / "fit.png").stat().st_size > 10_000
    assert run.invoke(app, options).exit_code == 0
    for bad, message in [
        (["--law", "odgen"], "unknown law"),
        (["--residual", "chi"], "allowed: relative, absolute, noise"),
        (["--residual", "noise"], "needs the noise"),
        (["--data", "uniaxal=x.csv"], 'did you mean "uniaxial"'),
        (["--data", "x.csv"], "expected NAME=FILE"),
        (["--data", "uniaxial=missing.csv"], "no such file"),
        (["--terms", "9"], "allows 1"),
        (["--bound", "mu=3"], "expected NAME=LOW:HIGH"),
        (["--specimen", "wdth=3 mm"], 'did you mean "width"'),
    ]:
        result = run.invoke(app, [*options, *bad])
        assert result.exit_code == 2, bad
        assert message in result.stderr


def test_a_clock_tells_the_time(tmp_path: pathlib.Path) -> None:
    clock = ["23:59:58.5", "23:59:59", "0:00:01", "0:00:02.25"]
    rows = "\n".join(f"{text},{k}.0,{k}.5" for k, text in enumerate(clock, 1))
    file = written(tmp_path, f"Time (hh:mm:ss),Strain (%),Stress (MPa)\n{rows}".encode())
    data = load_dataset("uniaxial", file)
    assert isinstance(data, StressTest)
    np.testing.assert_allclose(np.diff(data.time), [0.5, 2.0, 1.25])
    late = rows.replace("23:", "11:").replace("58.5", "58.5 PM").replace("59,", "59 PM,")
    late = late.replace("0:00:01", "12:00:01 AM").replace("0:00:02.25", "12:00:02.25 AM")
    file = written(tmp_path, f"Time,Strain (%),Stress (MPa)\n{late}".encode(), "late.csv")
    data = load_dataset("uniaxial", file)
    assert isinstance(data, StressTest)
    np.testing.assert_allclose(np.diff(data.time), [0.5, 2.0, 1.25])


@pytest.mark.parametrize(
    ("name", "cell", "told"),
    [
        ("Time", "7", True),
        ("time_min", "7", False),
        ("Time (s)", "7", False),
        ("Time", "0:00:07", False),
    ],
)
def test_times_without_a_unit_are_taken_as_seconds_aloud(
    tmp_path: pathlib.Path, name: str, cell: str, told: bool
) -> None:
    text = f"{name},strain,nominal_stress_MPa\n{cell},0.1,0.1\n{cell}.5,0.2,0.2\n"
    data = load_dataset("uniaxial", written(tmp_path, text.encode()))
    assert any("states no unit; taken as seconds" in text for text in data.warnings) == told


def test_shear_by_its_letters(tmp_path: pathlib.Path) -> None:
    shear = np.linspace(0.1, 0.8, 8)
    file = written(tmp_path, "gamma [-];tau [MPa]\n" + rows(shear, 0.6 * shear, between=";"))
    data = load_dataset("simple_shear", file)
    np.testing.assert_allclose(data.coordinate, shear, rtol=1e-8)
    np.testing.assert_allclose(data.value, 6e5 * shear, rtol=1e-8)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# mode: pure shear\nstrain,nominal_stress_MPa\n", '"pure shear" speaks of another'),
        (
            "Uniaxial,,Equibiaxial,\nstrain,nominal_stress_MPa,strain,nominal_stress_MPa\n",
            "Equi",
        ),
        ("Strain X,Strain Y,nominal_stress_MPa\n", "grow together"),
    ],
    ids=["stated", "two kinds side by side", "two strains"],
)
def test_a_file_of_another_kind_of_test_is_doubted(
    tmp_path: pathlib.Path, text: str, said: str
) -> None:
    strain, stress = STRETCH - 1, NOMINAL / 1e6
    columns = [
        strain if "train" in name else stress for name in text.split("\n")[-2].split(",")
    ]
    file = written(tmp_path, text + rows(*columns))
    assert any(said in warning for warning in load_dataset("uniaxial", file).warnings)
    if "X" in text or "pure" in text:
        mode = "pure_shear" if "pure" in text else "equibiaxial"
        assert not any("kind" in w or "grow" in w for w in load_dataset(mode, file).warnings)


@pytest.mark.parametrize("head", ["# specimen type: planar tension\n", "# width: 150 mm\n"])
def test_a_planar_specimen_is_doubted_as_uniaxial(tmp_path: pathlib.Path, head: str) -> None:
    """Its modulus would be 12 % too large."""
    wide = "150" in head
    text = head + ("# thickness: 2 mm\n" if wide else "# area: 300 mm2\n")
    text += "# gauge_length: 15 mm\nExtension (mm),Load (N)\n"
    file = written(tmp_path, text + rows(15.0 * (STRETCH - 1.0), 3e-4 * NOMINAL))
    said = ["pure_shear" in text for text in load_dataset("uniaxial", file).warnings]
    assert any(said)
    assert load_dataset("pure_shear", file).warnings == ()
    squeezed = written(tmp_path, text + rows(-5.0 * (STRETCH - 1.0), -3e-4 * NOMINAL))
    assert not wide or load_dataset("uniaxial", squeezed).warnings == ()


@pytest.mark.parametrize(
    ("names", "count"),
    [
        ("Stress S1 (MPa),Stress S2 (MPa)", 2),
        ("Stress 1 (MPa),Stress 2 (MPa),Stress 3 (MPa)", 3),
    ],
)
def test_stresses_beside_one_strain_are_of_a_specimen_each(
    tmp_path: pathlib.Path, names: str, count: int
) -> None:
    stresses = [(1 + 0.1 * k) * NOMINAL / 1e6 for k in range(count)]
    file = written(tmp_path, f"Strain (-),{names}\n" + rows(STRETCH - 1, *stresses))
    data = load_dataset("uniaxial", file)
    np.testing.assert_allclose(data.value, 1e6 * np.concatenate(stresses))
    np.testing.assert_allclose(data.coordinate, np.tile(STRETCH, count))


@pytest.mark.parametrize(
    ("travel", "force"),
    [
        *(("Course", "Effort"), ("Zugdehnung", "Zugkraft"), ("Strain", "Load")),
        *(("Längenänderung Feindehnung", "Kraft"), ("Extension from Preload", "Force")),
    ],
)
def test_names_of_travel_and_force(tmp_path: pathlib.Path, travel: str, force: str) -> None:
    """A strain in millimetres is a travel."""
    text = f"# area: 12 mm2\n# gauge_length: 25 mm\n{travel} [mm],{force} [N]\n"
    file = written(tmp_path, text + rows(25 * (STRETCH - 1), NOMINAL * 12e-6))
    data = load_dataset("uniaxial", file)
    np.testing.assert_allclose(data.coordinate, STRETCH)
    np.testing.assert_allclose(data.value, NOMINAL)


@pytest.mark.parametrize("beside", ["Crosshead travel (mm)", "Remark", "Width (mm)"])
def test_sizes_of_the_deformed_specimen_are_no_sizes_at_rest(
    tmp_path: pathlib.Path, beside: str
) -> None:
    # A machine's distance of its grips was the length that its travel stretches.
    stretch = np.linspace(1.0, 2.0, 9)
    nominal = 4e5 * (stretch - stretch**-2)
    other = {"C": 25 * (stretch - 1), "R": 0 * stretch + 7, "W": 6 / np.sqrt(stretch)}
    text = "# width: 6 mm\n# thickness: 2 mm\n# grip separation: 25 mm\n"
    text += f"Grip to grip separation (mm),{beside},Force (N)\n"
    file = written(tmp_path, text + rows(25 * stretch, other[beside[0]], nominal * 12e-6))
    test = load_dataset("uniaxial", file)
    np.testing.assert_allclose(test.stretch_1, stretch, rtol=1e-9)
    np.testing.assert_allclose(test.value, nominal, rtol=1e-6, atol=1e-3)
    without = file.read_text(encoding="utf-8").replace("# grip", "# ")
    with pytest.raises(DataError, match="needs the specimen's length"):
        load_dataset("uniaxial", written(tmp_path, without))


@pytest.mark.parametrize("name", ["Strain", "Strain (%)"])
def test_cells_that_a_workbook_shows_in_per_cent(tmp_path: pathlib.Path, name: str) -> None:
    # The number behind "50 %" is 0.5, which was read as 0.5 % where the name says per cent.
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    sheet.append([name, "Nominal stress (MPa)"])
    for row, pair in enumerate(zip(STRETCH - 1, NOMINAL / 1e6, strict=True), 2):
        sheet.append(list(map(float, pair)))
        sheet.cell(row, 1).number_format = "0.0%"
    book.save(tmp_path / "a.xlsx")
    test = load_dataset("uniaxial", tmp_path / "a.xlsx")
    np.testing.assert_allclose(test.stretch_1, STRETCH, rtol=1e-12)


def test_formulas_without_values_leave_the_other_columns(tmp_path: pathlib.Path) -> None:
    # A stress whose formulas kept no values hid the force beside it.
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append(["Strain [%]", "Force [N]", "Stress [MPa]"])
    for row, (stretch, stress) in enumerate(zip(STRETCH, NOMINAL, strict=True), 2):
        sheet.append([float(100 * (stretch - 1)), float(stress * 12e-6), f"=B{row}/12"])
    book.save(tmp_path / "a.xlsx")
    test = load_dataset("uniaxial", tmp_path / "a.xlsx", specimen={"area": "12 mm2"})
    np.testing.assert_allclose(test.value, NOMINAL, rtol=1e-12)
    assert any("formulas count" in text for text in warnings_of(test))
    sheet.delete_cols(2)
    book.save(tmp_path / "b.xlsx")
    with pytest.raises(DataError, match=r"stress is missing.*formulas count"):
        load_dataset("uniaxial", tmp_path / "b.xlsx")


@pytest.mark.parametrize(
    ("names", "encoding"),
    [
        ("Время, с;Перемещение траверсы, мм;Сила, Н", "cp1251"),
        ("Время [с];Относительное удлинение [%];Напряжение [МПа]", "utf-8"),
        ("Czas [s];Wydłużenie [mm];Siła [N]", "cp1250"),
        ("Čas [s];Deformace [%];Smluvní napětí [MPa]", "cp1250"),
        ("Zaman (s);Birim uzama (%);Çekme Gerilmesi (MPa)", "cp1254"),
        ("Tid [s];Förlängning [mm];Kraft [N]", "cp1252"),
        ("Tid [s];Forlængelse [mm];Kraft [N]", "utf-8"),
    ],
)
def test_languages_in_the_code_pages_of_their_machines(
    tmp_path: pathlib.Path, names: str, encoding: str
) -> None:
    seconds = np.arange(4.0)
    strained = "%" in names
    state = 100 * (STRETCH - 1) if strained else 25 * (STRETCH - 1)
    reading = NOMINAL / 1e6 if strained else NOMINAL * 12e-6
    head = "Ширина: 6 мм\nТолщина: 2 мм\n" if names.startswith("Время, ") else ""
    text = head + names + "\n" + rows(seconds, state, reading, between=";", decimal=",")
    file = written(tmp_path, text.encode(encoding))
    sizes = {"length": "25 mm"} | ({} if head else {"area": "12 mm2"})
    test = load_dataset("uniaxial", file, specimen=sizes)
    np.testing.assert_allclose(test.stretch_1, STRETCH, rtol=1e-12)
    np.testing.assert_allclose(test.value, NOMINAL, rtol=1e-9)
    np.testing.assert_array_equal(test.time, seconds)


def test_the_position_of_a_crosshead_is_counted_from_its_first(tmp_path: pathlib.Path) -> None:
    # 120 mm were taken for slack, or for a break where the crosshead goes down.
    force, sizes = NOMINAL * 12e-6, {"length": "25 mm", "area": "12 mm2"}
    moved = 25 * (STRETCH - 1)
    file = written(tmp_path, "Position [mm],Force [N]\n" + rows(120 + moved, force))
    test = load_dataset("uniaxial", file, specimen=sizes)
    np.testing.assert_allclose(test.stretch_1, STRETCH, rtol=1e-12)
    assert any("is a position" in text for text in warnings_of(test))
    down = written(tmp_path, "Position [mm],Force [N]\n" + rows(120 - moved / 2, force))
    with pytest.raises(ValueError, match=r"-1 mm\" where it was pulled"):
        refuse_without_information(load_dataset("uniaxial", down, specimen=sizes))
    # A test that is cut out of a longer one begins under load.
    cut = written(tmp_path, "Extension [mm],Force [N]\n" + rows(60 + moved, 5 + force))
    test = load_dataset("uniaxial", cut, specimen=sizes)
    np.testing.assert_allclose(test.stretch_1, 1 + (60 + moved) / 25, rtol=1e-12)


def test_a_block_is_sheared_on_its_face(tmp_path: pathlib.Path) -> None:
    # The force over width times thickness was taken for the shear stress.
    shear = np.linspace(0.0, 1.0, 5)
    text = "# length: 25 mm\n# width: 20 mm\n# thickness: 4 mm\nTravel (mm),Force (N)\n"
    file = written(tmp_path, text + rows(4 * shear, 4e5 * shear * 500e-6))
    test = load_dataset("simple_shear", file)
    np.testing.assert_allclose(test.value, 4e5 * shear, rtol=1e-9)
    with pytest.raises(DataError, match=r"sheared face.*length"):
        load_dataset("simple_shear", written(tmp_path, text[16:] + rows(shear, shear)))


@pytest.mark.parametrize(
    ("column", "power"), [("Tensile stress", 1), ("True stress", 0), ("PK2", 2)]
)
def test_a_stress_that_is_not_the_force_over_the_sizes_is_told(
    tmp_path: pathlib.Path, column: str, power: int
) -> None:
    text = f"# area: 12 mm2\nstrain,Force (N),{column} (MPa)\n"
    stress = NOMINAL * STRETCH ** (1 - power) / 1e6
    for off in (1.0, 1.5):
        file = written(tmp_path, text + rows(STRETCH - 1, NOMINAL * 12e-6, off * stress))
        told = [x for x in load_dataset("uniaxial", file).warnings if "check the sizes" in x]
        assert len(told) == (off > 1.0)


@pytest.mark.parametrize("order", [1, -1])
def test_a_size_that_stands_twice_is_told(tmp_path: pathlib.Path, order: int) -> None:
    text = "".join(["Gauge length,25,mm\n", "Length,50,mm\n"][::order])
    text += "Width,6,mm\nThickness,2,mm\nExtension (mm),Force (N)\n"
    file = written(tmp_path, text + rows(25 * (STRETCH - 1), NOMINAL * 12e-6))
    test = load_dataset("uniaxial", file)
    np.testing.assert_allclose(test.stretch_1, STRETCH, rtol=1e-9)
    assert any("length stands twice" in x for x in test.warnings)
    test = load_dataset("uniaxial", file, {"length": "50 mm"})
    assert not any("twice" in x for x in test.warnings)
    np.testing.assert_allclose(test.stretch_1, (1 + STRETCH) / 2, rtol=1e-9)


def test_tension_counted_as_negative_is_refused_with_a_way_out(tmp_path: pathlib.Path) -> None:
    text = "# area: 12 mm2\nstrain,Load (N)\n" + rows(STRETCH - 1, -NOMINAL * 12e-6)
    file = written(tmp_path, text)
    with pytest.raises(ValueError, match='"force=NAME -1 N"'):
        refuse_without_information(load_dataset("uniaxial", file))
    data = load_dataset("uniaxial", file, columns={"force": "Load (N) -1 N"})
    np.testing.assert_allclose(data.value, NOMINAL)
    # The gap of a rheometer's plates has no name for the way that they close.
    text = "# area: 12 mm2\n# gauge_length: 25 mm\nGap (mm),Axial force (N)\n"
    file = written(tmp_path, text + rows(25.0 / STRETCH, NOMINAL * 12e-6))
    with pytest.raises(ValueError, match="rubber's; turn the sign"):
        refuse_without_information(load_dataset("uniaxial", file))


def test_columns_of_another_mode_are_told(tmp_path: pathlib.Path) -> None:
    file = written(tmp_path, "# radius: 25 mm\napex_height_mm,pressure_kPa\n1,2\n3,4\n5,6\n")
    with pytest.raises(DataError, match="--data bulge=FILE"):
        load_dataset("uniaxial", file)


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        *(("拉伸应力(MPa)", "nominal"), ("力值(N)", "force"), ("夹头位移(mm)", "displacement")),
        *(
            ("压缩力(N)", "force"),
            ("高さ (mm)", "height"),
            ("伸び率(%)", "strain"),
            ("引張荷重(N)", "force"),
        ),
        *(
            ("Last (N)", "force"),
            ("Charge (kN)", "force"),
            ("Contrainte vraie (MPa)", "cauchy"),
        ),
        *(("Déplacement traverse (mm)", "displacement"), ("인장응력 (MPa)", "nominal")),
        *(("Nominell töjning (%)", "strain"), ("Nominelle Spannung (MPa)", "nominal")),
        *(("Sann spänning (MPa)", "cauchy"), ("Sann töjning", "log_strain")),
        *(("Einspannlänge L0 (mm)", "grip_separation"), ("Klemmlänge L0", "grip_separation")),
        *(("Longueur de jauge (mm)", "length"), ("つかみ具間距離 (mm)", "grip_separation")),
    ],
)
def test_names_of_other_languages(name: str, quantity: str) -> None:
    assert quantity_of(name) == quantity
