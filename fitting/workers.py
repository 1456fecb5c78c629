"""Processes that work for this one: on this machine over pipes alone, or of a Dask scheduler.

Both are a `concurrent.futures.Executor`; who is given one need not know which.
"""

import contextlib
import functools
import logging
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from types import TracebackType
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")

_ATTEMPTS = 3  # processes that one task may take with it
_TIMEOUT = "10s"  # for a scheduler to answer
_PROTOCOLS = "tls://", "tcp://"


class LostWorkerError(OSError):
    """A task took every process with it that tried."""


class _Worker(NamedTuple):
    process: SpawnProcess
    pipe: Connection


class LocalWorkers(Executor):
    """Processes that are spawned when they are first needed, each at a pipe of its own.

    Nothing listens, so nobody else can reach them. A task whose process died is given to a new
    one; `concurrent.futures.ProcessPoolExecutor` would drop all tasks, and could not be
    interrupted while they run. The processes end with this one, however it ends, and never
    see an interrupt from the terminal (Ctrl-C).

    Spawned, not forked: a fork of a process that runs JAX hangs. They import the script that
    runs, which must not start work unless its ``__name__`` is ``"__main__"``.

    `lost` is called with a sentence that names a process that died, from any thread.
    """

    def __init__(self, count: int, lost: Callable[[str], None] = lambda sentence: None) -> None:
        self._threads = ThreadPoolExecutor(count)  # each waits for a process of its own
        self._own = threading.local()
        self._lock = threading.Lock()  # what starts, buries and kills processes
        self._workers: list[_Worker] = []
        self._killed = False
        self._lost = lost

    def submit(
        self, function: Callable[..., T], /, *arguments: Any, **named: Any
    ) -> "Future[T]":
        """Run a function in a process; it, its arguments and its result are pickled.

        The future raises what the function raised, or `LostWorkerError`.
        """
        return self._threads.submit(self._run, (function, arguments, named))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes once they have done what was submitted; see the base class."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            for worker in self._workers:
                worker.pipe.close()
            for worker in self._workers:
                worker.process.join()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the processes, at once if an exception leaves the block."""
        if kind is not None:
            with self._lock:
                self._killed = True
                for worker in self._workers:
                    worker.process.kill()
        self.shutdown(cancel_futures=kind is not None)

    def _run(self, task: Any) -> Any:
        sent = pickle.dumps(task)
        for attempt in range(_ATTEMPTS):
            worker = self._worker()
            try:
                worker.pipe.send_bytes(sent)
                answer = worker.pipe.recv_bytes()
            except (EOFError, OSError):
                death = self._bury(worker)
                if attempt + 1 < _ATTEMPTS and not self._killed:
                    self._lost(f"{death}; a new one does its work again")
                continue
            result, error = pickle.loads(answer)
            if error is not None:
                raise error
            return result
        raise LostWorkerError(
            f"{death}, and so did {_ATTEMPTS - 1} others with the same work; where memory is "
            "short, fewer workers need less"
        )

    def _worker(self) -> _Worker:
        """The process of this thread."""
        if not hasattr(self._own, "worker"):
            pipe, theirs = multiprocessing.Pipe()
            process = multiprocessing.get_context("spawn").Process(
                target=_serve, args=(theirs,), daemon=True
            )
            with self._lock:
                if self._killed:
                    raise LostWorkerError("the workers have been stopped")
                resource_tracker.ensure_running()  # which unblocks signals, if it must start
                # Inherited from this thread, and blocked before the process can set anything.
                if hasattr(signal, "pthread_sigmask"):
                    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
                process.start()
                self._own.worker = _Worker(process, pipe)
                self._workers.append(self._own.worker)
            theirs.close()
        return self._own.worker

    def _bury(self, worker: _Worker) -> str:
        """Forget a process that died; how, in words."""
        with self._lock:  # two threads that wait for processes take answers from each other
            worker.process.join()
            self._workers.remove(worker)
        del self._own.worker
        worker.pipe.close()
        status = worker.process.exitcode or 0
        how = (
            f"was ended by {signal.Signals(-status).name}"
            if status < 0
            else f"ended with status {status}"
        )
        return f"worker process {worker.process.pid} {how}"


def in_float64(function: Callable[..., T], *first: Any) -> Callable[..., T]:
    """A function for workers to call in float64, with what else it takes after some arguments.

    These are sent as bytes: read before float64 is on, their arrays would be of float32.
    """
    return functools.partial(_called_in_float64, pickle.dumps((function, first)))


def _called_in_float64(sent: bytes, *others: Any) -> Any:
    from suas_jax.runtime.settings import configure

    configure()
    function, first = pickle.loads(sent)
    return function(*first, *others)


def _serve(pipe: Connection) -> None:
    """What a process does: one task after another, until the pipe is closed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            received = pipe.recv_bytes()
            try:
                function, arguments, named = pickle.loads(received)
                answer = pickle.dumps((function(*arguments, **named), None))
            except Exception as error:
                error.add_note(traceback.format_exc())
                answer = _pickled_error(error)
            pipe.send_bytes(answer)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _pickled_error(error: Exception) -> bytes:
    """An exception as it is, or in words where it can't be sent."""
    try:
        found = pickle.dumps((None, error))
        pickle.loads(found)
    except Exception:
        return pickle.dumps((None, RuntimeError(f"{type(error).__name__}: {error}")))
    return found


class _SchedulerWorkers(Executor):
    """Dask's workers, whose deaths have the same name as others'."""

    def __init__(self, client: Any) -> None:
        self._inner = client.get_executor(pure=False)

    def submit(
        self, function: Callable[..., T], /, *arguments: Any, **named: Any
    ) -> "Future[T]":
        """See the base class."""
        from distributed.scheduler import KilledWorker

        future: Future[T] = Future()

        def pass_on(inner: "Future[T]") -> None:
            if inner.cancelled():  # with the client, whose results nobody waits for
                future.cancel()
                return
            error = inner.exception()
            if isinstance(error, KilledWorker):
                future.set_exception(LostWorkerError(str(error)))
            elif error is not None:
                future.set_exception(error)
            else:
                future.set_result(inner.result())

        self._inner.submit(function, *arguments, **named).add_done_callback(pass_on)
        return future


@contextlib.contextmanager
def scheduler_workers(address: str, *, trust_network: bool = False) -> Iterator[Executor]:
    """The workers of a Dask scheduler.

    What it sends back can run code here, and what is sent to it runs on its workers. So both
    sides show certificates of one authority, which Dask's configuration names:
    ``distributed.comm.tls.ca-file``, ``distributed.comm.tls.client.cert`` and ``.key``.

    The address is ``tls://host:port``. `trust_network` also allows ``tcp://host:port``: whoever
    can reach that port, or is on the way to it, can run code as this user and as the workers'.
    Raises ValueError: the address is no such address, a certificate is not named, or Dask is
    not installed.
    Raises OSError: no scheduler answers, or a certificate can't be used.
    """
    if not address.startswith(_PROTOCOLS):
        raise ValueError(f"{address}: the address of a scheduler is tls://host:port")
    if address.startswith("tcp://") and not trust_network:
        raise ValueError(
            f"{address}: without certificates anyone who can reach this port can run code as "
            "this user; give tls://host:port, or allow it by --trust-network"
        )
    try:
        from distributed import Client, Security
    except ImportError:
        raise ValueError('a scheduler needs Dask: pip install "suas-jax[cluster]"') from None
    security = Security()
    if address.startswith("tls://"):
        _check_certificates(address, security)
    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL)  # connections that end are not news, least of all in stacks
    try:
        with Client(
            address, security=security, timeout=_TIMEOUT, set_as_default=False
        ) as client:
            yield _SchedulerWorkers(client)
    finally:
        log.setLevel(level)


def _check_certificates(address: str, security: Any) -> None:
    """Refuse certificates that are not named or can't be used, before Dask says so in stacks.

    Raises ValueError: one is not named.
    Raises OSError: one can't be read, or is none.
    """
    needed = {"ca-file": security.tls_ca_file, "client.cert": security.tls_client_cert}
    for key, file in needed.items():
        if not file:
            raise ValueError(
                f"{address}: Dask's configuration names no certificate distributed.comm.tls."
                f"{key}; the three it needs are ca-file, client.cert and client.key"
            )
    try:
        security.get_connection_args("client")
    except OSError as error:
        files = ", ".join(map(str, needed.values()))
        raise OSError(f"{address}: certificates {files}: {error}") from None
