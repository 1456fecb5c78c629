"""The error of a data file that can't be used."""


class DataError(ValueError):
    """A data file can't be used; the message names file, line, column and what is allowed."""
