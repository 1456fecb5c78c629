"""`suas solve`. JAX is imported inside the command, so that the help starts at once."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fitting.cli.contract import NO_SOLUTION, Overwrite, answer, bad_input
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
from suas_jax.acquisition.terminal import new_console, print_table, say

if TYPE_CHECKING:
    from suas_jax.config import InputErrors, SceneSpec
    from suas_jax.scene.solve import Solution


def solve(
    scene: SceneFile,
    as_json: AsJson = False,
    model: Model = None,
    rtol: Rtol = None,
    gradient: Annotated[
        str | None,
        option(
            "Also differentiate a quantity of the JSON (such as oil_pressure_Pa or "
            "loads.0.displacement_m) by every continuous input.",
            metavar="QUANTITY",
        ),
    ] = None,
    plot: Plot = None,
    pad: Annotated[Path | None, option("Write a figure of the taxels' sensor output.")] = None,
    vtu: Annotated[
        Path | None, option("Write the fields of the solid, or of a pad, for ParaView.")
    ] = None,
    repeat: Annotated[
        int, option("Time the solve as the median of this many runs.", min=1, max=100_000)
    ] = 1,
    overwrite: Overwrite = False,
) -> None:
    """Find the equilibrium of a scene: displacement, oil pressure, gaps, stability.

    Exit status: 0 converged, 2 bad input, 3 no solution found.
    """
    with bad_input():
        spec = scene_of(scene, model, rtol)
        if vtu is not None and spec.geometry.dimension == 2 and spec.solve.model != "solid":
            raise ValueError("--vtu: a section's fields come with the solid model only")
        check_files(plot, pad, others=[vtu], overwrite=overwrite)
        if pad is not None and spec.electrodes is None:
            raise ValueError(
                "--pad: the skin has no [electrodes], so there are no taxels to draw"
            )
        if gradient is not None:
            from suas_jax.scene.report_keys import require_reported

            require_reported(gradient, len(spec.loads))
        with computing("solving"):
            from suas_jax.config import input_errors
            from suas_jax.scene.solve import solve as run

            solution = run(spec, repeat=repeat)
            errors = input_errors(spec)
            _complete(solution, errors, gradient)
            _draw(solution, plot, pad, vtu)
    if errors.text:
        say(f"suas: {errors.text}", err=True)
    report = solution.report | material_note(spec)
    answer(as_json, report, lambda: _print_report(report, spec))
    if not solution.converged:
        raise typer.Exit(NO_SOLUTION)


def _complete(solution: "Solution", errors: "InputErrors", quantity: str | None) -> None:
    """Add what a report has beside the state itself: standard deviations, derivatives."""
    report = solution.report
    report["uncertainty"] = None
    if quantity is not None:
        report["gradient"] = report["gradient_error_estimate"] = None
    if not solution.converged:
        return
    from suas_jax.scene.uncertainty import uncertainty

    report["uncertainty"] = uncertainty(solution, errors)
    if quantity is not None:
        from suas_jax.scene.gradient import gradient, gradient_error_estimate

        report["gradient"] = gradient(solution, quantity)
        report["gradient_error_estimate"] = gradient_error_estimate(solution, quantity)


def _draw(solution: "Solution", plot: Path | None, pad: Path | None, vtu: Path | None) -> None:
    if plot is not None:
        from suas_jax.figures.section import plot_solution

        plot_solution(solution, plot)
    if pad is not None:
        from suas_jax.figures.pad import plot_pad

        plot_pad(solution.scene, [taxel["so"] for taxel in solution.report["taxels"]], pad)
    if vtu is not None:
        from suas_jax.figures.vtu import write_vtu

        write_vtu(solution, vtu)


def _two_digits(x: float) -> str:
    """A number rounded to two digits, without an exponent below a million."""
    return f"{float(f'{x:.2g}'):g}"


def _print_report(report: dict[str, Any], spec: "SceneSpec") -> None:
    """What a person wants to see first, with units."""
    from rich.markup import escape
    from rich.table import Table

    from suas_jax.equilibrium.outcomes import MEANINGLESS

    console = new_console()
    colour = "green" if report["status"] == "converged" else "red"
    message = escape(report["message"])
    console.print(f"[{colour}]{report['status']}[/] ({report['model']}) {message}")
    if report["status"] in MEANINGLESS:
        return
    table = Table(show_header=False, box=None)
    for row in _rows(report, by_arc=not spec.geometry.has_angle):
        table.add_row(*row)
    console.print(table)
    if report.get("gradient"):
        from suas_jax.config import continuous_inputs

        print_gradient(report["gradient"], continuous_inputs(spec))
        error = report["gradient_error_estimate"]
        text = "unknown" if error is None else f"{error:.1e}"
        say(f"estimated error of the gradient: {text}")


def _rows(report: dict[str, Any], *, by_arc: bool) -> Iterator[tuple[str, str]]:
    band = report.get("uncertainty") or {}

    def spread(path: str, factor: float) -> str:
        """The standard deviation of a quantity, after its number."""
        sigma = band.get(path)
        return "" if not sigma else f" ± {_two_digits(factor * sigma)}"

    for i, load in enumerate(report["loads"]):
        if load["kind"] == "pressure":
            yield f"load {i}", f"external pressure {1e-3 * load['pressure_Pa']:.5g} kPa"
            continue
        place, own = place_text(load, "", 4, by_arc=by_arc), f"loads.{i}."
        if "axial_m" in load:
            place += f", {1e3 * load['axial_m']:.4g} mm"
        yield f"load {i}", f"{load['force_N']:.5g}{spread(own + 'force_N', 1.0)} N at {place}"
        if load["kind"] == "body":
            depth = f"{1e3 * load['depth_m']:.5g}{spread(own + 'depth_m', 1e3)} mm"
            area = f"touches {1e6 * load['contact_area_m2']:.4g} mm²"
            if not load["contact_resolved"]:
                area = "touches less than the mesh resolves"
            yield "", f"by a body {depth} in, which {area}"
        moved = f"{1e3 * load['displacement_m']:.4g}{spread(own + 'displacement_m', 1e3)}"
        yield (
            "",
            f"moves {moved} mm, the inner face {1e3 * load['inner_displacement_m']:.4g} mm",
        )
    pressure = f"{1e-3 * report['oil_pressure_Pa']:.5g}{spread('oil_pressure_Pa', 1e-3)} kPa"
    yield "oil pressure", pressure
    if "absolute_oil_pressure_Pa" in report:
        yield "", f"{1e-3 * report['absolute_oil_pressure_Pa']:.5g} kPa absolute"
    for name, key in (
        ("smallest gap", "min_gap"),
        ("largest displacement", "max_displacement"),
        ("largest bulge", "bulge"),
    ):
        size = f"{round(1e3 * report[key + '_m'], 6):.4g}"  # to the nanometre
        text = f"{size}{spread(key + '_m', 1e3)} mm at "
        text += place_text(report, f"{key}_", 3, by_arc=by_arc)
        if key + "_axial_m" in report:
            axial = round(1e3 * report[key + "_axial_m"], 6) + 0.0
            text += f", {axial:.3g} mm along the axis"
        yield name, text
    if report["wall"] is not None:
        yield "wall", _wall(report["wall"], by_arc=by_arc)
    if report.get("rest"):
        yield "at rest", _stress(report["rest"])
    so = [taxel["so"] for taxel in report["taxels"] if taxel["so"] == taxel["so"]]
    if so:
        sigma = max((v for k, v in band.items() if k.endswith(".so")), default=0.0)
        each = f", each ± {_two_digits(sigma)} or less" if sigma else ""
        yield "sensor output", f"{min(so):.5g} to {max(so):.5g} counts{each}"
    yield "strain energy", f"{1e3 * report['strain_energy_J']:.4g} mJ"
    yield "stretch", f"{report['stretch_min']:.4f} to {report['stretch_max']:.4f}"
    yield "equilibrium", "stable" if report["stable"] else "[red]unstable[/]"
    yield "material", "stable" if report["material_stable"] else "[red]outside its window[/]"
    mesh, model = report["discretisation_error"], report["model_error"]
    known = mesh is not None
    error = f"{mesh:.1e} by the mesh, {model:.1e} by the model" if known else "unknown"
    yield "estimated error", error
    times = report["timings_s"]
    seconds = times["solve"]
    took = f"{1e3 * seconds:.3g} ms" if seconds < 1 else f"{seconds:.2f} s"
    yield "solve / compile", f"{took} / {times['compile']:.2f} s"


_ANGLE, _ARC = ("angle_deg", 1.0, "deg"), ("arc_m", 1e3, "mm along the arc")


def place_text(row: dict[str, Any], key: str, digits: int, *, by_arc: bool) -> str:
    """Where something is, by what the section's places are told by."""
    name, scale, unit = _ARC if by_arc else _ANGLE
    return f"{_rounded(scale * row[key + name], digits)} {unit}"


def _rounded(place: float, digits: int) -> str:
    """A place: in the middle it is known to rounding errors, which nobody wants to read."""
    return f"{round(place, 6) + 0.0:.{digits}g}"


def _wall(wall: dict[str, Any], *, by_arc: bool) -> str:
    """What the wall carries, how surely, and where."""
    name, scale, unit = _ARC if by_arc else _ANGLE
    first, last = (_rounded(scale * x, 4) for x in wall[name])
    unsure = wall["force_error_N"]
    to = "" if unsure is None else f" to {unsure:.2g} N,"
    return f"carries {wall['force_N']:.5g} N{to} from {first} to {last} {unit}"


def _stress(rest: dict[str, Any]) -> str:
    """What the skin carries without its loads."""
    if not rest["stable"] and len(rest) == 1:
        return "[red]no stable state[/]"
    force, share = rest["hoop_force_N_per_m"], 100 * rest["buckling_share"]
    text = f"hoop force {force:.4g} N/m"
    if share > 0:
        text += f", {share:.3g} % of what buckles the skin"
    if rest["stiffness_change"] is not None:
        text += f"; stiffness under the loads {100 * rest['stiffness_change']:+.3g} %"
    return text


def print_gradient(slopes: dict[str, float], inputs: dict[str, float]) -> None:
    """Derivatives by what a per cent of each input does, the largest first."""
    effects = {name: 0.01 * slope * inputs[name] for name, slope in slopes.items()}
    rounding = 1e-12 * max(filter(math.isfinite, map(abs, effects.values())), default=0.0)

    def acts(name: str) -> bool:
        # An input that is zero has no per cent; its derivative may be large all the same.
        if inputs[name] == 0.0:
            return slopes[name] != 0.0
        return not abs(effects[name]) <= rounding

    felt = sorted(
        filter(acts, slopes), key=lambda name: (-abs(effects[name]), -abs(slopes[name]))
    )
    rows = [
        (
            name,
            f"{slopes[name]:+.6g}",
            f"{effects[name]:+.4g}" if inputs[name] != 0.0 else "input is zero",
        )
        for name in felt
    ]
    print_table(("input (SI)", "derivative", "1 % of the input"), rows)
    if len(felt) < len(slopes):
        say(f"{len(slopes) - len(felt)} other inputs have no effect (--json lists them).")
