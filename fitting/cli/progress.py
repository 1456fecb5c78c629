"""Progress: a spinner on a terminal, or a bar where the total is known.

Elsewhere, as in a pipe or a log of a job, a sentence says what is being done if it takes long.
"""

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator

from suas_jax.acquisition.terminal import new_console, say
from suas_jax.runtime.compiling import listening

_COMPILING = "compiling, once for this kind of scene, about 20 s"
_COMPILING_MANY = " (compiling, once for this kind of scene; minutes in all)"
_LONG = 20.0  # without a terminal: after which something is said of what goes on [s]


@contextlib.contextmanager
def spinner(what: str) -> Iterator[Callable[[str], None]]:
    """Show what is being done, with the elapsed time, and that a program is being compiled.

    Yields a function that shows something else.
    """
    if not sys.stderr.isatty():
        with _said_late(what) as show:
            yield show
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=new_console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)
        with _described(what, lambda text: progress.update(task, description=text)) as show:
            yield show


@contextlib.contextmanager
def fitting_spinner() -> Iterator[Callable[[str], None]]:
    """A spinner of the commands that fit: first the files are read, then fits are named."""
    with spinner("reading") as show:
        yield lambda text: show(f"fitting {text}")


@contextlib.contextmanager
def bar(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show how much of a total is done of something; yields a function that is told."""
    if not sys.stderr.isatty():
        with _said_late(what):
            yield lambda done: None
        return
    from rich.progress import Progress

    with Progress(console=new_console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=total)
        with _described(what, lambda text: progress.update(task, description=text)):
            yield lambda done: progress.update(task, completed=done)


@contextlib.contextmanager
def _described(
    what: str, describe: Callable[[str], None], note: str = f": {_COMPILING}"
) -> Iterator[Callable[[str], None]]:
    """Describe what is being done, with a note while a program is compiled for it."""
    busy = False

    def told() -> None:
        describe(what + note if busy else what)

    def show(text: str) -> None:
        nonlocal what
        what = text
        told()

    def compiling(begins: bool) -> None:
        nonlocal busy
        busy = begins
        told()

    with listening(compiling):
        yield show


@contextlib.contextmanager
def _said_late(what: str) -> Iterator[Callable[[str], None]]:
    """Say once what is being done, if it takes long."""
    doing = what

    def describe(text: str) -> None:
        nonlocal doing
        doing = text

    timer = threading.Timer(_LONG, lambda: say(f"suas: still {doing}", err=True))
    timer.daemon = True
    timer.start()
    try:
        with _described(what, describe, _COMPILING_MANY) as show:
            yield show
    finally:
        timer.cancel()
