"""The terminal of a live command: messages, and where wanted a table that moves below them."""

import time
from types import TracebackType
from typing import TYPE_CHECKING, Self

import typer

if TYPE_CHECKING:
    from rich.live import Live
    from rich.table import Table


class LiveTerminal:
    """Messages on stderr, one a line; where wanted also a table, redrawn in place.

    Args:
        wanted: whether to draw the table.
        refresh: shortest time between two drawings [s].
    """

    def __init__(self, wanted: bool, refresh: float) -> None:
        self._wanted = wanted
        self._refresh = refresh
        self._live: Live | None = None
        self._shown = -refresh

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def say(self, sentence: str) -> None:
        """Print a message, above the table."""
        if self._live is not None:
            self._live.console.print(f"suas: {sentence}", markup=False, highlight=False)
        else:
            typer.echo(f"suas: {sentence}", err=True)

    def due(self) -> bool:
        """Whether the table is wanted and old enough to be drawn again."""
        return self._wanted and time.monotonic() - self._shown >= self._refresh

    def draw(self, table: "Table") -> None:
        """Draw the table."""
        self._shown = time.monotonic()
        if self._live is None:
            from rich.console import Console
            from rich.live import Live

            self._live = Live(console=Console(stderr=True), auto_refresh=False, transient=True)
            self._live.start()
        self._live.update(table, refresh=True)
