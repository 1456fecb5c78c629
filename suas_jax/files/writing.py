"""Output files: written whole or not at all, and never over another file unasked.

Every output goes to a hidden draft beside its place, is forced to the disk and moved there.
Whoever writes owns the place, a command from the check of its outputs to its end.
"""

import contextlib
import errno
import os
import secrets
import shutil
import stat
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from suas_jax.files.command import allow_replacing, is_input, may_replace, own_output
from suas_jax.files.ownership import is_special, owned, unwritten

_ABANDONED = 3600.0  # age of a draft whose process is taken to have ended [s]


def check_output(path: Path, *, overwrite: bool = False) -> None:
    """Make sure that a file may be written, before any work is done for it.

    An empty file may be; another where the user allows it (`overwrite`), here and when it is
    written.

    Raises FileExistsError: it exists, is not empty, and `overwrite` is not set. Raises
    OwnedError: another process writes it. Raises ValueError: it is an input of the command that
    runs, or can't be a file. Raises OSError: its folder is missing, or it is a directory.
    """
    if not path.name or "\0" in str(path):
        raise ValueError(f'"{path}": is not the name of a file')
    own_output(path)
    try:
        facts = os.stat(path)
    except FileNotFoundError:
        folder = Path(os.path.realpath(path)).parent
        if not folder.is_dir():
            raise FileNotFoundError(
                errno.ENOENT, f"there is no folder {path.parent}", str(path)
            ) from None
        if not os.access(folder, os.W_OK):
            raise PermissionError(
                errno.EACCES, "the folder can't be written to", str(path)
            ) from None
        return
    if stat.S_ISDIR(facts.st_mode):
        raise IsADirectoryError(errno.EISDIR, "is a directory; name a file", str(path))
    if not stat.S_ISREG(facts.st_mode):
        return  # a device or a pipe holds nothing
    if is_input(path):
        raise ValueError(f"{path}: is an input of this command; choose another name")
    if facts.st_size and not overwrite:
        raise FileExistsError(
            errno.EEXIST, "exists; choose another name or give --overwrite", str(path)
        )
    allow_replacing(path)


def check_outputs(paths: Iterable[Path | None], *, overwrite: bool = False) -> None:
    """`check_output` for all outputs of a command, which must be different files."""
    given = [path for path in paths if path is not None]
    for path in given:
        check_output(path, overwrite=overwrite)
    places = [os.path.realpath(path) for path in given if not is_special(path)]
    for path in given:
        if places.count(os.path.realpath(path)) > 1:
            raise ValueError(f"{path}: is named for two outputs; choose different names")


@contextlib.contextmanager
def written(path: Path) -> Iterator[Path]:
    """Write a file whole or not at all: yields an empty draft, which takes its place then.

    A command replaces only what `check_output` was told may be replaced. The draft is removed
    if the block raises. Raises OSError, ValueError: as `check_output`, or the disk is full.
    """
    overwrite = may_replace(path)
    check_output(path, overwrite=overwrite)
    if is_special(path):  # a device or a pipe can't be replaced
        yield path
        return
    with owned(path), drafted(path) as draft:
        yield draft
        _force_to_disk(draft)
        publish(draft, path, replace=overwrite)
        with contextlib.suppress(OSError):
            _force_to_disk(draft.parent)


@contextlib.contextmanager
def drafted(path: Path) -> Iterator[Path]:
    """An empty draft beside the place of a file, which is owned; removed in the end."""
    place = Path(os.path.realpath(path))
    _remove_drafts(place)
    draft = place.with_name(f"{_draft_prefix(place)}{secrets.token_hex()}.part")
    draft.touch(exist_ok=False)  # with the mode that the user's mask gives any new file
    try:
        yield draft
    finally:
        with contextlib.suppress(OSError):
            draft.unlink()


def publish(draft: Path, path: Path, *, replace: bool) -> None:
    """Move a draft from `drafted` to its place, in one step; `replace` one that isn't empty.

    Raises FileExistsError: there is one, and `replace` is not set. Raises OwnedError: another
    process writes the one that is there. Raises OSError: it can't be moved.
    """
    place = Path(os.path.realpath(path))
    with contextlib.suppress(FileNotFoundError):
        shutil.copymode(place, draft)
    moved = False
    while not moved:
        with unwritten(place) as there:
            if there and not replace and not _is_empty(place):
                raise FileExistsError(
                    errno.EEXIST, "was made by another program meanwhile", str(path)
                )
            if there:
                os.replace(draft, place)
            moved = there or _linked(draft, place)


def _linked(draft: Path, place: Path) -> bool:
    """Move to a name that no file has; False where one has it by now."""
    try:
        os.link(draft, place)
    except FileExistsError:
        return False
    except OSError:  # a file system without links
        os.replace(draft, place)
    return True


def write_bytes(path: Path, content: bytes) -> None:
    """Write bytes to a file, whole or not at all; see `written`."""
    with written(path) as draft, draft.open("wb") as stream:
        stream.write(content)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text to a file, whole or not at all; see `written`."""
    write_bytes(path, text.encode())


def _draft_prefix(place: Path) -> str:
    """How names of drafts begin; 40 characters of up to four bytes leave room for the rest."""
    return f".{place.name[:40]}."


def _remove_drafts(place: Path) -> None:
    """Remove what a killed process left over."""
    prefix = _draft_prefix(place)
    for entry in os.scandir(place.parent):
        if entry.name.startswith(prefix) and entry.name.endswith(".part"):
            with contextlib.suppress(OSError):
                if time.time() - entry.stat().st_mtime > _ABANDONED:
                    os.unlink(entry.path)


def _force_to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _is_empty(path: Path) -> bool:
    with contextlib.suppress(OSError):
        return not path.stat().st_size
    return False
