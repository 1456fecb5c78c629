"""Two processes at the same files, killed and delayed between any two calls of the system.

    python -m benchmarks.interleavings                   # 2,000 of them
    python -m benchmarks.interleavings --count 100 log table

Two forked processes do what commands do with their files. Every call of the system that opens,
locks, writes, moves or removes a file may be delayed, and may be the one before which the
process is killed (SIGKILL). Each says what it has done, over a pipe. Afterwards everything that
was said must be there: rows, lines and steps that were written, by whoever; files that nobody
was told to replace; files under their own name are whole; no two processes ever had one file;
and the cache gave back what was put there, or nothing. Exit status: 0 all was well, 1 not.
"""

import argparse
import collections
import contextlib
import fcntl
import json
import os
import random
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from suas_jax.acquisition.log.log_file import LogFileError, LogWriter, log_header, read_log
from suas_jax.files.cache_folder import CacheFolder, kept_arrays
from suas_jax.files.command import command_files
from suas_jax.files.line_file import LineFile
from suas_jax.files.ownership import OwnedError, owned
from suas_jax.files.writing import check_output, write_text

_CALLS = "open write replace rename link unlink fsync ftruncate pread"
_LONGEST_DELAY = 2e-3  # [s]
_MOST_CALLS = 60  # among which the one is at which half of the processes are killed
_TRIES = 30  # of a process that is refused
_ROWS = 12
_EARLIER = "what was there before\n"

Say = Callable[..., None]


class Event(NamedTuple):
    """What a process said that it had done."""

    process: int  # 0 or 1
    what: str  # it did
    value: Any  # which one
    time: float  # after it was done [s]


def disturbed(draw: random.Random, *, killed: bool) -> None:
    """Delay this process at some calls of the system, and kill it at one of them."""
    left = round(_MOST_CALLS ** draw.random()) if killed else -1

    def at_call(call: Callable[..., Any]) -> Callable[..., Any]:
        def late(*arguments: Any, **options: Any) -> Any:
            nonlocal left
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            if draw.random() < 0.3:
                time.sleep(draw.uniform(0, _LONGEST_DELAY))
            return call(*arguments, **options)

        return late

    for name in _CALLS.split():
        setattr(os, name, at_call(getattr(os, name)))
    fcntl.flock = at_call(fcntl.flock)  # type: ignore[assignment]


def log(folder: Path, process: int, draw: random.Random, say: Say) -> None:
    """As `suas log`, which replaces, goes on in, or makes a file."""
    overwrite = draw.random() < 0.5
    append = not overwrite and draw.random() < 0.7
    path = folder / "run.csv"
    with command_files() if draw.random() < 0.5 else contextlib.nullcontext():
        check_output(path, overwrite=overwrite or append)
        if overwrite:
            say("may replace")
        rotated = 1500 if draw.random() < 0.3 else None
        with LogWriter(
            path,
            log_header(),
            flush_interval=9.0,
            overwrite=overwrite,
            append=append,
            rotate_bytes=rotated,
        ) as writer:
            say("replaced" if overwrite else "began")
            if writer.taxels is None:
                writer.start(2)
            for k in range(_ROWS):
                writer.write(0.01 * k, 0.01 * k, k, process, [k, k])
                if k % 3 == 2:
                    writer.flush()
                    say("rows", k)
            say("ended")


def check_log(folder: Path, events: list[Event]) -> Iterator[str]:
    """Rows are there unless their log was replaced, as its user had said, later on."""
    yield from overlapping(events)
    found = {row for file in folder.glob("*.csv") for row in rows_in(file, follow=False)}
    rows_in(folder / "run.csv")  # all parts are there
    said = {(e.process, e.what) for e in events}
    for event in events:
        other = 1 - event.process
        replaced = any(
            e.what == "replaced" and e.process == other and e.time > event.time for e in events
        ) or {(other, "may replace"), (other, "killed")} <= said - {(other, "replaced")}
        if event.what == "rows" and not replaced:
            lost = {(event.process, k) for k in range(event.value + 1)} - found
            if lost:
                yield f"rows are lost: {sorted(lost)}"


def rows_in(file: Path, *, follow: bool = True) -> set[tuple[int, int]]:
    """Module and number of each row; none where the columns are not named yet."""
    try:
        part = read_log(file, follow=follow)
    except FileNotFoundError:
        if file.name != "run.csv":
            raise
        return set()
    except LogFileError as error:
        if "no line of column names" not in str(error):
            raise
        return set()
    return set(zip(part.module.tolist(), part.seq.tolist(), strict=True))


def lost_log(folder: Path, process: int, draw: random.Random, say: Say) -> None:
    """One records; the other deletes, moves or replaces its file meanwhile."""
    path, acted = folder / "run.csv", folder / "acted"
    if process == 0:
        often = draw.choice([0.0, 9.0])
        rotated = 1500 if draw.random() < 0.3 else None
        with LogWriter(
            path,
            log_header(),
            taxels=2,
            flush_interval=0.0,
            sync_interval=often,
            rotate_bytes=rotated,
        ) as writer:
            say("began")
            for k in range(6 * _ROWS):
                # Rotation comes later: a part that it has ended has no owner any more.
                while k == _ROWS and not acted.exists():
                    writer.flush()
                writer.write(0.01 * k, 0.01 * k, k, 0, [k, k])
        say("rows", k)
        say("beside", [str(file) for file in writer.beside])
        return
    while not path.exists():
        time.sleep(1e-4)
    time.sleep(draw.uniform(0, 0.02))
    how = draw.choice(["delete", "move", "replace"])
    if how == "replace":
        (folder / "other").write_text(_EARLIER)
        os.replace(folder / "other", path)
        say("placed")
    elif how == "move":
        os.rename(path, folder / "moved.txt")
    else:
        os.unlink(path)
    acted.touch()


def check_lost_log(folder: Path, events: list[Event]) -> Iterator[str]:
    """Every row is in a file that has the log's name, and what replaced it is untouched."""
    (last,) = (e.value for e in events if e.what == "rows")
    placed = any(e.what == "placed" for e in events)
    if placed and (folder / "run.csv").read_text() != _EARLIER:
        yield "what was put in its place is gone"
    logs = [file for file in folder.glob("run*.csv") if file.read_text() != _EARLIER]
    found = {row for file in logs for row in rows_in(file, follow=False)}
    if found != {(0, k) for k in range(last + 1)}:
        yield "rows are lost"


def result(folder: Path, process: int, draw: random.Random, say: Say) -> None:
    """As a command that computes, then writes a table."""
    overwrite = draw.random() < 0.6
    path = folder / "table.csv"
    with command_files():
        check_output(path, overwrite=overwrite)
        say("replaced" if overwrite else "began")
        time.sleep(draw.uniform(0, 4e-3))
        write_text(path, f"{process}\n" * 5000)
        say("wrote")
        time.sleep(draw.uniform(0, 4e-3))
        say("ended")


def check_result(folder: Path, events: list[Event]) -> Iterator[str]:
    """One of the tables, whole, and the earlier one unless a user said otherwise."""
    yield from overlapping(events)
    path = folder / "table.csv"
    text = path.read_text() if path.exists() else None
    earlier = any(e.what == "earlier" for e in events)
    tables = {f"{k}\n" * 5000: k for k in (0, 1)}
    told = {e.process for e in events if e.what == "replaced"}
    if text not in (_EARLIER if earlier else None, *tables):
        yield f"a file that is not whole: {text and len(text)} bytes"
    elif earlier and text in tables and tables[text] not in told:
        yield "a file was replaced unasked"
    elif text not in tables and any(e.what == "wrote" for e in events):
        yield "what was written is gone"


def chain(folder: Path, process: int, draw: random.Random, say: Say) -> None:
    """As a posterior whose chain is resumed: replaced whole, with what it had and more."""
    path = folder / "chain"
    with owned(path):
        say("began")
        steps = path.read_text() if path.exists() else ""
        for k in range(6):
            steps += f"{process}.{k}\n"
            write_text(path, steps)
            say("steps", f"{process}.{k}\n")
        say("ended")


def check_chain(folder: Path, events: list[Event]) -> Iterator[str]:
    """Every step is there."""
    yield from overlapping(events)
    path = folder / "chain"
    steps = path.read_text() if path.exists() else ""
    lost = [e.value for e in events if e.what == "steps" and e.value not in steps]
    if lost or (steps and not steps.endswith("\n")):
        yield f"steps are lost: {lost}"


def results(folder: Path, process: int, draw: random.Random, say: Say) -> None:
    """As `suas fit materials`: a line a result, in a file that is gone on with."""
    path = folder / "results.jsonl"
    with contextlib.closing(LineFile.open(path)) as file:
        say("began")
        for k in range(6):
            file.append(json.dumps([process, k]) + "\n")
            file.sync()
            say("line", [process, k])
        say("ended")


def check_results(folder: Path, events: list[Event]) -> Iterator[str]:
    """Every line is there, and whole."""
    yield from overlapping(events)
    path = folder / "results.jsonl"
    text = path.read_text() if path.exists() else ""
    lines = [json.loads(line) for line in text.splitlines()]
    lost = [e.value for e in events if e.what == "line" and e.value not in lines]
    if lost:
        yield f"lines are lost: {lost}"


def content(name: str) -> bytes:
    """What an entry of the cache must be."""
    return name.encode() * 3000


def cache(folder: Path, process: int, draw: random.Random, say: Say) -> None:
    """As compiled programs: entries made, read, discarded and pushed out by others."""
    kept = CacheFolder(folder / "kept", most_bytes=20_000, key_file=folder / "key" / "key")
    for _ in range(12):
        name = draw.choice("abc")
        found = kept.get(name)
        if found is None:
            kept.put(name, content(name))
        elif found != content(name):
            say("damaged", name)
        if draw.random() < 0.1:
            kept.discard(name)
        if draw.random() < 0.3:
            kept.settled()
    kept.settled()


def check_cache(folder: Path, events: list[Event]) -> Iterator[str]:
    """Nothing but what was put there comes back, and the folder still works."""
    yield from ("a damaged entry was served" for e in events if e.what == "damaged")
    kept = CacheFolder(folder / "kept", most_bytes=20_000, key_file=folder / "key" / "key")
    for name in "abc":
        if kept.get(name) not in (None, content(name)):
            yield "a damaged entry is served"
    kept.put("a", content("a"))
    if kept.get("a") != content("a"):
        yield f"nothing can be kept any more: {kept.refusal}"
    kept.settled()


def table(folder: Path, process: int, draw: random.Random, say: Say) -> None:
    """As the tables of solved states, which one process computes and the other waits for."""
    kept = CacheFolder(folder / "kept", key_file=folder / "key" / "key")

    def compute() -> Mapping[str, Any]:
        say("began")
        time.sleep(draw.uniform(0, 4e-3))
        say("ended")
        return {"x": np.arange(1000)}

    warnings.simplefilter("ignore")
    for _ in range(2):
        if not np.array_equal(kept_arrays("t", compute, kept)["x"], np.arange(1000)):
            say("damaged")
    say("computed")


def check_table(folder: Path, events: list[Event]) -> Iterator[str]:
    """Nobody computed the table at the same time, and it was kept.

    What a process was reading when it was killed is discarded: it may have been the cause.
    """
    yield from overlapping(events)
    yield from ("a damaged table was served" for e in events if e.what == "damaged")
    kept = CacheFolder(folder / "kept", key_file=folder / "key" / "key")
    said = {e.what for e in events}
    if "computed" in said and "killed" not in said and kept.get("t") is None:
        yield "the table was not kept"
    kept.settled()


def overlapping(events: list[Event]) -> Iterator[str]:
    """Two processes that had one file at a time."""
    begun = [e for e in events if e.what in ("began", "replaced")]
    for first in begun:
        ended = [e.time for e in events if e.process == first.process and e.time > first.time]
        if any(
            first.time < e.time < max(ended, default=0)
            for e in begun
            if e.process != first.process
        ):
            yield "two processes had one file"


class Scenario(NamedTuple):
    """What two processes do, and what must be true afterwards."""

    run: Callable[[Path, int, random.Random, Say], None]
    check: Callable[[Path, list[Event]], Iterator[str]]
    before: Callable[[Path], object] = lambda folder: None
    kills: bool = True


def earlier_log(folder: Path) -> None:
    """A log that is there before; the rows of module 7."""
    with LogWriter(folder / "run.csv", log_header(), taxels=2) as writer:
        writer.write(0.0, 0.0, 0, 7, [1, 1])


SCENARIOS = {
    "log": Scenario(log, check_log, earlier_log),
    "lost log": Scenario(lost_log, check_lost_log, kills=False),
    "result": Scenario(result, check_result, lambda f: (f / "table.csv").write_text(_EARLIER)),
    "chain": Scenario(chain, check_chain),
    "lines": Scenario(results, check_results),
    "cache": Scenario(cache, check_cache),
    "table": Scenario(table, check_table),
}


def interleaved(scenario: Scenario, folder: Path, seed: int) -> tuple[list[str], list[Event]]:
    """Run two processes once; what is wrong, and what they said."""
    draw = random.Random(seed)
    events = []
    if draw.random() < 0.5:
        scenario.before(folder)
        events.append(Event(-1, "earlier", True, 0.0))
    inlet, outlet = os.pipe()
    sys.stdout.flush()
    started = [forked(scenario, folder, seed, process, outlet) for process in (0, 1)]
    os.close(outlet)
    with open(inlet, encoding="utf-8") as said:
        events += [Event(*json.loads(line)) for line in said]
    for process, child in enumerate(started):
        if os.WIFSIGNALED(os.waitpid(child, 0)[1]):
            events.append(Event(process, "killed", None, 0.0))
    wrong = [f"crashed: {e.value}" for e in events if e.what == "crashed"]
    try:
        wrong += scenario.check(folder, events)
    except Exception as error:
        wrong.append(f"{type(error).__name__}: {error}")
    return wrong, events


def forked(scenario: Scenario, folder: Path, seed: int, process: int, outlet: int) -> int:
    """A process that ends by itself, or is killed."""
    child = os.fork()
    if child:
        return child
    write = os.write

    def say(what: str, value: Any = None) -> None:
        write(outlet, f"{json.dumps([process, what, value, time.monotonic()])}\n".encode())

    draw = random.Random(f"{seed} {process}")
    disturbed(draw, killed=scenario.kills and draw.random() < 0.5)
    time.sleep(draw.choice([0, draw.uniform(0, 0.03)]))
    try:
        for _ in range(_TRIES):
            try:
                scenario.run(folder, process, draw, say)
                break
            except OwnedError as error:
                say("refused", str(error))
                time.sleep(2 * _LONGEST_DELAY)
    except (FileExistsError, FileNotFoundError) as error:
        say("refused", str(error))
    except BaseException as error:
        say("crashed", f"{type(error).__name__}: {error}")
    os._exit(0)


def torture(count: int, seed: int, words: list[str]) -> tuple[dict[str, Any], list[str]]:
    """Totals of many interleavings, and what was wrong in them."""
    chosen = [k for k in SCENARIOS if not words or any(word in k for word in words)]
    totals: dict[str, collections.Counter[str]] = {k: collections.Counter() for k in chosen}
    findings = []
    for i in range(count):
        name = chosen[i % len(chosen)]
        with tempfile.TemporaryDirectory() as folder:
            wrong, events = interleaved(SCENARIOS[name], Path(folder), seed + i)
        findings += [f"{name}, seed {seed + i}: {what}" for what in wrong]
        said = [e.what for e in events]
        totals[name] += collections.Counter(
            interleavings=1,
            refused=said.count("refused"),
            killed=said.count("killed"),
            wrong=bool(wrong),
        )
    return {name: dict(total) for name, total in totals.items()}, findings


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("words", nargs="*", help="of the scenarios' names; all by default")
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    totals, findings = torture(arguments.count, arguments.seed, arguments.words)
    print("\n".join(findings))
    print(json.dumps(totals, indent=1))
    sys.exit(bool(findings))


if __name__ == "__main__":
    main()
