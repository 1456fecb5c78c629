"""Answers of a command, and its exit status where it can't do what it was asked.

0 done; 2 bad input, or this machine can't do it (memory, disk, a closed output); 3 no solution;
130 interrupted. With `--json` a failure is also an object with a status and a message.
"""

import contextlib
import errno
import io
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fitting.json_text import json_text
from suas_jax.acquisition.terminal import new_console, printable, say

if TYPE_CHECKING:
    from fitting.report.description import Part

BAD_INPUT = 2
NO_SOLUTION = 3
INTERRUPTED = 130

Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace existing files.")]

# Failures that a user can mend, or that are this machine's.
_EXPECTED = (ValueError, OSError, MemoryError, RecursionError, OverflowError)


@contextlib.contextmanager
def bad_input() -> Iterator[None]:
    """Turn errors that the user can mend into a message and exit status 2."""
    try:
        yield
    except _EXPECTED as error:
        _tell(*_in_words(error))
        raise typer.Exit(BAD_INPUT) from None
    except RuntimeError as error:
        if not _is_out_of_memory(error):
            raise
        _tell(*_in_words(error))
        raise typer.Exit(BAD_INPUT) from None


def answer(as_json: bool, report: Any, show: Callable[[], None]) -> None:
    """Print a result: as JSON for programs, else what is shown to a person."""
    if as_json:
        say(json_text(report))
    else:
        show()


def print_report(parts: "Sequence[Part]") -> None:
    """Print a report's parts for a person."""
    from fitting.report.description import print_parts

    print_parts(new_console(), parts)


def run(program: Callable[[], Any]) -> int:
    """Run the command line, and return its exit status whatever happens.

    `program`: parses the arguments and runs a command; ends with `SystemExit`.
    """
    _replace_missing_streams()
    if not all(map(str.isprintable, sys.argv)):
        new_console()  # the parser's messages are Rich's, too
    try:
        status = _status_of(program)
        sys.stdout.flush()
    except BaseException as error:
        status = INTERRUPTED if isinstance(error, KeyboardInterrupt) else BAD_INPUT
        with contextlib.suppress(OSError, ValueError):
            _tell(*_in_words(error))
        if os.environ.get("SUAS_TRACEBACK"):
            traceback.print_exception(error, file=sys.stderr)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            # Or the interpreter tries again when it ends, and complains.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return status


def _status_of(program: Callable[[], Any]) -> int:
    try:
        program()
    except SystemExit as ended:
        if ended.code == INTERRUPTED:
            raise KeyboardInterrupt from None
        if ended.code == 1:  # the parser's answer to a pipe that was closed
            raise BrokenPipeError(errno.EPIPE, "is closed", "standard output") from None
        status = ended.code if isinstance(ended.code, int) else 0
        if status == BAD_INPUT and not _told:
            _tell_json("bad_input", "the command line can't be understood; see --help")
        return status
    return 0


_told: list[str] = []


def answered(status: str) -> None:
    """Note that a command has said itself what failed, on both outputs.

    `status`: as its JSON object has it.
    """
    _told.append(status)


def _tell(status: str, message: str) -> None:
    """Say what failed, on the terminal and, where JSON was asked for, to programs."""
    say(f"suas: {message}", err=True, lines=True)
    _tell_json(status, message)


def _tell_json(status: str, message: str) -> None:
    _told.append(status)
    if "--json" in sys.argv:
        say(json_text({"status": status, "message": message}))


def _in_words(error: BaseException) -> tuple[str, str]:
    """Status and message of an error."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted", "interrupted"
    if isinstance(error, MemoryError) or _is_out_of_memory(error):
        detail = str(error).splitlines()[0][:200] if str(error) else ""
        return "out_of_memory", "not enough memory" + (f": {detail}" if detail else "")
    if isinstance(error, RecursionError):
        return "bad_input", "the input is nested too deeply"
    if isinstance(error, OverflowError):
        return "bad_input", f"a number is too large to compute with ({error})"
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return "bad_input", printable(f"{os.fsdecode(error.filename)}: {error.strerror}")
    if isinstance(error, OSError) and error.strerror:
        return "bad_input", f"standard output or a file: {error.strerror}"
    if isinstance(error, ValueError | OSError):
        mistakes = map(_located, getattr(error, "mistakes", (error,)))  # a line for each
        return "bad_input", "\n".join(printable(str(mistake)) for mistake in mistakes)
    message = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    return "internal_error", f"internal error: {message}; SUAS_TRACEBACK=1 shows where"


def _located(mistake: Any) -> Any:
    """A configuration's mistake with the file that the user gave, not "skin" or "scene"."""
    files = [x for x in sys.argv[1:] if x.endswith(".toml") and os.path.isfile(x)]
    if getattr(mistake, "file", "") not in ("skin", "scene") or not files:
        return mistake
    from suas_jax.config.load import located

    return located(mistake, files[0])


def _is_out_of_memory(error: BaseException) -> bool:
    """Whether the compiled program found no memory."""
    text = str(error)
    return isinstance(error, RuntimeError) and (
        "RESOURCE_EXHAUSTED" in text or "Out of memory" in text
    )


class _Closed(io.TextIOBase):
    """A standard output that was closed before the program began."""

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "is closed", "standard output")

    def fileno(self) -> int:
        return 1


def _replace_missing_streams() -> None:
    """Fill descriptors that are closed, or the next file opened would take their place."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    if sys.stdout is None:
        sys.stdout = _Closed()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
