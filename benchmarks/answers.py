"""Answers of two revisions, command by command: what a change of structure must leave alone.

    python -m benchmarks.answers REVISION            every scene, log and data file of configs
    python -m benchmarks.answers REVISION solve fit  commands whose line contains a word

Both revisions run the same command lines in folders of their own; every number of their JSON is
compared, relative to the largest of its list or to itself. Times are left out. Exit status 1
if an answer differs by more than 1e-9, is missing, or a command ends otherwise.
"""

import json
import math
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

ROOT = pathlib.Path(__file__).resolve().parent.parent
TOLERANCE = 1e-9
_TIMES = ("timings", "latency", "seconds", "versions", "written", "sha256")
_DATA = "../configs/data/"


def command_lines() -> list[str]:
    """Command lines of `suas`, in an order in which each finds the files that it reads."""
    scenes = sorted((ROOT / "configs" / "scenes").glob("*.toml"))
    lines = [f"solve ../configs/scenes/{s.name} --json --gradient min_gap_m" for s in scenes]
    for name in ("case_a", "case_b", "spread_load", "two_contacts"):
        lines += [
            f"solve ../configs/scenes/{name}.toml --json --model shell",
            f"solve ../configs/scenes/{name}.toml --json --model solid --rtol 1e-2",
        ]
    lines += [
        "sweep ../configs/scenes/case_a.toml --json --force 0:90:10",
        "sweep ../configs/scenes/case_b.toml --json --oil-pressure 0:16000:9",
        "sweep ../configs/scenes/pad_crown.toml --json --force 0:19:6",
        "simulate ../configs/scenes/press_path.csv -o press.csv",
        "fit sensor ../configs/skins/suas.toml press.csv --json",
        "invert ../configs/skins/suas.toml press.csv --json",
        "invert ../configs/skins/suas.toml press.csv --json --direction",
        "health press.csv --json",
        "range ../configs/skins/suas.toml --json",
        "simulate ../configs/scenes/pad_crown.toml -o pad.csv --duration 0.3",
        "invert ../configs/skins/suas-pad.toml pad.csv --json",
    ]
    treloar = " ".join(
        f"--data {mode}={_DATA}treloar1944_{mode}.csv"
        for mode in ("uniaxial", "equibiaxial", "pure_shear")
    )
    kawabata = f"--data biaxial={_DATA}kawabata1981_general_biaxial.csv"
    return [
        *lines,
        f"fit material --json --law ogden --terms 3 {treloar}",
        f"fit material --json --law ogden --terms 2 --residual absolute {treloar}",
        f"fit material --json --law auto {treloar}",
        f"fit material --json --law mooney-rivlin {kawabata}",
    ]


def answer(tree: pathlib.Path, folder: pathlib.Path, line: str) -> tuple[int, list[Any]]:
    """Exit status and JSON objects of a command line under a tree's code."""
    run = subprocess.run(
        [sys.executable, "-c", "from fitting.cli.app import main; main()", *shlex.split(line)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(tree), "PYTHONSAFEPATH": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    found = run.stdout if "--json" in line else "{}"
    try:
        return run.returncode, [json.loads(found)]
    except json.JSONDecodeError:  # one object a line, as `invert` has it
        objects = [text for text in found.splitlines() if text.startswith("{")]
        return run.returncode, [json.loads(text) for text in objects]


def numbers(value: Any, path: str = "") -> Iterator[tuple[str, Any, float]]:
    """Every leaf: its path, its value, and the size that a difference is relative to."""
    if isinstance(value, dict):
        for key, entry in value.items():
            if not any(word in key for word in _TIMES):
                yield from numbers(entry, f"{path}.{key}")
    elif isinstance(value, list):
        sizes = [abs(x) for x in _flat(value) if math.isfinite(x)]
        for i, entry in enumerate(value):
            for name, leaf, size in numbers(entry, f"{path}.{i}"):
                yield name, leaf, max(size, *sizes, 0.0) if _plain(value) else size
    else:
        yield path, value, abs(value) if isinstance(value, int | float) else 0.0


def _plain(value: list[Any]) -> bool:
    """Whether a list holds numbers alone, or lists of them: one quantity."""
    return all(_plain(x) if isinstance(x, list) else isinstance(x, int | float) for x in value)


def _flat(value: list[Any]) -> Iterator[float]:
    for entry in value:
        if isinstance(entry, list):
            yield from _flat(entry)
        elif isinstance(entry, int | float):
            yield float(entry)


def worst_difference(before: Any, after: Any) -> tuple[float, str]:
    """The largest relative difference of two answers, and where; infinite if one is missing."""
    old = {path: (leaf, size) for path, leaf, size in numbers(before)}
    new = {path: leaf for path, leaf, _ in numbers(after)}
    if missing := old.keys() ^ new.keys():
        return math.inf, f"only in one: {sorted(missing)[0]}"
    worst = (0.0, "")
    for path, (leaf, size) in old.items():
        other = new[path]
        if leaf == other or (leaf != leaf and other != other):
            continue
        both = all(isinstance(x, int | float) for x in (leaf, other))
        worst = max(worst, (abs(leaf - other) / size if both and size else math.inf, path))
    return worst


def main() -> None:
    """Compare; see the module's docstring."""
    revision, *words = sys.argv[1:] or sys.exit("which revision? see the module's docstring")
    wanted = [x for x in command_lines() if not words or any(word in x for word in words)]
    failed = False
    with tempfile.TemporaryDirectory(prefix="answers-") as name:
        base = pathlib.Path(name)
        subprocess.run(
            ["git", "worktree", "add", "--detach", "-q", base / "old", revision],
            cwd=ROOT,
            check=True,
        )
        try:
            trees = {"before": base / "old", "after": ROOT}
            for side in trees:
                (base / side).mkdir()
            (base / "configs").symlink_to(base / "old" / "configs")
            for line in wanted:
                got = [answer(tree, base / side, line) for side, tree in trees.items()]
                (status, before), (now, after) = got
                worst, where = worst_difference(before, after)
                bad = worst > TOLERANCE or status != now
                failed |= bad
                note = f"exit {status} and {now} " if status != now else ""
                print(
                    f"{'DIFFERS' if bad else 'same':8}{worst:8.1e}  {line}  {note}{where}",
                    flush=True,
                )
        finally:
            subprocess.run(
                ["git", "worktree", "remove", "--force", base / "old"], cwd=ROOT, check=True
            )
    sys.exit(failed)


if __name__ == "__main__":
    main()
