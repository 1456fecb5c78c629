"""Fuzz what reads files and ports: no traceback, no hang over 5 s, no memory over 1 GB.

    python benchmarks/fuzzing.py --seconds 3600

Mutated bytes go into every frame decoder and every parser of files (logs, baselines, skins,
scenes, load paths, material data), mutated tables into the configuration. Frames come out in
the order of their arrival. What a parser may raise is what its command turns into one line for
the user; anything else is a finding, printed with the seed that makes it again. Exit status: 0
nothing found, 1 findings.
"""

import argparse
import itertools
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from suas_jax.acquisition.baseline import read_baseline
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.frames.registry import ENCODERS, FORMATS
from suas_jax.acquisition.health import log_health
from suas_jax.acquisition.integrity import Integrity
from suas_jax.acquisition.log.log_file import group_frames, read_log
from suas_jax.acquisition.log.resume import end_of_log
from suas_jax.config import load_scene, load_skin
from suas_jax.config.csv_table import read_csv_table

CONFIGS = Path(__file__).parent.parent / "configs"
HANG = 5  # [s]
MEMORY = 1_000_000_000  # bytes of the process, beyond what it needs for its imports
# What commands turn into one line (fitting.cli.contract).
EXPECTED = (ValueError, OSError, MemoryError, RecursionError, OverflowError)
# Pieces that break parsers more often than random bytes do.
PIECES = (
    *(b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b'"', b"'''", b"\n", b"\r", b","),
    *(b"nan", b"-1", b"inf", b"1e999", b"9" * 40, b"1_000", b"[[", b"]" * 50, b"{" * 200),
    *(b"= 1 m**9**9\n", b"*0000", b"\xf0\x9f\x90\x99", b"so_1,", b"t_host_s"),
    *(b"\x00\x01\x40", b"# continued_in: a.csv\n"),
)


class HangError(Exception):
    """An input took longer than HANG."""


class Finding(NamedTuple):
    """Something that must not happen."""

    target: str  # what was fuzzed
    seed: int  # that makes the input again
    what: str  # the last line of the traceback


def mutated(data: bytes, draw: random.Random) -> bytes:
    """Data with some bytes flipped, taken out, doubled, or replaced by hostile pieces."""
    changed = bytearray(data)
    for _ in range(draw.choice((1, 1, 2, 4, 16))):
        at = draw.randrange(len(changed) + 1)
        end = min(at + draw.choice((1, 2, 8, 64)), len(changed))
        kind = draw.randrange(5)
        if kind == 0 and at < len(changed):
            changed[at] ^= 1 << draw.randrange(8)
        elif kind == 1:
            del changed[at:end]
        elif kind == 2:
            changed[at:at] = changed[at:end] * draw.choice((1, 2, 50))
        elif kind == 3:
            changed[at:end] = draw.choice(PIECES)
        else:
            changed[at:at] = draw.randbytes(draw.choice((1, 4, 32)))
    return bytes(changed)


def file_targets() -> dict[str, tuple[Callable[[Path], object], list[bytes]]]:
    """Parsers of files, and inputs to begin with."""
    log = b"# format: suas-so-log\n# start_time: 2025-11-21T00:00:00+00:00\n"
    log += b"t_host_s,t_device_s,seq,module,so_1,so_2,lost,other_taxels\n"
    log += b"".join(
        b"%g,%g,%d,0,%d,%d,0,0\n" % (0.01 * k, 0.01 * k, k, 13000 + k % 7, 13100 - k % 5)
        for k in range(60)
    )
    baseline = b'{"format": "suas-baseline", "format_version": 1, "frames": 50, "modules": '
    baseline += b'[{"module": 0, "so": [1.5, null], "noise": [2.0, null]}]}'

    def judged(path: Path) -> None:
        found = read_log(path)
        group_frames(found)
        log_health(found)

    skins = [path.read_bytes() for path in sorted((CONFIGS / "skins").glob("*.toml"))]
    scenes = [path.read_bytes() for path in sorted((CONFIGS / "scenes").glob("*.toml"))]
    scenes = [text.replace(b"../", str(CONFIGS).encode() + b"/") for text in scenes]
    tables = [path.read_bytes() for path in sorted((CONFIGS / "data").glob("*.csv"))]
    return {
        "log": (judged, [log]),
        "end of log": (end_of_log, [log]),
        "baseline": (read_baseline, [baseline]),
        "skin": (load_skin, skins),
        "scene": (load_scene, scenes),
        "table": (read_csv_table, tables),
    }


def frame_target(name: str) -> tuple[Callable[[bytes], object], bytes]:
    """A decoder fed in pieces, its readings judged; and a stream to begin with."""

    def feed(data: bytes) -> None:
        decode = FORMATS[name].decoder()
        integrity = Integrity(decode.clock_modulus, decode.checked)
        draw = random.Random(len(data))
        at = 0
        readings: list[Reading] = []
        while at < len(data):
            size = draw.choice((1, 7, 100, 4096))
            readings += decode.feed(data[at : at + size], 0.001 * at)
            at += size
        readings += decode.finish()
        for reading in readings:
            integrity.judge(reading)
        if any(b.t_host < a.t_host for a, b in itertools.pairwise(readings)):
            raise AssertionError("t_host runs backwards")

    readings = (Reading(k, 0.01 * k, k % 3, (13000 + k, None, 7)) for k in range(30))
    return feed, b"".join(map(ENCODERS[name], readings))


def targets() -> Iterator[tuple[str, Callable[[random.Random, Path], None]]]:
    """Everything that is fuzzed: its name, and one trial."""
    for name, (parse, inputs) in file_targets().items():

        def trial_file(
            draw: random.Random,
            folder: Path,
            parse: Callable[[Path], object] = parse,
            inputs: list[bytes] = inputs,
        ) -> None:
            path = folder / "fuzzed.csv"
            path.write_bytes(mutated(draw.choice(inputs), draw))
            parse(path)

        yield name, trial_file
    for name in FORMATS:
        if name not in ENCODERS:
            continue
        feed, stream = frame_target(name)

        def trial_frames(
            draw: random.Random,
            folder: Path,
            feed: Callable[[bytes], object] = feed,
            stream: bytes = stream,
        ) -> None:
            feed(mutated(stream, draw))

        yield f"frames: {name}", trial_frames


def fuzz(
    seconds: float,  # for all
    seed: int = 0,  # of the first input; the n-th has seed + n
) -> tuple[dict[str, int], list[Finding]]:
    """Fuzz until the time is over; number of inputs of each target, and what was found."""

    def interrupt(_signal: int, _frame: FrameType | None) -> None:
        raise HangError(f"took more than {HANG} s")

    everything = list(targets())
    trials = dict.fromkeys((name for name, _ in everything), 0)
    findings: list[Finding] = []
    begin = time.monotonic()
    before = signal.signal(signal.SIGALRM, interrupt)
    with tempfile.TemporaryDirectory() as folder:
        try:
            while time.monotonic() - begin < seconds:
                for name, trial in everything:
                    found = _tried(name, trial, seed, Path(folder))
                    trials[name] += 1
                    findings += [found] if found else []
                    seed += 1
        finally:
            signal.alarm(0)
            signal.signal(signal.SIGALRM, before)
    return trials, findings


def _tried(
    name: str, trial: Callable[[random.Random, Path], None], seed: int, folder: Path
) -> Finding | None:
    signal.alarm(HANG)
    try:
        trial(random.Random(seed), folder)
    except EXPECTED as error:
        if isinstance(error, ValueError | OSError) and not str(error).strip():
            return Finding(name, seed, f"{type(error).__name__} without a message")
    except Exception:
        return Finding(name, seed, traceback.format_exc().strip().splitlines()[-1])
    finally:
        signal.alarm(0)
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    trials, findings = fuzz(arguments.seconds, arguments.seed)
    for name, count in trials.items():
        print(f"{name}: {count} inputs")
    for finding in findings[:100]:
        print(f"{finding.target}, seed {finding.seed}: {finding.what}")
    print(f"{len(findings)} findings")
    sys.exit(bool(findings))


if __name__ == "__main__":
    main()
