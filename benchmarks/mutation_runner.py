"""What tests say of a mutant: they run on a copy of the tree, within a memory and a time."""

import contextlib
import os
import pathlib
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from typing import NamedTuple

ROOT = pathlib.Path(__file__).resolve().parent.parent
LONGEST = 900.0  # seconds; a mutant that hangs its tests is noticed
_NOT_COPIED = (".git", ".venv", ".hypothesis", "__pycache__", "demo", "shared", "notebooks")
_MEMORY = 8 * 2**30  # bytes; a mutant may fill a list without end


class Verdict(NamedTuple):
    """What tests said.

    Attributes:
        outcome: "passed", "failed", "hung" or "no result" (tests that can't be collected, or
            a process that died).
        seconds: that they took [s].
        processor_seconds: of all their processes [s].
    """

    outcome: str
    seconds: float
    processor_seconds: float


@contextlib.contextmanager
def copied(python: str = sys.executable) -> Iterator[pathlib.Path]:
    """A temporary copy of the tree, compiled for a Python."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = pathlib.Path(folder) / "tree"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*_NOT_COPIED), symlinks=True)
        # Byte code that is checked by the source's content: a mutant may have the size and
        # the second of the one before.
        compiling = ["-m", "compileall", "-q", "--invalidation-mode", "checked-hash"]
        subprocess.run([python, *compiling, "suas_jax", "fitting"], cwd=copy, check=True)
        yield copy


def run_tests(
    copy: pathlib.Path,
    tests: str,
    *,
    only: str = "",
    limit: float = LONGEST,
    python: str = sys.executable,
) -> Verdict:
    """Run tests of a copy until the first failure.

    Args:
        copy: of the tree.
        tests: their files, separated by spaces.
        only: which of them, as pytest's -k.
        limit: after which they hang [s].
        python: that runs them.
    """
    command = [python, "-m", "pytest", "-n", "0", "-x", "-q", "-p", "no:cacheprovider"]
    command += ["--hypothesis-seed=0", "-k", only, *tests.split()]
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    before, start = os.times(), time.perf_counter()
    process = subprocess.Popen(
        command,
        cwd=copy,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY)),
    )
    try:
        outcome = {0: "passed", 1: "failed"}.get(process.wait(limit), "no result")
    except subprocess.TimeoutExpired:
        outcome = "hung"
    finally:
        with contextlib.suppress(ProcessLookupError):  # nobody is left
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    shutil.rmtree(copy / ".hypothesis", ignore_errors=True)
    seconds, after = time.perf_counter() - start, os.times()
    used = after.children_user + after.children_system
    return Verdict(outcome, seconds, used - before.children_user - before.children_system)
