"""What a person sees while a log is recorded: on a terminal a table that moves, else lines."""

import sys
import time
from collections import deque
from typing import TYPE_CHECKING, Any

from suas_jax.acquisition.stream import Stream
from suas_jax.acquisition.terminal import LiveTerminal

if TYPE_CHECKING:
    from rich.table import Table

# Rates are means over this time [s].
_WINDOW = 2.0
_REFRESH = 0.25  # between two tables [s]


class View(LiveTerminal):
    """Messages on stderr; on a terminal (or `live`) also a table of rates and losses."""

    def __init__(self, title: str, live: bool | None = None) -> None:
        super().__init__(sys.stderr.isatty() if live is None else live, _REFRESH)
        self._title = title
        self._history: deque[tuple[float, int, int]] = deque()

    def update(self, stream: Stream) -> None:
        """Show where the recording stands, a few times a second."""
        if not self.due():
            return
        now = time.monotonic()
        self._history.append((now, stream.summary.rows, stream.tally.bytes))
        while now - self._history[0][0] > _WINDOW:
            self._history.popleft()
        self.draw(self._table(stream))

    def _table(self, stream: Stream) -> "Table":
        from rich.table import Table

        (then, rows, size), (now, rows_now, size_now) = self._history[0], self._history[-1]
        span = max(now - then, 1e-9)
        modules, total, tally = len(stream.modules), stream.summary, stream.tally
        row_rate = (rows_now - rows) / span
        table = Table(show_header=False, box=None, title=self._title, title_justify="left")
        state = "[red]link lost[/]" if stream.lost_link else "recording"
        table.add_row("state", f"{state}, {stream.reconnects} reconnects")
        table.add_row("modules", str(modules))
        table.add_row("frames", f"{row_rate / max(modules, 1):.1f} per second and module")
        table.add_row(
            "rows",
            f"{total.rows} ({row_rate:.0f}/s, {1e-3 * (size_now - size) / span:.1f} kB/s)",
        )
        table.add_row("lost", f"{total.lost} frames, {total.restarts} device restarts")
        table.add_row(
            "refused", f"{tally.bad_crc} wrong checksums, {tally.malformed} malformed frames"
        )
        table.add_row(
            "flagged",
            f"{total.duplicates} sent twice, {total.repeats} not refreshed, "
            f"{total.suspects} suspect",
        )
        if total.stuck:
            taxels = ", ".join(f"{m}: {ks}" for m, ks in sorted(total.stuck.items()))
            table.add_row("[yellow]stuck taxels[/]", f"module {taxels}")
        return table


def totals_text(totals: dict[str, Any]) -> str:
    """The totals of a recording in a sentence."""
    troubles = [
        f"{totals[key]} {words}"
        for key, words in (
            ("lost_frames", "frames lost"),
            ("bad_crc", "wrong checksums"),
            ("malformed", "malformed frames"),
            ("duplicates", "frames sent twice"),
            ("suspect_rows", "suspect rows"),
            ("restarts", "device restarts"),
            ("clock_jumps", "jumps of the device's clock"),
            ("other_taxels_rows", "rows with another number of taxels"),
            ("reconnects", "reconnects"),
            ("unwritten_rows", "rows not written"),
        )
        if totals[key]
    ]
    troubles += [f"module {m}: taxels {ks} stuck" for m, ks in totals["stuck_taxels"].items()]
    return (
        f"{totals['rows']} rows of {len(totals['modules'])} modules in "
        f"{totals['elapsed_s']:.1f} s; {', '.join(troubles) or 'nothing lost'}"
    )
