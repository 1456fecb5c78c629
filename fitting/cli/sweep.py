"""`suas sweep`: a load-displacement curve. JAX is imported inside the command."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fitting.cli.contract import NO_SOLUTION, Overwrite, answer, bad_input, print_report, say
from fitting.cli.options import (
    AsJson,
    Model,
    Plot,
    Rtol,
    SceneFile,
    check_files,
    computing,
    material_note,
    option,
    scene_of,
)

if TYPE_CHECKING:
    from suas_jax.config import SceneSpec
    from suas_jax.scene.sweep import Sweep

_MOST_POINTS = 10_000
_RANGES = {
    "--force": ("SI units", "0:30:31"),
    "--oil-pressure": ("SI units", "0:10000:21"),
    "--depth": ("millimetres", "0:4:41"),
}


def _levels(text: str) -> Any:
    return option(text, metavar="FROM:TO:COUNT")


def sweep(
    scene: SceneFile,
    force: Annotated[
        str | None, _levels("Total force of all line loads [N]; their pattern stays.")
    ] = None,
    oil_pressure: Annotated[
        str | None, _levels("Oil pressure [Pa]; all loads are scaled to reach it.")
    ] = None,
    depth: Annotated[
        str | None,
        _levels("Travel of the bodies [mm]: an indentation curve; other loads stay."),
    ] = None,
    history: Annotated[
        Path | None,
        option(
            "Loads over time: CSV with t_s and force_N or factor; stress relaxes as "
            "[material] says.",
            metavar="FILE",
        ),
    ] = None,
    gradient: Annotated[
        str | None,
        option(
            "Of a history: also differentiate a quantity of its last point (such as "
            "oil_pressure_Pa), or of points.3.oil_pressure_Pa, by every continuous input.",
            metavar="QUANTITY",
        ),
    ] = None,
    as_json: AsJson = False,
    model: Model = None,
    rtol: Rtol = None,
    csv_file: Annotated[Path | None, option("Write the curve as CSV.", "--csv")] = None,
    plot: Plot = None,
    overwrite: Overwrite = False,
) -> None:
    """Trace a load-displacement curve in one continuation, or a history of loads in time.

    Exit status: 0 all points converged, 2 bad input, 3 some did not.
    """
    with bad_input():
        if sum(x is not None for x in (force, oil_pressure, depth, history)) != 1:
            raise ValueError(
                "--force, --oil-pressure, --depth, --history: give one of them, all but the "
                "last as FROM:TO:COUNT"
            )
        if gradient is not None and history is None:
            raise ValueError(
                "--gradient goes with --history; of one load, `suas solve --gradient` does it"
            )
        spec = scene_of(scene, model, rtol)
        check_files(plot, others=[csv_file], overwrite=overwrite)
        levels = {
            "forces": _range("--force", force),
            "oil_pressures": _range("--oil-pressure", oil_pressure),
            "depths": _range("--depth", depth, 1e-3),
        }
        with computing("sweeping"):
            if history is not None:
                from suas_jax.dynamics.course import read_history
                from suas_jax.dynamics.history import history_sweep

                curve = history_sweep(spec, read_history(history), gradient)
            else:
                from suas_jax.scene.sweep import sweep as run

                curve = run(spec, **levels)
            if csv_file is not None:
                curve.write_csv(csv_file)
            if plot is not None:
                from suas_jax.figures.curve import plot_sweep

                plot_sweep(curve, plot)
    report: dict[str, Any] = {"points": curve.points, "first_contact": curve.first_contact}
    report |= material_note(spec) | friction_note(spec, levels["depths"])
    if curve.film is not None:
        report["film"] = curve.film
    if gradient is not None:
        report["gradient"] = curve.gradient
    answer(as_json, report, lambda: _print_curve(curve))
    if any(point["status"] != "converged" for point in curve.points):
        raise typer.Exit(NO_SOLUTION)


def friction_note(spec: "SceneSpec", depths: list[float] | None) -> dict[str, str]:
    """Say on stderr what letting go under friction leaves out; the same for the JSON."""
    falls = any(after < before for before, after in itertools.pairwise(depths or ()))
    if not falls or not any(body.friction for body in spec.bodies):
        return {}
    note = (
        "friction is modelled for bodies that are pressed ever further: every travel is "
        "answered as if pressed in to; what friction holds back when bodies let go is left out"
    )
    say(f"suas: {note}", err=True)
    return {"friction_note": note}


def _range(option: str, text: str | None, unit: float = 1.0) -> list[float] | None:
    """Values of FROM:TO:COUNT in SI units, if it is given."""
    if text is None:
        return None
    try:
        first, last, count = text.split(":")
        start, stop, n = float(first), float(last), int(count)
        if not 1 <= n <= _MOST_POINTS:
            raise ValueError
    except ValueError:
        units, example = _RANGES[option]
        raise ValueError(
            f'{option} = "{text[:80]}": expected FROM:TO:COUNT in {units}, for example '
            f"{example}; COUNT is at most {_MOST_POINTS}"
        ) from None
    return [unit * (start + (stop - start) * i / max(n - 1, 1)) for i in range(n)]


def _print_curve(curve: "Sweep") -> None:
    from fitting.report.description import Remark, ReportTable
    from suas_jax.equilibrium.outcomes import MEANINGLESS

    # How far the body is in that is in most; without one how far the skin has moved.
    travels = [
        [load["depth_m"] for load in point["loads"] if "depth_m" in load]
        for point in curve.points
    ]
    moved = "travel [mm]" if travels[0] else "moved [mm]"
    names = ("force [N]", "oil [kPa]", moved, "gap [mm]", "wall [N]", "status")
    time = ("t [s]",) if "t_s" in curve.points[0] else ()

    def shown(row: dict[str, Any], travel: list[float]) -> list[str]:
        if row["status"] in MEANINGLESS:
            return ["-"] * (len(names) - 1)
        return [
            f"{row['force_N']:.4g}",
            f"{1e-3 * row['oil_pressure_Pa']:.4g}",
            # to the nanometre
            f"{round(1e3 * max(travel, default=row['max_displacement_m']), 6):.4g}",
            f"{1e3 * row['min_gap_m']:.4g}",
            f"{row['wall_force_N']:.4g}",
        ]

    rows = [
        [
            *(f"{row['t_s']:.6g}" for _ in time),
            *shown(row, travel),
            row["status"] if row["stable"] else f"{row['status']}, unstable",
        ]
        for row, travel in zip(curve.rows(), travels, strict=True)
    ]
    film, contact = curve.film, curve.first_contact
    touch = "The inner face does not reach the wall."
    if contact is not None:
        from fitting.cli.solve import place_text

        place = place_text(contact, "", 3, by_arc=not curve.scene.geometry.has_angle)
        touch = (
            f"First wall contact at {contact['force_N']:.4g} N "
            f"({1e-3 * contact['oil_pressure_Pa']:.4g} kPa), {place}."
        )
    said = [touch] if film is None else [film["message"], touch]
    table = ReportTable("", (*time, *names), rows)
    print_report([table, *map(Remark, said)])
    if curve.gradient is not None:
        from fitting.cli.solve import print_gradient
        from suas_jax.config import continuous_inputs

        print_gradient(curve.gradient, continuous_inputs(curve.scene))
