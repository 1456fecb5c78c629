"""Processes that work for a command: no door, deaths named, interrupts, certificates."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import psutil
import pytest
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.cli.options import executor
from fitting.workers import LocalWorkers, LostWorkerError

ROOT = Path(__file__).parent.parent
DATA = ROOT / "configs" / "data" / "treloar1944_uniaxial.csv"
PATIENCE = 60.0  # with a busy machine [s]


class TwoWordsError(Exception):
    """Can't be pickled: it is made of two arguments, and kept with one."""

    def __init__(self, one: str, two: str) -> None:
        super().__init__(one + two)


def refuse() -> None:
    raise TwoWordsError("no", "where")


def die_once(file: Path) -> int:
    if not file.exists():
        file.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 7


def waited(condition: Callable[[], Any]) -> Any:
    """What a condition comes to, once it is true."""
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)
    return found


def test_a_worker_that_dies_is_named_and_its_work_done_again(tmp_path: Path) -> None:
    said: list[str] = []
    with LocalWorkers(1, said.append) as own:
        pid = own.submit(os.getpid).result()
        assert own.submit(die_once, tmp_path / "died").result() == 7
        assert said == [
            f"worker process {pid} was ended by SIGKILL; a new one does its work again"
        ]
        with pytest.raises(LostWorkerError, match="was ended by SIGKILL, and so did 2 others"):
            own.submit(signal.raise_signal, signal.SIGKILL).result()
        assert list(own.map(abs, [-3, 2, -1])) == [3, 2, 1]


def test_errors_come_back_from_workers() -> None:
    with LocalWorkers(1) as own:
        with pytest.raises(ValueError, match="invalid literal") as caught:
            own.submit(int, "x").result()
        assert "Traceback" in caught.value.__notes__[0]
        with pytest.raises(RuntimeError, match="TwoWordsError: nowhere"):
            own.submit(refuse).result()
        with pytest.raises(TypeError, match="cannot pickle"):
            own.submit(open, DATA).result()


def test_workers_end_with_a_process_that_is_killed() -> None:
    program = (
        "import time\n"
        "from fitting.workers import LocalWorkers\n"
        "own = LocalWorkers(2)\n"
        "futures = [own.submit(time.sleep, 600) for _ in range(2)]\n"
        "time.sleep(600)\n"
    )
    with running(program) as parent:
        waited(lambda: len(spawned(parent)) == 2)
        family = parent.children(recursive=True)
        parent.kill()
        parent.wait()
    assert psutil.wait_procs(family, PATIENCE)[1] == []


@contextlib.contextmanager
def running(program: str, *arguments: str) -> Iterator[psutil.Popen]:
    """A process in a group of its own, as a terminal has it, killed at the end."""
    process = psutil.Popen(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.stderr.close()
        process.wait()


def spawned(parent: psutil.Process) -> list[psutil.Process]:
    """Worker processes that have begun."""
    found = []
    for child in parent.children():
        with contextlib.suppress(psutil.NoSuchProcess):
            if "--multiprocessing-fork" in child.cmdline():
                found.append(child)
    return found


def doors(process: psutil.Process) -> list[Any]:
    """What another process could connect to: all but pairs of sockets, which have no name."""
    found = process.net_connections(kind="all")
    return [x for x in found if x.family.name != "AF_UNIX" or x.laddr]


def test_a_command_with_workers_has_no_door_and_is_interrupted_at_once(tmp_path: Path) -> None:
    (tmp_path / "jobs.toml").write_text(
        "".join(
            f'[[membrane]]\nname = "m{k}"\ndata = {{ uniaxial = "{DATA}" }}\n' for k in range(9)
        )
    )
    run = "import sys; from fitting.cli.app import main; sys.exit(main())"
    files = [str(tmp_path / "jobs.toml"), "-o", str(tmp_path / "results.jsonl")]
    with running(run, "fit", "materials", *files, "--workers", "2") as command:
        waited(lambda: len(spawned(command)) == 2)
        family = [command, *command.children(recursive=True)]
        assert {process: doors(process) for process in family} == {p: [] for p in family}
        os.killpg(command.pid, signal.SIGINT)  # Ctrl-C goes to the whole group
        assert command.wait(PATIENCE) == 130
        assert command.stderr.read().decode() == "suas: interrupted\n"
        assert psutil.wait_procs(family, PATIENCE)[1] == []


class Losing(Executor):
    """Calibrates nothing; membrane b takes its workers with it."""

    def submit(self, function: Any, /, job: Any) -> Future[Any]:  # type: ignore[override]
        """Answer at once."""
        future: Future[Any] = Future()
        if job["name"] == "b":
            future.set_exception(LostWorkerError("worker process 7 was ended by SIGKILL"))
        else:
            future.set_result({"name": job["name"], "status": "converged"})
        return future


def test_a_membrane_whose_workers_die_has_no_result_and_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = [f'[[membrane]]\nname = "{k}"\ndata = {{ uniaxial = "{DATA}" }}\n' for k in "abc"]
    (tmp_path / "jobs.toml").write_text("".join(tables))
    results = tmp_path / "results.jsonl"
    losing = contextlib.nullcontext(Losing())
    monkeypatch.setattr("fitting.cli.fit_materials.executor", lambda *_: losing)
    files = [str(tmp_path / "jobs.toml"), "-o", str(results)]
    done = CliRunner().invoke(app, ["fit", "materials", *files])
    assert done.exit_code == 2
    assert done.stderr == "suas: membrane b: worker process 7 was ended by SIGKILL\n"
    names = [json.loads(line)["name"] for line in results.read_text().splitlines()]
    assert sorted(names) == ["a", "c"]


# Dask is imported where it is used, as worker processes import this file.


def certificates(folder: Path) -> tuple[Any, dict[str, str]]:
    """Certificates of one authority, and the Dask configuration that names their files."""
    from distributed import Security

    security, named = Security.temporary(), {}
    for key in ("ca-file", "client.cert", "client.key"):
        file = folder / f"{key}.pem"
        file.write_text(getattr(security, "tls_" + key.replace(".", "_").replace("-", "_")))
        named[f"distributed.comm.tls.{key}"] = str(file)
    return security, named


@contextlib.contextmanager
def scheduler(**settings: Any) -> Iterator[str]:
    """The address of a scheduler in this process, with one worker."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", **settings
    ) as cluster:
        yield cluster.scheduler_address


def test_a_scheduler_and_its_client_show_certificates(tmp_path: Path) -> None:
    import dask

    (tmp_path / "other").mkdir()
    security, named = certificates(tmp_path)
    _, others = certificates(tmp_path / "other")
    with scheduler(protocol="tls", security=security) as address:
        assert address.startswith("tls://")
        with pytest.raises(ValueError, match="names no certificate"), executor(address, False):
            pass
        with dask.config.set(named), executor(address, False) as own:
            assert own is not None
            assert list(own.map(abs, [-3, 2, -1])) == [3, 2, 1]
            with pytest.raises(ValueError, match="invalid literal"):
                own.submit(int, "x").result()
        with (
            dask.config.set(others),
            pytest.raises(OSError, match="certificate does not match"),
            executor(address, False),
        ):
            pass
    (tmp_path / "ca-file.pem").write_text("none\n")
    with (
        dask.config.set(named),
        pytest.raises(OSError, match=r"tls://nowhere:1: certificates .*ca-file\.pem"),
        executor("tls://nowhere:1", False),
    ):
        pass


def test_a_scheduler_without_certificates_is_asked_for(tmp_path: Path) -> None:
    with scheduler(protocol="tcp") as address:
        with pytest.raises(ValueError, match="anyone who can reach"), executor(address, False):
            pass
        with executor(address, True) as own:
            assert own is not None
            assert own.submit(abs, -3).result() == 3
    for wrong in ("0", "-1", "two", "ws://host:1", "10000"):
        with pytest.raises(ValueError, match=wrong), executor(wrong, True):
            pass
