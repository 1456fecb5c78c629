"""The error of a data file that can't be used."""

import contextlib
from collections.abc import Iterator


class DataError(ValueError):
    """A data file can't be used; the message names file, line, column and what is allowed."""


@contextlib.contextmanager
def said_of(where: str) -> Iterator[None]:
    """Errors of a value inside, as those of the place in a file where it stands."""
    try:
        yield
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None
