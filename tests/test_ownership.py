"""Files have one owner, whom a second program sees; the short version of the interleavings."""

import fcntl
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from benchmarks.interleavings import SCENARIOS
from fitting.calibration.run import CalibrationFolder
from fitting.material.many import calibrate_all, finished
from fitting.statistics.log_probability import Gaussian, NumpyBatch
from fitting.statistics.posterior import Settings, sample
from suas_jax.acquisition.log import writer as log_writer
from suas_jax.acquisition.log.log_file import LineWriteError, LogWriter, log_header, read_log
from suas_jax.files.cache_folder import CacheFolder, kept_arrays
from suas_jax.files.command import command_files
from suas_jax.files.line_file import LineFile
from suas_jax.files.ownership import OwnedError
from suas_jax.files.writing import check_output, write_text

ROOT = Path(__file__).parent.parent
MINE = f"process {os.getpid()} is writing it"


@contextmanager
def command(path: Path, *, overwrite: bool = False) -> Iterator[subprocess.Popen]:
    """A process that has begun to work for a file, as every command does."""
    program = (
        "import sys; from pathlib import Path;"
        "from suas_jax.files.command import command_files;"
        "from suas_jax.files.writing import check_output\n"
        "with command_files():\n"
        f"    check_output(Path(sys.argv[1]), overwrite={overwrite})\n"
        "    print('owned', flush=True); sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == "owned\n"
        yield process
        process.kill()


def elsewhere(action: Callable[[], object]) -> object:
    """What another thread gets, which owns nothing; locks are told apart by open files."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(action).result(timeout=20)


def recorded(path: Path, rows: range, **options) -> LogWriter:
    with LogWriter(path, log_header(), **options) as log:
        for k in rows:
            log.write(0.01 * k, 0.01 * k, k, 0, (k,))
    return log


@pytest.mark.parametrize("there", [False, True])
def test_a_second_command_is_told_who_writes_its_output(tmp_path: Path, there: bool) -> None:
    file = tmp_path / "a.csv"
    if there:
        file.write_text("old")
    with command(file, overwrite=there) as first:
        with command_files(), pytest.raises(OwnedError) as error:
            check_output(file, overwrite=True)
        assert f"process {first.pid} is writing it" in str(error.value)
        with pytest.raises(OwnedError):
            write_text(file, "mine")
        assert file.exists() == there
        first.send_signal(signal.SIGKILL)
        first.wait()
        assert list(tmp_path.glob(".*")) == [tmp_path / ".a.csv.lock"]
        with command_files():  # what a killed process leaves over blocks nobody
            check_output(file, overwrite=True)
            write_text(file, "mine")
    assert file.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [file]


def test_a_command_owns_all_of_its_outputs_until_it_ends(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("a", "b", "n" * 255)]
    with command_files():
        for file in files:
            check_output(file)
            check_output(file)
            write_text(file, "mine")
        for file in files:
            with pytest.raises(OwnedError, match=MINE):
                elsewhere(lambda file=file: write_text(file, "theirs"))
    for file in files:
        elsewhere(lambda file=file: write_text(file, "theirs"))
    assert {file.read_text() for file in files} == {"theirs"}
    assert set(tmp_path.iterdir()) == set(files)


def test_readers_that_lock_are_no_hindrance(tmp_path: Path) -> None:
    """As HDF5 does with every file that it opens for reading."""
    file = tmp_path / "chain.h5"
    file.write_text("old")
    with file.open() as reader:
        fcntl.flock(reader, fcntl.LOCK_SH)
        write_text(file, "new")
        assert reader.read() == "old"
    assert file.read_text() == "new"


@pytest.mark.parametrize("name", ["a.csv", "hard", "soft", "folder/../a.csv"])
def test_a_log_is_not_taken_from_the_one_who_records_it(tmp_path: Path, name: str) -> None:
    path, other = tmp_path / "a.csv", tmp_path / name
    (tmp_path / "folder").mkdir()
    with LogWriter(path, log_header(), taxels=1) as log:
        log.write(0.0, 0.0, 0, 0, (5,))
        log.flush()
        if name in ("hard", "soft"):
            (other.hardlink_to if name == "hard" else other.symlink_to)(path)
        for options in ({"overwrite": True}, {"append": True}):
            with pytest.raises(OwnedError, match=MINE):
                LogWriter(other, log_header(), **options)
        with pytest.raises(OwnedError, match=MINE):
            write_text(other, "a table")
        with command_files(), pytest.raises(OwnedError, match=MINE):
            check_output(other, overwrite=True)
        log.write(0.1, 0.1, 1, 0, (6,))
    assert log.beside == ()
    assert read_log(path).seq.tolist() == [0, 1]
    recorded(path, range(3), overwrite=True)  # the lock has ended with its writer
    assert len(read_log(path)) == 3


LOSSES: dict[str, Callable[[Path], object]] = {
    "deleted": Path.unlink,
    "moved": lambda path: path.rename(path.with_name("moved.csv")),
    "replaced": lambda path: (
        path.with_name("other").write_text("another program's\n"),
        path.with_name("other").replace(path),
    ),
    "folder": lambda path: path.parent.rename(path.parent.with_name(f"of {path.name}")),
}


@pytest.mark.parametrize("at_close", [False, True])
@pytest.mark.parametrize("loss", LOSSES)
def test_a_log_whose_file_is_lost_goes_on_beside(
    tmp_path: Path, loss: str, at_close: bool
) -> None:
    path, said = tmp_path / "logs" / "run.csv", []
    path.parent.mkdir()
    with LogWriter(
        path,
        log_header(),
        flush_interval=0.0,
        sync_interval=99.0 if at_close else 0.0,
        report=said.append,
    ) as log:
        for k in range(50):
            log.write(0.01 * k, 0.01 * k, k, 0, (k,))
            if k in (20, 40):
                LOSSES[loss](log.path)
                last = log.path
                log.flush()
                assert (log.path == last) == at_close
                if at_close:
                    break
    beside = path.with_name(f"run.beside{1 if at_close else 2}.csv")
    assert log.path == log.beside[-1] == beside
    assert read_log(beside).seq.tolist() == list(range(k + 1))
    assert len(said) == (1 if at_close else 2)
    assert str(path) in said[0]
    assert str(log.beside[0]) in said[0]
    assert ("replaced" if loss == "replaced" else "deleted or moved") in said[0]
    if loss == "replaced":
        assert path.read_text() == "another program's\n"


def test_a_part_that_is_lost_goes_on_beside(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    options = {"flush_interval": 0.0, "sync_interval": 99.0, "rotate_bytes": 600}
    with LogWriter(path, log_header(), taxels=1, **options) as log:
        for k in range(60):
            log.write(0.01 * k, 0.01 * k, k, 0, (k,))
            if k == 5:
                path.unlink()
    assert log.beside == (tmp_path / "run.beside1.csv",)
    assert log.path.name.startswith("run.part")
    assert read_log(log.beside[0]).seq.tolist() == list(range(60))


def test_no_place_beside_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    log = LogWriter(Path("run.csv"), log_header(), taxels=1)
    Path("run.csv").unlink()
    (tmp_path / "gone").rmdir()
    with pytest.raises(LineWriteError, match="nothing can be written beside it"):
        log.close()


def test_what_another_writes_before_the_lock_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two loggers go on in one log that a kill cut off: the later one begins behind both."""
    path, before = tmp_path / "run.csv", log_writer.end_of_log
    recorded(path, range(3))
    with path.open("a") as file:
        file.write("0.07,0.07,7,0,1")

    def overtaken(base: Path) -> object:
        monkeypatch.setattr(log_writer, "end_of_log", before)
        end = before(base)
        recorded(path, range(10, 13), append=True)
        return end

    monkeypatch.setattr(log_writer, "end_of_log", overtaken)
    recorded(path, range(20, 23), append=True)
    assert read_log(path).seq.tolist() == [0, 1, 2, 10, 11, 12, 20, 21, 22]


def test_lines_go_on_behind_whole_ones(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    LineFile.open(path).close()
    path.write_text('{"a": 1}\n{"b"')
    file = LineFile.open(path)
    with pytest.raises(OwnedError, match=MINE):
        LineFile.open(path)
    file.append("{}\n")
    file.close()
    assert path.read_text() == '{"a": 1}\n{"b"\n{}\n'


class Done(Executor):
    """Every calibration ends at once; before the first, something happens."""

    def __init__(self, happens: Callable[[], object] = lambda: None) -> None:
        self._happens = happens

    def submit(self, function: Callable, /, *jobs: dict, **_: object) -> Future:
        """The result, which is there."""
        if jobs[0]["name"] == "a":
            self._happens()
        future: Future = Future()
        future.set_result({"name": jobs[0]["name"]})
        return future


@pytest.mark.parametrize("loss", [None, "replaced"])
def test_results_of_many_membranes_have_one_owner(tmp_path: Path, loss: str | None) -> None:
    results, jobs = tmp_path / "r.jsonl", [{"name": "a"}, {"name": "b"}]

    def second() -> None:
        with pytest.raises(OwnedError, match=MINE):
            elsewhere(lambda: calibrate_all(jobs, results, Done()))
        if loss:
            LOSSES[loss](results)

    if loss is None:
        assert calibrate_all(jobs, results, Done(second)) == 2
        assert calibrate_all(jobs, results, Done()) == 0
        return
    with pytest.raises(ValueError, match=r"r\.beside1\.jsonl"):
        calibrate_all(jobs, results, Done(second))
    assert finished(tmp_path / "r.beside1.jsonl") == {"a", "b"}
    assert results.read_text() == "another program's\n"


def test_a_chain_has_one_sampler(tmp_path: Path) -> None:
    chain = tmp_path / "chain.h5"
    batch = NumpyBatch(lambda x: -0.5 * np.sum(x**2, axis=1))
    start = Gaussian(np.zeros(1), np.eye(1))
    settings = Settings(walkers=4, steps=20, check=10, chain=chain)
    refused: list[BaseException] = []

    def second(*_: object) -> None:
        try:
            elsewhere(lambda: sample(batch, start, ("x",), settings))
        except OwnedError as error:
            refused.append(error)

    assert sample(batch, start, ("x",), settings, progress=second).steps == 20
    assert len(refused) == 3
    assert MINE in str(refused[0])


def test_a_calibration_has_one_person(tmp_path: Path) -> None:
    skin, folder = tmp_path / "skin.toml", tmp_path / "skin.calibration"
    skin.write_text("")

    def opened() -> None:
        with CalibrationFolder.owned(folder, skin, ()):
            pass

    with CalibrationFolder.owned(folder, skin, ()), pytest.raises(OwnedError, match=MINE):
        elsewhere(opened)
    elsewhere(opened)


def test_a_table_is_computed_by_one_and_waited_for_by_the_other(tmp_path: Path) -> None:
    begun, go_on, computed = threading.Event(), threading.Event(), []

    def folder() -> CacheFolder:
        return CacheFolder(tmp_path / "kept", key_file=tmp_path / "state" / "key")

    def compute() -> dict[str, np.ndarray]:
        computed.append(1)
        begun.set()
        assert go_on.wait(20)
        return {"x": np.arange(5)}

    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(kept_arrays, "t", compute, folder())
        assert begun.wait(20)
        threading.Timer(0.1, go_on.set).start()
        with pytest.warns(UserWarning, match=f"waiting for process {os.getpid()}"):
            found = pool.submit(kept_arrays, "t", compute, folder()).result(timeout=20)
        np.testing.assert_array_equal(found["x"], first.result()["x"])
    assert computed == [1]


def test_no_interleaving_loses_anything() -> None:
    """In a process of its own, as it forks."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.interleavings", "--count", "28"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(f'"{name}"' in done.stdout for name in SCENARIOS)
