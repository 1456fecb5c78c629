"""Prony terms of a skin as JSON, for people, as a figure and in its file."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from matplotlib.figure import Figure

from fitting.report.description import Headline, Part, Remark, ReportTable
from fitting.sensor.relaxation.fit import RelaxationFit, relaxed, unexplained
from fitting.sensor.report.mark import MARK
from suas_jax.config import UncertainQuantity
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.toml_file import MOST_BYTES
from suas_jax.figures.style import styled, written
from suas_jax.files.reading import read_bytes

_SHOWN = 4  # taxels of a figure


def relaxation_report(fit: RelaxationFit, tried: list[dict[str, Any]]) -> dict[str, Any]:
    """Everything that is known of the terms and of one more (`tried`), SI units."""
    covariance, (first, longest) = fit.covariance, fit.window
    deviation = np.sqrt(np.diagonal(covariance))
    stated = fit.data.spec.material.relaxation
    gone = []
    for t in [*(10.0**k for k in range(-3, 6) if first < 10.0**k < longest), longest]:
        share, error = fit.relaxed(t, first)
        file = None if stated is None else relaxed(stated, t, first)
        gone.append({"t_s": t, "share": share, "standard_error": error, "skin_file": file})
    return {
        "parameters": dict(zip(fit.names, map(float, fit.constants), strict=True)),
        "standard_errors": dict(zip(fit.names, map(float, deviation), strict=True)),
        "covariance": covariance.tolist(),
        "covariance_order": list(fit.names),
        "correlation": (covariance / np.outer(deviation, deviation)).tolist(),
        "relaxed_since_s": first,
        "relaxed": gone,
        "terms_tried": tried,
        "hold_s": longest,
        "unidentifiable": [
            f"what relaxes within {first:.3g} s of a change counts as elastic, what takes much "
            f"longer than the hold of {longest:.3g} s as long-term",
            *fit.hidden,
        ],
        "residual": {"n": fit.readings, "chi2": fit.chi2, "inflation": fit.inflation},
        "logs": [dataclasses.asdict(file) for file in fit.data.files],
        "warnings": list(fit.data.warnings),
        "status": "converged",
    }


def described(report: dict[str, Any]) -> Iterator[Part]:
    """The report in parts."""
    residual = report["residual"]
    text = f"{residual['n']} means, residuals {residual['inflation']:.3g} times their noise"
    yield Headline(report["status"], f"{text}, held for {report['hold_s']:.4g} s", good=True)
    errors = report["standard_errors"]
    rows = [
        (name, f"{x:.4g}", f"{errors[name]:.2g}") for name, x in report["parameters"].items()
    ]
    yield ReportTable("Constants", ("constant, SI units", "value", "standard error"), rows)
    gone = []
    for row in report["relaxed"]:
        found = f"{100 * row['share']:.3g} +- {100 * row['standard_error']:.2g} %"
        file = "" if row["skin_file"] is None else f"{100 * row['skin_file']:.3g} %"
        gone.append((f"{row['t_s']:.4g} s", found, file))
    since = f"gone since {report['relaxed_since_s']:.3g} s"
    yield ReportTable("Stress", ("after", since, "as the skin file had it"), gone)
    for row in report["terms_tried"]:
        why = row["unknown"] or f"gain of {row['gain_of_bic']:.3g} by Schwarz's criterion"
        yield Remark(f"{row['terms']} terms: {why}")
    for key, label in (("unidentifiable", "not determined"), ("warnings", "warning")):
        yield from (Remark(text, label) for text in report[key])


def relaxing_skin(skin: Path, fit: RelaxationFit) -> str:
    """Text of a skin file with the terms and their deviations; comments and the rest stay."""
    document: Any = tomlkit.parse(read_bytes(skin, MOST_BYTES).decode("utf-8-sig"))
    deviation, n = np.sqrt(np.diagonal(fit.covariance)), fit.terms
    own = [UncertainQuantity(*pair) for pair in zip(fit.constants, deviation, strict=True)]
    table = tomlkit.inline_table()
    table.update(RelaxationSpec(g=tuple(own[:n]), tau=tuple(own[n : 2 * n])).table())
    logs = ", ".join(f"{Path(file.path).name} {file.sha256}" for file in fit.data.files)
    document["material"]["relaxation"] = table
    table.comment(f"{MARK} --fit relaxation from {logs}")
    document["material"].pop("correlation", None)  # it may be of the terms before
    return str(tomlkit.dumps(document))


@styled
def plot_relaxation(fit: RelaxationFit, file: Path | None = None) -> Figure:
    """Draw the readings of the taxels that move most, and the model, against time."""
    figure = Figure(figsize=(9.0, 3.2 * len(fit.presses)), layout="constrained")
    rows = figure.subplots(len(fit.presses), 1, squeeze=False)[:, 0]
    modules, numbers = fit.data.spec.sensing.taxel_names
    for axes, press, readings in zip(rows, fit.presses, fit.trial.readings, strict=True):
        model = press.so - press.deviation * unexplained(press, readings[:1])[0]
        moves = np.where(np.isfinite(press.so).any(1), np.ptp(readings[0], axis=1), 0.0)
        for i in np.argsort(-moves)[:_SHOWN]:
            rest = np.nanmean(press.so[i, : np.argmax(press.load > 0)])
            name = f"taxel {modules[i]}.{numbers[i]}"
            axes.plot(press.time, press.so[i] - rest, ".", ms=4, label=name)
            axes.plot(press.time, model[i] - rest, "k-", lw=0.8)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("change [counts]")
        axes.legend(frameon=False)
    terms = zip(fit.series.g, fit.series.tau, strict=True)
    figure.suptitle("; ".join(f"g = {g:.3g}, tau = {tau:.3g} s" for g, tau in terms))
    return written(figure, file)
