"""`suas invert --live`: a port read, its loads estimated, shown, sent on and recorded."""

import contextlib
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.live.stream import (
    FrameReadings,
    LiveFrame,
    LiveWatcher,
    json_line,
    live_frames,
)
from fitting.inverse_load.report.text import contact_text, field_text
from suas_jax.acquisition.frames.registry import decoder, open_source
from suas_jax.acquisition.log.log_file import LogWriter, log_header
from suas_jax.acquisition.log.record import FLAG_COLUMNS, write_reading
from suas_jax.acquisition.stream import Judged, Stream, discard_waiting, ended_by_signal
from suas_jax.acquisition.terminal import LiveTerminal, say

if TYPE_CHECKING:
    from rich.table import Table

_WIDTH = 61  # characters of the pad's picture
_WINDOW = 2.0  # rates are means over this time [s]
_REFRESH = 0.1  # between two pictures [s]


class LoadView(LiveTerminal, LiveWatcher):
    """Messages on stderr; on a terminal also a picture that moves.

    The estimator names the skin, the title is the port. `show`: whether a picture is wanted;
    without a terminal there is none.
    """

    def __init__(self, estimator: LoadEstimator, title: str, *, show: bool) -> None:
        super().__init__(show and sys.stderr.isatty(), _REFRESH)
        self._by_arc, self._edge = estimator.along.name == "arc", estimator.along.edge
        self._title = title
        self._times: deque[float] = deque()

    def said(self, sentence: str) -> None:
        """Print a sentence."""
        self.say(sentence)

    def estimated(self, frame: LiveFrame) -> None:
        """Show a frame, a few times a second."""
        now = time.monotonic()
        self._times.append(now)
        while now - self._times[0] > _WINDOW:
            self._times.popleft()
        if self.due():
            self.draw(self._table(frame))

    def _table(self, frame: LiveFrame) -> "Table":
        from rich.table import Table

        estimate = frame.estimate
        table = Table(show_header=False, box=None, title=self._title, title_justify="left")
        if self._by_arc:
            arcs = [c.arc for c in estimate.contacts if c.arc is not None]
            line = picture(arcs, self._edge, unit=" mm", scale=1e3)
        else:
            line = picture([c.angle for c in estimate.contacts], self._edge)
        table.add_row("pad", line)
        for contact in estimate.contacts:
            table.add_row("load", contact_text(contact))
        if estimate.field is not None:
            table.add_row("load", field_text(estimate.field))
        if not np.isnan(estimate.oil_pressure):
            table.add_row("oil", f"{1e-3 * estimate.oil_pressure:.2f} kPa")
        table.add_row("status", estimate.status_text)
        span = max(self._times[-1] - self._times[0], 1e-9)
        rate = (len(self._times) - 1) / span
        table.add_row("rate", f"{rate:.1f} per second, {frame.dropped} dropped")
        table.add_row("latency", f"{1e3 * estimate.latency:.1f} ms")
        return table


def picture(
    angles: list[float], edge: float, *, unit: str = "°", scale: float = 180 / np.pi
) -> str:
    """The pad from edge to edge as a line of characters, a mark at each contact.

    Angles are those of the contacts, or their places along the axis; `edge` is the largest that
    there is. `scale` turns them into the unit that is written at the edges.
    """
    line = ["─"] * _WIDTH
    line[0], line[-1], line[_WIDTH // 2] = "├", "┤", "┼"
    for angle in angles:
        place = round((angle / edge + 1) / 2 * (_WIDTH - 1))
        line[min(max(place, 0), _WIDTH - 1)] = "▼"
    limit = f"{scale * edge:.0f}{unit}"
    return f"-{limit} {''.join(line)} +{limit}"


@dataclass(frozen=True)
class LiveOptions:
    """How to run."""

    port: str  # as `suas log` takes it
    format_name: str = "text"
    baud: int = 115200  # bits per second
    duration: float | None = None  # stop after this long [s]
    latency: float = 0.1  # age at which a frame is dropped [s]
    log: Path | None = None  # where readings are recorded, if anywhere
    as_json: bool = False  # JSON lines instead of a view
    smooth: bool = False  # filter over time
    overwrite: bool = False  # replace an existing log

    def __post_init__(self) -> None:
        if not self.latency > 0:
            raise ValueError(f"--latency {self.latency:g}: a time above zero is needed")


class JsonLines(LiveWatcher):
    """A JSON line a frame on the standard output."""

    def estimated(self, frame: LiveFrame) -> None:
        """Print it."""
        say(json_line(frame))


def run_live(
    prepare: Callable[[], LoadEstimator],
    options: LiveOptions,
    watchers: Callable[
        [LoadEstimator, contextlib.ExitStack], Sequence[LiveWatcher]
    ] = lambda estimator, stack: (),
) -> None:
    """`suas invert --live`: until Ctrl-C, SIGTERM or the end of the duration.

    `prepare` makes the estimator, which takes long: a port that can't be opened is refused
    before. `watchers` makes what takes part; what it enters into the stack is left at the end.
    Raises ValueError: the log was deleted, moved or replaced, and went on beside its place.
    Raises PortError: the port can't be opened.
    """
    decode = decoder(options.format_name)
    source = open_source(options.port, options.format_name, options.baud)
    with contextlib.ExitStack() as stack:
        stack.callback(source.close)
        estimator = prepare()
        estimator.warm_up()
        present = [*watchers(estimator, stack)]
        discard_waiting(source)
        writer: LogWriter | None = None
        if options.log is not None:  # not before the port is known to be there
            extra = decode.extra_columns
            writer = stack.enter_context(
                _log_writer(estimator, options, extra, lambda sentence: say(sentence))
            )
        view = stack.enter_context(LoadView(estimator, options.port, show=not options.as_json))
        present.insert(0, view)
        if options.as_json:
            present.append(JsonLines())

        def say(sentence: str) -> None:
            for watcher in present:
                watcher.said(sentence)

        stream = Stream(source, decode, options.format_name, report=say)
        began = time.monotonic()

        def idle() -> None:
            if writer is not None and stream.lost_link:
                writer.flush()  # nothing more comes that would do it
            for watcher in present:
                watcher.waited(stream)
            if options.duration is not None and time.monotonic() - began > options.duration:
                stream.stop.set()

        def record(judged: Judged) -> None:
            if writer is not None:
                write_reading(writer, judged, began)

        def read(frame: FrameReadings) -> None:
            for watcher in present:
                watcher.read(frame)

        frames = dropped = 0
        with ended_by_signal(stream):
            for frame in live_frames(
                stream,
                estimator,
                latency=options.latency,
                smooth=options.smooth,
                on_reading=record,
                on_frame=read,
                idle=idle,
            ):
                frames, dropped = frames + 1, frame.dropped
                for watcher in present:
                    watcher.estimated(frame)
        say(f"{options.port}: {frames} frames estimated, {dropped} dropped")
    if writer is not None and writer.beside:
        raise ValueError(
            f"{options.log}: was lost while it was recorded; the log is in {writer.beside[-1]}"
        )


def _log_writer(
    estimator: LoadEstimator,
    options: LiveOptions,
    extra_columns: tuple[str, ...],
    report: Callable[[str], None],
) -> LogWriter:
    assert options.log is not None
    header = log_header(
        scale=f"{1e15 * estimator.spec.sensing.lsb:.6g} fF",
        start_time=datetime.now(UTC),
        port=options.port,
        frame_format=options.format_name,
    )
    flags = FLAG_COLUMNS + extra_columns
    return LogWriter(
        options.log, header, flags=flags, overwrite=options.overwrite, report=report
    )
