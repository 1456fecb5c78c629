"""A log with its skin and what finds its loads, for commands that show or convert it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fitting.cli.options import remark
from fitting.cli.progress import spinner

if TYPE_CHECKING:
    from fitting.arrays import Floats
    from fitting.inverse_load.estimate.estimate import LoadEstimate
    from fitting.inverse_load.estimator import LoadEstimator
    from fitting.inverse_load.log.log_estimator import LogEstimator
    from fitting.inverse_load.readings import LogReadings
    from suas_jax.acquisition.log.log_file import SoLog
    from suas_jax.config import SkinSpec


class LogFrames(NamedTuple):
    """What is known of a log."""

    skin: Path  # file of its skin
    spec: "SkinSpec"  # that skin
    rest: "Floats | None"  # readings at rest
    readings: "LogReadings"  # its frames
    estimator: "LogEstimator | None"  # of loads; None where they are known or left out
    estimates: "list[LoadEstimate] | None"  # the loads, where they are known


def log_frames(
    log: Path,
    skin: Path | None,  # its skin file; None for the one that its header names
    baseline: Path | None,  # readings at rest
    loads: Path | None,  # what `suas invert LOG --json` found
    *,
    taxels_only: bool,
    **options: Any,  # of the estimator
) -> LogFrames:
    """Read a log. Raises ValueError: it names no skin, or options contradict each other."""
    if loads is not None and taxels_only:
        raise ValueError("--loads and --taxels-only: give one of them")
    from fitting.inverse_load.log.log_estimator import LogEstimator, skin_states
    from fitting.inverse_load.readings import readings_of
    from fitting.inverse_load.report.read_back import read_estimates
    from fitting.inverse_load.zero.skin_estimator import estimator_of, rest_of
    from fitting.inverse_load.zero.zero_file import skin_with_zero, zero_file_of
    from suas_jax.acquisition.log.log_file import read_log
    from suas_jax.runtime.settings import configure
    from suas_jax.simulation.load_path import skin_behind

    read = read_log(log)
    file = skin_of_log(read) if skin is None else skin
    if file is None:
        raise ValueError(f"{log}: its header names no skin file that is here; give --skin")
    configure()
    spec, told = (
        skin_with_zero(file) if zero_file_of(file).is_file() else (skin_behind(file), "")
    )
    rest, _ = rest_of(spec, baseline)
    readings = readings_of(read, spec, options.get("noise"))
    options["noise"] = readings.noise
    estimator = None
    if loads is None and not taxels_only:
        states = skin_states(spec, readings, str(log))
        with spinner("preparing the estimate") as show:

            def make(spec: "SkinSpec", name: str) -> "LoadEstimator":
                show(name or "preparing the estimate")
                return estimator_of(spec, baseline, progress=show, **options)

            estimator = LogEstimator(readings, states, make)
        remark(told, *estimator.states.said)
    estimates = None if loads is None else read_estimates(loads, readings.seq)
    return LogFrames(file, spec, rest, readings, estimator, estimates)


def skin_of_log(log: "SoLog") -> Path | None:
    """The skin file that the log's header names, if it is here."""
    name = log.header.get("skin", "")
    places = (Path(name), log.path.parent / name)
    return next((place for place in places if name and place.is_file()), None)
