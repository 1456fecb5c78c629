"""`suas export`: logs for other programs. JAX is imported inside the command."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.log import skin_of_log
from fitting.cli.options import Baseline, argument, option
from fitting.cli.progress import bar, spinner
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_output

if TYPE_CHECKING:
    from fitting.inverse_load.estimator import LoadEstimator
    from fitting.inverse_load.readings import LogReadings
    from suas_jax.acquisition.log.log_file import SoLog
    from suas_jax.config import SkinSpec


def mcap(
    log: Annotated[Path, argument("SO log.", metavar="LOG")],
    output: Annotated[
        Path | None,
        option("File to write; default: LOG as .mcap.", "-o", "--output", metavar="FILE"),
    ] = None,
    skin: Annotated[
        Path | None, option("Skin file; default: the one the log's header names.")
    ] = None,
    baseline: Baseline = None,
    loads: Annotated[
        Path | None,
        option("Loads that `suas invert LOG --json` found; default: estimate.", metavar="FILE"),
    ] = None,
    taxels_only: Annotated[bool, option("Leave the loads out.", "--taxels-only")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Write a log as MCAP with ROS 2 messages: taxels, contacts, transforms.

    Exit status: 0 written, 2 bad input.
    """
    with bad_input():
        if loads is not None and taxels_only:
            raise ValueError("--loads and --taxels-only: give one of them")
        target = log.with_suffix(".mcap") if output is None else output
        check_output(target, overwrite=overwrite)
        from fitting.robotics.recording import require_mcap

        require_mcap()
        from suas_jax.acquisition.log.log_file import read_log

        read = read_log(log)
        skin = skin_of_log(read) if skin is None else skin
        if skin is None:
            raise ValueError(f"{log}: its header names no skin file that is here; give --skin")
        from fitting.inverse_load.zero.skin_estimator import estimator_of, rest_of
        from suas_jax.runtime.settings import configure
        from suas_jax.simulation.load_path import skin_behind

        configure()
        spec = skin_behind(skin)
        rest, _ = rest_of(spec, baseline)
        estimator, estimates = None, None
        if loads is None and not taxels_only:
            with spinner("preparing the estimate") as show:
                estimator = estimator_of(spec, baseline, progress=show)
        readings = _readings(read, spec, estimator)
        for note in readings.notes:
            say(f"suas: {log}: {note}", err=True)
        if loads is not None:
            from fitting.inverse_load.report.read_back import read_estimates

            estimates = read_estimates(loads, readings.seq)
        elif estimator is not None:
            with bar("estimating loads", len(readings.so)) as advance:
                estimates = estimator.estimate(
                    readings.so,
                    readings.stuck,
                    advance,
                    pressure=readings.pressure,
                    time=readings.time,
                )
        from fitting.robotics.recording import Recording, write_readings

        with (
            bar("writing", len(readings.so)) as advance,
            Recording(
                target, spec, rest=rest, estimator=estimator, skin_file=skin
            ) as recording,
        ):
            write_readings(recording, readings, estimates, advance)
    say(f"{target}: {len(readings.so)} frames", err=True)


def _readings(
    log: "SoLog", spec: "SkinSpec", estimator: "LoadEstimator | None"
) -> "LogReadings":
    """A log's frames, stuck taxels told by the noise that the estimate assumes."""
    from fitting.inverse_load.readings import Layout, readings_of

    Layout(spec)  # or there are no electrodes, which is said here
    assert spec.electrodes is not None
    noise = spec.electrodes.noise if estimator is None else estimator.reading_noise
    return readings_of(log, spec, noise)
