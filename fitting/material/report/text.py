"""A material fit for people: tables with units, warnings, and the [material] table."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from fitting.material.cards.card import card
from fitting.material.fit.result import MaterialFit
from suas_jax.acquisition.terminal import new_console
from suas_jax.config.quantities import format_quantity
from suas_jax.config.schema_material import LAWS


def print_report(report: dict[str, Any], fit: MaterialFit | None) -> None:
    """Print what was found.

    Args:
        report: the JSON of `suas fit material`.
        fit: the fit it came from; None where only a bulk modulus was fitted.
    """
    console = new_console(highlight=False)
    if fit is not None:
        _print_law(console, report, fit)
    if "bulk_modulus_Pa" in report:
        _print_bulk_modulus(console, report)
    for text in report["warnings"]:
        console.print(f"[yellow]warning:[/] {escape(text)}")
    if fit is not None and fit.family.law_name in LAWS:
        console.print("\n" + card(fit.material(), "toml"), markup=False)


def _print_bulk_modulus(console: Console, report: dict[str, Any]) -> None:
    """The bulk modulus, its energy, and how closely it follows the tests."""
    found, about, mode = (
        report["bulk_modulus_Pa"],
        report["volumetric"],
        report["modes"]["volumetric"],
    )
    value, low, high = (_text(found[key], "Pa") for key in ("value", "low95", "high95"))
    console.print(
        f"bulk modulus {value} (95 %: {low} to {high}), energy {about['energy']}, "
        f"{mode['n']} readings, relative RMS {100.0 * mode['relative_rms']:.3g} %"
    )
    if about["poisson_ratio"] is not None:
        console.print(
            f"Poisson's ratio {about['poisson_ratio']:.6f}; the law is fitted as if it were 1/2"
        )


def _print_law(console: Console, report: dict[str, Any], fit: MaterialFit) -> None:
    """The law: constants, modes, comparison, and what the data leave open."""
    colour = "green" if fit.status == "converged" else "yellow"
    console.print(
        f"[{colour}]{fit.status}[/] {fit.family.title}: {report['starts_agreeing']} of the "
        f"best {len(fit.minima.cost)} of {fit.starts} starts agree"
    )
    table = Table("constant", "value", "standard error", "95 % interval")
    low, high = fit.intervals(0.95)
    errors = fit.uncertainty.standard_errors
    for i, (name, unit) in enumerate(zip(fit.family.names, fit.family.units, strict=True)):
        numbers = (fit.constants[i], errors[i], low[i], high[i])
        value, error, first, last = (_text(number, unit) for number in numbers)
        table.add_row(name, value, error, f"{first} to {last}")
    modulus, first, last = (_text(x, "Pa") for x in fit.shear_modulus())
    table.add_row("shear modulus", modulus, "", f"{first} to {last}")
    console.print(table)
    table = Table("mode", "points", "RMS", "relative RMS", "stable for stretches")
    for mode in {**report["modes"], **report["stable_range"]}:
        row = report["modes"].get(mode)
        window = report["stable_range"].get(mode)
        table.add_row(
            mode,
            str(row["n"]) if row else "not measured",
            format_quantity(1e6 * row["rms_MPa"], "stress") if row and "rms_MPa" in row else "",
            f"{100.0 * row['relative_rms']:.3g} %" if row else "",
            _window(window, report["stable_range_open"][mode]) if window else "",
        )
    console.print(table)
    if "candidates" in report:
        table = Table("law", "constants", "AICc", "above best", "rejected because")
        for row in report["candidates"]:
            chosen = "[bold]" if row["title"] == fit.family.title else ""
            table.add_row(
                chosen + row["title"],
                str(row["constants"]),
                f"{row['aicc']:.2f}",
                f"{row['delta_aicc']:.2f}",
                escape("; ".join(row["rejected"])),
            )
        for name, reason in report["candidates_failed"].items():
            table.add_row(name, "", "", "", escape(reason))
        console.print(table)
    else:
        console.print(f"AICc {report['aicc']:.2f}, BIC {report['bic']:.2f}", end=", ")
    kind = report["residual"]["kind"]
    floor = f", floor {100 * 0.01:.0f} % of each file's median" if kind == "relative" else ""
    console.print(f"residuals {kind}{floor}, condition number {report['condition_number']:.3g}")
    if "posterior" in report:
        _print_posterior(console, report["posterior"], fit)
    if "specimens" in report:
        _print_specimens(console, report["specimens"])
    for zero in report["zeros"]:
        console.print(
            f"{zero['name']} of {escape(zero['file'])}: {zero['value']:.4g} +- "
            f"{zero['standard_error']:.2g} {zero['unit']}"
        )
    for text in report["at_limits"]:
        console.print(f"[yellow]at a limit:[/] {escape(text)}")
    for text in report["unidentifiable"]:
        console.print(f"[yellow]not determined:[/] {escape(text)}")


def _print_specimens(console: Console, found: dict[str, Any]) -> None:
    """Stiffness of each specimen, and the scatter between them."""
    table = Table("specimen", "mode", "shear modulus", "standard error")
    for one in found["specimens"]:
        name = f"{one['file']} {one['specimen']}".strip()
        error = f"{100.0 * one['standard_error'] / one['factor']:.2g} %"
        table.add_row(escape(name), one["mode"], _text(one["shear_modulus_Pa"], "Pa"), error)
    console.print(table)
    low, high = found["relative_scatter_95"]
    first, last = (_text(x, "Pa") for x in found["next_specimen_95_Pa"])
    console.print(
        f"scatter between specimens {100.0 * found['relative_scatter']:.2g} % "
        f"({100.0 * low:.2g} to {100.0 * high:.2g} %); a further specimen has a shear modulus "
        f"of {first} to {last} (95 %)"
    )


def _print_posterior(console: Console, posterior: dict[str, Any], fit: MaterialFit) -> None:
    """Quantiles of the samples, what was assumed, and whether to trust them."""
    colour = "green" if posterior["converged"] else "yellow"
    console.print(f"\n[{colour}]posterior[/] {posterior['message']}")
    if "parameters" not in posterior:
        return
    table = Table("constant", "median", "68 % interval", "95 % interval")

    def flat(tree: dict[str, Any]) -> list[Any]:
        """Values by constant, in the order of the family."""
        found = []
        for name in fit.family.names:
            key, _, index = name.partition(".")
            found.append(tree[key][int(index)] if index else tree[key])
        return found

    columns = (posterior["parameters"], *posterior["intervals"].values())
    rows = zip(fit.family.names, fit.family.units, *map(flat, columns), strict=True)
    for name, unit, middle, *ends in rows:
        shown = [f"{_text(low, unit)} to {_text(high, unit)}" for low, high in ends]
        table.add_row(name, _text(middle, unit), *shown)
    modulus = {key: _text(value, "Pa") for key, value in posterior["shear_modulus_Pa"].items()}
    table.add_row(
        "shear modulus",
        modulus["median"],
        f"{modulus['low68']} to {modulus['high68']}",
        f"{modulus['low95']} to {modulus['high95']}",
    )
    if "noise" in posterior:
        noise = posterior["noise"]
        ends = [f"{low:.3g} to {high:.3g}" for low, high in (noise["68"], noise["95"])]
        table.add_row("noise (of residuals)", f"{noise['median']:.3g}", *ends)
    console.print(table)
    for name, prior in posterior["priors"].items():
        console.print(f"prior of {name}: {prior}", highlight=False, markup=False)
    for text in posterior["warnings"]:
        console.print(f"[yellow]warning:[/] {escape(text)}")
    for text in posterior["prior_dominated"]:
        console.print(f"[yellow]prior, not data:[/] {text}")
    console.print(posterior["agreement"]["message"])


def _window(ends: list[float], is_open: list[bool]) -> str:
    """Stretches between which a law is stable."""
    if all(is_open):
        return "all"
    low, high = (f"{end:.3f}" for end in ends)
    return (
        f"above {low}" if is_open[1] else f"below {high}" if is_open[0] else f"{low} to {high}"
    )


def _text(value: float, unit: str) -> str:
    if np.isinf(value):
        return "no limit"
    return format_quantity(value, "stress") if unit == "Pa" else f"{value:.5g}"
