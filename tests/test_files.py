"""What is written is whole, and replaces nothing unasked; what is read is bounded."""

import errno
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest

from suas_jax.files.command import command_files
from suas_jax.files.reading import read_bytes
from suas_jax.files.writing import check_output, check_outputs, write_bytes, write_text, written


def drafts(folder: Path) -> list[Path]:
    return list(folder.glob(".*.part"))


def interrupted_write(file: Path, text: str) -> None:
    with written(file) as draft:
        draft.write_text(text)
        raise InterruptedError


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    with pytest.raises(InterruptedError):
        interrupted_write(file, "half of i")
    assert not list(tmp_path.iterdir())
    write_text(file, "all of it")
    assert file.read_text() == "all of it"
    assert not drafts(tmp_path)


def test_what_was_there_survives_a_write_that_fails(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("old")
    with pytest.raises(InterruptedError):
        interrupted_write(file, "new")
    assert file.read_text() == "old"


def test_a_command_replaces_what_it_is_told_to(tmp_path: Path) -> None:
    file, empty = tmp_path / "a.csv", tmp_path / "empty"
    file.write_text("1")  # a single byte may be all that somebody knows
    empty.touch()
    with command_files():
        with pytest.raises(FileExistsError, match="--overwrite"):
            check_output(file)
        with pytest.raises(FileExistsError, match="--overwrite"):
            check_outputs([file])
        with pytest.raises(FileExistsError, match="--overwrite"):
            write_text(file, "new")
        check_output(file, overwrite=True)
        write_text(file, "new")
        write_text(empty, "no loss")
    assert (file.read_text(), empty.read_text()) == ("new", "no loss")


def test_what_another_program_makes_meanwhile_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"

    def overtaken() -> None:
        with written(file) as draft:
            draft.write_text("mine")
            file.write_text("theirs")

    with command_files(), pytest.raises(FileExistsError, match="meanwhile"):
        overtaken()
    assert file.read_text() == "theirs"
    assert not drafts(tmp_path)


@pytest.mark.parametrize("name", ["a.toml", "hard", "soft", "folder/../a.toml"])
def test_an_input_is_never_replaced(tmp_path: Path, name: str) -> None:
    file = tmp_path / "a.toml"
    file.write_text("the only copy")
    (tmp_path / "folder").mkdir()
    (tmp_path / "hard").hardlink_to(file)
    (tmp_path / "soft").symlink_to(file)
    with command_files():
        read_bytes(file, 100)
        with pytest.raises(ValueError, match="is an input of this command"):
            check_outputs([tmp_path / name], overwrite=True)
        with pytest.raises(ValueError, match="is an input of this command"):
            write_text(tmp_path / name, "something else")
    assert file.read_text() == "the only copy"


def test_two_outputs_are_two_files(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "a")
    for other in ("a", "link", "../" + tmp_path.name + "/a"):
        with pytest.raises(ValueError, match="named for two outputs"):
            check_outputs([tmp_path / "a", None, tmp_path / other])
    check_outputs([tmp_path / "a", tmp_path / "b", Path(os.devnull), Path(os.devnull)])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing/a.csv", "there is no folder"),
        (".", "is a directory"),
        ("a\0b", "not the name of a file"),
        ("", "is a directory"),
        ("loop", "symbolic links"),
        ("a" * 300, "too long"),
    ],
)
def test_places_where_no_file_can_be(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises((OSError, ValueError), match=message):
        check_output(tmp_path / name)


def test_links_stay_links_and_modes_stay(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    file, link = tmp_path / "real" / "a.csv", tmp_path / "link.csv"
    link.symlink_to(file)
    write_text(link, "first")
    assert link.is_symlink()
    assert file.read_text() == "first"
    file.chmod(0o640)
    write_text(link, "second")
    assert file.stat().st_mode & 0o777 == 0o640
    for mask, mode in ((0o027, 0o640), (0, 0o666)):
        before = os.umask(mask)
        try:
            write_text(tmp_path / f"new-{mask}", "")
        finally:
            os.umask(before)
        assert (tmp_path / f"new-{mask}").stat().st_mode & 0o777 == mode


def test_devices_are_written_to(tmp_path: Path) -> None:
    write_text(Path(os.devnull), "gone")
    assert not Path(os.devnull).is_file()


@pytest.mark.parametrize("name", ["a.csv", "a" * 200, 63 * "\N{SNAIL}"])
def test_a_draft_that_a_kill_left_is_removed_later(tmp_path: Path, name: str) -> None:
    """Names of 255 bytes are the longest; a draft's is as long as it may be or shorter."""
    found = []
    for _ in range(3):
        with written(tmp_path / name) as draft:
            found.append(draft)
    left, fresh, early = found
    alike = [tmp_path / other for other in (f".{name[:40]}.notes", ".another.part")]
    for path in (*found, *alike):
        path.touch()
    for path in (left, *alike):
        os.utime(path, (0, time.time() - 4000))
    os.utime(early, (0, time.time() + 4000))  # made on a machine whose clock is ahead
    write_text(tmp_path / name, "x")
    assert set(tmp_path.iterdir()) == {tmp_path / name, fresh, early, *alike}


def test_a_disk_that_knows_no_links_is_written_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refused)
    with command_files():
        write_text(tmp_path / "a.csv", "all of it")
    assert (tmp_path / "a.csv").read_text() == "all of it"
    assert not drafts(tmp_path)


def test_a_full_disk_leaves_what_was_there(tmp_path: Path) -> None:
    """The largest file that a process may write stands for the room on a disk."""
    file = tmp_path / "a.csv"
    file.write_text("old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError, match="too large"):
            write_bytes(file, bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert file.read_text() == "old"
    assert not drafts(tmp_path)


def test_only_regular_files_of_a_known_size_are_read(tmp_path: Path) -> None:
    file, pipe, loop = (tmp_path / name for name in ("file", "pipe", "loop"))
    file.write_bytes(bytes(100))
    os.mkfifo(pipe)
    loop.symlink_to(loop)
    assert read_bytes(file, 100) == bytes(100)
    for path, most, message in (
        (file, 99, "at most"),
        (pipe, 100, "is a pipe"),
        (loop, 100, "symbolic links"),
        (tmp_path, 100, "irectory"),
        (Path("/dev/zero"), 100, "is a character device"),
        (Path("/proc/self/maps"), 100, "at most"),  # says that it is empty
        (tmp_path / "none", 100, "No such file"),
    ):
        with pytest.raises(OSError, match=message):
            read_bytes(path, most)


SCENE = Path(__file__).parent.parent / "configs" / "scenes" / "case_b.toml"
SPECIAL = ["/dev/zero", "pipe", "loop"]
COMMANDS = [
    ("solve", "{}"),
    ("sweep", "{}", "--force", "0:1:2"),
    ("simulate", "{}", "-o", "out.csv"),
    ("simulate", "{}", "--live"),
    ("simulate", "{}.csv", "-o", "out.csv"),
    ("convert", "{}.csv", "out.nc"),
    ("convert", "{}.nc", "out.csv"),
    ("convert", "{}.parquet", "out.csv"),
    ("baseline", "{}", "-o", "out.json"),
    ("baseline", "log.csv", "-o", "out.json", "--reference", "{}"),
    ("invert", "{}", "log.csv"),
    ("invert", "skin.toml", "{}"),
    ("invert", "skin.toml", "log.csv", "--baseline", "{}"),
    ("fit", "sensor", "{}", "log.csv"),
    ("fit", "sensor", "skin.toml", "{}"),
    ("fit", "sensor", "skin.toml", "log.csv", "--inputs", "{}"),
    ("fit", "material", "--data", "uniaxial={}"),
    ("fit", "material", "--data", "uniaxial=log.csv", "--sample", "--chain", "{}"),
    ("fit", "materials", "{}", "-o", "out.jsonl"),
]


def test_every_command_answers_at_once_to_special_files(tmp_path: Path) -> None:
    """All commands in one process: it would wait for ever, or fill the memory, at the first."""
    program = f"""
import os, resource, sys
from pathlib import Path
from typer.testing import CliRunner
from fitting.cli.app import app
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
os.chdir({str(tmp_path)!r})
os.mkfifo("pipe")
os.symlink("loop", "loop")
skin = Path({str(SCENE.parent.parent / "skins" / "suas.toml")!r})
Path("skin.toml").write_bytes(skin.read_bytes())
Path("log.csv").write_text("t_host_s,t_device_s,seq,module,so_1\\n0,0,1,0,5\\n")
for special in {SPECIAL!r}:
    for ending in (".csv", ".nc", ".parquet"):
        Path("x" + ending).unlink(missing_ok=True)
        os.symlink(special, "x" + ending)
    for command in {COMMANDS!r}:
        arguments = [a.replace("{{}}.", "x.").replace("{{}}", special) for a in command]
        result = CliRunner().invoke(app, arguments)
        print(command, special, result.output)
        assert result.exit_code == 2, (command, result.output, result.exception)
        assert result.output.count("\\n") < 8, result.output
        assert not Path("out.csv").exists()
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr
