"""A live stream of readings: read, decode, judge, watch the link, come back when it is lost.

The kernel keeps only a few kilobytes for a port. So one thread does nothing but take bytes
away and stamp them; parsing, computing and a slow disk then can't lose any.
"""

import contextlib
import queue
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from types import FrameType
from typing import NamedTuple

from suas_jax.acquisition.frames.reading import Decoder, Reading, Tally
from suas_jax.acquisition.frames.registry import FORMATS
from suas_jax.acquisition.integrity import Flags, Integrity, Summary
from suas_jax.acquisition.ports.serial_port import PortError, Source

# A port that says nothing, or nothing that makes sense, for this long is reported [s]; a
# device that speaks more seldom, after three times its own second longest pause (the
# longest may have been a fault).
SILENT_AFTER = 1.5
_PAUSES = 3.0
# Wait between two tries to open a lost port again [s].
_RETRY = 0.2
# A silent network link is opened anew after this long: it may be dead without an error [s].
_DEAD_LINK = 5.0
# Bytes come one line at a time; taking a few milliseconds' worth at once costs far less
# and is still shorter than what the kernel's buffer holds [s].
_GATHER = 2e-3
# Chunks (of at most 64 kB) kept while the consumer is busy; beyond it the operating system
# and the device's flow control hold the rest.
_MOST_WAITING = 1024
# A port's buffer is forgotten at most so often: a fast device fills it again meanwhile.
_MOST_BUFFERS = 16
# Bytes kept to guess what an unintelligible stream is.
_RECENT = 4096


def discard_waiting(source: Source) -> None:
    """Forget the bytes that came while nobody read: they are of an unknown age."""
    for _ in range(_MOST_BUFFERS):
        if not source.waiting():
            return


class Judged(NamedTuple):
    """A reading, its device time with the clock's wraps undone [s], and its flags."""

    reading: Reading
    t_device: float
    flags: Flags


class _Chunk(NamedTuple):
    t_host: float
    data: bytes = b""
    lost: str = ""  # why the link was lost
    resumed: bool = False


class Stream:
    """Readings from an open source, until `stop` is set: what has arrived is delivered."""

    def __init__(
        self,
        source: Source,  # the open port; the stream closes it
        decode: Decoder,  # decoder of its format
        format_name: str,  # the format's name, for messages
        *,
        # called with a sentence about anything a person should know
        report: Callable[[str], None],
        # host time [s], as it shall stand in the readings
        clock: Callable[[], float] = time.monotonic,
        # how many each module has, where a skin file says so
        taxels: Mapping[int, int] | None = None,
        resumed: bool = False,  # the readings continue an earlier recording
    ) -> None:
        self.stop = threading.Event()
        self.reconnects = 0  # how often a lost link came back
        self.lost_link = False  # whether the link is lost now
        self._source = source
        self._decode = decode
        self._format = format_name
        self._report = report
        self._clock = clock
        self._integrity = Integrity(
            decode.clock_modulus, decode.checked, taxels=taxels, resumed=resumed
        )
        self._chunks: queue.Queue[_Chunk] = queue.Queue(_MOST_WAITING)
        self._heard = self._understood = self._lost_at = clock()
        self._recent = b""
        self._pauses = (0.0, 0.0)  # the two longest between chunks, ascending [s]
        self._silent = self._puzzled = False  # reported, and not yet over
        self._started = False

    @property
    def tally(self) -> Tally:
        """The decoder's counts."""
        return self._decode.tally

    @property
    def summary(self) -> Summary:
        """Totals of what was judged."""
        return self._integrity.summary

    @property
    def modules(self) -> list[int]:
        """The modules seen, ascending."""
        return self._integrity.modules

    @property
    def waiting(self) -> bool:
        """Whether more has arrived than was taken."""
        return not self._chunks.empty()

    def close(self) -> None:
        """End the stream and let go of the port, whether its batches were asked for or not."""
        self.stop.set()
        if not self._started:
            self._source.close()

    def batches(self) -> Generator[list[Judged], None, None]:
        """Readings in the order of arrival; an empty list at least ten times a second."""
        self._started = True
        reader = threading.Thread(target=self._read, name="suas port", daemon=True)
        reader.start()
        try:
            while not self.stop.is_set():
                try:
                    chunk = self._chunks.get(timeout=0.1)
                except queue.Empty:
                    self._watch()
                    yield []
                    continue
                yield self._take(chunk)
            reader.join(timeout=1.0)
            while not self._chunks.empty():
                yield self._take(self._chunks.get_nowait())
            yield self._judge(self._decode.finish())
        finally:
            self.stop.set()
            reader.join(timeout=1.0)
            self._source.close()

    def _take(self, chunk: _Chunk) -> list[Judged]:
        if chunk.lost:
            self._report(f"{chunk.lost}; waiting for it to come back")
            self.lost_link, self._lost_at = True, chunk.t_host
            return self._judge(self._decode.finish())
        if chunk.resumed:
            away = chunk.t_host - self._lost_at
            self._report(f"{self._source.name}: back after {away:.1f} s")
            self.reconnects += 1
            self.lost_link = self._silent = False
            self._heard = self._understood = chunk.t_host
            return []
        if not chunk.data:
            return []
        if self._silent:
            self._report(f"{self._source.name}: data again")
            self._silent = False
            self._understood = chunk.t_host
        if self._recent or self.tally.readings:
            pause = chunk.t_host - self._heard
            _, *longest = sorted((*self._pauses, pause))
            self._pauses = (longest[0], longest[1])
        self._heard = chunk.t_host
        readings = self._decode.feed(chunk.data, chunk.t_host)
        if readings:
            self._understood, self._puzzled = chunk.t_host, False
        else:
            self._recent = (self._recent + chunk.data)[-_RECENT:]
            self._watch()
        return self._judge(readings)

    def _judge(self, readings: list[Reading]) -> list[Judged]:
        self._integrity.checked = self._decode.checked
        judge = self._integrity.judge
        judged = [Judged(reading, *judge(reading)) for reading in readings]
        for sentence in self._integrity.sentences():
            self._report(f"{self._source.name}: {sentence}")
        return judged

    def _watch(self) -> None:
        """Report silence, and bytes that make no sense."""
        if self.lost_link:
            return
        now = self._clock()
        patience = max(SILENT_AFTER, _PAUSES * self._pauses[0])
        if now - self._heard > patience and not self._silent:
            self._silent = True
            self._report(
                f"{self._source.name}: silent for {now - self._heard:.0f} s, still listening; "
                "check that the device is powered and sends, the cable, and TX/RX"
            )
        elif self._heard - self._understood > patience and not self._puzzled:
            self._puzzled = True
            self._report(not_understood(self._source.name, self._format, self._recent))

    def _read(self) -> None:
        """The reading thread."""
        heard = self._clock()
        while not self.stop.is_set():
            try:
                data = self._source.read()
                now = self._clock()
                if data:
                    heard = now
                    self._chunks.put(_Chunk(now, data))
                    time.sleep(_GATHER)
                elif now - heard > 0.5 and self._source.is_gone():
                    raise PortError(f"{self._source.name}: was unplugged")
                elif now - heard > _DEAD_LINK and self._source.is_network:
                    raise PortError(f"{self._source.name}: silent for {_DEAD_LINK:.0f} s")
            except PortError as error:
                self._chunks.put(_Chunk(self._clock(), lost=str(error)))
                self._reopen()
                heard = self._clock()
        self._chunks.put(_Chunk(self._clock(), self._source.waiting()))

    def _reopen(self) -> None:
        while not self.stop.wait(_RETRY):
            try:
                self._source.reopen()
            except PortError:
                continue
            self._chunks.put(_Chunk(self._clock(), resumed=True))
            return


_PRINTABLE = frozenset(b"\t\r\n" + bytes(range(32, 127)))


def not_understood(name: str, wanted: str, recent: bytes) -> str:
    """A sentence for bytes that come but make no frame of the wanted format."""
    start = f'{name}: bytes come, but no frame of the format "{wanted}" among them'
    for other, known in FORMATS.items():
        if other == wanted:
            continue
        attempt = known.decoder()
        if (
            known.looks_like(recent)
            if known.looks_like is not None
            else attempt.feed(recent, 0.0) or attempt.finish()
        ):
            return f"{start}; they look like {other}: try --format {other}"
    printable = sum(byte in _PRINTABLE for byte in recent) / max(len(recent), 1)
    if printable > 0.95:
        line = max(recent.decode("ascii", "replace").splitlines()[1:-1], key=len, default="")
        shown = f', such as "{line[:60]}"' if line else ""
        return (
            f"{start}; they are text{shown}; a line must read "
            "seq,t_device_s,module,so_1,...,so_n with whole counts from 0 to 65535"
        )
    return (
        f"{start}; {100 * (1 - printable):.0f} % of them are not text: a wrong --baud makes "
        f"this, or another --format ({', '.join(f for f in FORMATS if f != wanted)})"
    )


@contextlib.contextmanager
def set_by_signal(stop: threading.Event) -> Iterator[None]:
    """Ctrl-C, SIGTERM and a closed terminal set an event instead of ending the process."""

    def end(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # not every system has all
    known = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, end) for number in known}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def ended_by_signal(stream: Stream) -> contextlib.AbstractContextManager[None]:
    """Signals end the stream; see `set_by_signal`."""
    return set_by_signal(stream.stop)
