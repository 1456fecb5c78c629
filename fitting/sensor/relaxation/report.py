"""Prony terms of a skin as JSON, for people, as a figure and in its file."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from matplotlib.figure import Figure

from fitting.report.description import Headline, Part, Remark, ReportTable, print_parts
from fitting.sensor.relaxation.fit import RelaxationFit, relaxed, unexplained
from suas_jax.acquisition.terminal import new_console
from suas_jax.config import UncertainQuantity
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.toml_file import MOST_BYTES
from suas_jax.figures.style import styled, written
from suas_jax.files.reading import read_bytes
from suas_jax.sensing.taxels import taxel_names

_SHOWN = 4  # taxels of a figure


def relaxation_report(fit: RelaxationFit, tried: list[dict[str, Any]]) -> dict[str, Any]:
    """Everything that is known of the terms and of one more (`tried`), SI units."""
    covariance, own = fit.covariance, fit.constants
    deviation = np.sqrt(np.diagonal(covariance))

    def by_name(values: Any) -> dict[str, float]:
        return dict(zip(fit.names, map(float, values), strict=True))

    first, longest = fit.window
    times = [t for t in 10.0 ** np.arange(-3, 6) if first < t < longest] + [longest]
    stated = fit.data.spec.material.relaxation
    return {
        "parameters": by_name(own),
        "standard_errors": by_name(deviation),
        "intervals": {
            "95": {
                k: [x - 1.96 * e, x + 1.96 * e]
                for k, x, e in zip(
                    fit.names, map(float, own), map(float, deviation), strict=True
                )
            }
        },
        "covariance_order": list(fit.names),
        "covariance": covariance.tolist(),
        "correlation": (covariance / np.outer(deviation, deviation)).tolist(),
        "relaxed": [
            {
                "since_s": first,
                "t_s": t,
                "share": share,
                "standard_error": error,
                "skin_file": None if stated is None else relaxed(stated, t, first),
            }
            for t in times
            for share, error in [fit.relaxed(t, first)]
        ],
        "terms_tried": tried,
        "hold_s": longest,
        "unidentifiable": fit.findings,
        "residual": {"n": fit.readings, "chi2": fit.chi2, "inflation": fit.inflation},
        "logs": [dataclasses.asdict(file) for file in fit.data.files],
        "warnings": list(fit.data.warnings),
        "status": "converged",
    }


def print_relaxation(report: dict[str, Any]) -> None:
    """Print the terms."""
    print_parts(new_console(highlight=False), [*_described(report)])


def _described(report: dict[str, Any]) -> Iterator[Part]:
    residual = report["residual"]
    text = f"{residual['n']} means, residuals {residual['inflation']:.3g} times their noise"
    yield Headline(report["status"], f"{text}, held for {report['hold_s']:.4g} s", good=True)
    yield ReportTable(
        "Constants",
        ("constant", "value", "standard error"),
        [
            (f"{name} [s]" if ".tau." in name else name, f"{value:.4g}", f"{error:.2g}")
            for (name, value), error in zip(
                report["parameters"].items(), report["standard_errors"].values(), strict=True
            )
        ],
    )
    yield ReportTable(
        "Stress that is gone",
        ("after", f"since {report['relaxed'][0]['since_s']:.3g} s", "as the skin file had it"),
        [
            (
                f"{row['t_s']:.4g} s",
                f"{100 * row['share']:.3g} +- {100 * row['standard_error']:.2g} %",
                "" if row["skin_file"] is None else f"{100 * row['skin_file']:.3g} %",
            )
            for row in report["relaxed"]
        ],
    )
    for row in report["terms_tried"]:
        why = row["unknown"] or f"gain of {row['gain_of_bic']:.3g} by Schwarz's criterion"
        yield Remark(f"{row['terms']} terms: {why}")
    for text in report["unidentifiable"]:
        yield Remark(text, "not determined")
    for text in report["warnings"]:
        yield Remark(text, "warning")


def relaxing_skin(skin: Path, fit: RelaxationFit) -> str:
    """Text of a skin file with the terms and their deviations; comments and the rest stay."""
    document: Any = tomlkit.parse(read_bytes(skin, MOST_BYTES).decode("utf-8-sig"))
    deviation = np.sqrt(np.diagonal(fit.covariance))
    terms = [UncertainQuantity(*pair) for pair in zip(fit.constants, deviation, strict=True)]
    n = fit.terms
    table = tomlkit.inline_table()
    table.update(RelaxationSpec.model_construct(g=terms[:n], tau=terms[n : 2 * n]).table())
    document["material"]["relaxation"] = table
    document["material"].pop("correlation", None)  # it may be of the terms before
    logs = ", ".join(f"{Path(file.path).name} {file.sha256}" for file in fit.data.files)
    table.comment(f"written by suas fit sensor --fit relaxation from {logs}")
    return str(tomlkit.dumps(document))


@styled
def plot_relaxation(fit: RelaxationFit, file: Path | None = None) -> Figure:
    """Draw the readings of the taxels that move most, and the model, against time."""
    figure = Figure(figsize=(9.0, 3.2 * len(fit.presses)), layout="constrained")
    rows = figure.subplots(len(fit.presses), 1, squeeze=False)[:, 0]
    modules, numbers = taxel_names(fit.data.spec.electrodes)  # type: ignore[arg-type]
    for axes, press, readings in zip(rows, fit.presses, fit.trial.readings, strict=True):
        model = press.so - press.deviation * unexplained(press, readings[:1])[0][0]
        most = np.argsort(-np.ptp(np.nan_to_num(readings[0]), axis=1))[:_SHOWN]
        for i in most:
            rest = np.nanmean(press.so[i, : np.argmax(press.load > 0)])
            name = f"{modules[i]}.{numbers[i]}"
            axes.plot(press.time, press.so[i] - rest, ".", ms=4, label=f"taxel {name}")
            axes.plot(press.time, model[i] - rest, "k-", lw=0.8)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("change [counts]")
        axes.legend(frameon=False)
    terms = zip(fit.series.g, fit.series.tau, strict=True)
    figure.suptitle("; ".join(f"g = {g:.3g}, tau = {tau:.3g} s" for g, tau in terms))
    return written(figure, file)
