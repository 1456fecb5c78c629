"""The parts of `suas invert` that read a log, and estimate, print and draw its loads."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

from fitting.cli.contract import BAD_INPUT
from fitting.cli.options import check_figures, remark
from fitting.cli.progress import bar, spinner
from fitting.inverse_load.check.verdict import ModelVerdict
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.log.log_estimator import LogEstimator
from fitting.inverse_load.readings import (
    EmptyLogError,
    LayoutMismatchError,
    LogReadings,
    readings_of,
)
from fitting.inverse_load.report.text import (
    frame_json,
    posterior_json,
    posterior_lines,
    print_table,
)
from fitting.json_text import json_text
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.acquisition.terminal import say
from suas_jax.config import SkinSpec

if TYPE_CHECKING:
    from fitting.inverse_load.frame_posterior import LoadMode


def read_for(
    spec: SkinSpec,
    log: Path,  # SO log
    noise: float | None,  # standard deviation of a reading [counts]; the skin file's if None
    *,
    as_json: bool,  # whether JSON lines are printed
    plot: Path | None,  # file of a figure, if one is wanted
    posterior: int | None,  # number of the frame whose loads are sampled, if one is wanted
) -> LogReadings:
    """Read and judge a log, before the estimator is made, which may take minutes.

    Raises Exit: the log can't be used; ValueError: no such frame, or no such figure; or the
    skin has no electrodes.
    """
    check_figures(plot)
    try:
        readings = readings_of(read_log(log), spec, noise)
    except (EmptyLogError, LayoutMismatchError) as error:
        status = "empty_log" if isinstance(error, EmptyLogError) else "layout_mismatch"
        if as_json:
            nothing = LoadEstimate(None, status=status)
            say(json_text(frame_json(float("nan"), None, nothing)))
        remark(str(error))
        raise typer.Exit(BAD_INPUT) from None
    for note in readings.notes:
        remark(f"{log}: {note}")
    if posterior is not None and posterior not in readings.seq:
        raise ValueError(
            f"--posterior {posterior}: no such frame; the log has {readings.seq.min()} to "
            f"{readings.seq.max()}"
        )
    return readings


def invert_log(
    estimator: LogEstimator,  # of the log, as `read_for` read it
    skin: Path,
    log: Path,  # SO log
    *,
    as_json: bool,  # print a JSON line a frame, not a table
    smooth: bool,  # add loads filtered over time
    plot: Path | None,  # file of a figure, if one is wanted
    posterior: int | None,  # number of the frame whose loads are sampled, if one is wanted
) -> list[LoadEstimate]:
    """Estimate a log, print and draw what was found, and return it.

    Raises ValueError: the frame has no load to sample.
    """
    readings = estimator.readings
    modes = None if posterior is None else _modes(estimator, posterior)
    with bar("estimating loads", len(readings.so)) as advance:
        estimates = estimator.estimate(advance)
    with spinner("comparing the log with the skin file"):
        verdict = _verdict(estimator, estimates)
    if verdict is not None and not (verdict.right and as_json):
        remark(f"{log}: {verdict.text}")
        main = estimator.main
        record = main.spec.calibration
        zeroed = main.rest is None and record is not None and bool(record.taken)
        command = verdict.command(str(skin), str(log), zeroed=zeroed)
        if command:
            remark(f"to set it right: {command}")
    left = estimator.main.fading.left
    if left is not None:
        remark(f"{log}: {left.text(remembers=estimator.main.remembers)}")
        remark(f"a log of a held press finds it: suas fit sensor {skin} LOG --fit relaxation")
    filtered = None
    if smooth:
        from fitting.inverse_load.live.filter import LoadFilter

        track = LoadFilter()
        filtered = [
            track.feed(t, estimate)
            for t, estimate in zip(readings.time.tolist(), estimates, strict=True)
        ]
    if plot is not None:
        from fitting.inverse_load.report.plots import plot_loads

        plot_loads(readings.time, estimates, plot, filtered)
    if as_json:
        lines = []
        for k, estimate in enumerate(estimates):
            smoothed = None if filtered is None else filtered[k]
            line = frame_json(float(readings.time[k]), int(readings.seq[k]), estimate, smoothed)
            if modes is not None and line["seq"] == posterior:
                line["posterior"] = posterior_json(modes)
            lines.append(json_text(line))
        say("\n".join(lines), lines=True)
    else:
        print_table(readings.time, estimates)
        if modes is not None:
            say("\n".join(posterior_lines(modes)), lines=True)
    return estimates


def _verdict(log: LogEstimator, estimates: list[LoadEstimate]) -> ModelVerdict | None:
    """What a log says about its skin file; None where it has too few contacts.

    None of a membrane that remembers: what one frame reads is not its loads' alone.
    """
    estimator, readings = log.main, log.readings
    if estimator.remembers:
        return None
    frames, so = log.main_frames()
    pressure, force = (
        None if x is None else x[frames] for x in (readings.pressure, readings.force)
    )
    own = [estimates[i] for i in frames]
    # Taxels that an estimate left out say nothing about the skin file either.
    unused = readings.stuck[frames].copy()
    for row, estimate in zip(unused, own, strict=True):
        row[list(estimate.left_out)] = True
    given = estimator, so, unused
    if estimator.spec.geometry.dimension == 3:
        from fitting.inverse_load.check.skin_file import model_verdict

        return model_verdict(*given, pressure, own)
    from fitting.inverse_load.check.section_log import section_verdict

    return section_verdict(*given, own, pressure=pressure, force=force)


def _modes(log: LogEstimator, seq: int) -> "list[LoadMode]":
    """Modes of the frame with a number."""
    from fitting.inverse_load.frame_posterior import frame_posterior

    readings = log.readings
    i = int(np.flatnonzero(readings.seq == seq)[0])
    estimator, so = log.near(i)
    if estimator.remembers:
        raise ValueError(
            f"--posterior {seq}: the membrane remembers ([material] relaxation), so that a "
            "frame alone does not determine its loads; take a skin file without relaxation"
        )
    try:
        return frame_posterior(
            estimator,
            so,
            readings.stuck[i],
            progress=remark,
            pressure=float("nan") if readings.pressure is None else readings.pressure[i],
        )
    except ValueError as error:
        raise ValueError(f"--posterior {seq}: {error}") from None
