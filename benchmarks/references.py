"""Every section that an independent program solved, by `solve` as a user calls it.

    python -m benchmarks.references [WORD...]

The files of tests/data whose name contains a word (all without one): pressures, spread loads,
the wall, an ellipse, a body. No scene names a model or a mesh. The true error is the largest of
force, oil pressure and displacement, each relative to the reference; the wall's force is
relative to the load. Rewrites the table of docs/validation.md if no word is given.
"""

import csv
import pathlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

from benchmarks.pages import write_section
from suas_jax import configure, scene_from_dict, solve

DATA = pathlib.Path(__file__).parents[1] / "tests" / "data"
_LAW = {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"}
_SPREAD_LAW = {
    "law": "ogden",
    "convention": "mu/alpha",
    "mu": ["0.63 MPa", "1.2 kPa", "-10 kPa"],
    "alpha": [1.3, 5.0, -2.0],
}
_CIRCLE = {"inner_radius": "57.5 mm", "half_angle": "90 deg"}
_ELLIPSE = {
    "section": "ellipse",
    "inner_semi_axes": ["57.5 mm", "40 mm"],
    "half_angle": "90 deg",
}

Row = dict[str, str]
Errors = dict[str, float]


def rows_of(name: str) -> Iterator[Row]:
    """Rows of a table; its header says how good they are."""
    lines = (DATA / name).read_text(encoding="utf-8").splitlines()
    yield from csv.DictReader(line for line in lines if not line.startswith("#"))


def answered(
    shape: dict[str, Any],
    load: dict[str, Any],
    law: dict[str, Any] = _LAW,
    thickness: str = "1.5 mm",
    **tables: Any,
) -> dict[str, Any]:
    """The report of a section 123 mm wide with a gap of 5 mm."""
    size = {"thickness": thickness, "width": "123 mm", "oil_gap": "5 mm"}
    scene = {
        "geometry": shape | size,
        "material": law,
        "oil": {"model": "incompressible"},
        "load": [load],
    }
    return solve(scene_from_dict(scene | tables)).report


def line(row: Row, **more: str) -> dict[str, str]:
    """A line load where the row has it, or spread evenly over its arc."""
    load = {"kind": "line", "angle": f"{row['load_angle_deg']} deg", **more}
    if float(row["load_spread_m"]):
        load["spread"] = f"{row['load_spread_m']} m"
    return load


def relative(row: Row, **found: float) -> Errors:
    """Differences from columns of the row, relative to them."""
    return {name: abs(value / float(row[name]) - 1) for name, value in found.items()}


def of_pressure(row: Row, report: dict[str, Any]) -> Errors:
    """Differences where the oil pressure is prescribed."""
    load = report["loads"][0]
    moved = load["inner_displacement_m"]
    return relative(row, force_N=load["force_N"], inner_displacement_along_load_m=moved)


def arch(row: Row) -> tuple[dict[str, Any], Errors]:
    """A prescribed oil pressure below a line load, without the wall."""
    report = answered(
        {
            "inner_radius": f"{row['inner_radius_m']} m",
            "half_angle": f"{row['half_angle_deg']} deg",
        },
        line(row, force="1 N"),
        _SPREAD_LAW if row["law"].startswith("ogden") else _LAW,
        f"{row['thickness_m']} m",
        wall={"contact": False},
        solve={"oil_pressure": f"{row['oil_pressure_Pa']} Pa"},
    )
    return report, of_pressure(row, report)


def profile(row: Row) -> tuple[dict[str, Any], Errors]:
    """The same on two sections."""
    report = answered(
        _CIRCLE if row["section"] == "circle" else _ELLIPSE,
        {"kind": "line", "arc": f"{row['load_arc_from_crown_m']} m", "force": "1 N"},
        wall={"contact": False},
        solve={"oil_pressure": f"{row['oil_pressure_Pa']} Pa"},
    )
    return report, of_pressure(row, report)


def contact(row: Row) -> tuple[dict[str, Any], Errors]:
    """A force that presses the membrane onto the wall."""
    report = answered(_CIRCLE, line(row, force=f"{row['force_N']} N"))
    moved = report["loads"][0]["inner_displacement_m"]
    errors = relative(
        row, oil_pressure_Pa=report["oil_pressure_Pa"], inner_displacement_along_load_m=moved
    )
    held = report["wall"]["force_N"] if report["wall_contact"] else 0.0
    errors["wall"] = abs(held - float(row["contact_force_N"])) / float(row["force_N"])
    return report, errors


def body(row: Row) -> tuple[dict[str, Any], Errors]:
    """A cylinder that travels along a ray."""
    report = answered(
        _CIRCLE,
        {
            "kind": "body",
            "shape": "cylinder",
            "radius": f"{row['R_m']} m",
            "angle": f"{row['angle_deg']} deg",
            "depth": f"{row['d_m']} m",
        },
        wall={"contact": False},
    )
    return report, relative(
        row,
        force_radial_N=report["loads"][0]["force_N"],
        oil_pressure_Pa=report["oil_pressure_Pa"],
    )


# With how well each reference is known, by its header: to another program or a coarser mesh.
FILES: dict[str, tuple[Callable[[Row], tuple[dict[str, Any], Errors]], float]] = {
    "arch.csv": (arch, 3e-4),
    "profile2d.csv": (profile, 2e-4),
    "contact2d.csv": (contact, 2e-4),
    "indenter2d.csv": (body, 5e-4),
}


def main() -> None:
    """Print every row, and write the table of all."""
    configure()
    wanted = sys.argv[1:] or [""]
    lines = [
        "| reference | known to | rows | by the solid | largest true error | stated there |",
        "|---|---|---|---|---|---|",
    ]
    beyond = 0
    for name, (compared, known) in FILES.items():
        if not any(word in name for word in wanted):
            continue
        found = []
        for row in rows_of(name):
            report, errors = compared(row)
            worst = max(errors, key=lambda key: errors[key])
            stated = report["error_estimate"]
            found.append((errors[worst], stated, report["model"]))
            beyond += errors[worst] > stated + known
            told = {key: f"{value:.1e}" for key, value in errors.items()}
            print(name, report["model"], report["status"], f"stated {stated:.1e}", told)
        true, stated, _ = max(found)
        solids = sum(model == "solid" for *_, model in found)
        cells = f"{known:.0e} | {len(found)} | {solids} | {true:.1e} | {stated:.1e}"
        lines.append(f"| {name} | {cells} |")
    print("\n".join(lines), f"\nbeyond what is stated: {beyond}")
    if wanted == [""]:
        write_section("validation.md", "references", lines)


if __name__ == "__main__":
    main()
