"""Kill every writing command at random instants beside a second one, and look at the disk.

    python benchmarks/kills.py              # 20 kills of each command
    python benchmarks/kills.py --kills 200
    python benchmarks/kills.py convert log     those whose names contain one of the words

A command is run to its end once, which gives its duration and its files; then it is started
again and again and killed (SIGKILL) at a random instant, while a second one that would write
the same file is started at another. Afterwards every file of its own is either not there, or
whole: it is read back by the reader that is made for it. A log may end in a line that was cut
off, which the reader notes. What a kill leaves is hidden and has an ending that no reader
takes. With `--overwrite` the file that was there must survive as it was, or be replaced by a
whole one. Meanwhile, where this is run as root, another user looks for ports that the commands
listen on: there is none, as none of them serves. `interleavings` does the same to the files
alone, between any two calls of the system. Exit status: 0 all was well, 1 something was not.
"""

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from matplotlib.image import imread

from suas_jax.acquisition.baseline import read_baseline
from suas_jax.acquisition.device.device import Device, log_readings, repeated
from suas_jax.acquisition.log.convert import read_netcdf, read_parquet
from suas_jax.acquisition.log.log_file import LogWriter, log_header, read_log

ROOT = Path(__file__).parent.parent
SUAS = [sys.executable, "-c", "from fitting.cli.app import main; main()"]
SKIN, SCENE = ROOT / "configs/skins/suas.toml", ROOT / "configs/scenes/case_b.toml"
EARLIER = b"what was there before\n"
NOBODY = 65534


@dataclass(frozen=True)
class Command:
    """A command that writes."""

    words: tuple[str, ...]  # of the command line; "{out}" stands for the file that it writes
    output: str  # name of that file
    read: Callable[[Path], object]  # raises where it is not whole
    replaces: bool = True  # whether it can be told to replace the file


def toml(path: Path) -> object:
    return tomllib.loads(path.read_text())


def csv_rows(path: Path) -> None:
    """A table whose last line is as long as its first."""
    lines = path.read_text().splitlines()
    assert len({line.count(",") for line in lines if not line.startswith("#")}) == 1
    assert path.read_bytes().endswith(b"\n")


def json_lines(path: Path) -> None:
    """Each of the membranes at most once; a kill may cut off a line, which stays alone."""
    names = []
    for line in path.read_text().splitlines():
        with contextlib.suppress(ValueError):
            names.append(json.loads(line)["name"])
    assert len(set(names)) == len(names)


COMMANDS = {
    "new skin": Command(("new", "skin", "{out}", "--pad", "4x8"), "skin.toml", toml),
    "baseline": Command(("baseline", "rest.csv", "-o", "{out}"), "rest.json", read_baseline),
    "convert to Parquet": Command(("convert", "rest.csv", "{out}"), "a.parquet", read_parquet),
    "convert to NetCDF": Command(("convert", "rest.csv", "{out}"), "a.nc", read_netcdf),
    "health": Command(("health", "rest.csv", "--plot", "{out}"), "a.png", imread),
    "simulate": Command(("simulate", str(SCENE), "-o", "{out}"), "s.csv", read_log),
    "solve": Command(("solve", str(SCENE), "--plot", "{out}"), "section.png", imread),
    "sweep": Command(
        ("sweep", str(SCENE), "--force", "0:20:5", "--csv", "{out}"), "c.csv", csv_rows
    ),
    "fit sensor": Command(
        ("fit", "sensor", str(SKIN), "rest.csv", "-o", "{out}"), "k.toml", toml
    ),
    "fit materials": Command(
        ("fit", "materials", "jobs.toml", "-o", "{out}", "--workers", "2"),
        "r.jsonl",
        json_lines,
        replaces=False,
    ),
}
_INPUTS = ("rest.csv", "jobs.toml")


def jobs(path: Path) -> None:
    """Three small calibrations."""
    data = ROOT / "configs/data/treloar1944_uniaxial.csv"
    path.write_text(
        "".join(
            f'[[membrane]]\nname = "m{i}"\nlaw = "neo-hookean"\ndata.uniaxial = "{data}"\n'
            for i in range(3)
        )
    )


def rest_log(path: Path) -> None:
    """Two seconds of the shipped skin at rest."""
    draw = random.Random(1)
    with LogWriter(path, log_header(), taxels=8) as log:
        for k in range(200):
            counts = tuple(round(154.97 + draw.gauss(0, 2)) for _ in range(8))
            log.write(0.01 * k, 0.01 * k, k, 0, counts)


def started(words: list[str], folder: Path) -> subprocess.Popen:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([*SUAS, *words], cwd=folder, env=environment, **quiet)


def killed(command: Command, folder: Path, kills: int, draw: random.Random) -> list[str]:
    """What was not well after the kills."""
    out = folder / command.output
    words = [word.format(out=command.output) for word in command.words]
    begin = time.monotonic()
    if started(words, folder).wait() or not out.exists():
        return ["does not run to its end"]
    duration = time.monotonic() - begin
    whole = out.read_bytes()
    wrong = []
    for kill in range(kills):
        replaces = command.replaces and kill % 2 == 1
        if replaces:
            out.write_bytes(EARLIER)
        else:
            out.unlink(missing_ok=True)
        wrong += pair([*words, *(["--overwrite"] if replaces else [])], folder, duration, draw)
        wrong += _state(out, command, replaces)
        for draft in folder.iterdir():
            if draft.name.startswith("."):
                draft.unlink()
            elif draft != out and draft.name not in _INPUTS:
                wrong.append(f"leaves {draft.name}")
                draft.unlink()
    out.write_bytes(whole)
    return wrong


def pair(words: list[str], folder: Path, duration: float, draw: random.Random) -> list[str]:
    """Two processes of one command, one of them killed; what the second was not told."""
    # Half of the kills near the end, where files are written.
    share = draw.uniform(0.0, 1.1) if draw.random() < 0.5 else draw.uniform(0.8, 1.1)
    first, wrong = started(words, folder), set()
    time.sleep(draw.uniform(0.0, 0.5) * share * duration)
    second, end = started(words, folder), time.monotonic() + share * duration
    while time.monotonic() < end and second.poll() is None:
        wrong |= doors(first.pid, second.pid)
        time.sleep(0.05)
    one = draw.choice([first, second])
    one.send_signal(signal.SIGKILL)
    statuses = [process.wait() for process in (first, second)]
    if not set(statuses) <= {0, 2, -signal.SIGKILL}:
        wrong.add(f"statuses {statuses}")
    return sorted(wrong)


def doors(*parents: int) -> set[str]:
    """Ports on which processes and their children listen, as another user finds them."""
    if os.geteuid() != 0:
        return set()
    sockets = set()
    for process in family(*parents):
        with contextlib.suppress(OSError):
            for entry in os.scandir(f"/proc/{process}/fd"):
                with contextlib.suppress(OSError):
                    sockets.add(os.readlink(entry.path))
    inlet, outlet = os.pipe()
    if not (child := os.fork()):
        os.setuid(NOBODY)
        os.write(outlet, json.dumps(listeners()).encode())
        os._exit(0)
    os.close(outlet)
    with open(inlet, encoding="utf-8") as answer:
        found = json.loads(answer.read() or "{}")
    os.waitpid(child, 0)
    return {f"listens on {port}" for port, inode in found.items() if inode in sockets}


def family(*parents: int) -> set[int]:
    """Processes and all that they have started."""
    found = set(parents)
    while True:
        more = set()
        for process in found:
            with contextlib.suppress(OSError):
                for task in Path(f"/proc/{process}/task").iterdir():
                    more |= {int(k) for k in (task / "children").read_text().split()}
        if more <= found:
            return found
        found |= more


def listeners() -> dict[str, str]:
    """Every TCP socket of this machine that listens, by its address."""
    found = {}
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            _, address, _, state, *rest = line.split()
            if state == "0A":
                found[address] = f"socket:[{rest[5]}]"
    return found


def _state(out: Path, command: Command, replaces: bool) -> list[str]:
    if not out.exists():
        return ["the earlier file is gone"] if replaces else []
    if replaces and out.read_bytes() == EARLIER:
        return []
    try:
        command.read(out)
    except Exception as error:
        return [f"{out.name} is not whole: {error}"]
    return []


def killed_logger(folder: Path, kills: int, draw: random.Random) -> list[str]:
    """The logger, whose file is read back with at most a line that was cut off."""
    wrong = []
    readings = list(log_readings(read_log(folder / "rest.csv")))
    for kill in range(kills):
        out = folder / f"log{kill}.csv"
        with Device("cobs", link=folder / "port") as device:
            words = ["log", device.port, "--format", "cobs", "-o", out.name, "--rotate", "0.02"]
            process = started(words, folder)
            device.wait_for_host(lambda process=process: process.poll() is not None)
            words[1] = str(folder / "spare")
            with Device("cobs", link=folder / "spare"):
                second = started([*words[:-2], "--overwrite"], folder)
                device.play(repeated(readings), speed=10.0, duration=draw.uniform(0.0, 1.5))
                wrong += doors(process.pid, second.pid)
                # Every other time while the second one still starts.
                if kill % 2 and second.wait() != 2:
                    wrong.append(f"{out.name}: is taken from its logger")
                process.send_signal(signal.SIGKILL)
                process.wait()
                second.send_signal(signal.SIGKILL)
                second.wait()
        try:
            log = read_log(out)
        except Exception as error:
            wrong.append(f"{out.name}: {error}")
            continue
        steps = {b - a for a, b in zip(log.seq.tolist(), log.seq.tolist()[1:], strict=False)}
        if not steps <= {1}:
            wrong.append(f"{out.name}: rows are missing in the middle")
    return wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("words", nargs="*", help="of the commands' names; all by default")
    parser.add_argument("--kills", type=int, default=20, help="of each command")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    draw = random.Random(arguments.seed)
    failures = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        rest_log(folder / "rest.csv")
        jobs(folder / "jobs.toml")
        if os.geteuid() != 0:
            print("not root: nobody looks for ports", file=sys.stderr)
        for title, command in COMMANDS.items():
            if not chosen(title, arguments.words):
                continue
            place = folder / title.replace(" ", "_")
            place.mkdir()
            for name in _INPUTS:
                (place / name).write_bytes((folder / name).read_bytes())
            failures += report(title, killed(command, place, arguments.kills, draw))
        if chosen("log", arguments.words):
            failures += report("log", killed_logger(folder, arguments.kills, draw))
    sys.exit(bool(failures))


def chosen(title: str, words: list[str]) -> bool:
    return not words or any(word in title for word in words)


def report(title: str, wrong: list[str]) -> int:
    print(json.dumps({"command": title, "wrong": sorted(set(wrong))}), flush=True)
    return len(wrong)


if __name__ == "__main__":
    main()
