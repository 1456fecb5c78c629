"""What `suas log` keeps, costs and survives, over a pseudo-terminal.

    python benchmarks/acquisition.py [--seconds 60] [--fuzz-megabytes 10]

A simulated device (32 modules x 10 taxels x 100 Hz) plays in this process; the logger is a
process of its own, whose processor time is measured. Every recorded row is compared with
what was sent.
"""

import argparse
import contextlib
import itertools
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from suas_jax.acquisition.device.device import Device
from suas_jax.acquisition.device.faults import Faults
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.frames.registry import ENCODERS, decoder
from suas_jax.acquisition.log.log_file import read_log

MODULES, TAXELS, RATE = 32, 10, 100.0
SUAS = [sys.executable, "-c", "from fitting.cli.app import main; main()"]


def counts(seq: int, module: int) -> tuple[int, ...]:
    return tuple(13000 + (7 * seq + 13 * k + module) % 997 for k in range(TAXELS))


def frames(seconds: float) -> Iterator[Reading]:
    for seq in range(round(seconds * RATE)):
        for module in range(MODULES):
            yield Reading(seq, seq / RATE, module, counts(seq, module))


class Watched(Device):
    """A device that notes which rows it sent undamaged."""

    def __init__(self, *args: object, **options: object) -> None:
        super().__init__(*args, **options)  # type: ignore[arg-type]
        self.whole: set[tuple[int, int]] = set()
        self.sent: set[tuple[int, int]] = set()
        encode, damaged = self._encode, self._injector.damaged
        current: list[tuple[int, int]] = [(0, 0)]

        def noting(reading: Reading) -> bytes:
            current[0] = (reading.seq, reading.module)
            self.sent.add(current[0])
            return encode(reading)

        def comparing(data: bytes) -> bytes:
            out = damaged(data)
            if out == data:
                self.whole.add(current[0])
            return out

        self._encode, self._injector.damaged = noting, comparing  # type: ignore[method-assign]


def logger(link: Path, name: str, path: Path, *options: str) -> subprocess.Popen[str]:
    args = ["log", str(link), "--format", name, "-o", str(path), "--json", *options]
    return subprocess.Popen([*SUAS, *args], stdout=subprocess.PIPE, text=True)


def children_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def throughput(folder: Path, encoder: str, seconds: float, faults: Faults) -> list[str]:
    name = encoder.removesuffix("-checked")
    path = folder / f"{encoder}-{faults.corrupt}.csv"
    before = children_seconds()
    with Watched(encoder, faults, folder / "port") as device:
        opened = time.monotonic()
        process = logger(folder / "port", name, path)
        device.wait_for_host()
        opened = time.monotonic() - opened
        device.play(frames(seconds))
        time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        totals = json.loads(process.communicate()[0])
    share = (children_seconds() - before) / seconds
    log = read_log(path)
    rows = list(zip(log.seq.tolist(), log.module.tolist(), log.so.tolist(), strict=True))
    got = {(seq, module) for seq, module, _ in rows}
    if name == "roboskin":  # 8 bits arrive: the rows are compared by number
        false = len(got - device.sent)
    else:
        false = sum(
            (seq, module) not in device.sent or tuple(so) != counts(seq, module)
            for seq, module, so in rows
        )
    damaged = len(device.sent - device.whole)
    return [
        f"{encoder}, {100 * faults.corrupt:g} % of bytes changed",
        str(len(device.sent)),
        str(damaged),
        str(len(device.whole - got)),
        str(false),
        str(totals["lost_frames"]),
        f"{100 * share:.1f} %",
        f"{opened:.2f} s",
    ]


def replug(folder: Path) -> list[tuple[str, str]]:
    path = folder / "replug.csv"
    with Device("cobs", Faults(unplug_at=2.0, unplug_for=1.0), folder / "port") as device:
        process = logger(folder / "port", "cobs", path)
        device.wait_for_host()
        device.play(frames(6.0))
        time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        process.communicate()
    times = read_log(path).t_host
    gap = float(max(b - a for a, b in itertools.pairwise(times)))
    return [("unplugged for 1 s: resumes after it is back", f"{gap - 1.0:.2f} s")]


def kill(folder: Path) -> list[tuple[str, str]]:
    lost = []
    for k in range(5):
        path = folder / f"kill{k}.csv"
        with Watched("cobs", None, folder / "port") as device:
            process = logger(folder / "port", "cobs", path)
            device.wait_for_host()
            device.play(frames(1.0 + 0.07 * k))
            process.kill()
            process.communicate()
        log = read_log(path)
        got = list(zip(log.seq.tolist(), log.module.tolist(), strict=True))
        assert got == sorted(device.sent)[: len(got)], "the log has a hole"
        lost.append((len(device.sent) - len(got)) / (MODULES * RATE))
    return [("kill -9, five times: reads back whole, loses at most", f"{max(lost):.3f} s")]


def trouble(label: str, port: str, name: str, word: str) -> tuple[str, str]:
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [*SUAS, "log", port, "--format", name, "-o", f"{folder}/log.csv"],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stderr
        line = process.stderr.readline()
        spent = time.monotonic() - start
        process.terminate()
        process.communicate()
    assert word in line, line
    return (label, f"{spent:.2f} s")


def troubles() -> list[tuple[str, str]]:
    rows = [trouble("no such port: named after", "/dev/ttyNONE", "text", "no such port")]
    senders = {
        "silent": ("text", lambda n: b"", "silent"),
        "another format": (
            "text",
            lambda n: ENCODERS["cobs"](Reading(n, 0.0, 0, (1,))),
            "cobs",
        ),
        "another baud rate": ("text", lambda n: os.urandom(20), "--baud"),
    }
    for label, (name, data, word) in senders.items():
        with Device("text") as device:
            done = threading.Event()

            def send(device: Device = device, data=data, done=done) -> None:  # type: ignore[no-untyped-def]
                device.wait_for_host(done.is_set)
                n = 0
                while not done.wait(0.02):
                    with contextlib.suppress(OSError):
                        device._send(data(n))
                    n += 1

            thread = threading.Thread(target=send)
            thread.start()
            rows.append(trouble(f"{label}: named after", device.port, name, word))
            done.set()
            thread.join()
    return rows


def fuzz(encoder: str, megabytes: float) -> list[str]:
    rng = random.Random(1)
    reading = Reading(7, 0.07, 3, counts(7, 3))
    true = b"\n" + ENCODERS[encoder](reading)
    decode = decoder(encoder.removesuffix("-checked"))
    fed = accepted = false = 0
    tracemalloc.start()
    while fed < megabytes * 1e6:
        chunk = bytearray(rng.randbytes(rng.randrange(1, 4000)))
        for _ in range(rng.randrange(4)):  # whole frames, and frames with a byte changed
            piece = bytearray(true)
            if rng.random() < 0.5:
                piece[rng.randrange(len(piece))] = rng.randrange(256)
            at = rng.randrange(len(chunk))
            chunk[at:at] = piece
        readings = decode.feed(bytes(chunk), 0.0)
        accepted += len(readings)
        false += sum(r.counts != reading.counts for r in readings)
        fed += len(chunk)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return [encoder, f"{fed / 1e6:.1f} MB", str(accepted), str(false), f"{peak / 1e3:.0f} kB"]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--seconds", type=float, default=60.0)
    options.add_argument("--fuzz-megabytes", type=float, default=10.0)
    options.add_argument("--formats", default="text,text-checked,cobs")
    chosen = options.parse_args()
    console = Console()
    table = Table(
        "stream", "rows sent", "damaged", "whole but not kept", "false", "counted lost",
        "processor", "opened after",
        title=f"{MODULES} modules x {TAXELS} taxels x {RATE:g} Hz, {chosen.seconds:g} s",
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for encoder in chosen.formats.split(","):
            table.add_row(*throughput(folder, encoder, chosen.seconds, Faults()))
            if encoder in ("cobs", "text-checked"):
                faults = Faults(corrupt=0.01, seed=1)
                table.add_row(*throughput(folder, encoder, chosen.seconds, faults))
        console.print(table)
        events = Table("event", "measured")
        for row in replug(folder) + kill(folder) + troubles():
            events.add_row(*row)
    console.print(events)
    parsers = Table("decoder", "fuzzed with", "frames accepted", "false", "peak memory")
    for encoder in ENCODERS:
        parsers.add_row(*fuzz(encoder, chosen.fuzz_megabytes))
    console.print(parsers)


if __name__ == "__main__":
    main()
