"""A simulated device: plays readings on a pseudo-terminal, with faults on demand."""

import contextlib
import errno
import json
import math
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from itertools import groupby
from pathlib import Path

from suas_jax.acquisition.device.faults import Faults, Injector
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.frames.registry import encoder
from suas_jax.acquisition.log.log_file import SoLog, read_log
from suas_jax.acquisition.stream import set_by_signal
from suas_jax.acquisition.terminal import say

# A device whose host doesn't take its bytes drops them after this long [s].
_HOST_STALLS = 0.5
# How often an idle device looks whether a host has opened the port [s].
_LOOK = 0.01
# A host needs this long from opening the port to switching off the terminal's echo [s].
_SETTLE = 0.05


@dataclass
class Played:
    """What a device has done: the truth that a log can be held against."""

    rows: int = 0  # rows sent, the damaged ones included
    damaged: int = 0  # rows with at least one changed byte
    dropped: int = 0  # rows left out on purpose
    duplicated: int = 0  # rows sent twice
    stalled: int = 0  # rows among them that no host took: none there, too slow, or unplugged
    bytes: int = 0  # bytes sent


def log_readings(log: SoLog) -> Iterator[Reading]:
    """The readings of a log, to play it again; without device times, its host times."""
    counts = [
        tuple(None if c != c else round(c) for c in row[: _last_present(row)])
        for row in log.so.tolist()
    ]
    device = log.t_device if not any(log.t_device != log.t_device) else log.t_host
    columns = zip(log.seq.tolist(), device.tolist(), log.module.tolist(), counts, strict=True)
    return (Reading(*row) for row in columns)


def _last_present(row: list[float]) -> int:
    return max((k + 1 for k, c in enumerate(row) if c == c), default=len(row))


def repeated(readings: Iterable[Reading]) -> Iterator[Reading]:
    """The readings over and over, their counter and clock going on."""
    once = list(readings)
    if not once:
        return
    frames = max(r.seq for r in once) - min(r.seq for r in once) + 1
    span = once[-1].t_device - once[0].t_device
    lap = span * frames / max(frames - 1, 1)
    n = 0
    while True:
        for r in once:
            yield r._replace(seq=r.seq + n * frames, t_device=r.t_device + n * lap)
        n += 1


class Device:
    """A device on a pseudo-terminal; `played` is what it has sent so far."""

    def __init__(
        self,
        format_name: str,  # frame format, a key of `ENCODERS`
        faults: Faults | None = None,  # what goes wrong
        # symbolic link to keep pointing at the pseudo-terminal, whose own name changes when it
        # is plugged in again
        link: Path | None = None,
    ) -> None:
        self.played = Played()
        self._encode = encoder(format_name)
        self._faults = Faults() if faults is None else faults
        self._injector = Injector(self._faults)
        self._link = link
        self._master = -1
        if link is not None and (link.exists() or link.is_symlink()) and not link.is_symlink():
            raise FileExistsError(f"{link}: exists and is not a link; choose another name")
        if self._faults.unplug_at is not None and link is None:
            raise ValueError(
                "the fault unplug needs --port LINK: a port that comes back has another name"
            )
        self.plug_in()

    @property
    def port(self) -> str:
        """What to open: the link, or the pseudo-terminal itself."""
        return str(self._link) if self._link is not None else self._terminal

    def plug_in(self) -> None:
        """Make the pseudo-terminal appear."""
        self._master, slave = os.openpty()
        tty.setraw(slave, termios.TCSANOW)
        self._terminal = os.ttyname(slave)
        # Closed here, so that the master can tell whether a host has it open.
        os.close(slave)
        os.set_blocking(self._master, False)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(self._terminal)

    def unplug(self) -> None:
        """Make it vanish, as a pulled cable does."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    close = unplug

    def __enter__(self) -> "Device":
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def wait_for_host(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Return once a host has opened the port."""
        while not self._has_host() and not stopped():
            time.sleep(_LOOK)
        time.sleep(_SETTLE)
        self._drain()

    def let_host_finish(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Stay plugged in until the host has taken what was sent, or has left."""
        patience = time.monotonic() + _HOST_STALLS
        while self._has_host() and not stopped() and time.monotonic() < patience:
            time.sleep(_LOOK)

    def play(
        self,
        readings: Iterable[Reading],  # in order of time; those of equal time are sent together
        *,
        speed: float = 1.0,  # times faster than their clock
        duration: float | None = None,  # end after this long [s]
        stopped: Callable[[], bool] = lambda: False,  # asked between frames whether to end
    ) -> Played:
        """Send readings at the pace of their device times; returns what was sent."""
        start, first, stalled = time.monotonic(), math.nan, False
        for t_device, together in groupby(readings, key=lambda reading: reading.t_device):
            first = t_device if math.isnan(first) else first
            due = start + (t_device - first) / speed
            elapsed = max(due, time.monotonic()) - start
            if duration is not None and elapsed > duration:
                break
            while (wait := due - time.monotonic()) > 0 and not stopped():
                time.sleep(min(wait, 0.1))
            if stopped():
                break
            self._follow_plug(elapsed)
            rows = list(self._rows(together))
            # What became due while no host took anything is gone, as in a real device.
            overdue = stalled and time.monotonic() > due + _LOOK
            stalled = overdue or self._master < 0 or not self._send(b"".join(rows))
            self.played.stalled += len(rows) * stalled
        return self.played

    def _follow_plug(self, elapsed: float) -> None:
        """Unplug, and plug in again, when the time has come."""
        at, away = self._faults.unplug_at, self._faults.unplug_for
        if at is None:
            return
        absent = at <= elapsed < at + away
        if absent and self._master >= 0:
            self.unplug()
        elif not absent and self._master < 0:
            self.plug_in()

    def _rows(self, readings: Iterable[Reading]) -> Iterator[bytes]:
        played = self.played
        for reading in readings:
            copies = self._injector.copies()
            played.dropped += copies == 0
            played.duplicated += copies == 2
            for _ in range(copies):
                data = self._encode(self._injector.distorted(reading))
                damaged = self._injector.damaged(data)
                played.rows += 1
                played.damaged += damaged != data
                yield damaged

    def _has_host(self) -> bool:
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def _drain(self) -> None:
        """Read and forget what the host sent."""
        with contextlib.suppress(OSError):
            while os.read(self._master, 4096):
                pass

    def _send(self, data: bytes) -> bool:
        """Send, with the patience of a device; False if the host didn't take it."""
        self._drain()
        patience = time.monotonic() + _HOST_STALLS
        while data:
            if not self._has_host() or time.monotonic() > patience:
                return False
            try:
                sent = os.write(self._master, data)
                self.played.bytes += sent
                data = data[sent:]
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.EIO):
                    raise
                select.select([], [self._master], [], _LOOK)
        return True


@dataclass(frozen=True)
class LiveOptions:
    """How to play. Raises ValueError: an unknown format, or a speed that is none."""

    format_name: str = "text"  # frame format, as `suas log --format` takes it, or text-checked
    link: Path | None = None  # symbolic link to the pseudo-terminal
    faults: Faults = field(default_factory=Faults)  # what goes wrong
    speed: float = 1.0  # times faster than the readings' clock
    duration: float | None = None  # end after this long [s]
    loop: bool = False  # play over and over
    as_json: bool = False  # print the port, and at the end what was played, as JSON lines

    def __post_init__(self) -> None:
        encoder(self.format_name)
        if not 0 < self.speed < float("inf"):
            raise ValueError(f"--speed {self.speed:g}: a number above zero is needed")


def play_log(path: Path, options: LiveOptions) -> None:
    """Play a log; LogFileError where it is none."""
    play_live(log_readings(read_log(path)), options)


def play_live(readings: Iterable[Reading], options: LiveOptions) -> None:
    """Wait for a host, then play readings, in order of time, until their end or a signal."""
    stop = threading.Event()
    with (
        set_by_signal(stop),
        Device(options.format_name, options.faults, options.link) as device,
    ):
        name = options.format_name.removesuffix("-checked")
        if options.as_json:
            say(json.dumps({"port": device.port, "format": name}))
        else:
            say(device.port)
            say(
                f"suas: waiting for a host: suas log {device.port} --format {name} -o "
                "LOG.csv; Ctrl-C ends",
                err=True,
            )
        device.wait_for_host(stop.is_set)
        played = device.play(
            repeated(readings) if options.loop else readings,
            speed=options.speed,
            duration=options.duration,
            stopped=stop.is_set,
        )
        device.let_host_finish(stop.is_set)
    if options.as_json:
        say(json.dumps(asdict(played)))
    else:
        words = ", ".join(f"{value} {name}" for name, value in asdict(played).items() if value)
        say(f"suas: played {words or 'nothing'}", err=True)
