"""A private folder of bytes by name that can be made again at any time.

An entry counts only if this user wrote it: each carries a message authentication code (keyed
BLAKE2b, RFC 7693) whose key lies in a private file elsewhere. Nothing here ever raises because
of what is on the disk: a cache that can't be used costs time.
"""

import atexit
import contextlib
import hashlib
import hmac
import io
import os
import re
import secrets
import stat
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
from numpy.typing import NDArray

from suas_jax.files.ownership import LOCKS, lock, owned

_CODE = 32  # bytes of an authentication code, and of the key
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_ABANDONED = 3600.0  # a draft older than this is left over from a process that ended [s]
_DRAFT, _MARKER = ".draft-", ".loading-"
DEFAULT_SIZE = 500_000_000


class CacheFolder:
    """Entries of bytes by name, the least recently used of which go first.

    While entries are loaded that could crash the process (compiled programs), a marker names
    them; `settled` takes it back. The next process that finds the marker of one that ended
    discards what it names, so nothing crashes twice.

    `folder`: where the entries lie; made with mode 0700 when first needed. `most_bytes`: size
    of all entries together. `key_file`: file of the authentication key; made with mode 0600
    when first needed. By default in the user's state folder, apart from every cache.
    """

    def __init__(
        self, folder: Path, *, most_bytes: int = DEFAULT_SIZE, key_file: Path | None = None
    ) -> None:
        self._folder = folder
        self._most_bytes = most_bytes
        self._key_file = key_file or platformdirs.user_state_path("suas_jax") / "cache.key"
        self._key: bytes | None = None
        self._refusal: str | None = None
        self._marker: tuple[int, Path, int] | None = None  # descriptor, file, process
        self._room = 0  # bytes to write before the folder is looked through again

    @property
    def refusal(self) -> str | None:
        """Why the folder is not used, or None where it is."""
        self._open()
        return self._refusal

    def get(self, name: str) -> bytes | None:
        """An entry that this user wrote, or None."""
        if not self._open():
            return None
        file = self._file(name)
        try:
            content = read_private(file, self._most_bytes + _CODE)
        except OSError:
            return None
        code, content = content[:_CODE], content[_CODE:]
        if not hmac.compare_digest(code, self._code(name, content)):
            self.discard(name)
            return None
        self._mark(name)
        with contextlib.suppress(OSError):
            os.utime(file)
        return content

    def put(self, name: str, content: bytes) -> None:
        """Keep an entry; the oldest ones go where it would not fit."""
        if len(content) + _CODE > self._most_bytes or not self._open():
            return
        try:
            handle, draft = tempfile.mkstemp(prefix=_DRAFT, dir=self._folder)
            with os.fdopen(handle, "wb") as stream:
                stream.write(self._code(name, content))
                stream.write(content)
            os.replace(draft, self._file(name))
            self._room -= len(content) + _CODE
            if self._room < 0:
                self._tidy()
        except OSError:
            return

    @contextlib.contextmanager
    def making(self, name: str, wait: Callable[[str], None]) -> Iterator[None]:
        """Be the only process that makes an entry; `wait` is told who makes it instead."""
        with owned(self._file(name), wait=wait) if self._open() else contextlib.nullcontext():
            yield

    def discard(self, name: str) -> None:
        """Remove an entry."""
        with contextlib.suppress(OSError):
            self._file(name).unlink()

    def settled(self) -> None:
        """Say that everything loaded so far works."""
        if self._marker is None:
            return
        descriptor, file, process = self._marker
        self._marker = None
        with contextlib.suppress(OSError):
            os.close(descriptor)
            if process == os.getpid():  # a forked child has the marker of its parent
                file.unlink()

    def _file(self, name: str) -> Path:
        """Names that are not plain file names are replaced by their digest."""
        if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,180}", name):
            name = hashlib.sha256(name.encode()).hexdigest()
        return self._folder / f"{name}.kept"

    def _code(self, name: str, content: bytes) -> bytes:
        assert self._key is not None
        code = hashlib.blake2b(key=self._key, digest_size=_CODE)
        code.update(f"{name}\0".encode())
        code.update(content)
        return code.digest()

    def _open(self) -> bool:
        """Make or check folder and key, once."""
        if self._key is not None or self._refusal is not None:
            return self._refusal is None
        try:
            _private_folder(self._folder)
            _private_folder(self._key_file.parent)
            self._key = _key_of(self._key_file)
            self._discard_crashed()
        except OSError as error:
            self._refusal = f"{error.filename or self._folder}: {error.strerror or error}"
        return self._refusal is None

    def _tidy(self) -> None:
        """Remove what is over the size limit, and drafts of processes that ended."""
        kept, total = [], 0
        for entry in os.scandir(self._folder):
            with contextlib.suppress(OSError):
                facts = entry.stat(follow_symlinks=False)
                if entry.name.startswith(_DRAFT):
                    if time.time() - facts.st_mtime > _ABANDONED:
                        os.unlink(entry.path)
                elif not entry.name.startswith("."):
                    kept.append((facts.st_mtime, facts.st_size, entry.path))
                    total += facts.st_size
        for _, size, path in sorted(kept):
            if total <= self._most_bytes:
                break
            with contextlib.suppress(OSError):
                os.unlink(path)
            total -= size
        # Other processes write as well: half of what is left, for each of two.
        self._room = (self._most_bytes - total) // 2

    def _mark(self, name: str) -> None:
        """Name an entry in this process's marker."""
        if not LOCKS:  # a crash is not told from a running process
            return
        with contextlib.suppress(OSError):
            if self._marker is None:
                descriptor, path = tempfile.mkstemp(prefix=_MARKER, dir=self._folder)
                lock(descriptor, Path(path))
                self._marker = descriptor, Path(path), os.getpid()
                atexit.register(self.settled)
            os.write(self._marker[0], f"{self._file(name).name}\n".encode())

    def _discard_crashed(self) -> None:
        """Discard what a process was loading when it ended without a word."""
        for marker in self._folder.glob(f"{_MARKER}*"):
            with contextlib.suppress(OSError), marker.open("rb") as stream:
                if not lock(stream.fileno(), marker):  # taken where its process has ended
                    continue
                for line in stream.read(1_000_000).decode("ascii", "replace").splitlines():
                    if re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*\.kept", line):
                        (self._folder / line).unlink(missing_ok=True)
                marker.unlink()


def read_private(file: Path, most_bytes: int) -> bytes:
    """The bytes of a regular file of this user's that nobody else can write.

    Raises OSError: it is anything else, or larger.
    """
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with open(file, "rb", opener=lambda path, _: os.open(path, flags)) as stream:
        facts = os.fstat(stream.fileno())
        if not stat.S_ISREG(facts.st_mode) or facts.st_size > most_bytes:
            raise OSError(0, "is not a regular file of the expected size", str(file))
        _refuse_foreign(file, facts)
        return stream.read(most_bytes)


def _private_folder(folder: Path) -> None:
    """Make a folder with mode 0700, or check that it is this user's alone."""
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    facts = os.lstat(folder)
    if not stat.S_ISDIR(facts.st_mode):
        raise NotADirectoryError(0, "is not a folder", str(folder))
    _refuse_foreign(folder, facts)


def _refuse_foreign(path: Path, facts: os.stat_result) -> None:
    if hasattr(os, "geteuid") and facts.st_uid != os.geteuid():
        raise PermissionError(0, "belongs to another user", str(path))
    if hasattr(os, "geteuid") and facts.st_mode & _OTHERS_WRITE:
        raise PermissionError(
            0, f"other users can write to it; chmod go-w {path}, after a look at it", str(path)
        )


def _key_of(file: Path) -> bytes:
    """Read the key, or make one that no other process can have replaced meanwhile."""
    try:
        key = read_private(file, _CODE)
        if len(key) == _CODE:
            return key
        file.unlink()
    except FileNotFoundError:
        pass
    handle, draft = tempfile.mkstemp(prefix=_DRAFT, dir=file.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(secrets.token_bytes(_CODE))
        with contextlib.suppress(FileExistsError):  # another process was first
            os.link(draft, file)
    finally:
        os.unlink(draft)
    return read_private(file, _CODE)


Arrays = Mapping[str, NDArray[Any]]


def kept_arrays(
    name: str, compute: Callable[[], Mapping[str, Any]], folder: CacheFolder | None = None
) -> Arrays:
    """Arrays from a folder of the user's cache, computed where they are not there.

    `name` is a digest of all that they depend on. Where another process computes the same, its
    end is waited for, and a warning says so. A cache that can't be used costs time, never a
    result.
    """
    kept = folder or CacheFolder(platformdirs.user_cache_path("suas_jax") / "tables")
    found = kept.get(name)
    if found is None:
        with kept.making(name, _warn):
            found = kept.get(name)  # another process may have been first
            if found is None:
                stream = io.BytesIO()
                np.savez(stream, **compute())
                found = stream.getvalue()
                kept.put(name, found)
    with np.load(io.BytesIO(found)) as data:
        arrays = dict(data)
    kept.settled()  # arrays crash nobody: the next process need not distrust them
    return arrays


def _warn(process: str) -> None:
    warnings.warn(f"waiting for {process}, which computes the same table", stacklevel=2)
