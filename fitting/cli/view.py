"""`suas view`: a scene, a log or a live port in the browser. JAX is imported inside."""

import contextlib
import signal
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.log_frames import log_frames
from fitting.cli.options import (
    Baseline,
    Baud,
    Duration,
    Format,
    LivePort,
    LoadsOfLog,
    SkinOfLog,
    TaxelsOnly,
    argument,
    option,
    remark,
)
from fitting.cli.progress import spinner
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_outputs
from suas_jax.runtime.optional import optional

if TYPE_CHECKING:
    from fitting.inverse_load.estimator import LoadEstimator
    from fitting.inverse_load.live.stream import LiveWatcher
    from fitting.view.history_source import HistorySource
    from fitting.view.hub import Hub


def view(
    source: Annotated[
        Path, argument("Scene (TOML), log, or with --live the skin file.", metavar="SOURCE")
    ],
    record: Annotated[
        Path | None, argument("Live: where readings are recorded (optional).", metavar="[LOG]")
    ] = None,
    live: LivePort = None,
    format_name: Format = "text",
    baud: Baud = 115200,
    skin: SkinOfLog = None,
    baseline: Baseline = None,
    loads: LoadsOfLog = None,
    history: Annotated[
        Path | None,
        option("Of a scene: loads over time to play, as for `suas sweep`.", metavar="FILE"),
    ] = None,
    taxels_only: TaxelsOnly = False,
    contacts: Annotated[
        int, option("Largest number of contacts to look for.", min=1, max=4)
    ] = 3,
    address: Annotated[
        str, option("Where the page is served; port 0: any.", metavar="HOST:PORT")
    ] = "127.0.0.1:8700",
    browser: Annotated[bool, option("Open the page in the browser.", "--open")] = False,
    duration: Duration = None,
    overwrite: Overwrite = False,
) -> None:
    """Show a skin in the browser: membrane, taxels, contacts, force and oil pressure.

    The page is served from this machine alone unless --address says otherwise. Ctrl-C ends.
    Exit status: 0 ended, 2 bad input.
    """
    with bad_input():
        if record is not None and live is None:
            raise ValueError(f"{record}: readings are recorded with --live PORT only")
        if history is not None and (live is not None or source.suffix.lower() != ".toml"):
            raise ValueError("--history goes with a scene (TOML), which it loads over time")
        check_outputs([record], overwrite=overwrite)
        from fitting.inverse_load.live.serve import host_and_port

        host, port = host_and_port(address, "--address")
        optional("aiohttp", "suas view needs", "view")
        from suas_jax.runtime.settings import configure

        configure()

        @contextlib.contextmanager
        def served(hub: "Hub") -> Iterator[None]:
            from fitting.view.server import ViewServer

            with ViewServer(hub, host, port) as server:
                say(server.url)
                remark("the page is at this address; Ctrl-C ends")
                if browser:
                    webbrowser.open(server.url)
                yield

        if live is not None:
            options = {"port": live, "format_name": format_name, "baud": baud}
            options |= {"duration": duration, "log": record, "overwrite": overwrite}
            _live(source, baseline, contacts, options, served)
            return
        from suas_jax.acquisition.log.log_file import is_log

        shown: Any
        if source.suffix.lower() != ".toml" and is_log(source):
            from fitting.view.log_source import LogSource
            from fitting.view.readings_picture import ReadingsPictures

            found = log_frames(
                source, skin, baseline, loads, taxels_only=taxels_only, most_contacts=contacts
            )
            shown = LogSource(
                found.readings,
                ReadingsPictures(found.spec, found.rest),
                source.name,
                estimator=found.estimator,
                estimates=found.estimates,
            )
        elif history is not None:
            shown = _history_source(source, history)
        else:
            from fitting.view.scene_source import SceneSource
            from suas_jax.config import load_scene

            if source.suffix.lower() == ".csv":
                raise ValueError(
                    f"{source}: is not a log, which has a column t_host_s; loads over time go "
                    "with a scene, as --history"
                )
            shown = SceneSource(load_scene(source), source.name)
        with served(shown.hub), _ended_by_signal(duration) as over:
            shown.run(over)


def _live(
    skin: Path,
    baseline: Path | None,
    contacts: int,
    options: dict[str, Any],
    served: Callable[["Hub"], contextlib.AbstractContextManager[None]],
) -> None:
    from fitting.inverse_load.live.run import LiveOptions, run_live
    from fitting.inverse_load.zero.skin_estimator import skin_estimator
    from fitting.view.live_source import LiveSource
    from fitting.view.readings_picture import ReadingsPictures

    live = LiveOptions(**options)

    def prepare() -> "LoadEstimator":
        with spinner("preparing the estimate") as show:
            return skin_estimator(
                skin, baseline, progress=show, live=True, most_contacts=contacts
            )

    def watchers(
        estimator: "LoadEstimator", stack: contextlib.ExitStack
    ) -> "list[LiveWatcher]":
        pictures = ReadingsPictures(estimator.spec, estimator.rest)
        source = LiveSource(pictures, live.port)
        stack.enter_context(served(source.hub))
        return [source]

    run_live(prepare, live, watchers)


def _history_source(scene: Path, history: Path) -> "HistorySource":
    from fitting.view.history_source import HistorySource
    from suas_jax.config import load_scene
    from suas_jax.dynamics.course import read_history
    from suas_jax.dynamics.history import history_sweep

    spec, rows = load_scene(scene), read_history(history)
    with spinner("following the history"):
        return HistorySource(history_sweep(spec, rows), f"{scene.name}, {history.name}")


@contextlib.contextmanager
def _ended_by_signal(duration: float | None) -> Iterator[Callable[[], bool]]:
    """Ctrl-C, SIGTERM or the end of a duration end what asks the function that is given."""
    ended, began = threading.Event(), time.monotonic()

    def over() -> bool:
        return ended.is_set() or (duration is not None and time.monotonic() - began > duration)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {n: signal.signal(n, lambda *_: ended.set()) for n in numbers}
    try:
        yield over
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
