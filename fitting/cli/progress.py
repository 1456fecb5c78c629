"""Progress on a terminal: a spinner, or a bar where the total is known; elsewhere nothing."""

import contextlib
import sys
from collections.abc import Callable, Iterator

from suas_jax.acquisition.terminal import new_console
from suas_jax.runtime.compiling import listening

_COMPILING = "compiling, once for this kind of scene, about 20 s"


@contextlib.contextmanager
def spinner(what: str) -> Iterator[Callable[[str], None]]:
    """Show what is being done, with the elapsed time, and that a program is being compiled.

    Yields a function that shows something else.
    """
    if not sys.stderr.isatty():
        yield lambda text: None
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=new_console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)

        def show(text: str) -> None:
            nonlocal what
            what = text
            progress.update(task, description=text)

        def compiling(begins: bool) -> None:
            text = f"{what}: {_COMPILING}" if begins else what
            progress.update(task, description=text)

        with listening(compiling):
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
        yield lambda done: None
        return
    from rich.progress import Progress

    with Progress(console=new_console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done: progress.update(task, completed=done)
