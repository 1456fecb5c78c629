"""Bounded reading: regular files only, of a size that can be worked with."""

import contextlib
import csv
import errno
import hashlib
import os
import stat
from collections.abc import Iterator
from typing import BinaryIO

from suas_jax.files.command import remember_input

MEGABYTE = 1_000_000
_KINDS = {
    stat.S_IFCHR: "a character device",
    stat.S_IFBLK: "a block device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFDIR: "a directory",
}


@contextlib.contextmanager
def opened(
    path: str | os.PathLike[str], most_bytes: int, *, remember: bool = True
) -> Iterator[BinaryIO]:
    """Open a regular file, or a link to one, for reading, without ever waiting for it.

    `most_bytes`: the size that is still read. `remember`: it is an input of the command that
    runs, which no output may replace.
    Raises OSError: it can't be opened, is not a regular file, or is larger.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
    name = os.fspath(path)
    with open(name, "rb", opener=lambda file, _: os.open(file, flags)) as stream:
        facts = os.fstat(stream.fileno())
        if not stat.S_ISREG(facts.st_mode):
            kind = _KINDS.get(stat.S_IFMT(facts.st_mode), "a special file")
            raise OSError(errno.EINVAL, f"is {kind}; a regular file is needed", name)
        if facts.st_size > most_bytes:
            raise OSError(errno.EFBIG, _too_large(facts.st_size, most_bytes), name)
        if remember:
            remember_input(facts)
        yield stream


def read_bytes(
    path: str | os.PathLike[str], most_bytes: int, *, remember: bool = True
) -> bytes:
    """The content of a regular file; arguments and errors are those of `opened`."""
    with opened(path, most_bytes, remember=remember) as stream:
        content = stream.read(most_bytes + 1)
    if len(content) > most_bytes:  # it grew meanwhile, or its file system doesn't say
        raise OSError(errno.EFBIG, _too_large(len(content), most_bytes), os.fspath(path))
    return content


def sha256_of(path: str | os.PathLike[str], most_bytes: int) -> str:
    """Digest of a file, read as by `read_bytes`."""
    return hashlib.sha256(read_bytes(path, most_bytes)).hexdigest()


def check_readable(
    path: str | os.PathLike[str], most_bytes: int, *, remember: bool = True
) -> None:
    """Refuse what a library is about to open by its name; see `opened`."""
    with opened(path, most_bytes, remember=remember):
        pass


def split_fields(line: str, delimiter: str = ",", *, strict: bool = False) -> list[str]:
    """The fields of one line of a table, without the quotes around them.

    Raises ValueError: `strict` refuses quotes that don't end, or end inside a field.
    """
    if '"' not in line:
        return line.split(delimiter)
    csv.field_size_limit(max(csv.field_size_limit(), len(line)))
    try:
        return next(csv.reader([line], delimiter=delimiter, strict=strict))
    except csv.Error as error:
        raise ValueError(f"quotes: {error}") from None


def _too_large(size: int, most_bytes: int) -> str:
    return f"has {size / MEGABYTE:.1f} MB; at most {most_bytes / MEGABYTE:.0f} MB are read"
