"""`suas simulate --live`: play readings as a device on a pseudo-terminal, for a person."""

import json
import threading
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from suas_jax.acquisition.device.device import Device, log_readings, repeated
from suas_jax.acquisition.device.faults import Faults
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.frames.registry import ENCODERS
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.acquisition.signals import set_by_signal
from suas_jax.acquisition.terminal import say


@dataclass(frozen=True)
class LiveOptions:
    """How to play.

    Raises:
        ValueError: an unknown format, or a speed that is none.
    """

    format_name: str = "text"  # frame format, as `suas log --format` takes it, or text-checked
    link: Path | None = None  # symbolic link to the pseudo-terminal
    faults: Faults = field(default_factory=Faults)  # what goes wrong
    speed: float = 1.0  # times faster than the readings' clock
    duration: float | None = None  # end after this long [s]
    loop: bool = False  # play over and over
    as_json: bool = False  # print the port, and at the end what was played, as JSON lines

    def __post_init__(self) -> None:
        if self.format_name not in ENCODERS:
            raise ValueError(
                f'--format "{self.format_name}": allowed are {", ".join(sorted(ENCODERS))}'
            )
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
