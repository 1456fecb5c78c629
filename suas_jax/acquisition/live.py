"""`suas simulate --live`: play readings as a device on a pseudo-terminal, for a person."""

import json
import signal
import threading
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from types import FrameType

import typer

from suas_jax.acquisition.device import Device
from suas_jax.acquisition.faults import parse_faults
from suas_jax.acquisition.reading import Reading


def play_live(
    readings: Iterable[Reading],
    *,
    format_name: str = "text",
    link: Path | None = None,
    faults: Iterable[str] = (),
    speed: float = 1.0,
    duration: float | None = None,
    as_json: bool = False,
) -> None:
    """Wait for a host, then play until the readings end, Ctrl-C or SIGTERM.

    Args:
        readings: in order of time.
        format_name: frame format, as `suas log --format` takes it, or text-checked.
        link: symbolic link to the pseudo-terminal.
        faults: as on the command line, see `parse_faults`.
        speed: times faster than the readings' clock.
        duration: end after this long [s].
        as_json: print the port and what was played as JSON lines.

    Raises:
        ValueError: an unknown format or fault.
    """
    if not speed > 0:
        raise ValueError(f"--speed {speed:g}: a number above zero")
    stop = threading.Event()

    def end(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with Device(format_name, parse_faults(faults), link) as device:
            name = format_name.removesuffix("-checked")
            if as_json:
                typer.echo(json.dumps({"port": device.port, "format": name}))
            else:
                typer.echo(device.port)
                typer.echo(
                    f"suas: waiting for a host: suas log {device.port} --format {name} -o "
                    "LOG.csv; Ctrl-C ends",
                    err=True,
                )
            device.wait_for_host(stop.is_set)
            played = device.play(readings, speed=speed, duration=duration, stopped=stop.is_set)
            if not stop.is_set():
                device.let_host_finish(stop.is_set)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if as_json:
        typer.echo(json.dumps(asdict(played)))
    else:
        words = ", ".join(f"{value} {name}" for name, value in asdict(played).items() if value)
        typer.echo(f"suas: played {words or 'nothing'}", err=True)
