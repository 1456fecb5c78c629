"""`suas invert`. JAX is imported inside the command."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fitting.cli.contract import BAD_INPUT, Overwrite, bad_input
from fitting.cli.log import FORMAT_NAMES
from fitting.cli.pad_options import Workers, pad_settings
from fitting.cli.progress import bar, spinner
from fitting.json_text import json_text
from suas_jax.files.reading import check_readable
from suas_jax.files.writing import check_outputs

if TYPE_CHECKING:
    from fitting.inverse_load.check.verdict import ModelVerdict
    from fitting.inverse_load.estimate.estimate import LoadEstimate
    from fitting.inverse_load.estimator import LoadEstimator
    from fitting.inverse_load.live.watcher import LiveWatcher
    from fitting.inverse_load.posterior import LoadMode
    from fitting.inverse_load.readings import LogReadings
    from fitting.robotics.recording import Recording


def register(app: typer.Typer) -> None:
    """Add this module's command to the program."""
    app.command("invert")(invert)


def invert(
    skin: Annotated[Path, typer.Argument(metavar="SKIN", help="Skin file (TOML).")],
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="LOG", help="SO log; with --live, where readings are recorded (optional)."
        ),
    ] = None,
    live: Annotated[
        str | None, typer.Option(metavar="PORT", help="Read a port, as `suas log` does.")
    ] = None,
    format_name: Annotated[
        str, typer.Option("--format", metavar="NAME", help=f"Live: {', '.join(FORMAT_NAMES)}.")
    ] = "text",
    baud: Annotated[int, typer.Option(min=1, help="Live: bits per second.")] = 115200,
    duration: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="Live: stop after this long.")
    ] = None,
    latency: Annotated[
        float,
        typer.Option(metavar="S", help="Live: frames older than this are dropped, counted."),
    ] = 0.1,
    baseline: Annotated[
        Path | None, typer.Option(help="Readings at rest, from `suas baseline`.")
    ] = None,
    direction: Annotated[
        bool, typer.Option("--direction", help="Free the directions; radial otherwise.")
    ] = False,
    false_alarm: Annotated[
        float, typer.Option(metavar="RATE", help="Of a contact where there is none.")
    ] = 0.01,
    contacts: Annotated[
        int,
        typer.Option(min=1, max=4, help="Most to tell apart: up to 3, on a pad 4."),
    ] = 3,
    diameter: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH", help="On a pad: of the contacts, or 'free'; default 6 mm."
        ),
    ] = None,
    pressure_noise: Annotated[
        str | None,
        typer.Option(
            metavar="PRESSURE",
            help="On a pad: standard deviation of the log's oil_pressure_Pa, which is then "
            "used, such as '5 Pa'.",
        ),
    ] = None,
    workers: Workers = None,
    noise: Annotated[
        float | None,
        typer.Option(metavar="COUNTS", help="Standard deviation; default: the skin file's."),
    ] = None,
    model_error: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Of the model's change of readings."),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option("--filter", help="Add loads filtered over time (constant velocity)."),
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Write a figure of the loads over time.")
    ] = None,
    posterior: Annotated[
        int | None,
        typer.Option(metavar="SEQ", help="Sample the loads of the frame with this number."),
    ] = None,
    mcap: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also record taxels and loads as MCAP (ROS 2)."),
    ] = None,
    serve: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT", help="Live: send JSON lines to programs that connect (TCP)."
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON line a frame.")] = False,
) -> None:
    """Estimate contacts from readings: where, how strong, how sure.

    Exit status: 0 done, 2 bad input (also a log of another layout, or without a frame).
    """
    with bad_input():
        if (log is None) == (live is None) and live is None:
            raise ValueError("LOG: missing; give an SO log, or --live PORT")
        from suas_jax.acquisition.log.reader import MOST_BYTES

        record = log if live is not None else None
        check_outputs([plot, record, mcap], overwrite=overwrite)
        if serve is not None and live is None:
            raise ValueError("--serve: sends live estimates; give --live PORT")
        if mcap is not None:
            from fitting.robotics.recording import require_mcap

            require_mcap()
        if live is None and log is not None:  # before the estimator is made, which takes long
            check_readable(log, MOST_BYTES)
        from suas_jax.runtime.settings import configure

        configure()

        def prepare() -> "LoadEstimator":
            from fitting.inverse_load.skin_estimator import skin_estimator

            with spinner("preparing the estimate") as show:
                estimator = skin_estimator(
                    skin,
                    baseline,
                    progress=show,
                    direction=direction,
                    false_alarm=false_alarm,
                    most_contacts=contacts,
                    noise=noise,
                    live=live is not None,
                    model_error=model_error,
                    follow_drift=baseline is not None,
                    **pad_settings(diameter, pressure_noise, workers),
                )
            if estimator.input_errors.text:
                _say(estimator.input_errors.text)
            return estimator

        if live is not None:
            if posterior is not None or plot is not None:
                raise ValueError("--posterior and --plot need a log; leave --live out")
            from fitting.inverse_load.live.run import LiveOptions, run_live

            options = LiveOptions(
                live, format_name, baud, duration, latency, log, as_json, smooth, overwrite
            )

            def watchers(
                estimator: "LoadEstimator", stack: contextlib.ExitStack
            ) -> "list[LiveWatcher]":
                return _watchers(estimator, stack, skin, mcap, serve)

            run_live(prepare, options, watchers)
            return
        estimator = prepare()
        assert log is not None
        readings, estimates = _offline(
            estimator, skin, log, as_json=as_json, smooth=smooth, plot=plot, posterior=posterior
        )
        if mcap is not None:
            from fitting.robotics.log_recording import write_readings

            with _recording(estimator, skin, mcap) as recording:
                write_readings(recording, readings, estimates)


def _say(text: str) -> None:
    typer.echo(f"suas: {text}", err=True)


def _recording(estimator: "LoadEstimator", skin: Path, mcap: Path) -> "Recording":
    from fitting.robotics.recording import Recording

    rest = estimator.rest
    return Recording(mcap, estimator.spec, rest=rest, estimator=estimator, skin_file=skin)


def _watchers(
    estimator: "LoadEstimator",
    stack: contextlib.ExitStack,
    skin: Path,
    mcap: Path | None,
    serve: str | None,
) -> "list[LiveWatcher]":
    """What records a live run and sends it on."""
    found: list[LiveWatcher] = []
    if mcap is not None:
        from fitting.robotics.live_recording import LiveRecording

        found.append(LiveRecording(stack.enter_context(_recording(estimator, skin, mcap))))
    if serve is not None:
        from fitting.inverse_load.live.serve import LineServer

        server = stack.enter_context(LineServer(serve))
        _say("JSON lines at {}:{}".format(*server.address))
        found.append(server)
    return found


def _offline(
    estimator: "LoadEstimator",
    skin: Path,
    log: Path,
    *,
    as_json: bool,
    smooth: bool,
    plot: Path | None,
    posterior: int | None,
) -> "tuple[LogReadings, list[LoadEstimate]]":
    """Estimate a log, print and draw what was found, and return it with the readings."""
    from fitting.inverse_load.readings import EmptyLogError, LayoutMismatchError, readings_of
    from fitting.inverse_load.report.posterior_text import posterior_json, posterior_lines
    from fitting.inverse_load.report.text import frame_json, print_table
    from suas_jax.acquisition.log.log_file import read_log

    if plot is not None:
        from suas_jax.figures.style import check_figure_file

        check_figure_file(plot)
    try:
        readings = readings_of(read_log(log), estimator.spec, estimator.reading_noise)
    except (EmptyLogError, LayoutMismatchError) as error:
        status = "empty_log" if isinstance(error, EmptyLogError) else "layout_mismatch"
        if as_json:
            from fitting.inverse_load.estimator import LoadEstimate

            nothing = LoadEstimate(None, status=status)
            typer.echo(json_text(frame_json(float("nan"), None, nothing)))
        _say(str(error))
        raise typer.Exit(BAD_INPUT) from None
    for note in readings.notes:
        _say(f"{log}: {note}")
    modes = None if posterior is None else _modes(estimator, readings, posterior)
    with bar("estimating loads", len(readings.so)) as advance:
        estimates = estimator.estimate(
            readings.so,
            readings.stuck,
            advance,
            pressure=readings.pressure,
            time=readings.time,
        )
    with spinner("comparing the log with the skin file"):
        verdict = _verdict(estimator, readings, estimates)
    if verdict is not None and not (verdict.right and as_json):
        _say(f"{log}: {verdict.text}")
        command = verdict.command(str(skin), str(log))
        if command:
            _say(f"to set it right: {command}")
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
        typer.echo("\n".join(lines))
    else:
        print_table(readings.time, estimates)
        if modes is not None:
            typer.echo("\n".join(posterior_lines(modes)))
    return readings, estimates


def _verdict(
    estimator: "LoadEstimator", readings: "LogReadings", estimates: "list[LoadEstimate]"
) -> "ModelVerdict | None":
    """What a log says about its skin file; None where it has too few contacts."""
    so, stuck, pressure = readings.so, readings.stuck, readings.pressure
    if estimator.spec.geometry.dimension == 3:
        from fitting.inverse_load.check.skin_file import model_verdict

        return model_verdict(estimator, so, stuck, pressure, estimates)
    from fitting.inverse_load.check.section_log import section_verdict

    return section_verdict(
        estimator, so, stuck, estimates, pressure=pressure, force=readings.force
    )


def _modes(estimator: "LoadEstimator", readings: "LogReadings", seq: int) -> "list[LoadMode]":
    """Modes of the frame with a number."""
    import numpy as np

    from fitting.inverse_load.posterior import frame_posterior

    frames = np.flatnonzero(readings.seq == seq)
    if not frames.size:
        raise ValueError(
            f"--posterior {seq}: no such frame; the log has {readings.seq.min()} to "
            f"{readings.seq.max()}"
        )
    i = int(frames[0])
    try:
        return frame_posterior(
            estimator,
            readings.so[i],
            readings.stuck[i],
            progress=_say,
            pressure=float("nan") if readings.pressure is None else readings.pressure[i],
        )
    except ValueError as error:
        raise ValueError(f"--posterior {seq}: {error}") from None
