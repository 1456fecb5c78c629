"""Commands under a limit of memory, such as `ulimit -v`: a sentence instead of an abort.

Compilers and the C++ library end the process when they get no memory, and no exception is
raised. So a limited command runs in a child, and its parent says what became of it.
"""

import ctypes
import importlib.abc
import json
import os
import signal
import sys
from collections.abc import Sequence
from typing import NamedTuple

# With less, no command that computes answers, on 2 cores [bytes]: JAX fails in many ways, some
# of which never end.
_JAX_NEEDS = {"ulimit -v": 1_900_000_000, "ulimit -d": 500_000_000}
_ADVICE = "commands that compute need 2.5 GB, more on many cores"
# How the system, an allocator or a compiler ends a process that gets no memory.
_ENDED = (signal.SIGABRT, signal.SIGSEGV, signal.SIGBUS)
_PR_SET_PDEATHSIG = 1


class _Limit(NamedTuple):
    """A limit of memory [bytes], and the command that sets it."""

    size: int
    command: str

    def __str__(self) -> str:
        return f"{self.command} allows {self.size / 1e9:.2f} GB; {_ADVICE}"


def _limits() -> list[_Limit]:
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return []
    kinds = {"ulimit -v": resource.RLIMIT_AS, "ulimit -d": resource.RLIMIT_DATA}
    sizes = {command: resource.getrlimit(kind)[0] for command, kind in kinds.items()}
    return [_Limit(x, name) for name, x in sizes.items() if x != resource.RLIM_INFINITY]


def run_in_child_where_limited() -> None:
    """Go on in a child where memory is limited; the parent ends with the child's status."""
    limits = _limits()
    if not limits:
        return
    limit = min(limits)
    # What libraries of C and C++ write about their end takes no part in the answer.
    remarks = os.memfd_create("stderr") if hasattr(os, "memfd_create") else None
    parent, child = os.getpid(), os.fork()
    if child:
        _end_as(child, limit, remarks)
    _end_with(parent)
    if remarks is not None and sys.stderr is not None:
        sys.stderr = os.fdopen(os.dup(2), "w", buffering=1, errors="backslashreplace")
        os.dup2(remarks, 2)
    refusing = [limit for limit in limits if limit.size < _JAX_NEEDS[limit.command]]
    if refusing:
        sys.meta_path.insert(0, _NoJax(refusing[0]))


class _NoJax(importlib.abc.MetaPathFinder):
    """Refuses to import JAX, for commands that would compute."""

    def __init__(self, limit: _Limit) -> None:
        self._limit = limit

    def find_spec(self, name: str, path: Sequence[str] | None, target: object = None) -> None:
        if name == "jax":
            raise MemoryError(str(self._limit))


def _end_with(parent: int) -> None:
    """Let the system end this process when its parent is killed."""
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(130)


def _end_as(child: int, limit: _Limit, remarks: int | None) -> None:
    """Wait for the child, pass signals on to it, and end as it does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends it to the child, too
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _: os.kill(child, number))
    _, state = os.waitpid(child, 0)
    ended = os.WTERMSIG(state) if os.WIFSIGNALED(state) else 0
    if ended in _ENDED:
        message = f"not enough memory: {limit}"
        if "--json" in sys.argv:
            told = json.dumps({"status": "out_of_memory", "message": message})
            os.write(1, f"{told}\n".encode())
        os.write(2, f"suas: {message}\n".encode())
        os._exit(2)
    if remarks is not None:
        os.write(2, os.pread(remarks, 1_000_000, 0))
    os._exit(128 + ended if ended else os.WEXITSTATUS(state))
