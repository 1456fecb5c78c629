"""Kill every writing command at random instants, and look at what is on disk.

    python benchmarks/kills.py              # 20 kills of each command
    python benchmarks/kills.py --kills 200
    python benchmarks/kills.py convert log     those whose names contain one of the words

A command is run to its end once, which gives its duration and its files; then it is started
again and again and killed (SIGKILL) at a random instant. Afterwards every file of its own is
either not there, or whole: it is read back by the reader that is made for it. A log may end in
a line that was cut off, which the reader notes. Drafts that a kill leaves are hidden and have
an ending that no reader takes. With `--overwrite` the file that was there must survive as it
was, or be replaced by a whole one. Exit status: 0 all was well, 1 something was not.
"""

import argparse
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


@dataclass(frozen=True)
class Command:
    """A command that writes.

    Attributes:
        words: of the command line; "{out}" stands for the file that it writes.
        output: name of that file.
        read: raises where it is not whole.
    """

    words: tuple[str, ...]
    output: str
    read: Callable[[Path], object]


def toml(path: Path) -> object:
    return tomllib.loads(path.read_text())


def csv_rows(path: Path) -> None:
    """A table whose last line is as long as its first."""
    lines = path.read_text().splitlines()
    assert len({line.count(",") for line in lines if not line.startswith("#")}) == 1
    assert path.read_bytes().endswith(b"\n")


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
}


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
        replaces = kill % 2 == 1
        if replaces:
            out.write_bytes(EARLIER)
        else:
            out.unlink(missing_ok=True)
        process = started([*words, *(["--overwrite"] if replaces else [])], folder)
        # Half of the kills near the end, where files are written.
        share = draw.uniform(0.0, 1.1) if kill % 4 < 2 else draw.uniform(0.8, 1.1)
        time.sleep(share * duration)
        process.send_signal(signal.SIGKILL)
        process.wait()
        wrong += _state(out, command, replaces)
        for draft in folder.iterdir():
            if draft.name.startswith("."):
                draft.unlink()
            elif draft != out and draft.name != "rest.csv":
                wrong.append(f"leaves {draft.name}")
                draft.unlink()
    out.write_bytes(whole)
    return wrong


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
            device.play(repeated(readings), speed=10.0, duration=draw.uniform(0.0, 1.5))
            process.send_signal(signal.SIGKILL)
            process.wait()
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
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rest_log(folder / "rest.csv")
        for title, command in COMMANDS.items():
            if not chosen(title, arguments.words):
                continue
            place = folder / title.replace(" ", "_")
            place.mkdir()
            (place / "rest.csv").write_bytes((folder / "rest.csv").read_bytes())
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
