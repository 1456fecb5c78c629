"""The console script `suas`, which answers Ctrl-C from the first line of `main` on.

So nothing is imported above that an interpreter has not loaded anyway, but for `signal`.
"""

import os
import signal
import sys


def __getattr__(name: str) -> object:
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from fitting.cli.commands import app

    return app


def main() -> None:
    """Run the command line."""
    # A program in the background of a shell's script has been told to ignore Ctrl-C.
    listens = signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    if listens:
        signal.signal(signal.SIGINT, _end_at_once)
    from fitting.cli.limited_memory import run_in_child_where_limited

    run_in_child_where_limited()
    # Read when NumPy and SciPy are imported, which commands do. Each has a pool of threads of
    # its own, which on busy cores wait for one another longer than matrices this small take.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Else XLA asks for a bug report where a busy machine compiles a pad for two minutes.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    import gc

    gc.set_threshold(100_000)  # as `configure` has it: imports make many objects that stay
    from fitting.cli import contract
    from fitting.cli.commands import app

    sys.unraisablehook = _interrupt_again
    if listens:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    status = contract.run(app)
    if listens:  # all is said and written
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # Compiled programs, freed object by object, would take a sixth of a solve's time; the
    # system takes the memory of a process that ends at once.
    gc.freeze()
    sys.exit(status)


def _end_at_once(*_: object) -> None:
    """Answer Ctrl-C while the program is imported, when nothing is open yet.

    An exception would end as a stack, or be swallowed by what is imported.
    """
    try:
        if "--json" in sys.argv:
            os.write(1, b'{"status": "interrupted", "message": "interrupted"}\n')
        os.write(2, b"suas: interrupted\n")
    finally:  # whether the outputs are open or not
        os._exit(130)


def _interrupt_again(lost: "sys.UnraisableHookArgs") -> None:
    """Repeat a Ctrl-C that fell into a finaliser, which can't pass it on."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        import threading

        threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(lost)
