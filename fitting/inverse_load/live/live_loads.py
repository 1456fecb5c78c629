"""Loads from a port as an iterator: a control loop in a few lines."""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.estimate.estimate import LoadEstimate, load_array
from fitting.inverse_load.estimate.load_field import LoadField
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.live.stream import LiveFrame, live_frames
from fitting.inverse_load.zero.skin_estimator import skin_estimator
from suas_jax.acquisition.frames.registry import decoder, open_source
from suas_jax.acquisition.stream import Stream, discard_waiting
from suas_jax.runtime.start import configure_when_computing

_log = logging.getLogger("suas")


@dataclass(frozen=True)
class LoadFrame:
    """The loads of one frame.

    Attributes:
        time_s: on the device's clock if it has one, else on the host's [s].
        seq: frame number.
        contact: whether anything touches the skin; None where the readings cannot say.
        status: a key of `fitting.inverse_load.estimate.estimate.STATUS`; trust the numbers
            where it is `ok`.
        loads: structured array [load] with the fields `angle_rad` from the symmetry axis,
            `force_N` inwards, and `covariance` [2, 2] of these two in rad and N; on a pad
            `axial_m` stands between them, `diameter_m`, `direction_rad` and `tilt_rad` follow
            where they are estimated, and the covariance is as much larger.
        filtered: the same, followed over time; None where that wasn't asked for.
        field: a load field with intervals, where contacts do not explain the frame; else None.
        oil_pressure_Pa: above ambient [Pa]; NaN where unknown.
        latency_s: from the arrival of the frame's last byte to its estimate [s].
        dropped: frames left out so far because they had waited too long.
        estimate: all that is known of the frame.
    """

    time_s: float
    seq: int
    contact: bool | None
    status: str
    loads: NDArray[np.void]
    filtered: NDArray[np.void] | None
    field: LoadField | None
    oil_pressure_Pa: float  # noqa: N815 - the name that reports give it
    latency_s: float
    dropped: int
    estimate: LoadEstimate


class LiveLoads(Iterator[LoadFrame]):
    """Iterates over the loads of a port's frames; `live_loads` makes it.

    It ends when `close` is called, also from another thread or a signal handler.
    """

    def __init__(
        self,
        stream: Stream,
        estimator: LoadEstimator,
        *,
        latency_s: float,
        smooth: bool,
        timeout_s: float | None,
    ) -> None:
        self.estimator = estimator
        self._stream = stream
        self._timeout = timeout_s
        self._heard = time.monotonic()
        self._frames = live_frames(
            stream, estimator, latency=latency_s, smooth=smooth, idle=self._watch
        )

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> LoadFrame:
        self._heard = time.monotonic()
        return self._as_arrays(next(self._frames))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the iteration and let go of the port."""
        self._stream.close()
        with contextlib.suppress(ValueError):  # it is running, and sees that it should end
            self._frames.close()

    def _watch(self) -> None:
        waited = time.monotonic() - self._heard
        if self._timeout is not None and waited > self._timeout:
            raise TimeoutError(f"no frame came for {waited:.2f} s")

    def _as_arrays(self, frame: LiveFrame) -> LoadFrame:
        estimate, names = frame.estimate, self.estimator.names
        return LoadFrame(
            frame.time,
            frame.seq,
            estimate.contact,
            estimate.status,
            load_array(estimate.contacts, names),
            None if frame.filtered is None else load_array(frame.filtered, names),
            estimate.field,
            estimate.oil_pressure,
            estimate.latency,
            frame.dropped,
            estimate,
        )


def live_loads(
    skin: str | Path | LoadEstimator,
    port: str,
    *,
    frame_format: str = "text",
    baud: int = 115200,
    baseline: str | Path | None = None,
    latency_s: float = 0.1,
    timeout_s: float | None = None,
    smooth: bool = False,
    report: Callable[[str], None] = _log.warning,
    **settings: Any,
) -> LiveLoads:
    """Estimate loads from a port, frame by frame, as they come.

    JAX is switched to float64 (`suas_jax.configure`) where it is needed: single contacts on a
    pad whose table this machine keeps go without it. The port is opened first, so that one that
    is missing or busy is refused at once; the first frames follow when the estimator has been
    prepared, seconds later, or minutes where the skin is new to this machine.

    Args:
        skin: skin file; or an estimator that was made with `live=True`.
        port: as `suas log` takes it.
        frame_format: `text`, `cobs`, `jsonl` or `roboskin`.
        baud: bits per second.
        baseline: readings at rest, of `suas baseline`; readings are absolute without it.
        latency_s: frames that have waited longer are dropped, and counted [s].
        timeout_s: raise TimeoutError when no frame comes for so long; None waits [s].
        smooth: also follow loads over time (`LoadFrame.filtered`).
        report: called with a sentence about what a person should know, such as a link that
            is lost; by default the logger `suas`.
        settings: of the `LoadEstimator`, such as the `budget` of a frame [s].

    Raises:
        PortError: the port can't be opened.
        ConfigError: the skin file can't be used.
        ValueError: an argument makes no sense.
    """
    if not latency_s > 0 or (timeout_s is not None and not timeout_s > 0):
        raise ValueError(f"latency_s = {latency_s}, timeout_s = {timeout_s}: times above zero")
    if isinstance(skin, LoadEstimator) and (settings or baseline is not None):
        raise ValueError("baseline and settings belong to the estimator that was given")
    if isinstance(skin, LoadEstimator) and not skin.live:
        raise ValueError("the estimator is for batches; make it with live=True")
    decode = decoder(frame_format)
    source = open_source(port, frame_format, baud)
    try:
        configure_when_computing()
        if isinstance(skin, LoadEstimator):
            estimator = skin
        else:
            rest = None if baseline is None else Path(baseline)
            estimator = skin_estimator(Path(skin), rest, live=True, **settings)
        estimator.warm_up()
        discard_waiting(source)
    except BaseException:
        source.close()
        raise
    stream = Stream(source, decode, frame_format, report=report)
    return LiveLoads(stream, estimator, latency_s=latency_s, smooth=smooth, timeout_s=timeout_s)
