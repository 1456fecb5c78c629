r"""What leaves for a terminal: messages, tables, and a table that moves below messages.

Names of files and words from files may hold what a terminal obeys: escape sequences, line ends,
marks that turn the direction of writing. All of it is shown escaped, as `\x1b`.
"""

import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Self

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.live import Live
    from rich.table import Table

# Control characters, marks and overrides of the direction of writing, ends of lines and
# paragraphs, and halves of characters, which stand for bytes that are not text.
_OBEYED = (
    *range(0x20), *range(0x7F, 0xA0), 0x61C, *range(0x200E, 0x2010), *range(0x2028, 0x202F),
    *range(0x2066, 0x206A), *range(0xD800, 0xE000),
)  # fmt: skip
_ESCAPES = {code: ascii(chr(code))[1:-1] for code in _OBEYED}
_OF_LINES = {code: text for code, text in _ESCAPES.items() if chr(code) not in "\n\t"}


def printable(text: str, *, lines: bool = False) -> str:
    """The text with all that a terminal would obey escaped; tabs and ends of `lines` stay."""
    return text.translate(_OF_LINES if lines else _ESCAPES)


def say(text: str, *, err: bool = False, lines: bool = False) -> None:
    """Print a text of whatever origin on the standard output or on stderr; see `printable`."""
    typer.echo(printable(text, lines=lines), err=err)


def new_console(**options: Any) -> "Console":
    """A console of Rich whose texts are `printable`, as are all of Rich from then on."""
    from rich import control
    from rich.console import Console

    # What Rich takes out of every text that is not a sequence itself: a bell, but no escape.
    control._CONTROL_STRIP_TRANSLATE.update(_OF_LINES)
    return Console(**options)


def print_table(
    names: Iterable[str], rows: Iterable[Sequence[str]], caption: str | None = None
) -> None:
    """Print a table of texts as they are."""
    from rich.table import Table

    table = Table(*names, caption=caption)
    for row in rows:
        table.add_row(*row)
    new_console(markup=False, highlight=False).print(table)


class LiveTerminal:
    """Messages on stderr, one a line; where `wanted` also a table, redrawn in place."""

    def __init__(self, wanted: bool, refresh: float) -> None:
        self._wanted = wanted
        self._refresh = refresh
        self._live: Live | None = None
        self._shown = -refresh

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def say(self, sentence: str) -> None:
        """Print a message, above the table."""
        if self._live is not None:
            text = printable(f"suas: {sentence}")
            self._live.console.print(text, markup=False, highlight=False)
        else:
            say(f"suas: {sentence}", err=True)

    def due(self) -> bool:
        """Whether the table is wanted and old enough to be drawn again."""
        return self._wanted and time.monotonic() - self._shown >= self._refresh

    def draw(self, table: "Table") -> None:
        """Draw the table."""
        self._shown = time.monotonic()
        if self._live is None:
            from rich.live import Live

            self._live = Live(
                console=new_console(stderr=True), auto_refresh=False, transient=True
            )
            self._live.start()
        self._live.update(table, refresh=True)
