"""A file that takes whole lines alone, one writer at a time.

Lines are appended. Where the disk is full as many as fit are kept, and none is cut in two; the
file is locked against other writers, and a file that is replaced stays until the new one has
begun. What the lines say is the business of `writer`.
"""

import contextlib
import errno
import os
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# What a disk answers that can't take more; a pipe or a network drive that can't be forced to
# the disk answers something else.
_LOST = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG)


class LogWriteError(OSError):
    """The log can't be written any more: the disk is full or gone. Names the file."""


class LineFile:
    """A file that is open for appending.

    Args:
        path: named in messages.
        place: the file itself; a draft while it replaces another one.
        flags: of `os.open`, beside those for appending.

    Attributes:
        size: of the file [bytes].
    """

    def __init__(self, path: Path, place: Path, flags: int = 0) -> None:
        self.size = 0
        self._path = path
        self._descriptor = os.open(place, os.O_WRONLY | os.O_APPEND | flags, 0o666)

    @classmethod
    def create(cls, path: Path, text: str, *, overwrite: bool) -> "LineFile":
        """Begin a file with some lines.

        Args:
            path: file to create; an empty one may be there.
            text: the lines.
            overwrite: replace a file that isn't empty.

        Raises:
            FileExistsError: there is one, and `overwrite` is not set.
            OSError: it can't be written, or another program is writing it.
        """
        try:
            occupied = path.stat().st_size > 0
        except FileNotFoundError:
            occupied = False
        if occupied and not overwrite:
            raise FileExistsError(
                f"{path}: exists and is not empty; logs are never overwritten unasked, "
                "choose another name, or give --append or --overwrite"
            )
        # What is replaced stays until the new log has begun.
        place = path if not occupied else path.with_name(f".{path.name}.part")
        file = cls(path, place, os.O_CREAT | (os.O_TRUNC if occupied else 0))
        try:
            file._lock()
            file.append(text)
            if occupied:
                os.fsync(file._descriptor)
                os.replace(place, path)
        except LogWriteError:
            file.close()
            with contextlib.suppress(OSError):
                place.unlink()
            raise
        except OSError:
            file.close()
            raise
        return file

    @classmethod
    def reopen(cls, path: Path, size: int, text: str, *, cut: bool) -> "LineFile":
        """Go on in a file.

        Args:
            path: the file.
            size: of its whole lines [bytes].
            text: lines to go on with.
            cut: whether something that is no whole line follows them; it is taken out.

        Raises:
            OSError: it can't be written, or another program is writing it.
        """
        file = cls(path, path)
        try:
            file._lock()
            if cut:
                os.ftruncate(file._descriptor, size)
            file.size = size
            file.append(text)
        except OSError:
            file.close()
            raise
        return file

    @property
    def closed(self) -> bool:
        """Whether it takes no more."""
        return self._descriptor < 0

    def append(self, text: str) -> None:
        """Append whole lines; where the disk is full, as many as it takes.

        Raises:
            LogWriteError: it takes no more.
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

    def sync(self) -> bool:
        """Force what was appended to the disk; False where that can't be done.

        Raises:
            LogWriteError: the disk takes no more.
        """
        try:
            os.fsync(self._descriptor)
        except OSError as error:
            if error.errno in _LOST:
                raise self._failed(error) from None
            return False  # pipes and some network drives can't
        return True

    def finish(self, line: str) -> None:
        """Append a last line, force it to the disk and close the file.

        Raises:
            OSError: the line can't be written.
        """
        try:
            os.write(self._descriptor, line.encode())
            os.fsync(self._descriptor)
        finally:
            self.close()

    def close(self) -> None:
        """Take no more, and let other writers in."""
        if not self.closed:
            os.close(self._descriptor)
            self._descriptor = -1

    def _lock(self) -> None:
        """Keep other loggers out of the file."""
        if fcntl is None:
            return
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            reason = "another program is writing this log; choose another name"
            raise OSError(errno.EBUSY, reason, str(self._path)) from None
        except OSError:  # a file system without locks
            return

    def _failed(self, error: OSError) -> LogWriteError:
        return LogWriteError(error.errno, error.strerror, str(self._path))
