"""`suas export`: logs for other programs. JAX is imported inside the command."""

from pathlib import Path
from typing import Annotated

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.log_frames import log_frames
from fitting.cli.options import (
    Baseline,
    LoadsOfLog,
    SkinOfLog,
    TaxelsOnly,
    argument,
    output_option,
)
from fitting.cli.progress import bar
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_output


def mcap(
    log: Annotated[Path, argument("Log of taxels.", metavar="LOG")],
    output: Annotated[
        Path | None, output_option("File to write; default: LOG as .mcap.")
    ] = None,
    skin: SkinOfLog = None,
    baseline: Baseline = None,
    loads: LoadsOfLog = None,
    taxels_only: TaxelsOnly = False,
    overwrite: Overwrite = False,
) -> None:
    """Write a log as MCAP with ROS 2 messages: taxels, contacts, transforms.

    Exit status: 0 written, 2 bad input.
    """
    with bad_input():
        target = log.with_suffix(".mcap") if output is None else output
        check_output(target, overwrite=overwrite)
        from fitting.robotics.recording import require_mcap

        require_mcap()
        found = log_frames(log, skin, baseline, loads, taxels_only=taxels_only)
        readings, estimates, estimator = found.readings, found.estimates, found.estimator
        for note in readings.notes:
            say(f"suas: {log}: {note}", err=True)
        if estimator is not None:
            with bar("estimating loads", len(readings.so)) as advance:
                estimates = estimator.estimate(advance)
        from fitting.robotics.recording import Recording, write_readings

        with (
            bar("writing", len(readings.so)) as advance,
            Recording(
                target,
                found.spec,
                rest=found.rest,
                estimator=None if estimator is None else estimator.main,
                skin_file=found.skin,
            ) as recording,
        ):
            write_readings(recording, readings, estimates, advance)
    say(f"{target}: {len(readings.so)} frames", err=True)
