"""A file that takes whole lines alone, one writer at a time.

Where the disk is full as many lines as fit are kept. Where the file is deleted, moved or
replaced while it is written, all of it is copied beside its place, and the lines go on there.
"""

import contextlib
import errno
import itertools
import os
import re
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

from suas_jax.files.ownership import OwnedError, is_at, lock, open_alone, owned
from suas_jax.files.writing import drafted, publish

# What a disk answers that can't take more; a pipe or a network drive that can't be forced to
# the disk answers something else.
_LOST = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG)
_APPENDED = os.O_RDWR | os.O_APPEND
_PIECE = 1_000_000  # bytes that are copied at a time


class LineWriteError(OSError):
    """No more can be written: the disk is full or gone. Names the file."""


class LineFile:
    """A file that is open for appending; made by `create`, `reopen` or `open`."""

    def __init__(self, path: Path, descriptor: int) -> None:
        # files that the lines went on in, one after the other; a sentence says so when they do
        self.beside: tuple[Path, ...] = ()
        self.report: Callable[[str], None] = lambda sentence: None
        self._hold(path, descriptor)

    def _hold(self, path: Path, descriptor: int) -> None:
        self.path, self._descriptor = path, descriptor  # that takes the lines now
        self._place = Path(os.path.realpath(path))
        facts = os.fstat(descriptor)
        self.size = facts.st_size  # [bytes]
        self._placed = stat.S_ISREG(facts.st_mode)  # a pipe can't be lost

    @classmethod
    def create(cls, path: Path, text: str, *, overwrite: bool) -> Self:
        """Begin a file with some lines.

        Raises FileExistsError: there is one that isn't empty, and `overwrite` is not set.
        Raises OwnedError: another program is writing it. Raises OSError: it can't be written.
        """
        with owned(path):
            if path.exists() and not path.stat().st_size:
                flags = _APPENDED if path.is_file() else os.O_WRONLY | os.O_APPEND
                file = cls(path, open_alone(path, flags))
                try:
                    if not file.size:
                        file.append(text)
                        return file
                except OSError:
                    file.close()
                    raise
                file.close()
            if path.exists() and not overwrite:
                reason = "exists and is not empty; choose another name, or give --append or "
                raise FileExistsError(errno.EEXIST, f"{reason}--overwrite", str(path))
            return cls(path, _begun(path, text.encode(), replace=overwrite))

    @classmethod
    def reopen(cls, path: Path) -> Self:
        """Go on in a file that is there.

        Raises OwnedError: another program is writing it; OSError: it can't be opened.
        """
        return cls(path, open_alone(path, _APPENDED))

    @classmethod
    def open(cls, path: Path) -> Self:
        """Go on in a file, or begin it; what is not a whole line stays alone on its own.

        Raises OwnedError: another program is writing it; OSError: it can't be opened or
        written.
        """
        while True:
            with contextlib.suppress(FileExistsError):  # until a moment ago it was not there
                if not path.exists():
                    return cls.create(path, "", overwrite=False)
            with contextlib.suppress(FileNotFoundError):
                file = cls.reopen(path)
                if file.size and os.pread(file._descriptor, 1, file.size - 1) != b"\n":
                    file.append("\n")
                return file

    @property
    def closed(self) -> bool:
        """Whether it takes no more."""
        return self._descriptor < 0

    def cut(self, size: int) -> None:
        """Take out what follows the first `size` bytes."""
        os.ftruncate(self._descriptor, size)
        self.size = size

    def append(self, text: str) -> None:
        """Append whole lines; where the disk is full, as many as it takes.

        Raises LineWriteError: it takes no more.
        """
        data = text.encode()
        begin = 0
        try:
            while begin < len(data):
                begin += os.write(self._descriptor, data[begin:])
        except OSError as error:
            whole = data.rfind(b"\n", 0, begin) + 1
            with contextlib.suppress(OSError):  # a pipe or a device has no end to cut off
                now = os.fstat(self._descriptor).st_size
                os.ftruncate(self._descriptor, now - (begin - whole))
            self.size += whole
            raise self._failed(error) from None
        self.size += len(data)

    def sync(self) -> None:
        """Force what was appended to the disk, where that can be done.

        Where the file has lost its name, the lines go on beside it. Raises LineWriteError: the
        disk takes no more, or nothing can be written beside.
        """
        try:
            os.fsync(self._descriptor)
        except OSError as error:
            if error.errno in _LOST:  # pipes and some network drives can't
                raise self._failed(error) from None
        if self._placed and not is_at(self._descriptor, self._place):
            self._go_on_beside()

    def close(self) -> None:
        """Take no more, and let other writers in."""
        if not self.closed:
            os.close(self._descriptor)
            self._descriptor = -1

    def _go_on_beside(self) -> None:
        """Copy the file, which nobody can open by its name any more, and go on in the copy."""
        lost, stem = self.path, re.sub(r"\.beside[0-9]+$", "", self.path.stem)
        what = "replaced by another file" if self._place.exists() else "deleted or moved"
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            for number in itertools.count(len(self.beside) + 1):
                path = self.path.with_name(f"{stem}.beside{number}{self.path.suffix}")
                with contextlib.suppress(FileExistsError, OwnedError), owned(path):
                    descriptor = _begun(path, self._descriptor, replace=False)
                    break
        except OSError as error:
            reason = f"was {what}, and nothing can be written beside it ({error.strerror})"
            raise LineWriteError(error.errno, reason, str(lost)) from None
        os.close(self._descriptor)
        self._hold(path, descriptor)
        self.beside += (path,)
        self.report(f"{lost}: was {what} while it was written; all of it is in {path} now")

    def _failed(self, error: OSError) -> LineWriteError:
        return LineWriteError(error.errno, error.strerror, str(self.path))


def _begun(path: Path, content: bytes | int, *, replace: bool) -> int:
    """Descriptor of a file that appears with its first content, and locked.

    The content may be the descriptor of a file that has it; `replace` one that isn't empty.
    """
    with drafted(path) as draft:
        descriptor = os.open(draft, _APPENDED)
        try:
            lock(descriptor, path)
            pieces = [content] if isinstance(content, bytes) else _pieces(content)
            for piece in pieces:
                while piece:
                    piece = piece[os.write(descriptor, piece) :]
            if replace or isinstance(content, int):  # before what it stands for has gone
                os.fsync(descriptor)
            publish(draft, path, replace=replace)
        except OSError as error:
            os.close(descriptor)
            if error.errno in _LOST:
                raise LineWriteError(error.errno, error.strerror, str(path)) from None
            raise
    return descriptor


def _pieces(descriptor: int) -> Iterator[bytes]:
    begin = 0
    while piece := os.pread(descriptor, _PIECE, begin):
        yield piece
        begin += len(piece)
