"""What one command reads and may replace, so that no output takes the place of an input."""

import contextlib
import os
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from suas_jax.files.ownership import owned


@dataclass
class _Command:
    """Files of one command."""

    # device and inode of each file that was read
    inputs: set[tuple[int, int]] = field(default_factory=set)
    # places whose files the user allowed to be replaced
    replaceable: set[str] = field(default_factory=set)
    # what it owns until it ends
    outputs: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)


_command: ContextVar[_Command | None] = ContextVar("command", default=None)


@contextlib.contextmanager
def command_files() -> Iterator[None]:
    """Follow which files are read and written inside, as one command's.

    Outside, in a program that uses this package, a file that is written is replaced.
    """
    command = _Command()
    token = _command.set(command)
    try:
        with command.outputs:
            yield
    finally:
        _command.reset(token)


def own_output(path: Path | None) -> None:
    """Own a file that the command will write until it ends; outside of commands, nothing.

    Raises OwnedError: another process writes it.
    """
    command = _command.get()
    if command is not None and path is not None:
        command.outputs.enter_context(owned(path))


def remember_input(facts: os.stat_result) -> None:
    """Note a file that was read."""
    command = _command.get()
    if command is not None:
        command.inputs.add((facts.st_dev, facts.st_ino))


def is_input(path: Path) -> bool:
    """Whether the command that runs has read a file."""
    command = _command.get()
    if command is not None:
        with contextlib.suppress(OSError, ValueError):
            facts = path.stat()
            return (facts.st_dev, facts.st_ino) in command.inputs
    return False


def allow_replacing(path: Path) -> None:
    """Note that the user allowed a file to be replaced."""
    command = _command.get()
    if command is not None:
        command.replaceable.add(os.path.realpath(path))


def may_replace(path: Path) -> bool:
    """Whether a file may be replaced: outside of commands, or where the user allowed it."""
    command = _command.get()
    return command is None or os.path.realpath(path) in command.replaceable
