"""Who writes a file: locks that a second program sees, and that end with their process.

A name is owned through a hidden file beside it: the file itself may not be there yet, or be
replaced. One that is written in place is locked as well, whatever its other names. Where a
system knows no locks, nothing is owned, and nothing fails.
"""

import contextlib
import errno
import hashlib
import os
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LOCKS = fcntl is not None
"""Whether this system knows locks that end with their process."""
_LONGEST_NAME = 240  # bytes; a hidden file's name has some more than its file's
_SAFELY = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


class OwnedError(OSError):
    """Another process writes the file: names the file and the process."""


class _Owned(threading.local):
    """Names that this thread owns already."""

    def __init__(self) -> None:
        self.places: set[str] = set()


_owned = _Owned()


@contextlib.contextmanager
def owned(path: Path, *, wait: Callable[[str], None] | None = None) -> Iterator[None]:
    """Own a name, whether or not it has a file, inside: who else would write there is refused.

    Another owner's end is waited for where `wait` is given, which is called with its name; else
    this raises OwnedError, as where another process writes the file. A pipe has no owner.
    """
    place = os.path.realpath(path)
    if place in _owned.places or is_special(place):
        yield
        return
    hidden = _lock_file(place)
    descriptor = None
    try:
        descriptor = _locked_at(hidden, os.O_CREAT | _SAFELY, path, wait)
    except OwnedError:
        raise
    except OSError:
        pass  # where no file can be made, whoever writes one finds out, and says so
    _owned.places.add(place)
    try:
        with unwritten(path):
            pass
        yield
    finally:
        _owned.places.discard(place)
        if descriptor is not None:
            with contextlib.suppress(OSError):
                if is_at(descriptor, hidden):
                    os.unlink(hidden)
            os.close(descriptor)


@contextlib.contextmanager
def unwritten(path: Path) -> Iterator[bool]:
    """Keep writers in place out of the file that a name has now; yields whether it has one.

    Readers that lock what they read, as HDF5 does, are not in the way. Raises OwnedError:
    another process writes it.
    """
    descriptor, there = None, True
    try:
        descriptor = _locked_at(str(path), getattr(os, "O_NONBLOCK", 0), path, shared=True)
    except FileNotFoundError:
        there = False
    except OwnedError:
        raise
    except OSError:
        pass  # what can't be opened is not written either, as far as can be seen
    try:
        yield there
    finally:
        if descriptor is not None:
            os.close(descriptor)


def open_alone(path: Path, flags: int) -> int:
    """Open the file that a name has now, for its only writer; the descriptor.

    Raises OwnedError: another process writes it; OSError: it can't be opened.
    """
    return _locked_at(str(path), flags, path)


def lock(descriptor: int, path: Path, *, shared: bool = False) -> bool:
    """Lock an open file until its descriptor is closed; False where there are no locks.

    A `shared` lock keeps writers out, not those who do the same; the path is for messages.
    Raises OwnedError: another process has it locked.
    """
    if not LOCKS:
        return False
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        reason = f"{_holder(descriptor)} is writing it; choose another name, or wait"
        raise OwnedError(errno.EBUSY, reason, str(path)) from None
    except OSError:  # a file system without locks
        return False
    return True


def is_at(descriptor: int, path: str | Path) -> bool:
    """Whether an open file still has its name: it was not deleted, moved or replaced."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except (FileNotFoundError, NotADirectoryError):
        return False


def _locked_at(
    file: str,
    flags: int,
    path: Path,
    wait: Callable[[str], None] | None = None,
    *,
    shared: bool = False,
) -> int:
    """Open a file and lock it; once it is locked, its name must still be its own."""
    while True:
        descriptor = _opened(file, flags)
        try:
            try:
                lock(descriptor, path, shared=shared)
            except OwnedError:
                if wait is None:
                    raise
                wait(_holder(descriptor))
                fcntl.flock(descriptor, fcntl.LOCK_EX)
            if is_at(descriptor, file):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _opened(file: str, flags: int) -> int:
    """For writing, as network drives lock no other files; for reading where that is refused."""
    if flags & os.O_WRONLY:
        return os.open(file, flags)
    try:
        return os.open(file, os.O_RDWR | flags, 0o666)
    except PermissionError:
        return os.open(file, os.O_RDONLY | flags & ~(os.O_CREAT | os.O_APPEND))


def _lock_file(place: str) -> str:
    folder, name = os.path.split(place)
    if len(os.fsencode(name)) > _LONGEST_NAME:
        name = hashlib.sha256(os.fsencode(name)).hexdigest()
    return os.path.join(folder, f".{name}.lock")


def is_special(place: str | Path) -> bool:
    """Whether it is there and no regular file: a device, a pipe, a folder."""
    with contextlib.suppress(OSError, ValueError):
        return not stat.S_ISREG(os.stat(place).st_mode)
    return False


def _holder(descriptor: int) -> str:
    """The process that has a file locked, where the system tells it."""
    inode = os.fstat(descriptor).st_ino
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            # 3: FLOCK  ADVISORY  WRITE 4711 fe:00:131 0 EOF
            _, kind, _, _, process, file, *_ = line.split()
            if kind == "FLOCK" and file.endswith(f":{inode}"):
                return f"process {process}"
    return "another program"
