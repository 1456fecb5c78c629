"""A cache folder loads what this user put there, whole, and nothing else."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from suas_jax.files.cache_folder import CacheFolder

CONTENT = bytes(range(256)) * 3


def folder_in(path: Path, most_bytes: int = 10_000) -> CacheFolder:
    """As another process would open it."""
    return CacheFolder(path / "kept", most_bytes=most_bytes, key_file=path / "state" / "key")


def entry(path: Path) -> Path:
    (file,) = (path / "kept").glob("*.kept")
    return file


def test_an_entry_comes_back(tmp_path: Path) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    assert folder_in(tmp_path).get("a") == CONTENT
    assert folder_in(tmp_path).get("b") is None


def test_folder_key_and_entries_are_the_user_s_alone(tmp_path: Path) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    modes = [(tmp_path / name).stat().st_mode & 0o777 for name in ("kept", "state")]
    assert modes == [0o700, 0o700]
    assert (tmp_path / "state" / "key").stat().st_mode & 0o777 == 0o600
    assert entry(tmp_path).stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("name", ["../outside", "a/b", "", ".hidden", "x" * 5000, "a\0b"])
def test_no_name_leaves_the_folder(tmp_path: Path, name: str) -> None:
    folder = folder_in(tmp_path)
    folder.put(name, CONTENT)
    assert folder.get(name) == CONTENT
    assert entry(tmp_path).parent == tmp_path / "kept"


def test_a_flipped_bit_anywhere_is_no_entry(tmp_path: Path) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    file = entry(tmp_path)
    whole = file.read_bytes()
    for position in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[position // 8] ^= 1 << position % 8
        file.write_bytes(damaged)
        folder = folder_in(tmp_path)
        assert folder.get("a") is None
        assert not file.exists()


@pytest.mark.parametrize("length", [0, 1, 31, 32, 33, 799])
def test_a_cut_off_file_is_no_entry(tmp_path: Path, length: int) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    os.truncate(entry(tmp_path), length)
    assert folder_in(tmp_path).get("a") is None


def test_an_entry_can_t_stand_in_for_another(tmp_path: Path) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    file = entry(tmp_path)
    file.rename(file.with_name("b.kept"))
    assert folder_in(tmp_path).get("b") is None


def test_what_another_key_wrote_is_no_entry(tmp_path: Path) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    (tmp_path / "state" / "key").unlink()
    assert folder_in(tmp_path).get("a") is None


@pytest.mark.parametrize("place", ["kept", "state", "state/key"])
def test_what_others_can_write_is_refused(tmp_path: Path, place: str) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    os.chmod(tmp_path / place, 0o777)
    folder = folder_in(tmp_path)
    assert folder.get("a") is None
    assert "other users can write to it" in str(folder.refusal)
    folder.put("b", CONTENT)
    assert len(list((tmp_path / "kept").glob("*.kept"))) == 1


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
@pytest.mark.parametrize("place", ["kept", "state", "state/key"])
def test_what_belongs_to_another_user_is_refused(tmp_path: Path, place: str) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    os.chown(tmp_path / place, 12345, -1)
    folder = folder_in(tmp_path)
    assert folder.get("a") is None
    assert "belongs to another user" in str(folder.refusal)


def test_links_and_special_files_are_no_entries(tmp_path: Path) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    file = entry(tmp_path)
    moved = file.rename(tmp_path / "elsewhere")
    file.symlink_to(moved)
    assert folder_in(tmp_path).get("a") is None
    file.unlink()
    os.mkfifo(file)
    assert folder_in(tmp_path).get("a") is None  # and doesn't wait for a writer
    (tmp_path / "kept").rename(tmp_path / "real")
    (tmp_path / "kept").symlink_to(tmp_path / "real")
    assert folder_in(tmp_path).refusal is not None


def test_the_least_recently_used_go_first(tmp_path: Path) -> None:
    folder = folder_in(tmp_path, most_bytes=4 * (len(CONTENT) + 32))
    for i, name in enumerate("abcd"):
        folder.put(name, CONTENT)
        os.utime(tmp_path / "kept" / f"{name}.kept", (i, i))
    assert folder.get("a") == CONTENT  # used just now
    folder.put("e", CONTENT)
    assert [name for name in "abcde" if folder.get(name)] == ["a", "c", "d", "e"]
    folder.put("f", bytes(10 * len(CONTENT)))  # larger than all that may lie there
    assert folder.get("f") is None
    assert folder.get("e") == CONTENT


def test_a_folder_with_room_is_looked_through_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Programs come in thousands; two processes that don't look keep to the limit."""
    looks, scandir, size = [], os.scandir, len(CONTENT) + 32
    pair = [folder_in(tmp_path, most_bytes=20 * size) for _ in range(2)]
    assert [folder.refusal for folder in pair] == [None, None]

    def counted(path: Path) -> object:
        looks.append(path)
        return scandir(path)

    monkeypatch.setattr(os, "scandir", counted)
    for k in range(8):
        for name, folder in zip("ab", pair, strict=True):
            folder.put(f"{name}{k}", CONTENT)
    assert len(looks) == 2
    for k in range(8, 40):
        for name, folder in zip("ab", pair, strict=True):
            folder.put(f"{name}{k}", CONTENT)
            assert len(list((tmp_path / "kept").glob("*.kept"))) <= 20


def test_drafts_left_over_are_removed(tmp_path: Path) -> None:
    folder_in(tmp_path).put("a", CONTENT)
    left, fresh = tmp_path / "kept" / ".draft-x", tmp_path / "kept" / ".draft-y"
    for draft in (left, fresh):
        draft.write_bytes(CONTENT)
    os.utime(left, (0, time.time() - 4000))
    folder_in(tmp_path).put("b", CONTENT)
    assert (left.exists(), fresh.exists()) == (False, True)


@pytest.mark.parametrize("crash", [True, False])
def test_what_crashed_a_process_is_discarded(tmp_path: Path, crash: bool) -> None:
    """`bad` is being loaded when the process dies; `good` had settled before."""
    for name in ("good", "bad"):
        folder_in(tmp_path).put(name, CONTENT)
    program = (
        "import os, signal, sys; from pathlib import Path;"
        "from suas_jax.files.cache_folder import CacheFolder;"
        f"f = CacheFolder(Path({str(tmp_path / 'kept')!r}),"
        f" key_file=Path({str(tmp_path / 'state' / 'key')!r}));"
        "f.get('good'); f.settled(); f.get('bad');"
        f"{'os.kill(os.getpid(), signal.SIGSEGV)' if crash else 'pass'}"
    )
    # No core file of the crash.
    done = subprocess.run(
        ["bash", "-c", 'ulimit -c 0; exec "$@"', "_", sys.executable, "-c", program]
    )
    assert done.returncode == (-signal.SIGSEGV if crash else 0)
    folder = folder_in(tmp_path)
    assert folder.get("good") == CONTENT
    assert folder.get("bad") == (None if crash else CONTENT)


def test_what_a_running_process_loads_is_left_alone(tmp_path: Path) -> None:
    folder = folder_in(tmp_path)
    folder.put("a", CONTENT)
    assert folder.get("a") == CONTENT
    other = folder_in(tmp_path)
    assert other.get("a") == CONTENT
    folder.settled()
    other.settled()
    assert not list((tmp_path / "kept").glob(".loading-*"))


def test_a_disk_that_can_t_be_used_costs_nothing_but_time(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    folder = CacheFolder(tmp_path / "file" / "kept", key_file=tmp_path / "key")
    folder.put("a", CONTENT)
    assert folder.get("a") is None
    assert folder.refusal is not None
