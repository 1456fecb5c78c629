"""`suas invert`. JAX is imported inside the command."""

import contextlib
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.options import (
    Baseline,
    Baud,
    Duration,
    Format,
    LivePort,
    Plot,
    SkinFile,
    TrustNetwork,
    Workers,
    argument,
    computing,
    material_note,
    option,
    pad_settings,
    remark,
)
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_outputs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from fitting.inverse_load.estimator import LoadEstimator
    from fitting.inverse_load.live.stream import LiveWatcher
    from fitting.robotics.recording import Recording
    from suas_jax.config import SkinSpec


def invert(
    skin: SkinFile,
    log: Annotated[
        Path | None,
        argument(
            "Log of taxels; with --live, where readings are recorded (optional).", metavar="LOG"
        ),
    ] = None,
    live: LivePort = None,
    format_name: Format = "text",
    baud: Baud = 115200,
    duration: Duration = None,
    latency: Annotated[
        float, option("Live: drop frames older than this, except the newest.", metavar="S")
    ] = 0.1,
    budget: Annotated[
        str | None,
        option(
            "Live, on a pad: time that a frame may take ('20 ms'); what is left to try goes "
            "on with the next.",
            metavar="TIME",
        ),
    ] = None,
    baseline: Baseline = None,
    zero: Annotated[
        str | None,
        option(
            "What `suas zero` wrote; default: SKIN.zero.toml beside the skin, if any.",
            metavar="FILE|none",
        ),
    ] = None,
    direction: Annotated[
        bool,
        option(
            "Expect nothing of the directions of forces; else they are near radial.",
            "--direction",
        ),
    ] = False,
    false_alarm: Annotated[
        float, option("How often to report a contact where there is none.", metavar="RATE")
    ] = 0.01,
    contacts: Annotated[
        int,
        option("Largest number of contacts to look for; on a section at most 3.", min=1, max=4),
    ] = 3,
    diameter: Annotated[
        str | None,
        option(
            "On a pad: diameter expected of contacts (6 mm), or 'free' to estimate it.",
            metavar="LENGTH",
        ),
    ] = None,
    pressure_noise: Annotated[
        str | None,
        option(
            "Standard deviation of the log's oil_pressure_Pa, which is then used: on a section "
            "by load fields alone ('5 Pa').",
            metavar="PRESSURE",
        ),
    ] = None,
    load_fields: Annotated[
        bool | None,
        option(
            "Try a pressure over the skin (palms, straps) where one contact does not explain a "
            "frame; default on sections, takes seconds a frame on pads.",
            "--load-fields/--no-load-fields",
        ),
    ] = None,
    workers: Workers = None,
    trust_network: TrustNetwork = False,
    noise: Annotated[
        float | None, option("Noise of a reading; default: the skin file's.", metavar="COUNTS")
    ] = None,
    model_error: Annotated[
        float | None,
        option("Error of the model, as a share of the change of readings.", metavar="SHARE"),
    ] = None,
    smooth: Annotated[
        bool, option("Add loads filtered over time (constant velocity).", "--filter")
    ] = False,
    plot: Plot = None,
    posterior: Annotated[
        int | None, option("Sample the loads of the frame with this number.", metavar="SEQ")
    ] = None,
    mcap: Annotated[
        Path | None, option("Also record taxels and loads as MCAP (ROS 2).", metavar="FILE")
    ] = None,
    serve: Annotated[
        str | None,
        option("Live: send JSON lines to programs that connect (TCP).", metavar="HOST:PORT"),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Annotated[bool, option("One JSON line a frame.", "--json")] = False,
) -> None:
    """Estimate contacts from readings: where, how strong, how sure.

    Exit status: 0 done, 2 bad input (also a log of another layout, or without a frame).
    """
    with bad_input():
        if (log is None) == (live is None) and live is None:
            raise ValueError("LOG: missing; give a log, or --live PORT")
        record = log if live is not None else None
        check_outputs([plot, record, mcap], overwrite=overwrite)
        if serve is not None and live is None:
            raise ValueError("--serve: sends live estimates; give --live PORT")
        if mcap is not None:
            from fitting.robotics.recording import require_mcap

            require_mcap()
        on_pad = pad_settings(diameter, pressure_noise, budget)
        spec = _spec_of(skin, zero)

        settings = on_pad | {
            "direction": direction,
            "false_alarm": false_alarm,
            "most_contacts": contacts,
            "noise": noise,
            "live": live is not None,
            "model_error": model_error,
            "load_fields": load_fields,
            "follow_drift": baseline is not None,
        }
        making = _making(baseline, settings, workers, trust_network)
        if live is not None:
            if posterior is not None or plot is not None:
                raise ValueError("--posterior and --plot need a log; leave --live out")
            from fitting.inverse_load.live.run import LiveOptions, run_live

            options = LiveOptions(
                live, format_name, baud, duration, latency, log, as_json, smooth, overwrite
            )

            def prepare() -> "LoadEstimator":
                with making as make:
                    return _estimator_now(spec, make)

            def watchers(
                estimator: "LoadEstimator", stack: contextlib.ExitStack
            ) -> "list[LiveWatcher]":
                return _watchers(estimator, stack, skin, mcap, serve)

            run_live(prepare, options, watchers)
            return
        assert log is not None
        from fitting.cli.invert_log import invert_log, read_for
        from fitting.inverse_load.log.log_estimator import LogEstimator, skin_states

        readings = read_for(spec, log, noise, as_json=as_json, plot=plot, posterior=posterior)
        settings["noise"] = readings.noise
        states = skin_states(spec, readings, str(log))
        with making as make:
            found = LogEstimator(readings, states, make)
        remark(*found.states.said)
        _assumed(found.main)
        estimates = invert_log(
            found, skin, log, as_json=as_json, smooth=smooth, plot=plot, posterior=posterior
        )
        if mcap is not None:
            from fitting.robotics.recording import write_readings

            with _recording(found.main, skin, mcap) as recording:
                write_readings(recording, readings, estimates)


def _spec_of(skin: Path, zero: str | None) -> "SkinSpec":
    """The skin with its zero, which is named."""
    from fitting.inverse_load.zero.zero_file import skin_with_zero

    spec, told = skin_with_zero(skin, zero)
    remark(told)
    material_note(spec)
    return spec


@contextlib.contextmanager
def _making(
    baseline: Path | None, settings: dict[str, Any], workers: str | None, trust: bool
) -> "Iterator[Callable[[SkinSpec, str], LoadEstimator]]":
    """Yields what makes the estimator of a skin, in a state that has a name."""
    how = "preparing the estimate", workers, trust
    with computing(*how, later=settings["live"]) as (show, processes):
        from fitting.inverse_load.zero.skin_estimator import estimator_of

        def make(spec: "SkinSpec", name: str) -> "LoadEstimator":
            def told(text: str) -> None:
                show(f"{name}: {text}" if name else text)

            return estimator_of(spec, baseline, progress=told, workers=processes, **settings)

        yield make


def _estimator_now(
    spec: "SkinSpec", make: "Callable[[SkinSpec, str], LoadEstimator]"
) -> "LoadEstimator":
    """The estimator of a skin whose zero is of some time ago."""
    from fitting.inverse_load.zero.zero_file import aged

    now, said = aged(spec, datetime.now(UTC).isoformat())
    estimator = make(now, "")
    remark(*said)
    _assumed(estimator)
    return estimator


def _assumed(estimator: "LoadEstimator") -> None:
    """Say what the skin file leaves open."""
    from fitting.inverse_load.memory.series import assumed_of_memory

    remark(estimator.input_errors.text, assumed_of_memory(estimator.spec))


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
        from fitting.robotics.recording import LiveRecording

        found.append(LiveRecording(stack.enter_context(_recording(estimator, skin, mcap))))
    if serve is not None:
        from fitting.inverse_load.live.serve import LineServer

        server = stack.enter_context(LineServer(serve))
        say("suas: JSON lines at {}:{}".format(*server.address), err=True)
        say(f"suas: clients send this line first: {server.token}", err=True)
        found.append(server)
    return found
