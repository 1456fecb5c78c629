"""Files as test machines write them, made from one neo-Hookean rubber of 0.4 MPa."""

import io
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import openpyxl

MODULUS = 0.4e6
LENGTH, WIDTH, THICKNESS, DIAMETER = 25.0, 6.0, 2.0, 29.0  # mm
STRETCH = np.linspace(1.1, 2.0, 10)
SQUEEZED = np.linspace(0.97, 0.7, 10)


class MachineFile(NamedTuple):
    """One file, and what must come of it."""

    name: str  # whose file it is
    written: bytes | str  # what the file holds, bytes or text
    refused: tuple[str, ...] = ()  # parts of the message that refuses it; none where it is read
    # what `--columns` says, for a file that is read with it
    columns: Mapping[str, str] = MappingProxyType({})
    specimen: Mapping[str, str] = MappingProxyType({})  # what `--specimen` says
    stretch: np.ndarray = STRETCH  # what the specimens were stretched to
    mode: str = "uniaxial"  # kind of test
    factors: tuple[float, ...] = (1.0,)  # modulus of each specimen, over the rubber's
    suffix: str = ".csv"  # of the file
    encoding: str = "utf-8"  # of text

    @property
    def content(self) -> bytes:
        """Of the file."""
        written = self.written
        return written if isinstance(written, bytes) else written.encode(self.encoding)


def stress(stretch: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """Nominal stress in tension and compression [MPa]."""
    return factor * MODULUS / 1e6 * (stretch - stretch**-2)


def force(stretch: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """Force of the strip [N]."""
    return stress(stretch, factor) * WIDTH * THICKNESS


def button(stretch: np.ndarray) -> np.ndarray:
    """Force of the cylinder [N]."""
    return stress(stretch) * 0.25 * np.pi * DIAMETER**2


def rows(*columns: np.ndarray, between: str = ",", decimal: str = ".", quote: str = "") -> str:
    """Columns of numbers as lines of text."""
    return "".join(
        between.join(f"{quote}{x:.8g}{quote}".replace(".", decimal) for x in row) + "\n"
        for row in zip(*columns, strict=True)
    )


def workbook(sheets: dict[str, list[list[object]]]) -> bytes:
    """An .xlsx file."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, cells in sheets.items():
        sheet = book.create_sheet(title)
        for row in cells:
            sheet.append(row)
    file = io.BytesIO()
    book.save(file)
    return file.getvalue()


TIME = np.linspace(0.1, 9.1, 10)
TRAVEL, FORCE = LENGTH * (STRETCH - 1.0), force(STRETCH)
DOWN = LENGTH * (1.0 - SQUEEZED)
SEMICOLONS = {"between": ";", "decimal": ","}
SIZES = {"length": "25 mm", "width": "6 mm", "thickness": "2 mm"}
RESULTS = [["Specimen", "Thickness", "Width", "Gauge length"], ["", "mm", "mm", "mm"]]


def _results_and_specimens() -> bytes:
    sheets: dict[str, list[list[object]]] = {
        "Results": [*RESULTS, ["S1", 2.0, 6.0, 25.0], ["S2", 2.2, 6.0, 25.0]]
    }
    for k, factor in enumerate((1.0, 1.1), 1):
        pairs = zip(TRAVEL, force(STRETCH, factor), strict=True)
        sheets[f"S{k}"] = [["Extension", "Load"], ["mm", "N"], *map(list, pairs)]
    return workbook(sheets)


def _stacked(unit: str) -> str:
    text = "Report;7\n"
    for k, thickness in enumerate((2.0, 4.0), 1):
        text += f"Specimen;{k}\nThickness;{thickness};mm\nWidth;6;mm\nGauge length;25;mm\n"
        text += f"Extension;Load\nmm;{unit}\n" + rows(
            TRAVEL, FORCE * thickness / 2.0, between=";"
        )
    return text


SHEET = [*zip(100.0 * (STRETCH - 1.0), FORCE, strict=True)]
FILES = [
    MachineFile(
        "Shimadzu Trapezium X",
        '"Test Type","Tensile","Test Mode","Single"\n'
        '"Name","Thickness","Width","Gauge_Length"\n"Unit","mm","mm","mm"\n'
        '"1 _ 1","2.0000","6.0000","25.0000"\n\n"1 _ 1"\n"Time","Force","Stroke"\n'
        '"sec","N","mm"\n' + rows(TIME, FORCE, TRAVEL, quote='"'),
    ),
    MachineFile(
        "Shimadzu Trapezium X, two specimens side by side",
        '"Name","Thickness","Width","Gauge_Length"\n"Units","mm","mm","mm"\n'
        '"1 _ 1","2.0","6.0","25.0"\n"1 _ 2","1.0","6.0","25.0"\n\n'
        '"1 _ 1","","","1 _ 2","",""\n"Time","Force","Stroke","Time","Force","Stroke"\n'
        '"sec","N","mm","sec","N","mm"\n'
        + rows(TIME, FORCE, TRAVEL, TIME, 0.55 * FORCE, TRAVEL, quote='"'),
        factors=(1.0, 1.1),
    ),
    MachineFile(
        "Shimadzu Trapezium X, sizes in words",
        '"Plate Thickness : 2.0 mm","Plate Width : 6.0 mm","Gauge Length : 25 mm"\n'
        '"Time","Force","Stroke"\n"sec","N","mm"\n' + rows(TIME, FORCE, TRAVEL, quote='"'),
    ),
    MachineFile(
        "Shimadzu in Japanese, Shift-JIS",
        '"試験モード","シングル"\n"名前","厚さ","幅","標点距離"\n"単位","mm","mm","mm"\n'
        '"1 _ 1","2.0","6.0","25.0"\n"1 _ 1"\n"時間","試験力","変位"\n"sec","N","mm"\n'
        + rows(TIME, FORCE, TRAVEL, quote='"'),
        encoding="cp932",
    ),
    MachineFile(
        "MTS, sizes in one line",
        "MTS793|BTW|ENU|1|2|.|/|:|1|0|0|A\n"
        "Width: 6.00 mm  Thickness: 2.00 mm  Gauge Length: 25.00 mm\n"
        "Data Header:\tAxial\tTime:\t0.0\tSec\t3/12/2024 2:05:17 PM\n"
        "Running Time\tAxial Displacement\tAxial Force\nSec\tmm\tkN\n"
        + rows(TIME, TRAVEL, FORCE / 1e3, between="\t"),
        suffix=".txt",
    ),
    MachineFile(
        "MTS, sizes in one line with commas",
        "Specimen: width=6 mm, thickness=2 mm, length=25 mm\n"
        "Crosshead (mm)\tLoad (N)\n" + rows(TRAVEL, FORCE, between="\t"),
        suffix=".txt",
    ),
    MachineFile(
        "MTS TestSuite, blocks of one specimen",
        "Gauge Length:\t25.0\tmm\tWidth:\t6.0\tmm\tThickness:\t2.0\tmm\n\n"
        "Data Header:\tAxial\tTime:\t0.0\tSec\n"
        "Running Time\tAxial Displacement\tAxial Force\nSec\tmm\tkN\n"
        + rows(TIME[:5], TRAVEL[:5], FORCE[:5] / 1e3, between="\t")
        + "\nData Header:\tAxial\tTime:\t2.1\tSec\n"
        "Running Time\tAxial Displacement\tAxial Force\nSec\tmm\tkN\n"
        + rows(TIME[5:], TRAVEL[5:], FORCE[5:] / 1e3, between="\t"),
        suffix=".txt",
    ),
    MachineFile(
        "Zwick testXpert in German",
        '"Prüfprotokoll";;\n"Prüfer";"M. Müller";"Labor 3"\n"Probendicke a0";2,0;"mm"\n'
        '"Probenbreite b0";6,0;"mm"\n"Messlänge L0";25,00;"mm"\n'
        '"Prüfzeit";"Standardweg";"Standardkraft"\n"s";"mm";"N"\n'
        + rows(TIME, TRAVEL, FORCE, **SEMICOLONS),
        encoding="cp1252",
    ),
    MachineFile(
        "Zwick, Stauchung with positive signs",
        "Höhe;25;mm\nDurchmesser;29;mm\nStauchung;Druckkraft\n%;N\n"
        + rows(100.0 * (1.0 - SQUEEZED), -button(SQUEEZED), **SEMICOLONS),
        encoding="cp1252",
        stretch=SQUEEZED,
    ),
    MachineFile(
        "Instron Bluehill",
        '"Specimen 1 : Width","6.00","mm"\n"Specimen 1 : Thickness","2.00","mm"\n'
        '"Specimen 1 : Length","25.00","mm"\n\n"Time","Extension","Load"\n'
        '"(s)","(mm)","(N)"\n' + rows(TIME, TRAVEL, FORCE, quote='"'),
    ),
    MachineFile(
        "Instron Bluehill, sizes in the table of results",
        '\ufeff"General : Operator","jd","night shift"\n\n'
        '"Results Table 1"\n"","Width","Thickness","Gauge length","Maximum Load"\n'
        '"","(mm)","(mm)","(mm)","(N)"\n"1","6.00","2.00","25.00","8.4"\n\n"Specimen 1"\n'
        '"Time","Extension","Load","Tensile strain (Extension)"\n"(s)","(mm)","(N)","(%)"\n'
        + rows(TIME, TRAVEL, FORCE, 100.0 * (STRETCH - 1.0), quote='"'),
    ),
    MachineFile(
        "Lloyd Nexygen, workbook with a sheet about the test",
        workbook(
            {
                "Report": [
                    ["Tensile test report"],
                    *(["Width", 6.0, "mm"], ["Thickness", 2.0, "mm"]),
                    ["Gauge length", 25, "mm"],
                ],
                "Data": [
                    *(["Test", "Tension", "Sample A"], []),
                    ["Extension (mm)", "Load (N)", "Time (s)"],
                    *map(list, zip(TRAVEL, FORCE, TIME, strict=True)),
                ],
            }
        ),
        suffix=".xlsx",
    ),
    MachineFile(
        "Instron, compression with positive signs",
        '"Height","25.00","mm"\n"Diameter","29.00","mm"\n'
        '"Time","Compressive extension","Compressive load"\n"(s)","(mm)","(N)"\n'
        + rows(TIME, DOWN, -button(SQUEEZED), quote='"'),
        stretch=SQUEEZED,
    ),
    MachineFile(
        "Instron, compressive strain and stress",
        "Compressive strain (%),Compressive stress (MPa)\n"
        + rows(100.0 * (1.0 - SQUEEZED), -stress(SQUEEZED)),
        stretch=SQUEEZED,
    ),
    MachineFile(
        "Height of a cylinder, in one line",
        "Height: 25 mm\nDiameter: 29 mm\nDisplacement (mm),Force (N)\n"
        + rows(-DOWN, button(SQUEEZED)),
        stretch=SQUEEZED,
    ),
    MachineFile(
        "workbook with a sheet of results",
        _results_and_specimens(),
        (),
        {},
        {},
        STRETCH,
        "uniaxial",
        (1.0, 1.0),
        ".xlsx",
    ),
    MachineFile(
        "workbook, sizes above the table",
        workbook(
            {
                "Data": [
                    *(["Height [mm]", 25], ["Diameter", "29 mm"], []),
                    ["Travel", "Force"],
                    ["mm", "N"],
                    *map(list, zip(-DOWN, button(SQUEEZED), strict=True)),
                ]
            }
        ),
        stretch=SQUEEZED,
        suffix=".xlsx",
    ),
    MachineFile(
        "TA Q800, UTF-16",
        "Version\t5.0\nSample\tSilicone\nSize\t25.0000 x 6.0000 x 2.0000 mm\nNsig\t4\n"
        "Sig1\tTime (min)\nSig2\tTemperature (°C)\nSig3\tDisplacement (µm)\n"
        "Sig4\tStatic Force (N)\nOrgFile\tC:\\TA\\Data\\S.001\nStartOfData\n"
        + rows(TIME, TIME + 25.0, 1e3 * TRAVEL, FORCE, between="\t"),
        encoding="utf-16",
        suffix=".txt",
    ),
    MachineFile(
        "TA Q800, UTF-16 without its mark",
        "Size\t25.0000\t6.0000\t2.0000\tmm\nNsig\t3\nSig1\tTime (min)\nSig2\tStrain (%)\n"
        "Sig3\tStatic Force (N)\nStartOfData\n"
        + rows(TIME, 100.0 * (STRETCH - 1.0), FORCE, between="\t"),
        encoding="utf-16-le",
        suffix=".txt",
    ),
    MachineFile(
        "inflation in mbar",
        "# thickness: 0.3 mm\n# rest_radius: 20 mm\nRadius [mm];Druck [mbar]\n"
        + rows(
            20.0 * STRETCH,
            0.03 * 1e4 * MODULUS / 1e6 * (1 / STRETCH - STRETCH**-7),
            **SEMICOLONS,
        ),
        mode="balloon",
    ),
    MachineFile(
        "tension, stress in mbar",
        "Stretch,Nominal stress (mbar)\n" + rows(STRETCH, 1e4 * stress(STRETCH)),
    ),
    MachineFile(
        "VIC-3D, load as volts of an analogue channel",
        '"Count","eyy [1] - Lagrange","Dev1/ai0 (V)"\n'
        + rows(TIME, 0.5 * (STRETCH**2 - 1.0), FORCE / 50.0),
        refused=("Dev1/ai0 (V)", "--columns"),
    ),
    MachineFile(
        "VIC-3D, load as volts, scaled",
        '"Count","eyy [1] - Lagrange","Dev1/ai0 (V)"\n'
        + rows(TIME, 0.5 * (STRETCH**2 - 1.0), FORCE / 50.0),
        columns={"force": "3 50 N/V"},
        specimen=SIZES,
    ),
    MachineFile(
        "VIC-2D, Hencky strain and force",
        '"Count","eyy [1] - Hencky","Force [N]"\n' + rows(TIME, np.log(STRETCH), FORCE),
        specimen=SIZES,
    ),
    MachineFile(
        "GOM Correlate, stages with an analogue channel",
        "Stage;Time [s];Section 1.epsilon Y [%];AD-0 [V]\n"
        + rows(np.arange(10.0), TIME, 100.0 * (STRETCH - 1.0), FORCE / 50.0, **SEMICOLONS),
        refused=("AD-0 [V]", "--columns"),
    ),
    MachineFile(
        "GOM Aramis, technical strain and force",
        "Strain stage;Technical strain Y [%];Force [N]\n"
        + rows(np.arange(10.0), 100.0 * (STRETCH - 1.0), FORCE, **SEMICOLONS),
        specimen=SIZES,
    ),
    MachineFile(
        "statistics below the readings",
        "Stretch,Nominal stress (MPa)\n"
        + rows(STRETCH, stress(STRETCH))
        + "\nMean,0.5\nStd. dev.,0.1\n",
    ),
    MachineFile(
        "Chinese machine, UTF-8",
        "试样宽度,6,mm\n试样厚度,2,mm\n标距,25,mm\n时间(s),力(N),位移(mm)\n"
        + rows(TIME, FORCE, TRAVEL),
    ),
    MachineFile(
        "Italian, semicolons",
        "Larghezza;6;mm\nSpessore;2;mm\nLunghezza iniziale;25;mm\n"
        "Tempo [s];Spostamento [mm];Forza [N]\n" + rows(TIME, TRAVEL, FORCE, **SEMICOLONS),
    ),
    MachineFile(
        "Spanish, semicolons",
        "Ancho;6;mm\nEspesor;2;mm\nLongitud inicial;25;mm\n"
        "Tiempo [s];Alargamiento [mm];Fuerza [N]\n" + rows(TIME, TRAVEL, FORCE, **SEMICOLONS),
        encoding="cp1252",
    ),
    MachineFile(
        "Spanish stress and strain",
        "Deformación [%];Tensión nominal [MPa]\n"
        + rows(100.0 * (STRETCH - 1.0), stress(STRETCH), **SEMICOLONS),
        encoding="cp1252",
    ),
    MachineFile(
        "Portuguese, semicolons",
        "Largura;6;mm\nEspessura;2;mm\nComprimento inicial;25;mm\n"
        "Tempo [s];Deslocamento [mm];Força [N]\n" + rows(TIME, TRAVEL, FORCE, **SEMICOLONS),
        encoding="cp1252",
    ),
    MachineFile(
        "Portuguese stress and strain",
        "Deformação [%];Tensão nominal [MPa]\n"
        + rows(100.0 * (STRETCH - 1.0), stress(STRETCH), **SEMICOLONS),
    ),
    MachineFile(
        "Dutch, semicolons",
        "Breedte;6;mm\nDikte;2;mm\nMeetlengte;25;mm\n"
        "Tijd [s];Verplaatsing [mm];Kracht [N]\n" + rows(TIME, TRAVEL, FORCE, **SEMICOLONS),
    ),
    MachineFile(
        "Dutch stress and strain",
        "Rek [%];Nominale spanning [MPa]\n"
        + rows(100.0 * (STRETCH - 1.0), stress(STRETCH), **SEMICOLONS),
    ),
    MachineFile(
        "Korean, EUC-KR",
        "너비,6,mm\n두께,2,mm\n표점거리,25,mm\n시간(s),변위(mm),하중(N)\n"
        + rows(TIME, TRAVEL, FORCE),
        encoding="cp949",
    ),
    MachineFile(
        "Korean stress and strain, UTF-8",
        "공칭변형률(%),공칭응력(MPa)\n" + rows(100.0 * (STRETCH - 1.0), stress(STRETCH)),
    ),
    MachineFile(
        "TA Q800, blanks between fields",
        "Size 25.0000 x 6.0000 x 2.0000 mm\nNsig 3\nSig1 Time (min)\n"
        "Sig2 Static Force (N)\nSig3 Displacement (µm)\nStartOfData\n"
        + rows(TIME, FORCE, 1e3 * TRAVEL, between=" "),
        encoding="utf-16",
        suffix=".txt",
    ),
    MachineFile(
        "Japanese sizes by the marks' distance",
        "幅,6,mm\n厚さ,2,mm\n標線間距離,25,mm\n時間(s),試験力(N),ストローク(mm)\n"
        + rows(TIME, FORCE, TRAVEL),
    ),
    MachineFile(
        "Chinese machine, GBK",
        "时间(s),应变(%),工程应力(MPa)\n"
        + rows(TIME, 100.0 * (STRETCH - 1.0), stress(STRETCH)),
        encoding="gbk",
    ),
    MachineFile(
        "a remark of 200,000 characters",
        f'"Remark","{"a, b; " * 40000}"\nStretch,Nominal stress (MPa)\n'
        + rows(STRETCH, stress(STRETCH)),
    ),
    MachineFile(
        "specimens one after the other, each with its sizes", _stacked("N"), factors=(1.0, 1.0)
    ),
    MachineFile(
        "French, decimal commas",
        "Largeur;6;mm\nÉpaisseur;2;mm\nLongueur initiale;25;mm\n"
        "Déplacement (mm);Force (N)\n" + rows(TRAVEL, FORCE, **SEMICOLONS),
        encoding="cp1252",
    ),
    MachineFile(
        "LabVIEW measurement",
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "***End_of_Header***\t\n\nX_Value\tForce (N)\tDisplacement (mm)\tComment\n"
        + rows(TIME, FORCE, TRAVEL, between="\t"),
        specimen=SIZES,
        suffix=".lvm",
    ),
    MachineFile(
        "dates and times in the rows",
        "Date;Time of day;Force (N);Displacement (mm)\n"
        + "".join(
            f"12.03.2024;14:05:{k:02d};{x:.6g};{y:.6g}\n"
            for k, (x, y) in enumerate(zip(FORCE, TRAVEL, strict=True))
        ),
        specimen=SIZES,
    ),
    MachineFile(
        "a logger's file, filled up with NUL",
        ("Stretch,Nominal stress (MPa)\n" + rows(STRETCH, stress(STRETCH))).encode()
        + b"\x00" * 4096,
    ),
    MachineFile(
        "pounds and inches",
        "Load (lbf),Crosshead (in)\n" + rows(FORCE / 4.4482216, TRAVEL / 25.4),
        specimen=SIZES,
    ),
    MachineFile(
        "MTS in inches and lbs, area in square inches",
        f"Area,{12.0 / 25.4**2:.8f},in^2\nGauge length,{25.0 / 25.4:.8f},inches\n"
        "Extension (inches),Load (lbs)\n" + rows(TRAVEL / 25.4, FORCE / 4.4482216),
    ),
    MachineFile(
        "ounces and mils",
        "Load (ozf),Travel (mil)\n" + rows(FORCE / 0.278013851, TRAVEL / 0.0254),
        specimen=SIZES,
    ),
    MachineFile(
        "Galdabini in Italian, cross-section",
        "Sezione iniziale;12;mm2\nTratto utile;25;mm\n"
        "Allungamento [mm];Carico [N]\n" + rows(TRAVEL, FORCE, **SEMICOLONS),
    ),
    MachineFile(
        "no units", "Force,Extension\n" + rows(FORCE, TRAVEL), refused=("no unit", "--columns")
    ),
    MachineFile(
        "no sizes", "Force (N),Extension (mm)\n" + rows(FORCE, TRAVEL), refused=("--specimen",)
    ),
    MachineFile(
        "web page called .xls",
        b"<html><body><table><tr><td>Force</td></tr></table></body></html>",
        ("web page", ".xlsx or as CSV"),
        suffix=".xls",
    ),
    MachineFile(
        "PDF", b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n1 0 obj\n", ("PDF", "CSV"), suffix=".pdf"
    ),
    MachineFile(
        "old workbook", b"\xd0\xcf\x11\xe0" + b"\x00" * 64, (".xlsx or as CSV",), suffix=".xls"
    ),
    MachineFile(
        "Instron Bluehill, two specimens under a table of results with a mean",
        '\ufeff"Results"\n"","Specimen label","Width","Thickness","Length","Force"\n'
        '"","","(mm)","(mm)","(mm)","(N)"\n"1","S-A","6.00","2.00","25.00","8.4"\n'
        '"2","S-B","6.00","4.00","25.00","16.8"\n"Mean","","6.00","3.00","25.00","12"\n\n'
        + "".join(
            f'"Specimen {k}"\n"Time","Displacement","Force"\n"(s)","(mm)","(N)"\n'
            + rows(TIME, TRAVEL, k * FORCE, quote='"')
            for k in (1, 2)
        ),
        factors=(1.0, 1.0),
    ),
    MachineFile(
        "MTS, short names",
        "Time\tAx Disp\tAx Force\nSec\tmm\tkN\n"
        + rows(TIME, TRAVEL, FORCE / 1e3, between="\t"),
        specimen=SIZES,
        suffix=".txt",
    ),
    MachineFile(
        "Shimadzu Trapezium, strain of the stroke beside it",
        '"Time","Stroke","Stress","Stroke Strain"\n"sec","mm","N/mm2","%"\n'
        + rows(TIME, TRAVEL, stress(STRETCH), 100.0 * (STRETCH - 1.0), quote='"'),
    ),
    MachineFile(
        "TA RSA-G3, distance of the clamps",
        "Length\t25.0 mm\nWidth\t6.0 mm\nThickness\t2.0 mm\n[step]\nAxial - 1\n"
        "Step time\tGap\tAxial force\ns\tmm\tN\n"
        + rows(TIME, LENGTH + TRAVEL, FORCE, between="\t"),
        suffix=".txt",
    ),
    MachineFile(
        "times of a clock, after midnight too",
        "Time,Displacement (mm),Force (N)\n"
        + "".join(
            f"{23 * (k < 5):02d}:{59 * (k < 5):02d}:{k:02d}.5,{x:.6g},{y:.6g}\n"
            for k, (x, y) in enumerate(zip(TRAVEL, FORCE, strict=True))
        ),
        specimen=SIZES,
    ),
    MachineFile(
        "decanewtons and microstrain",
        "Force (daN),Strain (µε)\n" + rows(FORCE / 10.0, 1e6 * (STRETCH - 1.0)),
        specimen=SIZES,
    ),
    MachineFile(
        "letters for names",
        "ε [%];σ [MPa]\n" + rows(100.0 * (STRETCH - 1.0), stress(STRETCH), **SEMICOLONS),
    ),
    MachineFile(
        "letters for force and travel", "ΔL (mm),F (N)\n" + rows(TRAVEL, FORCE), specimen=SIZES
    ),
    MachineFile(
        "thickness at three places",
        "Thickness 1,1.9,mm\nThickness 2,2.0,mm\nThickness 3,2.3,mm\nWidth,6,mm\n"
        "Gauge length,25,mm\nExtension (mm),Force (N)\n" + rows(TRAVEL, FORCE),
    ),
    MachineFile(
        "Cauchy stress by the force beside it",
        "Width: 6 mm\nThickness: 2 mm\nStrain (%),Force (N),Stress (MPa)\n"
        + rows(100.0 * (STRETCH - 1.0), FORCE, stress(STRETCH) * STRETCH),
    ),
    MachineFile(
        "compression that only the method tells",
        '"Method","ISO 7743 compression.im_comp"\n"Height h0","25","mm"\n'
        '"Diameter","29","mm"\n"Extension (mm)","Load (N)"\n'
        + rows(DOWN, -button(SQUEEZED), quote='"'),
        stretch=SQUEEZED,
    ),
    MachineFile(
        "ring by its word",
        "# Inner diameter: 44.6 mm\n# Width: 4 mm\n# Thickness: 4 mm\n"
        "Strain (%),Force (N)\n" + rows(100.0 * (STRETCH - 1.0), FORCE),
        refused=("ring", "legs", "--specimen"),
    ),
    MachineFile(
        "ring by a diameter and a thickness",
        "Diameter: 44.6 mm\nThickness: 4 mm\nStrain (%),Force (N)\n"
        + rows(100.0 * (STRETCH - 1.0), FORCE),
        refused=("ring", "legs", "--specimen"),
    ),
    MachineFile(
        "ring, both legs",
        "Specimen: ring ISO 37 type A\nDiameter: 44.6 mm\nThickness: 4 mm\n"
        "Strain (%),Force (N)\n" + rows(100.0 * (STRETCH - 1.0), FORCE),
        specimen={"area": "12 mm2"},
    ),
    MachineFile(
        "strain of an unknown kind",
        "frame,eps_yy,Force_N\n" + rows(TIME, STRETCH - 1.0, FORCE),
        refused=("strain=NAME %", "green_strain=NAME"),
        specimen=SIZES,
    ),
    MachineFile(
        "unknown unit in brackets",
        "Strain [%],Force (stone)\n" + rows(100.0 * (STRETCH - 1.0), FORCE),
        refused=("stone is not one of N", '"Force_N"'),
        specimen=SIZES,
    ),
    MachineFile(
        "inflation in inches of water, ratio of sizes",
        "# thickness_ratio: 0.015\nHoop stretch,Internal pressure (inH2O)\n"
        + rows(STRETCH, 0.03 * MODULUS / 249.089 * (1 / STRETCH - STRETCH**-7)),
        mode="balloon",
    ),
    MachineFile(
        "both directions' forces and travels",
        "Force X (N),Force Y (N),Displacement X (mm),Displacement Y (mm)\n"
        + rows(*[MODULUS / 1e6 * (STRETCH - STRETCH**-5) * 50.0] * 2, TRAVEL, TRAVEL),
        specimen={"length": "25 mm", "width": "25 mm", "thickness": "2 mm"},
        stretch=np.tile(STRETCH, 2),
        mode="biaxial",
    ),
    MachineFile(
        "Zwick's clamped length at the start position",
        "Probendicke a0;2,00;mm\nProbenbreite b0;6,00;mm\n"
        "Einspannlänge bei Startposition;25,00;mm\nStandardweg;Standardkraft\nmm;N\n"
        + rows(TRAVEL, FORCE, **SEMICOLONS),
        encoding="cp1252",
        suffix=".TRA",
    ),
    MachineFile(
        "cells that Excel takes as text, sizes with units in brackets",
        'Width (mm): 6\n="Thickness (mm)",="2"\n="Gauge [mm]",="25"\n'
        '="Elong. (mm)",="Load (N)"\n' + rows(TRAVEL, FORCE, quote='"'),
    ),
    MachineFile(
        "compression of a sample",
        "Sample diameter [mm],29\nSample height [mm],25\n"
        "Compressive extension (mm),Compressive load (N)\n" + rows(DOWN, -button(SQUEEZED)),
        stretch=SQUEEZED,
    ),
    MachineFile(
        "compression as the travel's name",
        "Specimen: cylinder\nDiameter (mm): 29.0\nHeight (mm): 25\n"
        "Time (s),Compression (mm),Compressive load (N)\n"
        + rows(TIME, DOWN, -button(SQUEEZED)),
        stretch=SQUEEZED,
    ),
    MachineFile(
        "units of LabVIEW's channels",
        "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\nChannels\t2\n"
        "Y_Unit_Label\tN\tmm\nX_Dimension\tTime\tTime\n***End_of_Header***\n"
        "X_Value\tForce\tDisplacement\tComment\n" + rows(TIME, FORCE, TRAVEL, between="\t"),
        specimen=SIZES,
        suffix=".lvm",
    ),
    MachineFile(
        "components of tensors", "F11 [-],P11 [kPa]\n" + rows(STRETCH, 1e3 * stress(STRETCH))
    ),
    MachineFile(
        "specimens side by side, sizes above their columns",
        "Specimen;1;;2;\nWidth (mm);6;;4;\nThickness;2 mm;;2 mm;\n"
        "Gauge length;25;mm;20;mm\n"
        "Extension (mm);Load (N);Extension (mm);Load (N)\n"
        + rows(TRAVEL, FORCE, 0.8 * TRAVEL, FORCE / 1.5, between=";"),
        factors=(1.0, 1.0),
    ),
    MachineFile(
        "specimens side by side, a row of sizes right above the names",
        "Width;6 mm;;4 mm;\nThickness;2 mm;;2 mm;\nGauge length;25 mm;;20 mm;\n"
        "Extension (mm);Load (N);Extension (mm);Load (N)\n"
        + rows(TRAVEL, FORCE, 0.8 * TRAVEL, FORCE / 1.5, between=";"),
        factors=(1.0, 1.0),
    ),
    MachineFile(
        "specimens side by side, a size too many",
        "Width (mm);6;4;5\nThickness (mm);2;2;2\nGauge length (mm);25;20;20\n"
        "Extension (mm);Load (N);Extension (mm);Load (N)\n"
        + rows(TRAVEL, FORCE, 0.8 * TRAVEL, FORCE / 1.5, between=";"),
        refused=("3 values of length", "2 specimens", "in their order"),
    ),
    MachineFile(
        "workbook, sizes of all specimens in rows of a sheet",
        workbook(
            {
                "Sizes": [["", "A", "B"], ["Width (mm)", 6, 4], ["Thickness (mm)", 2, 2]],
                "A": [["Strain (%)", "Load (N)"], *SHEET],
                "B": [["Strain (%)", "Load (N)"], *[(x, y / 1.5) for x, y in SHEET]],
            }
        ),
        factors=(1.0, 1.0),
        suffix=".xlsx",
    ),
    MachineFile(
        "a size at three places in one row",
        "Dicke;1,95;2,00;2,20;mm\nBreite;6;mm\nL0;25;mm\n"
        "Standardweg;Standardkraft\nmm;N\n" + rows(TRAVEL, FORCE, **SEMICOLONS),
    ),
    MachineFile(
        "Zwick in German, height of the specimen",
        "Probendurchmesser d0;29,00;mm\nProbenhöhe h0;25,00;mm\n"
        "Stauchung;Druckkraft\nmm;N\n" + rows(DOWN, -button(SQUEEZED), **SEMICOLONS),
        encoding="cp1252",
        stretch=SQUEEZED,
    ),
]
