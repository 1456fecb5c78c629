"""A whole log as a recording."""

from collections.abc import Callable, Sequence

import numpy as np

from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.readings import LogReadings
from fitting.robotics.recording import Recording, start_stamp

_EVERY = 100  # frames between two reports of progress


def write_readings(
    recording: Recording,
    readings: LogReadings,
    estimates: Sequence[LoadEstimate] | None,
    done: Callable[[int], None] = lambda frames: None,
) -> None:
    """Write a log's frames.

    Args:
        recording: to write to.
        readings: of the log.
        estimates: of its frames; None where nothing was estimated.
        done: called with the number of frames written so far.
    """
    stamps = start_stamp(readings.header) + np.round(1e9 * readings.host_time).astype(np.int64)
    for i, stamp in enumerate(np.maximum(stamps, 0).tolist()):
        sequence = int(readings.seq[i])
        recording.taxels(
            stamp, sequence, float(readings.time[i]), readings.so[i], readings.stuck[i]
        )
        if estimates is not None:
            recording.contacts(stamp, sequence, estimates[i])
        if i % _EVERY == 0:
            done(i)
