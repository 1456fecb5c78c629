"""The share of random mistakes in both packages that tests notice, quickest tests first.

    .venv/bin/python -m pip install --target .venv/.mutants/packages \
        cosmic-ray==8.7.0 coverage==7.17.3
    .venv/bin/python -m benchmarks.mutation record            which lines each test executes
    .venv/bin/python -m benchmarks.mutation record tests/test_drift.py
    .venv/bin/python -m benchmarks.mutation run --count 300 --seed 1
    .venv/bin/python -m benchmarks.mutation run inverse_load statistics

A mutant is tried on the tests that execute its line, one that changes a constant on those that
execute a line with its name; the quickest come first, up to `--budget` seconds of them. It is
killed if one fails that passes without it, or if they run into the limit of `--limit` processor
seconds and five times what they take without it. One that no test executes has survived.
Survivors are printed; those of `equivalent_mutants.toml` with the reason why no test can tell
them, and they count as survivors all the same. Tests run in copies of the tree, in processes
forked from this one, which has imported what takes long to import. Exit status 1 if fewer than
95 % were killed.
"""

import argparse
import ast
import contextlib
import importlib
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Generator, Iterator
from typing import NamedTuple

ROOT = pathlib.Path(__file__).resolve().parent.parent
STORE = ROOT / ".venv/.mutants"
sys.path.append(str(STORE / "packages"))

from benchmarks.mutants import PACKAGES, Mutant, draw  # noqa: E402

WANTED = 0.95
_MEMORY = 8 * 2**30  # bytes; a mutant may fill a list without end
_NOT_COPIED = (".git", ".venv", ".hypothesis", "__pycache__", "demo", "shared", "notebooks")
_QUIET = ["-q", "-x", "-n", "0", "-p", "no:cacheprovider", "--hypothesis-seed=0", "-m", ""]
_QUIET += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # plugins are imported before
_LONG_TO_IMPORT = (
    *("equinox", "hypothesis", "jax.experimental.sparse", "jinja2", "lineax", "openpyxl"),
    *("matplotlib.pyplot", "optimistix", "pint", "pydantic", "pytest", "rich.console"),
    *("scipy.interpolate", "scipy.optimize", "scipy.sparse.linalg", "scipy.special"),
    *("scipy.stats", "tomlkit", "typer.testing", "xdist"),
)


class Test(NamedTuple):
    """What was recorded of a test."""

    name: str  # its node
    seconds: float  # of processor time, the fixtures that it shares included
    lines: dict[str, frozenset[int]]  # that it executes, by file


# --- which tests ---------------------------------------------------------------------------


def record(files: list[str]) -> int:
    """Run test files, each in a process of its own, and keep which lines they execute."""
    wanted = files or sorted(str(f.relative_to(ROOT)) for f in ROOT.glob("tests/**/test_*.py"))
    plugin = ["-p", "benchmarks.mutation_lines", "-n", "0", "-q", "-m", ""]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{STORE / 'packages'}"}
    status = 0
    for file in wanted:
        command = [sys.executable, "-m", "pytest", *plugin, file]
        done = subprocess.run(command, cwd=ROOT, env=environment, check=False)
        status |= done.returncode
    return status


def recorded() -> list[Test]:
    """All tests of which something is known, the quickest first."""
    found = [
        Test(name, own["seconds"], {f: frozenset(x) for f, x in own["lines"].items()})
        for place in (STORE / "lines").glob("*.json")
        for name, own in json.loads(place.read_text()).items()
    ]
    return sorted(found, key=lambda test: test.seconds)


def tests_of(mutant: Mutant, tests: list[Test], budget: float) -> list[Test]:
    """Tests that may notice a mutant, the quickest first, up to some seconds of them."""
    lines, names = _place(mutant)
    wanted = {mutant.file: lines}
    if names is not None:
        wanted = _uses(mutant.file, names, lines)
    chosen, total = [], 0.0
    for test in tests:
        if any(not test.lines.get(f, frozenset()).isdisjoint(x) for f, x in wanted.items()):
            total += test.seconds
            if chosen and total > budget:
                break
            chosen.append(test)
    return chosen


def _place(mutant: Mutant) -> tuple[set[int], list[str] | None]:
    """Lines of the statement that is wrong; and, if it runs on import, the names it binds."""
    tree = ast.parse(mutant.right)
    inside, best = False, None
    for node in ast.walk(tree):  # outer ones first
        if not isinstance(node, ast.stmt) or node.end_lineno is None:
            continue
        decorators = getattr(node, "decorator_list", [])
        first = min([node.lineno, *(decorator.lineno for decorator in decorators)])
        if first <= mutant.line <= node.end_lineno:
            body = getattr(node, "body", None)
            header = body is None or mutant.line < body[0].lineno
            if isinstance(node, ast.FunctionDef):
                inside = True
                if header:  # defaults: whoever calls it
                    return set(range(body[0].lineno, node.end_lineno + 1)), None  # type: ignore[index]
            best = node
    assert best is not None
    end = best.end_lineno or best.lineno
    if getattr(best, "body", None):
        end = max(best.lineno, mutant.line)
    lines = set(range(best.lineno, end + 1))
    if inside:
        return lines, None
    targets = best.targets if isinstance(best, ast.Assign) else [getattr(best, "target", best)]
    names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
    return lines, names


def _uses(file: str, names: list[str], own: set[int]) -> dict[str, set[int]]:
    """Lines with one of some names, in the file or, where that has none, in both packages."""
    if not names:
        source = (ROOT / file).read_text().splitlines()
        return {file: set(range(1, len(source) + 1)) - own}
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, names))})\b")

    def lines_of(place: pathlib.Path) -> set[int]:
        rows = enumerate(place.read_text().splitlines(), 1)
        return {n for n, row in rows if pattern.search(row)}

    found = {file: lines_of(ROOT / file) - own}
    if found[file]:
        return found
    others = (f for package in PACKAGES for f in (ROOT / package).rglob("*.py"))
    return {str(f.relative_to(ROOT)): lines_of(f) for f in others}


# --- trying them ---------------------------------------------------------------------------


class Ended(NamedTuple):
    """How a run of tests ended."""

    outcome: str  # "passed", "failed", "hung" or "undetermined"
    seconds: float  # of processor time
    killer: str  # the test that failed; empty where none was told


class Runner:
    """Forks processes that run tests in a copy of the tree."""

    def __init__(
        self,
        copy: pathlib.Path,  # of the tree; one run at a time uses it
        limit: float,  # processor seconds after which a run is given up
    ) -> None:
        self.copy, self._limit = copy, limit
        self._pid = 0

    def start(self, tests: list[Test], mutant: Mutant | None) -> None:
        """Begin to run tests until the first failure, with a mistake or without one."""
        self._mutant, self._expected = mutant, sum(test.seconds for test in tests)
        self._told = self.copy / ".killer"
        self._told.unlink(missing_ok=True)
        if mutant is not None:
            (self.copy / mutant.file).write_text(mutant.source)
        limit = int(min(self._limit, 10 + 5 * self._expected))
        self._allowed = limit
        sys.stdout.flush()
        self._pid = os.fork()
        if self._pid == 0:
            _run_and_exit(self.copy, [test.name for test in tests], limit)

    def ended(self) -> Ended | None:
        """How the run ended; None while it goes on."""
        pid, status, usage = os.wait4(self._pid, os.WNOHANG)
        if not pid:
            return None
        with contextlib.suppress(ProcessLookupError):  # whom it has left behind
            os.killpg(self._pid, signal.SIGKILL)
        if self._mutant is not None:
            (self.copy / self._mutant.file).write_text(self._mutant.right)
        seconds = usage.ru_utime + usage.ru_stime
        killer = self._told.read_text() if self._told.exists() else ""
        if os.WIFEXITED(status):
            outcome = "passed" if os.WEXITSTATUS(status) == 0 else "failed"
        elif os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
            # Far longer than without the mistake, or only longer than anybody waits.
            outcome = "undetermined" if self._allowed >= self._limit else "hung"
        else:
            outcome = "failed"
        return Ended(outcome, seconds, killer)


class _Killer:
    """Pytest plugin that keeps the name of the test that failed."""

    def pytest_runtest_logreport(self, report: object) -> None:
        if getattr(report, "failed", False):
            pathlib.Path(".killer").write_text(report.nodeid)  # type: ignore[attr-defined]


def _run_and_exit(copy: pathlib.Path, tests: list[str], limit: int) -> None:
    """In a forked process: run tests of a copy and end with pytest's status."""
    os.setsid()
    os.chdir(copy)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nowhere, stream)
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
    os.environ["PYTHONPATH"] = str(copy)
    sys.path[:] = [str(copy)] + [p for p in sys.path if p not in ("", str(ROOT))]
    for name in [
        n for n in sys.modules if n.split(".")[0] in ("benchmarks", "tests", *PACKAGES)
    ]:
        del sys.modules[name]
    status = 3
    try:
        import pytest

        status = int(pytest.main([*_QUIET, *tests], plugins=[_Killer()]))
    finally:
        os._exit(status)


def _import_what_takes_long() -> None:
    """Packages of others, which no mutant changes; none of them starts a thread."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for name in _LONG_TO_IMPORT:
        importlib.import_module(name)


@contextlib.contextmanager
def _copies(count: int) -> Iterator[list[pathlib.Path]]:
    """Copies of the tree, compiled: byte code is checked by the source's content."""
    with tempfile.TemporaryDirectory(prefix="mutants-", ignore_cleanup_errors=True) as folder:
        copies = [pathlib.Path(folder) / f"tree{k}" for k in range(count)]
        for copy in copies:
            ignored = shutil.ignore_patterns(*_NOT_COPIED)
            shutil.copytree(ROOT, copy, ignore=ignored, symlinks=True)
            command = [sys.executable, "-m", "compileall", "-q"]
            checked = ["--invalidation-mode", "checked-hash", *PACKAGES]
            subprocess.run([*command, *checked], cwd=copy, check=True)
        yield copies


class _Judge:
    """Tries mutants, several at a time, and checks that whatever fails passes without them."""

    def __init__(self, tests: list[Test], budget: float) -> None:
        self._tests, self._budget = tests, budget
        self._sound: dict[str, bool] = {}

    def all(self, mutants: list[Mutant], runners: list[Runner]) -> list[tuple[Mutant, Ended]]:
        """How each mutant's tests end."""
        waiting, judged = list(mutants), []
        running = {runner: self._one(runner, waiting) for runner in runners}
        while running:
            time.sleep(0.02)
            for runner, job in list(running.items()):
                try:
                    next(job)
                except StopIteration as end:
                    if end.value is None:
                        del running[runner]
                        continue
                    judged.append(end.value)
                    _show(*end.value, len(judged), len(mutants))
                    running[runner] = self._one(runner, waiting)
        return judged

    def _one(
        self, runner: Runner, waiting: list[Mutant]
    ) -> Generator[None, None, tuple[Mutant, Ended] | None]:
        """Try the next mutant; a generator that yields while it waits."""
        if not waiting:
            return None
        mutant = waiting.pop()
        chosen = tests_of(mutant, self._tests, self._budget)
        seconds = 0.0
        while True:
            chosen = [test for test in chosen if self._sound.get(test.name, True)]
            if not chosen:
                return mutant, Ended("uncovered", seconds, "")
            runner.start(chosen, mutant)
            while (ended := runner.ended()) is None:
                yield
            seconds += ended.seconds
            if ended.outcome != "failed":
                return mutant, ended._replace(seconds=seconds)
            killer = ended.killer or chosen[0].name
            if killer not in self._sound:
                runner.start([t for t in chosen if t.name == killer] or chosen[:1], None)
                while (alone := runner.ended()) is None:
                    yield
                seconds += alone.seconds
                self._sound[killer] = alone.outcome == "passed"
            if self._sound[killer]:
                return mutant, Ended("killed", seconds, killer)


def _show(mutant: Mutant, ended: Ended, count: int, total: int) -> None:
    if ended.outcome not in ("killed", "hung"):
        print(
            f"{count}/{total} {ended.outcome} ({ended.seconds:.0f} s): {mutant.file}:"
            f"{mutant.line}\n    {mutant.change}",
            flush=True,
        )


def run(options: argparse.Namespace) -> int:
    """Draw mutants, try them, say which survived."""
    begin = time.perf_counter()
    mutants = draw(options.count, options.seed, options.words)
    tests = recorded()
    _import_what_takes_long()
    with _copies(options.processes) as copies:
        runners = [Runner(copy, options.limit) for copy in copies]
        judged = _Judge(tests, options.budget).all(mutants, runners)
    known = tomllib.loads((ROOT / "benchmarks/equivalent_mutants.toml").read_text())
    by_outcome: dict[str, list[tuple[Mutant, Ended]]] = {}
    for mutant, ended in judged:
        by_outcome.setdefault(ended.outcome, []).append((mutant, ended))
    left = [m for k, x in by_outcome.items() if k in ("passed", "uncovered") for m, _ in x]
    print(f"\nsurvivors of {len(judged)} (seed {options.seed}):")
    for mutant in sorted(left):
        reason = known.get(mutant.file, {}).get(mutant.change, "SURVIVED")
        print(f"{mutant.file}:{mutant.line}\n    {mutant.change}\n        {reason}")
    counts = {name: len(x) for name, x in sorted(by_outcome.items())}
    used = sum(ended.seconds for _, ended in judged)
    killed = counts.get("killed", 0) + counts.get("hung", 0)
    print(
        f"{killed} of {len(judged)} killed, {100 * killed / max(len(judged), 1):.1f} % "
        f"{counts}; {used:.0f} s of processor time, {time.perf_counter() - begin:.0f} s"
    )
    return int(killed < WANTED * len(judged))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("files", nargs="*", help="test files; all by default")
    running = commands.add_parser("run")
    running.add_argument("words", nargs="*", help="of the files' paths; all by default")
    running.add_argument("--count", type=int, default=300, help="mutants")
    running.add_argument("--seed", type=int, default=0, help="of the draw")
    running.add_argument("--budget", type=float, default=20.0, help="of tests for one [s]")
    running.add_argument("--limit", type=float, default=75.0, help="of a run [s]")
    running.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    return record(options.files) if options.command == "record" else run(options)


if __name__ == "__main__":
    sys.exit(main())
