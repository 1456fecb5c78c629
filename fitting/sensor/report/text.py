"""A calibration for people: tables with units, what is not known, and warnings."""

from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from fitting.sensor.fit.result import SensorFit
from suas_jax.acquisition.terminal import new_console
from suas_jax.config.quantities import format_quantity

_DIMENSIONS = {"m": "length", "F": "capacitance", "Pa": "stress"}


def print_report(report: dict[str, Any], fit: SensorFit) -> None:
    """Print what was found.

    Args:
        report: the JSON of `suas fit sensor`.
        fit: the calibration it came from.
    """
    console = new_console(highlight=False)
    colour = "green" if fit.status == "converged" else "yellow"
    residual = report["residual"]
    console.print(
        f"[{colour}]{fit.status}[/] {residual['n']} readings of "
        f"{sum(1 for t in report['taxels'] if t['n'])} taxels, RMS residual "
        f"{residual['rms_counts']:.3g} counts, condition number "
        f"{report['condition_number']:.3g}"
    )
    table = Table()
    table.add_column("constant", no_wrap=True)
    for heading in ("value", "standard error", "95 % interval"):
        table.add_column(heading, overflow="fold")
    table.add_column("prior")
    for name, value in report["parameters"].items():
        unit = report["units"][name]
        low, high = report["intervals"]["95"][name]
        prior = report["priors"].get(name)
        table.add_row(
            name,
            _text(value, unit),
            _text(report["standard_errors"][name], unit),
            f"{_text(low, unit)} to {_text(high, unit)}",
            f"{_text(prior['mean'], unit)} +- {_text(prior['sd'], unit)}: {prior['reason']}"
            if prior
            else "none",
        )
    console.print(table)
    ratio = report.get("permittivity_per_gap")
    if ratio:
        console.print(
            f"permittivity / gap: {ratio['value']:.6g} +- {ratio['standard_error']:.2g} 1/m"
        )
    posterior = report.get("posterior")
    if posterior:
        _print_posterior(console, posterior, report["units"])
    for text in report["unidentifiable"]:
        console.print(f"[yellow]not determined:[/] {escape(text)}")
    for row in report["masked"]:
        console.print(
            f"left out: module {row['module']}, taxel {row['taxel']}, {row['frames']} "
            f"readings: {row['reason']}"
        )
    for text in report["warnings"]:
        console.print(f"[yellow]warning:[/] {escape(text)}")


def _print_posterior(
    console: Console, posterior: dict[str, Any], units: dict[str, str]
) -> None:
    colour = "green" if posterior["status"] == "converged" else "yellow"
    console.print(f"posterior: [{colour}]{posterior['status']}[/] {posterior['message']}")
    for name, value in posterior.get("parameters", {}).items():
        low, high = posterior["intervals"]["95"][name]
        unit = units[name]
        console.print(
            f"  {name}: {_text(value, unit)}, 95 % from {_text(low, unit)} to "
            f"{_text(high, unit)}"
        )


def _text(value: float, unit: str) -> str:
    if unit in _DIMENSIONS and abs(value) > 0:
        return format_quantity(value, _DIMENSIONS[unit])  # type: ignore[arg-type]
    return f"{value:.6g}"
